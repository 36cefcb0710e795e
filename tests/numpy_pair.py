"""The formulas of a contact pair's slip, forces and tangent in numpy, all points at once.

The program has them in compiled loops (forms/native/pair_tangent.h), which are compared with these.
Axis letters: q, p points, r generalised coordinates, m nodes of the pair that move a point, i, j
space, α, β surface directions, k vertices of a slave facet, v vertices. Each variation is a matrix
that multiplies z = (a, b_α, c, d, f_e) of tribox/forms/contact/kinematics.py.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse

from tribox.forms.contact.kinematics import Anchor, ContactKinematics, in_plane
from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.tangent import Coupling, film_per_cover
from tribox.forms.contact.vertex_rows import completed
from tribox.geometry.surfaces.rigid_pieces import left_of
from tribox.geometry.surfaces.slave_points import CHORDS


def _anchor_of(anchor, take):
    arrays = anchor.foot, anchor.components, anchor.slip_image, anchor.slip_length
    return Anchor(*(array[take] for array in arrays))


@dataclass(slots=True)
class Variations:
    """How the kinematics change with the generalised coordinates."""

    d_gap: np.ndarray  # (q, r·i): δg, which is n·a but along rays
    d_normal: np.ndarray  # (q, i, r·j)
    d_slip: np.ndarray  # likewise
    d_elastic: np.ndarray  # likewise
    d_xi: np.ndarray  # (q, α, r·j): ∂ξ^α/∂z


def _outer(u, v):
    out = u[:, :, None] * v[:, None, :]
    return out


def _dot(u, v):
    out = np.einsum("qi,qi->q", u, v)
    return out


def relate(points, projection, anchor, closed):
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


def vary(points, projection, anchor):
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

    length: np.ndarray  # v (q,), m, 1 where the slip is as it is
    sunk: np.ndarray  # ν (q,), m
    stretch: np.ndarray  # (q,)

    @classmethod
    def of(cls, slip, points, at, anchor):
        """Of images ``slip`` (q, i); across a corner, or clamped to an end, they stay."""
        length = np.sqrt(_dot(slip, slip))
        sunk = _dot(at.normal, points - anchor.foot) - at.distance
        # ν/v = tan(Δθ/2) of a master of constant curvature: a half of it is a turn by 53° within a
        # step, beyond which it is a corner.
        bent = ~at.clamped & (np.abs(sunk) < 0.5 * length)
        length, sunk = np.where(bent, length, 1.0), np.where(bent, sunk, 0.0)
        return cls(length, sunk, np.sqrt(1.0 + 4.0 / 3.0 * (sunk / length) ** 2))

    def vary(self, slip, d_slip, d_sunk):
        """Variation (q, i, r) of the longer slip from that of its image and of ν (q, r)."""
        slope = self.sunk / self.length
        along = slip / self.length[:, None]
        grown = d_sunk - slope[:, None] * np.einsum("qi,qir->qr", along, d_slip)
        grown *= (4.0 / 3.0 * slope / self.stretch)[:, None]
        out = self.stretch[:, None, None] * d_slip + _outer(along, grown)
        return out


def _apart(points, projection, anchor):
    """Way (q, i), m, from the last step's material point to the current place.

    Clamped to an edge or a corner the foot moves, not x: a motionless point in a groove, with a
    normal that turns freely, would slip.
    """
    if not projection.clamped.any():
        return points - anchor.foot
    return np.where(projection.clamped[:, None], projection.foot, points) - anchor.foot


def _vary_projection(projection, size):
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


def _vary_clamped(projection, at, size):
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


def _vary_along_rays(projection, rays, size: int):
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


def _inverse(matrix):
    """Inverses (q, α, α) of matrices of one or two rows."""
    if matrix.shape[1] == 1:
        return np.asarray(1.0 / matrix, dtype=np.float64)
    out = np.empty_like(matrix)
    out[:, 0, 0], out[:, 1, 1] = matrix[:, 1, 1], matrix[:, 0, 0]
    out[:, 0, 1], out[:, 1, 0] = -matrix[:, 0, 1], -matrix[:, 1, 0]
    determinant = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
    inverse = out / determinant[:, None, None]
    return inverse


def _vary_in_plane(n, v, d_normal):
    """The part of δ((I − n⊗n) v) that comes from the normal: −δn (n·v) − n (δn·v)."""
    out = -_dot(n, v)[:, None, None] * d_normal
    out -= n[:, :, None] * np.einsum("qi,qir->qr", v, d_normal)[:, None, :]
    return out


def _rescaled(image, anchor):
    """Scale L/|v| (q,) that keeps the length of the elastic slip, and |v|, 1 where there is none.

    The length L is kept: neither the projection nor a stretch of the master may create or lose
    elastic energy.
    """
    length = np.sqrt(_dot(image, image))
    alive = (length > 0.0) & (anchor.slip_length > 0.0)
    safe = np.where(alive, length, 1.0)
    return np.where(alive, anchor.slip_length, 0.0) / safe, safe


def _vary_transport(n, plane, anchor, d_normal, of_slip: slice):
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


# -- forces and tangent ----------------------------------------------------------------------------


class NumpyPair:
    """Slip, forces and tangent of a contact term."""

    def __init__(self, term):
        self.term, self.surface, self.rule = term, term.surface, term.rule

    def anchor(self, nodes):
        """Places of the last step on the master's ``nodes`` (n, i), m, without other masters."""
        state = self.term.state
        foot, tangents = self.surface.target.places(state.facet, state.xi, nodes)
        foot = foot + np.einsum("qb,qbi->qi", state.ahead, tangents)
        image = np.einsum("qb,qbi->qi", state.slip_components, tangents)
        return Anchor(foot, state.slip_components, image, state.slip_length)

    def nodal_forces(self, trial):
        """Global nodes (q, m) and the residual −Gᵀ(w t) there (q, m, i)."""
        slave, at = self.surface.slave, trial.projection
        master = self.surface.target.weights(at.facet, at.xi)
        force = -(slave.weight[:, None] * trial.traction)
        if trial.carried is not None:
            tool = np.broadcast_to(self.surface.master.nodes, (len(force), 2))
            own = slave.shape[:, :, None] * force[:, None, :]
            parts = own, trial.carried.forces(master, -force)
            return np.concatenate([slave.nodes, tool], axis=1), np.concatenate(parts, axis=1)
        shape = np.concatenate([slave.shape, -master], axis=1)
        moved = self.surface.master.nodes[self.surface.target.stencil[at.facet]]
        nodes = np.concatenate([slave.nodes, moved], axis=1)
        values = shape[:, :, None] * force[:, None, :]
        if (images := self.surface.images) is None:
            return nodes, values
        # Forces on images are their nodes'; what that turns round comes from the planes.
        rows = self.surface.target.stencil[at.facet]
        own = len(self.surface.master.nodes) - len(images.of)
        image, is_image = np.maximum(rows - own, 0), rows >= own
        signs = np.where(is_image[:, :, None], images.signs[image], 1.0)
        beyond = values[:, slave.shape.shape[1] :]
        turned = (1.0 - signs) * beyond
        beyond *= signs
        every = [values]
        for axis in range(self.surface.dim):
            only = np.zeros_like(turned)
            only[:, :, axis] = turned[:, :, axis]
            plane = np.where(is_image, images.across[image, axis], rows)
            nodes = np.concatenate([nodes, self.surface.master.nodes[plane]], axis=1)
            every.append(only)
        return nodes, np.concatenate(every, axis=1)

    # -- point by point ---------------------------------------------------------------------------

    def varied(self, trial, take):
        at, anchor = trial.projection.of(take), _anchor_of(trial.anchor, take)
        return vary(trial.position[take], at, anchor)

    def traction_variation(self, trial, take):
        """∂t/∂z (p, i, r·j) at fixed averaged pressure, and that of the kinematics."""
        v = self.varied(trial, take)
        r, normal = trial.response, trial.kinematics.normal[take]
        out = trial.normal_contact.spring[take][:, None, None] * v.d_normal
        if not isinstance(self.rule, AveragedPressure):
            d_pressure = -trial.normal_contact.stiffness[take][:, None] * v.d_gap
            by_pressure = normal - r.d_traction_d_pressure[take]
            out += by_pressure[:, :, None] * d_pressure[:, None, :]
        out -= r.d_traction_d_slip[take] @ v.d_slip
        out -= r.d_traction_d_elastic[take] @ v.d_elastic
        if trial.projection.share_slope is not None:
            per_share = self.per_share(trial, take)
            out += per_share[:, :, None] * _share_variation(trial, take, v)[:, None]
        return out, v

    def per_share(self, trial, take):
        """∂t/∂σ (p, i), Pa: change of the traction with the share of a point over the master."""
        at, normal = trial.projection, trial.normal_contact
        share = at.share[take]
        per_share = np.where(share > 0.0, 1.0 / np.where(share > 0.0, share, 1.0), 0.0)
        by_pressure = trial.kinematics.normal[take] - trial.response.d_traction_d_pressure[take]
        out = (per_share * normal.spring[take])[:, None] * by_pressure
        if normal.cover is not None:
            cover = np.broadcast_to(normal.cover, at.share.shape)[take]
            out -= (per_share * cover)[:, None] * film_per_cover(trial, take)
        return out

    def point_blocks(self, trial):
        """Global nodes (p, m) and the blocks −Gᵀ C G (p, m, i, n, j) of closed points."""
        take = np.nonzero(trial.kinematics.closed)[0]
        if not len(take):
            return []
        surface = self.surface
        places, blocks = self._placed_blocks(trial, take)
        if trial.carried is not None:
            places, blocks = _carried_blocks(trial.carried, places, blocks, surface.first_master)
            at = trial.projection.of(take)
            force = surface.slave.weight[take][:, None] * trial.traction[take]
            bending = trial.carried.bending(surface.target.weights(at.facet, at.xi).T @ force)
            return [(surface.nodes[places], blocks), (surface.nodes[None, -2:], bending)]
        if (every := surface.signs) is not None:
            signs = every[places]
            blocks = signs[:, :, :, None, None] * blocks * signs[:, None, None]
        return [(surface.nodes[places], blocks)]

    def _placed_blocks(self, trial, take):
        rows, places = self.generalised_rows(trial, take)
        q, coordinates, m = rows.shape
        dim, lead = self.surface.dim, 1 + self.surface.shape.directions
        weight = self.surface.slave.weight[take]
        # Only rows a and b carry virtual work.
        load = np.empty((q, lead, dim, coordinates * dim))
        d_traction, v = self.traction_variation(trial, take)
        load[:, 0] = weight[:, None, None] * d_traction
        # Geometric stiffness: in the virtual work t·(δu¹ − δu²(ξ̄)) the place moves, −t·δu²,β Δξ^β.
        moved = weight[:, None] * trial.traction[take]
        load[:, 1:] = -moved[:, None, :, None] * v.d_xi[:, :, None, :]
        left = rows[:, :lead].transpose(0, 2, 1) @ load.reshape(q, lead, -1)
        left = left.reshape(q, m * dim, coordinates, dim).transpose(0, 1, 3, 2)
        blocks = -(left.reshape(q, m * dim * dim, coordinates) @ rows)
        return places, blocks.reshape(q, m, dim, dim, m).transpose(0, 1, 2, 4, 3)

    def generalised_rows(self, trial, take):
        """Coefficients (q, r, m) of z = (a, b_α, c, d, f_e) on nodes of the pair (q, m)."""
        slave, target, state = self.surface.slave, self.surface.target, self.term.state
        xi, facet = trial.projection.xi[take], trial.projection.facet[take]
        mine = slave.shape[take]
        count, a = mine.shape
        surface, m = xi.shape[1], target.stencil.shape[1]
        lead = 1 + surface
        rows = np.zeros((count, lead + 2, a + 2 * m))
        now, before = slice(a, a + m), slice(a + m, a + 2 * m)
        # Rows in the order of z: a = N¹ − N²(ξ̄), b_α = N²,α(ξ̄), c = N¹ − N²(Ȳ_n) with Ȳ_n moved
        # on by `ahead` along the tangents, d = e^α N²,α(Ȳ_n).
        rows[:, 0, :a] = mine
        rows[:, 0, now] = -target.weights(facet, xi)
        rows[:, 1:lead, now] = target.slopes(facet, xi)
        rows[:, lead, :a] = mine
        last = state.facet[take], state.xi[take]
        slopes = target.slopes(*last)
        rows[:, lead, before] = -target.weights(*last)
        rows[:, lead, before] -= np.einsum("qb,qbm->qm", state.ahead[take], slopes)
        rows[:, lead + 1, before] = np.einsum("qb,qbm->qm", trial.anchor.components[take], slopes)
        nodes = [self.surface.slave_rows[take], *map(self._master_rows, (facet, last[0]))]
        if trial.projection.rays is None:
            return rows, np.concatenate(nodes, axis=1)
        chords = np.zeros((count, lead + 4, a + 2 * m + 4))
        chords[:, :-2, :-4] = rows
        chords[:, -2:, -4:] = CHORDS
        return chords, np.concatenate([*nodes, self.surface.chain_rows[take]], axis=1)

    def _master_rows(self, facet):
        return self.surface.first_master + self.surface.target.stencil[facet].astype(np.int64)

    # -- averaged pressure ------------------------------------------------------------------------

    def coupling(self, trial):
        """The sum over the vertices; None point by point; collective."""
        if not isinstance(self.rule, AveragedPressure):
            return None
        take, needs = np.nonzero(trial.kinematics.closed)[0], trial.normal_contact.needs()
        at, surface, vertices = trial.projection, self.surface, self.rule.vertices
        facet = at.facet[take]
        master = surface.target.weights(facet, at.xi[take])
        shape = np.concatenate([surface.slave.shape[take], -master], axis=1)
        nodes = np.concatenate([surface.slave_rows[take], self._master_rows(facet)], axis=1)
        along = self.term.linearised.left_vectors(trial, take)
        values = shape[:, None, :, None] * along[:, :, None, :]
        left = self._of_nodes(self._rows(take, values, nodes, needs), trial)
        right = self._of_nodes(self._gap_rows(trial, needs), trial)
        area = vertices.area if trial.normal_contact.area is None else trial.normal_contact.area
        left.data /= np.repeat(area, np.diff(left.indptr))
        right, columns = completed(right, vertices, vertices.of_point, surface.nodes, surface.dim)
        return Coupling(surface.nodes, columns, left.T.tocsr() @ right)

    def _of_nodes(self, rows, trial):
        """Rows (v, m·i) for control points of a tool, or for images, taken to the pair's nodes."""
        if trial.carried is not None:
            return (rows @ trial.carried.operator(self.surface.first_master)).tocsr()
        if (signs := self.surface.signs) is not None:
            return (rows @ scipy.sparse.diags(signs.reshape(-1))).tocsr()
        return rows

    def _rows(self, take, values, nodes, needs):
        """Rows (v, m·i) of w times values (p, k, m, i) at nodes (p, m)."""
        surface, dim = self.surface, self.surface.dim
        values = surface.slave.weight[take][:, None, None, None] * values
        values = values * needs[surface.vertices.of_point[take]][:, :, None, None]
        row, column = np.broadcast_arrays(
            surface.vertices.of_point[take][:, :, None, None],
            dim * nodes[:, None, :, None] + np.arange(dim),
        )
        size = len(needs), dim * (surface.first_master + len(surface.master.position))
        place = row.reshape(-1), column.reshape(-1)
        return scipy.sparse.csr_matrix((values.reshape(-1), place), shape=size)

    def _gap_rows(self, trial, needs):
        """R: Σ_q w N_A ∂(σ g)/∂u (v, m·i) of all points that count."""
        at, take = trial.projection, np.nonzero(trial.coupled())[0]
        v = self.varied(trial, take)
        rows, nodes = self.generalised_rows(trial, take)
        change, shape = v.d_gap, self.rule.shape[take]
        if at.share is not None and at.share_slope is not None:
            of_share = _share_variation(trial, take, v)
            change = at.share[take][:, None] * v.d_gap + at.gap[take][:, None] * of_share
        size = len(take), rows.shape[1], self.surface.dim
        values = np.einsum("pk,prm,pri->pkmi", shape, rows, change.reshape(size))
        normal = trial.normal_contact
        if normal.grows is not None and normal.gap is not None and at.share_slope is not None:
            # Where a_A is what the master has, its change counts too.
            mean = np.where(normal.grows, normal.gap, 0.0)[self.surface.vertices.of_point[take]]
            less = np.einsum("prm,pri->pmi", rows, of_share.reshape(size))
            values -= np.einsum("pk,pmi->pkmi", shape * mean, less)
        return self._rows(take, values, nodes, needs)


