"""How the gap of a pair becomes its contact pressure: averaged over vertices, or point by point.

Axis letters: q points, v vertices of the slave facets.

**Averaged** (the default): with the linear shape functions N_A of the vertices A and the weights w
of the points,

    m_A = Σ_q w N_A,   g_A = (1/m_A) Σ_q w N_A g_q,   s_A = K_A⟨−g_A⟩,   t_N(q) = Σ_A N_A s_A.

The gap is averaged over the points that have a master below them, while m_A is that of the whole
support, so that the pressure fades where a slave hangs over the end of its master. Its energy is
½ Σ_A m_A s_A²/K_A. A facet may then lie on a curved master with small gaps and overlaps of its
points, as its chord must, and carries an even pressure. The test functions of the gap are those of
mortar methods with linear multipliers (Puso & Laursen, Comput. Methods Appl. Mech. Engng 193 (2004)
601); here the multiplier is eliminated by the penalty.

**Pointwise** (Luege & Luccioni): t_N = K_N⟨−g⟩ at each point. Over a curved master only few points
of a facet touch as soon as its sagitta exceeds the penetration.
"""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np

from tribox.forms.contact.state import ContactMode, ContactState, Fading, NormalContact
from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.slave_points import SlaveVertices
from tribox.geometry.surfaces.surface import ContactSurface

PressureKind = Literal["averaged", "pointwise"]

_NO_AREA = np.finfo(float).tiny  # instead of none at all
TOUCHING = 1e-11  # gap, relative to a facet's size, up to which a point or a vertex touches
ROUNDOFF_DEPTH = 1e-12  # penetration over a facet's length that may be round-off alone


class NormalRule(Protocol):
    """From the gaps to the pressure.

    Attributes:
        penalty: Pa/m, of each vertex (v,) or each point (q,).
    """

    penalty: Floats

    def evaluate(self, at: Projection, mode: ContactMode, least_depth: float) -> NormalContact:
        """Pressure of the points ``at`` their projections; collective.

        Args:
            at: projections of all points.
            mode: penalty scale and adhesive gap.
            least_depth: depth over facet length from which on there is pressure.
        """
        ...

    def energy(self, normal: NormalContact, penalty_scale: float) -> float:
        """Energy of the penalty, this rank's part, J per unit thickness."""
        ...

    def point_stiffness(self) -> Floats:
        """(q,), Pa/m: springs at the points that are together at least as stiff."""
        ...


