r"""Where a contact ends within a facet, for what acts on the area that touches: film, and area.

With averaged pressure a facet between a vertex A that carries pressure and one B that does not has
pressure on all of its length; the bodies part somewhere in between. Gaps of the points do not tell
where, for a straight facet opens as a whole. Pressure inside and gap outside do: beside the end of
a contact of smooth bodies, at the distance d,

.. math:: p = k \sqrt{d} \ \text{inside}, \qquad g = \frac{4 k}{3 E^*} d^{3/2} \ \text{outside}

(K. L. Johnson, Contact Mechanics, 1985, the limits of Hertz's p and of his gap; E* is the modulus
of both bodies together, :math:`1/E^* = \sum (1-\nu)/2G`). With k such that both distances add up
to the length h of the facet, the vertices get signed distances :math:`\varphi` from the end,

.. math:: \varphi_A = s_A^2 \kappa^3, \quad \varphi_B = -(\tfrac34 E^* g_B)^{2/3} \kappa, \quad
   s_A^2 \kappa^3 + (\tfrac34 E^* g_B)^{2/3} \kappa = h, \quad \kappa = k^{-2/3}

(where more vertices are open or closed, the largest g_B and s_A), and a point that stands for a
piece of the facet of length l is covered by
:math:`\chi = \langle \tfrac12 + (\varphi + c h)/l \rangle`, at most 1. In space h is the facet's
length along the slope :math:`\gamma` of its gaps, across the end: with its corners' second moments
w and their principal axes :math:`h^2 \propto \sum w_a \gamma_a^2 / \sum \gamma_a^2`, the sides of
a rectangle, and of the same mean as the root of the area.

The nodal values are means over the facets beside them, and elements are too stiff beside the end:
without c contacts end early by 0.16 h on each side, measured on round tools over rubber for all
meshes, Poisson's ratios and penalties (0.13 to 0.20; docs/verification.md). A facet cannot be more
than covered, so that c is a little more.
"""

from __future__ import annotations

import numpy as np

from tribox.forms.contact.state import NormalContact
from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.surface import ContactSurface

_EARLY = 0.175  # c
_NEWTON = 60  # at most; the cubic is monotone and convex


def rim_cover(
    surface: ContactSurface,
    normal: NormalContact,
    stiffness: Floats,
    modulus: float | None,
) -> tuple[Floats, Floats | None]:
    """Covered share χ (q,) of each point, and ∂χ/∂g (q, k), 1/m, for the gaps of its vertices.

    Args:
        surface: the pair's surfaces.
        normal: averaged normal contact; point by point all is covered.
        stiffness: (v,), Pa/m, of the vertices.
        modulus: Pa, E*; None: facets at the rim count whole.

    Returns:
        χ and its derivatives; None for these where all are zero.
    """
    cover = np.ones(len(normal.pressure))
    if normal.active is None or normal.gap is None or modulus is None:
        return cover, None
    vertices = surface.vertices
    active = normal.active[vertices.of_point]
    at = np.nonzero(normal.closed & ~active.all(axis=1))[0]
    if not len(at):
        return cover, None
    inside, number = active[at], vertices.of_point[at]
    gap = normal.gap[number]
    size, d_size = facet_length_along(surface, at, gap)
    piece = surface.slave.facet_share[at] ** (1.0 / surface.shape.directions)  # over the length
    distance, d_distance = _distances(gap, stiffness[number], inside, size, d_size, modulus)
    shape = vertices.shape[at]
    part = np.einsum("pk,pk->p", shape, distance) / size
    share = 0.5 + (part + _EARLY) / piece
    cover[at] = np.clip(share, 0.0, 1.0)
    slope = np.zeros((len(cover), active.shape[1]))
    within = (share > 0.0) & (share < 1.0)
    change = np.einsum("pk,pkl->pl", shape, d_distance) - part[:, None] * d_size
    slope[at] = np.where(within[:, None], change / (size * piece)[:, None], 0.0)
    return cover, slope


def facet_length_along(
    surface: ContactSurface, at: Longs | Bools, gap: Floats
) -> tuple[Floats, Floats]:
    """Length (p,), m, of the facets of points along the slope of what changes on them.

    Args:
        at: which points of the surface.
        gap: (p, k) what changes, at the vertices of their facets.

    Returns:
        The length, and its derivatives (p, k) by ``gap``; in the plane it does not change.
    """
    length = surface.slave.facet_length[at]
    if surface.dim < 3:
        return length, np.zeros_like(gap)
    return _along_slope(surface.vertices.position[surface.vertices.of_point[at]], gap, length)