def _share_variation(trial, take, v):
    """∂σ/∂z (p, r·j) of the points' share over the master.

    What depends on the ray's normal n does so relative to the master, which turns by b·m/|τ|, with
    m its own normal: δσ = σ_,ξ δξ + σ_,n·(δn − J n b·m/|τ|), J a turn to the left.
    """
    at = trial.projection
    out = np.einsum("pa,par->pr", at.share_slope[take], v.d_xi)
    if at.share_turn is None:
        return out
    by_normal, tau = at.share_turn[take], at.tangents[take, 0]
    out += np.einsum("pi,pir->pr", by_normal, v.d_normal)
    turned = np.einsum("pi,pi->p", by_normal, left_of(at.normal[take]))
    out[:, 2:4] -= (turned / np.einsum("pi,pi->p", tau, tau))[:, None] * left_of(tau)
    return out


def _carried_blocks(carried, places, blocks, first):
    """Blocks (p, m, i, n, j) of control points taken to the unknowns of a tool."""
    control = places[0] >= first
    matrix = carried.tangent[places[0][control] - first].reshape(-1, 2 * carried.dim)
    count, dim = len(places), carried.dim
    flat = blocks[:, control].reshape(count, -1, blocks[0, 0, 0].size)
    rows = (matrix.T @ flat).reshape(count, 2, dim, *blocks.shape[3:])
    half = np.concatenate([blocks[:, ~control], rows], axis=1)
    kept = half.shape[1]
    columns = half[:, :, :, control].reshape(count, kept, dim, -1) @ matrix
    columns = columns.reshape(count, kept, dim, 2, dim)
    tool = np.broadcast_to(first + np.arange(2), (count, 2))
    nodes = np.concatenate([places[:, ~control], tool], axis=1)
    return nodes, np.concatenate([half[:, :, :, ~control], columns], axis=3)