class AveragedPressure(NormalRule):
    """Pressure from the mean gaps at the vertices of the slave facets.

    Attributes:
        shape: (q, k) functions that gaps are averaged with and pressures spread by.
        others: (v,) area of the vertices that other masters have, see
            :mod:`tribox.forms.contact.shared_slave`; None without any.
    """

    def __init__(self, surface: ContactSurface, penalty: float | Floats) -> None:
        """Take the penalty, Pa/m: one number, or one for each vertex (v,)."""
        self.surface, self.vertices = surface, surface.vertices
        self.shape = self.vertices.shape
        self.penalty = _expanded(penalty, self.vertices.count, "vertices")
        self.others: Floats | None = None

    def evaluate(
        self, at: Projection, mode: ContactMode, least_depth: float = 0.0
    ) -> NormalContact:
        vertices = self.vertices
        share = 1.0 if at.share is None else at.share
        # A point beyond the master's end has no gap: the mean is over those that have one, and the
        # area is theirs, so that a vertex at the end carries by its covered part.
        weight = self.surface.slave.weight * np.where(at.on_surface, share, 0.0)
        gaps = vertices.sums(weight * np.where(at.on_surface, at.gap, 0.0))
        covered = vertices.sums(weight)
        gap, active, spring, stiffness = self.at_vertices(gaps, covered, mode, least_depth)
        damping = None if mode.dashpots is None else mode.dashpots.pressure(gap, spring)
        spring = spring if damping is None else spring + damping
        # A point shares the pressure of all vertices of its facet: one that is closed makes it
        # press.
        closed = at.on_surface & active[vertices.of_point].any(axis=1)
        at_points = np.where(closed, share * vertices.at_points(spring), 0.0)
        return NormalContact(
            closed=closed,
            spring=at_points,
            pressure=np.maximum(at_points, 0.0),
            gap=gap,
            nodal_pressure=np.maximum(spring, 0.0),
            active=active,
            area=self.area(covered),
            grows=None if self.others is None else covered > vertices.area - self.others,
            stiffness=stiffness,
            damping=damping,
        )

    def area(self, covered: Floats) -> Floats:
        """a_A (v,) that gaps are averaged over: m_A, or what other masters leave of it.

        Args:
            covered: (v,) Σ_q w N_A of the points that have this master below them.
        """
        if self.others is None:
            return self.vertices.area
        return np.maximum(self.vertices.area - self.others, np.maximum(covered, _NO_AREA))

    def at_vertices(
        self, gaps: Floats, covered: Floats, mode: ContactMode, least_depth: float = 0.0
    ) -> tuple[Floats, Bools, Floats, Floats]:
        """Mean gap g_A (v,), m, whether it carries pressure or touches, s_A, Pa, −∂s_A/∂g_A, Pa/m.

        Args:
            gaps: (v,) Σ_q w N_A g_q over the points that have a master below them, of all ranks.
            covered: (v,) Σ_q w N_A over the same points.
            mode: penalty scale and adhesive gap.
            least_depth: depth over facet length from which on there is pressure.
        """
        # Depths below round-off of the mean gap are no contact: which vertices press would be
        # chance. Pressure begins from nothing there: with a jump a vertex that has to carry less
        # than it, as between sheets that bend together, would find no equilibrium.
        length = self.vertices.length
        gap: Floats = gaps / self.area(covered)
        active: Bools = (covered > 0.0) & (gap <= _reach(length, mode))
        law = _law(gap, active, mode, self.penalty, least_depth * length)
        return gap, active, *law

    def energy(self, normal: NormalContact, penalty_scale: float) -> float:
        assert normal.nodal_pressure is not None
        spring = _of_springs(normal.nodal_pressure, normal)
        density = 0.5 * spring**2 / (penalty_scale * self.penalty)
        if normal.area is not None:
            density = density * (normal.area / self.vertices.area)
        return float(self.surface.slave.weight @ self.vertices.at_points(density))

    def point_stiffness(self) -> Floats:
        """See :class:`NormalRule`; by Jensen's inequality (∫N_A g)²/m_A ≤ ∫N_A g²."""
        return self.vertices.at_points(self.penalty)


class PointwisePressure(NormalRule):
    """Pressure of each point from its own gap."""

    def __init__(self, surface: ContactSurface, penalty: float | Floats) -> None:
        """Take the penalty, Pa/m: one number, or one for each point (q,)."""
        self.surface = surface
        self.penalty = _expanded(penalty, len(surface.slave.weight), "points")

    def evaluate(
        self, at: Projection, mode: ContactMode, least_depth: float = 0.0
    ) -> NormalContact:
        # Touching points count as closed: they carry no pressure yet, but their stiffness keeps a
        # body that only rests on another from being loose.
        size = np.sqrt(np.einsum("qai,qai->qa", at.tangents, at.tangents).max(axis=1))
        closed = (at.gap <= _reach(size, mode)) & at.on_surface
        spring, stiffness = _law(at.gap, closed, mode, self.penalty, least_depth * size)
        damping = None if mode.dashpots is None else mode.dashpots.pressure(at.gap, spring)
        spring = spring if damping is None else spring + damping
        pressure = np.maximum(spring, 0.0)
        return NormalContact(closed, spring, pressure, stiffness=stiffness, damping=damping)

    def energy(self, normal: NormalContact, penalty_scale: float) -> float:
        spring = _of_springs(normal.pressure, normal)
        density = 0.5 * spring**2 / (penalty_scale * self.penalty)
        return float(self.surface.slave.weight @ density)

    def point_stiffness(self) -> Floats:
        return self.penalty


def normal_rule(
    kind: PressureKind, surface: ContactSurface, penalty: float | Floats
) -> AveragedPressure | PointwisePressure:
    """The rule of a kind; ``penalty`` in Pa/m, of each vertex (v,) or point (q,) or one for all.

    Raises:
        ValueError: another kind, or numbers that do not fit the vertices or points.
    """
    if kind == "averaged":
        return AveragedPressure(surface, penalty)
    if kind == "pointwise":
        return PointwisePressure(surface, penalty)
    raise ValueError(f'the contact pressure is "averaged" or "pointwise", not {kind!r}')


