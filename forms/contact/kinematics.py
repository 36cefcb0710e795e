"""Kinematics of a contact point and its exact variation, at all points at once.

Axis letters: q points, r generalised coordinates, i, j space, α, β, γ surface directions.

Per point the motion enters through vectors that are linear in the nodal displacements,

    a   = δu¹ − δu²(ξ̄)      relative motion at the current closest point ξ̄,
    b_α = δu²_,α(ξ̄)          change of the master's tangents there,
    c   = δu¹ − δu²(Ȳ_n)     relative motion at the master material point Ȳ_n of the last step,
                             which the point was on, or opposite while it was open,
    d   = e^α δu²_,α(Ȳ_n)    change of the advected elastic slip,
    f_e = δe_A, δe_B        change of the slave's chords, of points projected along rays only,

stacked as z = (a, b_α, c, d, f_e). Each variation below is given as a matrix that multiplies z.
Closest-point variation: Laursen & Simo, Int. J. Numer. Meth. Engng 36 (1993) 3451; the slip against
the advected material point Ȳ_n is this project's, objective because both its ends move with the
bodies.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.facets import Bools, Floats, Longs, solve_small, unit_normals
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.rigid import RigidMotion
from tribox.geometry.surfaces.slave_points import PointNormals

_FACING = 0.5  # cosine between the surfaces from which on they face each other


@dataclass(slots=True)
class Anchor:
    """State of the last converged step at each point, moved with the current master."""

    # (q, i), m, current: φ²(Ȳ_n), where the material point that the slave point was on, or opposite
    # while it was open, is now: see :func:`opposite`
    foot: Floats
    components: Floats  # (q, α), e^α of the elastic slip; 0 where it came over from another master
    slip_image: Floats  # (q, i), m, current: e^α τ_α(Ȳ_n), the advected elastic slip
    slip_length: Floats  # (q,), m: L, the length of the elastic slip, kept by the transport

    def of(self, take: Longs) -> Anchor:
        """The same of the points ``take`` (p,)."""
        arrays = self.foot, self.components, self.slip_image, self.slip_length
        return Anchor(*(array[take] for array in arrays))


@dataclass(slots=True)
class ContactKinematics:
    """Current gap, slip increment and elastic slip."""

    normal: Floats  # (q, i)
    gap: Floats  # (q,), m
    closed: Bools  # (q,) whether the point carries pressure, or touches
    slip: Floats  # (q, i), m: Δg_T, 0 of open points
    elastic_slip: Floats  # (q, i), m: g_e in the current tangent plane


@dataclass(slots=True)
class Variations:
    """How the kinematics change with the generalised coordinates."""

    d_gap: Floats  # (q, r·i): δg, which is n·a but along rays
    d_normal: Floats  # (q, i, r·j)
    d_slip: Floats  # likewise
    d_elastic: Floats  # likewise
    d_xi: Floats  # (q, α, r·j): ∂ξ^α/∂z


def _outer(u: Floats, v: Floats) -> Floats:
    out: Floats = u[:, :, None] * v[:, None, :]
    return out


def _dot(u: Floats, v: Floats) -> Floats:
    out: Floats = np.einsum("qi,qi->q", u, v)
    return out


def opposite(
    at: Projection, points: Floats, slave_normal: Floats, master_normal: Floats
) -> tuple[Floats, Floats]:
    """Where open points are opposite the master: what their next slip is measured from.

    That is where the line along the mean of both surfaces' normals meets the tangent plane of the
    master. The closest point would be off by the gap times half the angle between the surfaces,
    which is no slip: equal bodies pressed on each other would rub. Past the end the tangent plane
    goes on, so that the slip of a step is that of its speed.

    Args:
        at: the points (q,) on the master.
        points: (q, i), m, current.
        slave_normal: (q, i), current, of either sign, and
        master_normal: (q, i), those of smooth surfaces
            (:meth:`tribox.geometry.surfaces.surface.ContactSurface.smooth_normals`).

    Returns:
        Way (q, α) to there from the projection, in components of the tangents there; and its length
        (q,), m, of points past the end, 0 of the others.
    """
    tau, past, apart = at.tangents, ~at.on_surface, points - at.foot
    normal, cosine = unit_normals(tau), _dot(slave_normal, master_normal)
    faces = np.abs(cosine) > _FACING
    # The slave's normal may point either way: it is turned to the side of the master's first.
    mean = master_normal + np.sign(cosine)[:, None] * slave_normal
    mean = np.where(faces[:, None], mean, normal)
    way = apart - (_dot(apart, normal) / _dot(mean, normal))[:, None] * mean
    way = np.where((faces | past)[:, None], way, 0.0)
    metric = np.einsum("qai,qbi->qab", tau, tau)
    ahead = solve_small(metric, np.einsum("qai,qi->qa", tau, way))
    return ahead, np.where(past, np.linalg.norm(way, axis=1), 0.0)


def relate(
    points: Floats, projection: Projection, anchor: Anchor, closed: Bools
) -> ContactKinematics:
    """Contact kinematics of the slave points against their projections.

    The slip of a step is as long as the way on a curved master, see :class:`_Arc`. That of a point
    that closes within the step counts in full, from the place that it was opposite: a share of it
    would depend on penalty and step. An open point does not slip.

    Args:
        points: (q, i), m, current: slave points.
        projection: their closest points on the deformed master.
        anchor: state of the last converged step, moved with the current master.
        closed: (q,) points in contact.
    """
    n = projection.normal
    slip = np.where(closed[:, None], in_plane(n, _apart(points, projection, anchor)), 0.0)
    slip *= _Arc.of(slip, points, projection, anchor).stretch[:, None]
    image = in_plane(n, anchor.slip_image)
    elastic = _rescaled(image, anchor)[0][:, None] * image
    return ContactKinematics(n, projection.gap, closed, slip, elastic)


def vary(points: Floats, projection: Projection, anchor: Anchor) -> Variations:
    """Variation of the kinematics of points that are closed.

    Args:
        points: (q, i), m, current: closed slave points.
        projection: their closest points on the deformed master, or those along rays.
        anchor: state of the last converged step, moved with the current master.
    """
    n = projection.normal
    count, dim = n.shape
    lead = (1 + projection.tangents.shape[1]) * dim
    a, c, d = slice(0, dim), slice(lead, lead + dim), slice(lead + dim, lead + 2 * dim)
    d_gap: Floats
    if projection.rays is None:
        d_gap = np.zeros((count, lead + 2 * dim))
        d_gap[:, a] = n
        d_xi, d_normal = _vary_projection(projection, lead + 2 * dim)
    else:
        d_gap, d_xi, d_normal = _vary_along_rays(projection, projection.rays, lead + 4 * dim)
    plane = np.eye(dim) - _outer(n, n)
    s = _apart(points, projection, anchor)
    d_slip = _vary_in_plane(n, s, d_normal)
    d_slip[:, :, c] += plane
    at = np.nonzero(projection.clamped)[0]
    if len(at):
        # The slip of clamped points is measured from the foot: δȳ = δu²(ξ̄) + τ_α δξ^α = δu¹ − a +
        # τ_α δξ^α takes the place of δx = δu¹.
        d_foot = np.einsum("qai,qar->qir", projection.tangents[at], d_xi[at])
        d_foot[:, :, a] -= np.eye(dim)
        d_slip[at] += plane[at] @ d_foot
    slip = in_plane(n, s)
    # Variation of the depth ν = n·s − g of `_Arc`.
    d_sunk = np.einsum("qi,qir->qr", s, d_normal) - d_gap
    d_sunk[:, c] += n
    d_slip = _Arc.of(slip, points, projection, anchor).vary(slip, d_slip, d_sunk)
    return Variations(d_gap, d_normal, d_slip, _vary_transport(n, plane, anchor, d_normal, d), d_xi)


@dataclass(frozen=True, slots=True)
class _Arc:
    r"""How much longer the way on a curved master is than its image v in the tangent plane.

    With the depth ν of the last step's place below that plane the arc has the length
    :math:`\sqrt{v^2 + 4\nu^2/3}`, up to the fifth power of the angle it turns by: a roll of the
    radius R that turns by Δθ rubs over R Δθ, of which the image is R sin Δθ.
    """

    length: Floats  # v (q,), m, 1 where the slip is as it is
    sunk: Floats  # ν (q,), m
    stretch: Floats  # (q,)

    @classmethod
    def of(cls, slip: Floats, points: Floats, at: Projection, anchor: Anchor) -> _Arc:
        """Of images ``slip`` (q, i); across a corner, or clamped to an end, they stay."""
        length = np.sqrt(_dot(slip, slip))
        sunk = _dot(at.normal, points - anchor.foot) - at.distance
        # ν/v = tan(Δθ/2) of a master of constant curvature: a half of it is a turn by 53° within a
        # step, beyond which it is a corner.
        bent = ~at.clamped & (np.abs(sunk) < 0.5 * length)
        length, sunk = np.where(bent, length, 1.0), np.where(bent, sunk, 0.0)
        return cls(length, sunk, np.sqrt(1.0 + 4.0 / 3.0 * (sunk / length) ** 2))

    def vary(self, slip: Floats, d_slip: Floats, d_sunk: Floats) -> Floats:
        """Variation (q, i, r) of the longer slip from that of its image and of ν (q, r)."""
        slope = self.sunk / self.length
        along = slip / self.length[:, None]
        grown = d_sunk - slope[:, None] * np.einsum("qi,qir->qr", along, d_slip)
        grown *= (4.0 / 3.0 * slope / self.stretch)[:, None]
        out: Floats = self.stretch[:, None, None] * d_slip + _outer(along, grown)
        return out


def _apart(points: Floats, projection: Projection, anchor: Anchor) -> Floats:
    """Way (q, i), m, from the last step's material point to the current place.

    Clamped to an edge or a corner the foot moves, not x: a motionless point in a groove, with a
    normal that turns freely, would slip.
    """
    if not projection.clamped.any():
        return points - anchor.foot
    return np.where(projection.clamped[:, None], projection.foot, points) - anchor.foot


def on_facet(slip: Floats, at: Projection) -> Floats:
    """Vectors (q, i) in the facets' planes whose images in the plane across n are ``slip`` (q, i).

    Where the projection is clamped, n is not the facet's normal n_f: q = g_e − n (n_f·g_e)/(n_f·n)
    gives (I − n⊗n) q = g_e again. A normal almost in the facet's plane
    changes nothing.
    """
    rows = np.nonzero(at.clamped)[0]
    if not len(rows):
        return slip
    out = slip.copy()
    n, facet = at.normal[rows], unit_normals(at.tangents[rows])
    between = np.einsum("qi,qi->q", n, facet)
    share = np.where(
        np.abs(between) > 0.1,
        np.einsum("qi,qi->q", slip[rows], facet) / np.where(between == 0.0, 1.0, between),
        0.0,
    )
    out[rows] -= share[:, None] * n
    return out


def in_plane(n: Floats, v: Floats) -> Floats:
    """(I − n⊗n) v."""
    out: Floats = v - _dot(n, v)[:, None] * n
    return out


def _vary_projection(projection: Projection, size: int) -> tuple[Floats, Floats]:
    """∂ξ^α/∂z (q, α, r·j) and ∂n/∂z (q, i, r·j) of points inside a facet, on an edge, at a corner.

    Inside a facet H_αβ δξ^β = τ_α·a + g n·b_α with H_αβ = τ_α·τ_β − g n·ȳ_,αβ, and
    δn = −(n·(b_α + ȳ_,αβ δξ^β)) τ^α.
    """
    n, gap, tau = projection.normal, projection.distance, projection.tangents
    count, surface, dim = tau.shape
    metric = np.einsum("qai,qbi->qab", tau, tau)
    inverse = _inverse(metric)
    contravariant = np.einsum("qab,qbi->qai", inverse, tau)
    bend = None  # n·ȳ_,αβ
    if projection.curvature is not None:
        bend = np.einsum("qabi,qi->qab", projection.curvature, n)
        # Two metrics: τ^α belong to τ_α·τ_β alone; ξ̄ moves by H, which the curvature of the master
        # bends by the gap.
        inverse = _inverse(metric - gap[:, None, None] * bend)
    d_xi = np.zeros((count, surface, size))
    d_normal = np.zeros((count, dim, size))
    d_xi[:, :, :dim] = contravariant if bend is None else inverse @ tau
    for beta in range(surface):  # one or two surface directions
        b = slice((1 + beta) * dim, (2 + beta) * dim)
        d_xi[:, :, b] = inverse[:, :, beta, None] * (gap[:, None] * n)[:, None, :]
        d_normal[:, :, b] = -_outer(contravariant[:, beta], n)
    if bend is not None:
        d_normal -= np.einsum("qai,qar->qir", contravariant, bend @ d_xi)
    at = np.nonzero(projection.clamped)[0]
    if len(at):
        d_xi[at], d_normal[at] = _vary_clamped(projection, at, size)
    return d_xi, d_normal


def _vary_clamped(projection: Projection, at: Longs, size: int) -> tuple[Floats, Floats]:
    """∂ξ^α/∂z (p, α, r·j) and ∂n/∂z (p, i, r·j) of the points ``at``, on an edge or at a corner.

    Along an edge ξ = ξ_0 + s e, with t = e^α τ_α: (t·t − g n·t_,s) δs = t·a + g n·e^α b_α and
    δξ^α = e^α δs; at a corner δξ = 0. As n lies along x − ȳ, δn = (I − n⊗n)(a − τ_α δξ^α)/g.
    """
    n, gap, tau = projection.normal[at], projection.distance[at], projection.tangents[at]
    count, surface, dim = tau.shape
    d_xi = np.zeros((count, surface, size))
    if projection.along is not None:
        e = projection.along[at]
        t = np.einsum("qa,qai->qi", e, tau)
        stiffness = _dot(t, t)
        if projection.curvature is not None:
            change = np.einsum("qa,qb,qabi->qi", e, e, projection.curvature[at])
            stiffness = stiffness - gap * _dot(n, change)
        moves = stiffness != 0.0
        e_over = np.where(moves[:, None], e, 0.0) / np.where(moves, stiffness, 1.0)[:, None]
        d_xi[:, :, :dim] = _outer(e_over, t)
        for beta in range(surface):
            b = slice((1 + beta) * dim, (2 + beta) * dim)
            d_xi[:, :, b] = _outer(e_over, (e[:, beta] * gap)[:, None] * n)
    d_apart = -np.einsum("qai,qar->qir", tau, d_xi)
    d_apart[:, :, :dim] += np.eye(dim)
    length = np.linalg.norm(tau, axis=2).max(axis=1)
    # On the edge itself the direction is undefined; the normal is then held.
    with np.errstate(divide="ignore"):
        over = np.where(np.abs(gap) > 1e-12 * length, 1.0 / gap, 0.0)
    d_normal = over[:, None, None] * ((np.eye(dim) - _outer(n, n)) @ d_apart)
    return d_xi, d_normal


def _vary_along_rays(
    projection: Projection, rays: PointNormals, size: int
) -> tuple[Floats, Floats, Floats]:
    """∂g/∂z (q, r·i), ∂ξ/∂z (q, 1, r·j) and ∂n/∂z (q, i, r·j) of points projected along rays.

    With x = ȳ(ξ) + g n and t = n turned to the right:

        δξ = (t·a − g t·δn)/(t·τ),   δg = n·a − n·τ δξ.
    """
    n, gap, tau = projection.normal, projection.distance, projection.tangents[:, 0]
    count, dim = n.shape
    along = np.stack([n[:, 1], -n[:, 0]], axis=1)
    d_normal = np.zeros((count, dim, size))
    d_normal[:, :, -2 * dim : -dim], d_normal[:, :, -dim:] = rays.change[:, 0], rays.change[:, 1]
    d_xi = -gap[:, None] * np.einsum("qi,qir->qr", along, d_normal)
    d_xi[:, :dim] += along
    d_xi /= _dot(along, tau)[:, None]
    d_gap = -_dot(n, tau)[:, None] * d_xi
    d_gap[:, :dim] += n
    return d_gap, d_xi[:, None], d_normal


def _inverse(matrix: Floats) -> Floats:
    """Inverses (q, α, α) of matrices of one or two rows."""
    if matrix.shape[1] == 1:
        return np.asarray(1.0 / matrix, dtype=np.float64)
    out = np.empty_like(matrix)
    out[:, 0, 0], out[:, 1, 1] = matrix[:, 1, 1], matrix[:, 0, 0]
    out[:, 0, 1], out[:, 1, 0] = -matrix[:, 0, 1], -matrix[:, 1, 0]
    determinant = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
    inverse: Floats = out / determinant[:, None, None]
    return inverse


def _vary_in_plane(n: Floats, v: Floats, d_normal: Floats) -> Floats:
    """The part of δ((I − n⊗n) v) that comes from the normal: −δn (n·v) − n (δn·v)."""
    out: Floats = -_dot(n, v)[:, None, None] * d_normal
    out -= n[:, :, None] * np.einsum("qi,qir->qr", v, d_normal)[:, None, :]
    return out


def _rescaled(image: Floats, anchor: Anchor) -> tuple[Floats, Floats]:
    """Scale L/|v| (q,) that keeps the length of the elastic slip, and |v|, 1 where there is none.

    The length L is kept: neither the projection nor a stretch of the master may create or lose
    elastic energy.
    """
    length = np.sqrt(_dot(image, image))
    alive = (length > 0.0) & (anchor.slip_length > 0.0)
    safe = np.where(alive, length, 1.0)
    return np.where(alive, anchor.slip_length, 0.0) / safe, safe


def _vary_transport(
    n: Floats, plane: Floats, anchor: Anchor, d_normal: Floats, of_slip: slice
) -> Floats:
    """Variation (q, i, r·j) of the elastic slip g_e = L v/|v|, v = (I − n⊗n) q."""
    v = in_plane(n, anchor.slip_image)
    scale, length = _rescaled(v, anchor)
    m = v / length[:, None]
    d_v = _vary_in_plane(n, anchor.slip_image, d_normal)
    d_v[:, :, of_slip] += plane
    # δ(v/|v|) = (I − m⊗m) δv/|v|: the length L is kept, so that only the direction varies.
    d_v -= m[:, :, None] * np.einsum("qi,qir->qr", m, d_v)[:, None, :]
    d_v *= scale[:, None, None]
    return d_v


# -- From the control points of a rigid tool to its own unknowns, displacement and angle -----------
#
# Axis letters: a control points, p points, m, n nodes of a block, i, j space, k the 2·i unknowns of
# the two reference nodes, which hold (c, θL), see :mod:`tribox.geometry.surfaces.rigid`.
#
# All of a contact between kinematics and assembly is written in the control points y_a, as if they
# were nodes. Their forces F_a and blocks K_ab become those of q = (c, θL) by the chain rule,
#
# .. math:: F_q = T^T F, \qquad K_{qq} = T^T K T + \sum_a F_a \cdot \partial^2 y_a/\partial q^2,
#    \qquad T = \partial y_a/\partial q;
#
# without the last term, which the angle alone has, Newton's method would not be quadratic.


@lru_cache
def _turned(motion: RigidMotion, theta: float) -> tuple[Floats, Floats]:
    """T (a, i, k) and ∂²y_a/∂(θL)² (a, i), 1/m, at an angle, rad: most tools keep theirs."""
    return motion.tangent(theta), motion.bend(theta)


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """How control points follow the unknowns of their tool, at one state."""

    tangent: Floats  # (a, i, k), no unit: T
    bend: Floats  # (a, i), 1/m: ∂²y_a/∂(θL)²
    centre: Floats  # (i,), m, current: about which the tool turns

    @classmethod
    def at(cls, motion: RigidMotion, values: Floats) -> Carried:
        """At the reference nodes' values (2, i), m."""
        displacement, theta = motion.read(values)
        return cls(*_turned(motion, theta), motion.centre + displacement)

    @property
    def dim(self) -> int:
        """Of space."""
        return int(self.tangent.shape[1])

    def forces(self, shares: Floats, force: Floats) -> Floats:
        """Forces (p, 2, i), N, on the reference nodes of forces (p, i) shared by (p, a)."""
        moved = np.einsum("pa,aik->pik", shares, self.tangent)
        out: Floats = np.einsum("pik,pi->pk", moved, force).reshape(len(force), 2, self.dim)
        return out

    def motions(self, values: Floats) -> Floats:
        """Velocities (a, i) of the control points of those (2, i) of the reference nodes."""
        out: Floats = self.tangent @ values.reshape(-1)
        return out

    def blocks(self, places: Longs, blocks: Floats, first: int) -> tuple[Longs, Floats]:
        """Blocks in the unknowns of the pair's nodes.

        Args:
            places: (p, m) nodes of the blocks, the control points from number ``first`` on, in the
                same columns at all p.
            blocks: (p, m, i, n, j), N/m.

        Returns:
            Nodes (p, m′), with the reference nodes at ``first`` and after, and blocks.
        """
        control = places[0] >= first
        matrix = self._columns(places[0][control] - first)
        count, dim = len(places), self.dim
        flat = blocks[:, control].reshape(count, -1, blocks[0, 0, 0].size)
        rows = (matrix.T @ flat).reshape(count, 2, dim, *blocks.shape[3:])
        # Tᵀ K T in two products, rows first: no block of the size of all control points is made.
        half: Floats = np.concatenate([blocks[:, ~control], rows], axis=1)
        kept = half.shape[1]
        moved = half[:, :, :, control].reshape(count, kept, dim, -1) @ matrix
        columns = moved.reshape(count, kept, dim, 2, dim)
        tool = np.broadcast_to(first + np.arange(2), (count, 2))
        nodes = np.concatenate([places[:, ~control], tool], axis=1)
        return nodes, np.concatenate([half[:, :, :, ~control], columns], axis=3)

    def _columns(self, points: Longs) -> Floats:
        """T (m i, k) of control points (m,)."""
        return self.tangent[points].reshape(-1, 2 * self.dim)

    def bending(self, forces: Floats) -> Floats:
        """Block (1, 2, i, 2, j), N/m, of the angle, from forces (a, i), N, at control points."""
        # Only the angle, the first component of the second reference node, enters y_a nonlinearly.
        out = np.zeros((1, 2, self.dim, 2, self.dim))
        out[0, 1, 0, 1, 0] = np.sum(forces * self.bend)
        return out

    def operator(self, first: int) -> scipy.sparse.csr_matrix:
        """T of all unknowns (nodes and control points · i, nodes of the pair · i)."""
        nodes = scipy.sparse.identity(first * self.dim, format="csr")
        tool = self.tangent.reshape(-1, 2 * self.dim)
        return scipy.sparse.block_diag([nodes, tool], format="csr")
