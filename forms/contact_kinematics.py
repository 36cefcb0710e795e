"""Kinematics of a contact point and its exact variation, at all points at once.

Axis letters: q points, r generalised coordinates, i, j space, α, β, γ surface directions.

Per point the motion enters through vectors that are linear in the nodal displacements,

    a   = δu¹ − δu²(ξ̄)      relative motion at the closest point ξ̄ of today,
    b_α = δu²_,α(ξ̄)          change of the master's tangents there,
    c   = δu¹ − δu²(Ȳ_n)     relative motion at the master material point Ȳ_n of the last step,
    d   = e^α δu²_,α(Ȳ_n)    change of the advected elastic slip,

stacked as z = (a, b_α, c, d). Each variation below is given as a matrix that multiplies z. For
straight facets the curvature terms ȳ_,αβ vanish. Closest-point variation: Laursen & Simo, Int. J.
Numer. Meth. Engng 36 (1993) 3451; the slip against the advected material point Ȳ_n is this
project's, objective because both its ends move with the bodies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.projection import Bools, Floats, Projection

TOUCHING = 1e-9  # gap, relative to a master facet's size, up to which a point touches


@dataclass(slots=True)
class Anchor:
    """What the last converged step left at each point, moved by today's master.

    Attributes:
        foot: (q, i), m, current: φ²(Ȳ_n), today's place of the last closest material point.
        slip_image: (q, i), m, current: e^α τ_α(Ȳ_n), the advected elastic slip.
        slip_length: (q,), m: L, the length of the elastic slip, kept by the transport.
        gap: (q,), m: gap of the last converged step (+inf where there was none).
    """

    foot: Floats
    slip_image: Floats
    slip_length: Floats
    gap: Floats


@dataclass(slots=True)
class ContactKinematics:
    """Gap, slip increment and elastic slip of today, with their variations.

    Attributes:
        normal: (q, i); gap: (q,), m; closed: (q,) bool, touching or g < 0, on the surface.
        slip: (q, i), m: Δg_T; elastic_slip: (q, i), m: g_e in today's tangent plane.
        d_gap: (q, r·i): δg = n·a; d_normal, d_slip, d_elastic: (q, i, r·j).
        d_xi: (q, α, r·j): ∂ξ^α/∂z.
    """

    normal: Floats
    gap: Floats
    closed: Bools
    slip: Floats
    elastic_slip: Floats
    d_gap: Floats
    d_normal: Floats
    d_slip: Floats
    d_elastic: Floats
    d_xi: Floats


def _outer(u: Floats, v: Floats) -> Floats:
    out: Floats = u[:, :, None] * v[:, None, :]
    return out


def _dot(u: Floats, v: Floats) -> Floats:
    out: Floats = np.einsum("qi,qi->q", u, v)
    return out


def relate(points: Floats, today: Projection, anchor: Anchor) -> ContactKinematics:
    """Contact kinematics of the slave points against their projections.

    Args:
        points: (q, i), m, current: slave points.
        today: their closest points on the deformed master.
        anchor: what the last converged step left, moved by today's master.
    """
    n, gap = today.normal, today.gap
    count, dim = n.shape
    surface = today.tangents.shape[1]
    size = (3 + surface) * dim
    a, c, d = slice(0, dim), slice(size - 2 * dim, size - dim), slice(size - dim, size)
    eye = np.broadcast_to(np.eye(dim), (count, dim, dim))

    d_gap = np.zeros((count, size))
    d_gap[:, a] = n
    d_xi, d_normal = _vary_projection(today, size)

    plane = eye - _outer(n, n)
    # Touching points count as closed: they carry no pressure yet, but their stiffness keeps a body
    # that only rests on another from being loose.
    length = np.linalg.norm(today.tangents[:, 0], axis=1)
    closed = (gap <= TOUCHING * length) & today.on_surface
    share, d_share = _closed_share(gap, anchor.gap, closed)
    # Clamped to a vertex, x − ȳ is not along n, and a motionless point in a groove would slip.
    s = np.where(today.clamped[:, None], today.foot, points) - anchor.foot
    full = np.einsum("qij,qj->qi", plane, s)
    d_full = _vary_in_plane(n, s, d_normal)
    d_full[:, :, c] += plane
    d_full[:, :, a] -= np.where(today.clamped[:, None, None], plane, 0.0)
    d_slip = share[:, None, None] * d_full + _outer(full, d_share[:, None] * d_gap)

    elastic, d_elastic = _transport(n, plane, anchor, d_normal, d)
    return ContactKinematics(
        normal=n,
        gap=gap,
        closed=closed,
        slip=share[:, None] * full,
        elastic_slip=elastic,
        d_gap=d_gap,
        d_normal=d_normal,
        d_slip=d_slip,
        d_elastic=d_elastic,
        d_xi=d_xi,
    )


def _vary_projection(today: Projection, size: int) -> tuple[Floats, Floats]:
    """∂ξ^α/∂z (q, α, r·j) and ∂n/∂z (q, i, r·j).

    On a facet H_αβ δξ^β = τ_α·a + g n·b_α with H = metric, and δn = −(n·b_α) τ^α; at a vertex
    δξ = 0 and δn = (I − n⊗n) a / g.
    """
    n, gap, tau = today.normal, today.gap, today.tangents
    count, surface, dim = tau.shape
    metric = np.einsum("qai,qbi->qab", tau, tau)
    inverse = 1.0 / metric if surface == 1 else np.linalg.inv(metric)
    contravariant = np.einsum("qab,qbi->qai", inverse, tau)
    d_xi = np.zeros((count, surface, size))
    d_normal = np.zeros((count, dim, size))
    d_xi[:, :, :dim] = contravariant
    for beta in range(surface):  # one or two surface directions
        b = slice((1 + beta) * dim, (2 + beta) * dim)
        d_xi[:, :, b] = inverse[:, :, beta, None] * (gap[:, None] * n)[:, None, :]
        d_normal[:, :, b] = -_outer(contravariant[:, beta], n)
    if today.clamped.any():
        at = np.nonzero(today.clamped)[0]
        d_xi[at] = 0.0
        d_normal[at] = 0.0
        length = np.sqrt(metric[at, 0, 0])
        # On the vertex itself the direction is undefined; the normal is then held.
        with np.errstate(divide="ignore"):
            over = np.where(np.abs(gap[at]) > 1e-12 * length, 1.0 / gap[at], 0.0)
        d_normal[at, :, :dim] = over[:, None, None] * (np.eye(dim) - _outer(n[at], n[at]))
    return d_xi, d_normal


def _vary_in_plane(n: Floats, v: Floats, d_normal: Floats) -> Floats:
    """The part of δ((I − n⊗n) v) that comes from the normal: −δn (n·v) − n (δn·v)."""
    out: Floats = -_dot(n, v)[:, None, None] * d_normal
    out -= n[:, :, None] * np.einsum("qi,qir->qr", v, d_normal)[:, None, :]
    return out


def _closed_share(gap: Floats, before: Floats, closed: Bools) -> tuple[Floats, Floats]:
    """Share of the step spent in contact, −g/(g_n − g) for a point that closes, and ∂/∂g."""
    closing = closed & (before > 0.0) & (gap < 0.0)
    known = closing & np.isfinite(before)
    start = np.where(known, before, 1.0)
    now = np.where(known, gap, -1.0)
    share = np.where(known, -now / (start - now), np.where(closing, 0.0, 1.0))
    return share, np.where(known, -start / (start - now) ** 2, 0.0)


def _transport(
    n: Floats, plane: Floats, anchor: Anchor, d_normal: Floats, d: slice
) -> tuple[Floats, Floats]:
    """Elastic slip g_e = L v/|v|, v = (I − n⊗n) q, in today's plane, and its variation.

    The length L is kept: neither the projection nor a stretch of the master may create or lose
    elastic energy.
    """
    image = anchor.slip_image
    v = np.einsum("qij,qj->qi", plane, image)
    length = np.linalg.norm(v, axis=1)
    alive = (length > 0.0) & (anchor.slip_length > 0.0)
    scale = np.where(alive, anchor.slip_length, 0.0) / np.where(alive, length, 1.0)
    m = v / np.where(alive, length, 1.0)[:, None]
    d_v = _vary_in_plane(n, image, d_normal)
    d_v[:, :, d] += plane
    d_elastic = scale[:, None, None] * (
        d_v - m[:, :, None] * np.einsum("qi,qir->qr", m, d_v)[:, None, :]
    )
    return scale[:, None] * v, d_elastic