def nodal_pressure(surface: ContactSurface, pressure: Floats) -> Floats:
    """Contact pressure (v,), Pa, at the slave's vertices from that at the points (q,); collective.

    p_A = (1/m_A) Σ_q w N_A t_N: the normal force of the vertex over its area. Where a contact ends
    within a facet the coefficients s_A of t_N go up and down about a smooth pressure, as those of
    any projection onto functions that are linear in a facet; the forces, which are all that the
    bodies feel of it, do not.

    Args:
        pressure: t_N at the points of this rank, whatever the rule that it comes from.
    """
    vertices = surface.vertices
    return vertices.sums(surface.slave.weight * pressure) / vertices.area


def _of_springs(pressure: Floats, normal: NormalContact) -> Floats:
    """Pressure, Pa, without what is the dashpots'."""
    return pressure if normal.damping is None else pressure - normal.damping


def _reach(length: Floats, mode: ContactMode) -> Floats:
    """Gap up to which vertices or points count as closed, m."""
    least = mode.adhesive_gap if mode.interior is None else mode.interior.reach
    return np.maximum(TOUCHING * length, least)


def _law(
    gap: Floats, closed: Bools, mode: ContactMode, penalty: Floats, least: Floats
) -> tuple[Floats, Floats]:
    """Pressure, Pa, negative only within an adhesive gap, and −∂p/∂g, Pa/m, where closed.

    What only touches has the stiffness that pressing on it would meet: a body that rests on
    another is not loose, and a flush surface stays closed as it is pressed. That is no derivative.
    """
    stiffness = mode.penalty_scale * penalty
    if mode.interior is not None:
        pressure, stiffness = mode.interior.law(gap, penalty)
    elif mode.adhesive_gap > 0.0:
        pressure = -stiffness * gap
    else:
        begins = 2.0 * (-gap - least)  # to be the penalty's again at twice the depth
        pressure = stiffness * np.maximum(np.minimum(begins, -gap), 0.0)
        stiffness = np.where((begins > 0.0) & (begins < -gap), 2.0, 1.0) * stiffness
    stiff = closed & (pressure != 0.0) if mode.only_pressed else closed
    return np.where(closed, pressure, 0.0), np.where(stiff, stiffness, 0.0)


def _expanded(penalty: float | Floats, count: int, what: str) -> Floats:
    out = np.array(penalty, dtype=np.float64)
    if out.ndim and out.shape != (count,):
        raise ValueError(f"penalty: {out.size} numbers for {count} {what}")
    if not np.all(np.isfinite(out) & (out > 0.0)):
        raise ValueError("penalty: must be positive and finite")
    return np.array(np.broadcast_to(out, (count,)))


# -- Where a contact ends within a facet, for what acts on the area that touches: film, and area ---
#
# With averaged pressure a facet between a vertex A that carries pressure and one B that does not
# has pressure on all of its length; the bodies part somewhere in between. Gaps of the points do
# not tell where, for a straight facet opens as a whole. Pressure inside and gap outside do: beside
# the end of a contact of smooth bodies, at the distance d,
#
# .. math:: p = k \sqrt{d} \ \text{inside}, \qquad g = \frac{4 k}{3 E^*} d^{3/2} \ \text{outside}
#
# (K. L. Johnson, Contact Mechanics, 1985, the limits of Hertz's p and of his gap; E* is the modulus
# of both bodies together, :math:`1/E^* = \sum (1-\nu)/2G`). With k such that both distances add up
# to the length h of the facet, the vertices get signed distances :math:`\varphi` from the end,
#
# .. math:: \varphi_A = s_A^2 \kappa^3, \quad \varphi_B = -(\tfrac34 E^* g_B)^{2/3} \kappa, \quad
#    s_A^2 \kappa^3 + (\tfrac34 E^* g_B)^{2/3} \kappa = h, \quad \kappa = k^{-2/3}
#
# (where more vertices are open or closed, the largest g_B and s_A), and a point that stands for a
# piece of the facet of length l is covered by :math:`\chi = \langle \tfrac12 + (\varphi + c h)/l
# \rangle`, at most 1. In space h is the facet's length along the slope :math:`\gamma` of its gaps,
# across the end: with its corners' second moments w and their principal axes :math:`h^2 \propto
# \sum w_a \gamma_a^2 / \sum \gamma_a^2`, the sides of a rectangle, and of the same mean as the
# root of the area.
#
# The nodal values are means over the facets beside them, and elements are too stiff beside the
# end: without c contacts end early by 0.16 h on each side, measured on round tools over rubber for
# all meshes, Poisson's ratios and penalties (0.13 to 0.20; docs/verification.md). A facet cannot
# be more than covered, so that c is a little more.