def _along_slope(corners: Floats, gap: Floats, mean: Floats) -> tuple[Floats, Floats]:
    """The same of facets in space.

    Args:
        corners: (p, k, i), m, reference.
        gap: (p, k) what changes, there.
        mean: (p,), m, the length where it is the same in all directions, or there is no slope.
    """
    away = corners - corners.mean(axis=1, keepdims=True)
    moments, axes = np.linalg.eigh(np.einsum("pki,pkj->pij", away, away))
    moments = moments[:, 1:]  # the first is across the facet
    by_gap = np.einsum("pki,pia->pka", away, axes[:, :, 1:]) / moments[:, None, :]
    slope = np.einsum("pka,pk->pa", by_gap, gap)
    spread = np.sqrt(moments.prod(axis=1))
    weight = moments * (mean**2 / spread)[:, None]
    # What no slope explains, of a saddle, has no direction.
    rest = gap - gap.mean(axis=1, keepdims=True)
    rest -= np.einsum("pka,pa->pk", by_gap, moments * slope)
    twist = np.einsum("pk,pk->p", rest, rest) / spread
    total = np.einsum("pa,pa->p", slope, slope) + twist
    known = total > 0.0
    total = np.where(known, total, 1.0)
    squared = (np.einsum("pa,pa->p", weight, slope**2) + mean**2 * twist) / total
    length = np.sqrt(np.where(known, squared, mean**2))
    change = np.einsum("pa,pka->pk", (weight - squared[:, None]) * slope, by_gap)
    change += ((mean**2 - squared) / spread)[:, None] * rest
    return length, np.where(known[:, None], change / (length * total)[:, None], 0.0)


def _distances(
    gap: Floats, stiffness: Floats, inside: Bools, size: Floats, d_size: Floats, modulus: float
) -> tuple[Floats, Floats]:
    """Signed distances φ (p, k), m, of vertices with mean gaps (p, k), and ∂φ_k/∂g_l (p, k, l)."""
    rows = np.arange(len(gap))
    pressure = np.where(inside, np.maximum(-stiffness * gap, 0.0), 0.0)
    opening = np.where(inside, 0.0, np.maximum(gap, 0.0))
    deepest, widest = np.argmax(pressure, axis=1), np.argmax(opening, axis=1)
    squared = pressure**2
    root = np.cbrt((0.75 * modulus * opening) ** 2)
    a, b = squared[rows, deepest], root[rows, widest]
    known = (a > 0.0) | (b > 0.0)
    kappa = _cubic(np.where(known, a, 1.0), b, size)
    distance = squared * kappa[:, None] ** 3 - root * kappa[:, None]
    # ∂(s²)/∂g = −2 K s inside, ∂b/∂g = ⅔ b/g outside.
    d_squared = np.where(inside, -2.0 * stiffness * pressure, 0.0)
    safe = np.where(opening > 0.0, opening, 1.0)
    d_root = np.where(opening > 0.0, root / (1.5 * safe), 0.0)
    d_kappa = np.zeros_like(gap)
    below = 3.0 * a * kappa**2 + b
    below = np.where(known, below, 1.0)
    d_kappa[rows, deepest] -= kappa**3 * d_squared[rows, deepest] / below
    d_kappa[rows, widest] -= kappa * d_root[rows, widest] / below
    d_kappa += d_size / below[:, None]
    by_kappa = 3.0 * squared * kappa[:, None] ** 2 - root
    d_distance = by_kappa[:, :, None] * d_kappa[:, None, :]
    corner = np.arange(gap.shape[1])
    d_distance[:, corner, corner] += d_squared * kappa[:, None] ** 3 - d_root * kappa[:, None]
    d_distance[~known] = 0.0
    distance[~known] = 0.0
    return distance, d_distance


def _cubic(a: Floats, b: Floats, size: Floats) -> Floats:
    """The root x > 0 of a x³ + b x = size, with a, b ≥ 0 and not both zero (p,)."""
    tiny = np.finfo(float).tiny
    # Each term alone gives an upper bound; from there Newton's method falls to the root.
    x = np.minimum(np.cbrt(size / np.maximum(a, tiny)), size / np.maximum(b, tiny))
    for _ in range(_NEWTON):
        step = (a * x**3 + b * x - size) / (3.0 * a * x**2 + b)
        x = x - step
        if np.all(np.abs(step) <= 1e-15 * x):
            break
    return x