_EARLY = 0.175  # c
_NEWTON = 60  # at most; the cubic is monotone and convex


def rim_cover(
    surface: ContactSurface,
    normal: NormalContact,
    stiffness: Floats,
    modulus: float | None,
    only_met: bool = False,
) -> tuple[Floats, Floats | None]:
    """Covered share χ (q,) of each point, and ∂χ/∂g (q, k), 1/m, for the gaps of its vertices.

    Args:
        normal: averaged normal contact; point by point all is covered.
        stiffness: (v,), Pa/m, of the vertices.
        modulus: Pa, E*; None: facets at the rim count whole.
        only_met: whether vertices count as open by their gaps, although they carry pressure.

    Returns:
        χ and its derivatives; None for these where all are zero.
    """
    cover = np.ones(len(normal.pressure))
    if normal.active is None or normal.gap is None:
        return cover, None
    vertices, met = surface.vertices, normal.active
    if only_met:
        met = met & (normal.gap <= TOUCHING * vertices.length)
    active = met[vertices.of_point]
    some = active.any(axis=1)
    cover[normal.closed & ~some] = 0.0
    at = np.nonzero(normal.closed & some & ~active.all(axis=1))[0]
    if not len(at) or modulus is None:
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
    # Least squares: the slope of the gap over the corners in their principal axes is γ_a = Σ_k x_ka
    # g_k/w_a, with the second moments w_a = Σ_k x_ka².
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
    # Implicit derivative of a κ³ + b κ = h, for the vertices of a and b and for h.
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
    first: Floats = size / np.maximum(a, tiny)
    second: Floats = size / np.maximum(b, tiny)
    x: Floats = np.minimum(np.cbrt(first), second)
    for _ in range(_NEWTON):
        step = (a * x**3 + b * x - size) / (3.0 * a * x**2 + b)
        x = x - step
        if np.all(np.abs(step) <= 1e-15 * x):
            break
    return x


# -- Energy that a contact gives up where points leave the end of the master bit by bit ------------
#
# Axis letters: q slave points. A point with the share σ presses with σ s, s = Σ_A N_A s_A. As σ
# falls it sinks below the surface that carries it less and less; the work of its pressure on the
# way down comes back to nobody: with the penalty's energy ½ Σ_A a_A s_A²/K_A, whose change is −Σ_q
# w s (σ dg + g dσ), there is left
#
# .. math:: \int \sum_q w \, s \, g \, d\sigma, \qquad g < 0,
#
# per step by the trapezoidal rule. It is what the pressing of the bodies had stored of what slides
# off: a rounded edge would give it back as a push, a fading one loses it. Where points come in over
# an end it is negative.


def fading(
    at: Projection, normal: NormalContact, vertices: SlaveVertices, before: ContactState
) -> Fading | None:
    """What fades in a step; None with the pressure point by point.

    Args:
        at: the points on the master.
        before: state of the last step.
    """
    if normal.nodal_pressure is None:
        return None
    share = np.where(at.on_surface, 1.0 if at.share is None else at.share, 0.0)
    full = vertices.at_points(normal.nodal_pressure)
    sunk = np.where(at.on_surface, full * np.minimum(at.gap, 0.0), 0.0)
    # Of a point that is over the master at one end of the step only, that end counts.
    mean = 0.5 * (sunk + before.sunk)
    mean = np.where(share > 0.0, np.where(before.share > 0.0, mean, sunk), before.sunk)
    return Fading(share, sunk, mean * (share - before.share))
