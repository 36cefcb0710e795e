"""The tangent of one contact pair.

With the rows G of the generalised coordinates z = (a, b_α, c, d) of
:mod:`tribox.forms.contact.kinematics`,

    K_c = −Gᵀ C G  +  Σ_A (1/m_A) L_A R_Aᵀ.

C is block diagonal per point: its rows a hold w ∂t/∂z at fixed averaged pressure, its rows b_β hold
−w t ⊗ ∂ξ^β/∂z, since the closest point moves under the load. The sum over the vertices is that of
the averaged pressure, with H_A = 1 where they are active and

    R_A = Σ_q w N_A G_aᵀ n = m_A ∂g_A/∂u,
    L_A = Σ_q w G_aᵀ (K_A H_A N_A (n − ∂T/∂t_N) + ∂T/∂χ ∂χ/∂g_A),

one sparse product; χ is the film's cover at the rim (:mod:`tribox.forms.contact.pressure`). Point
by point there is no such sum, and ∂t/∂z holds K_N ∂g/∂z.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse

from tribox.forms.contact.kinematics import Variations, vary
from tribox.forms.contact.pressure import AveragedPressure, NormalRule
from tribox.forms.contact.state import ContactState, ContactTrial
from tribox.forms.contact.vertex_rows import Coupling, VertexRows, adding_up, completed
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
from tribox.geometry.surfaces.rigid_pieces import left_of
from tribox.geometry.surfaces.slave_points import CHORDS
from tribox.geometry.surfaces.surface import ContactSurface

__all__ = ["Coupling", "PairTangent"]

# Entries of point blocks that must be saved for a second group of them to pay for its overhead.
WORTH_FOLDING = 50_000


@dataclass(frozen=True, slots=True)
class PairTangent:
    """Makes the tangent of one pair."""

    surface: ContactSurface  # of the pair
    rule: NormalRule  # from gaps to pressure
    _known: dict[bool, list[VertexRows]] = field(
        default_factory=lambda: {False: [], True: []}, repr=False
    )

    @property
    def _places(self) -> int:
        """Number of the pair's nodes, those of a tool replaced by its control points."""
        return self.surface.first_master + len(self.surface.master.position)

    # -- point by point -----------------------------------------------------------------------

    def varied(self, trial: ContactTrial, take: Longs) -> Variations:
        """Variation of the kinematics of the closed points ``take`` (p,)."""
        assert trial.anchor is not None
        at, anchor = trial.projection.of(take), trial.anchor.of(take)
        return vary(trial.position[take], at, anchor)

    def traction_variation(self, trial: ContactTrial, take: Longs) -> tuple[Floats, Variations]:
        """∂t/∂z (p, i, r·j) of the closed points ``take`` (p,), and that of their kinematics.

        t = t_N n − T changes through gap, normal, slip and elastic slip; through an averaged
        pressure elsewhere, see :meth:`vertex_coupling`.
        """
        v = self.varied(trial, take)
        r, normal = trial.response, trial.kinematics.normal[take]
        out: Floats = trial.normal_contact.spring[take][:, None, None] * v.d_normal
        if not isinstance(self.rule, AveragedPressure):
            assert trial.normal_contact.stiffness is not None
            d_pressure = -trial.normal_contact.stiffness[take][:, None] * v.d_gap
            by_pressure = normal - r.d_traction_d_pressure[take]
            out += by_pressure[:, :, None] * d_pressure[:, None, :]
        out -= r.d_traction_d_slip[take] @ v.d_slip
        out -= r.d_traction_d_elastic[take] @ v.d_elastic
        if trial.projection.share_slope is not None:
            out += (
                self.per_share(trial, take)[:, :, None] * _share_variation(trial, take, v)[:, None]
            )
        return out, v

    def per_share(self, trial: ContactTrial, take: Longs) -> Floats:
        """∂t/∂σ (p, i), Pa: change of the traction with the share of a point over the master."""
        at, normal = trial.projection, trial.normal_contact
        assert at.share is not None
        share = at.share[take]
        per_share = np.where(share > 0.0, 1.0 / np.where(share > 0.0, share, 1.0), 0.0)
        by_pressure = trial.kinematics.normal[take] - trial.response.d_traction_d_pressure[take]
        out: Floats = (per_share * normal.spring[take])[:, None] * by_pressure
        if normal.cover is not None:
            cover = np.broadcast_to(normal.cover, at.share.shape)[take]
            out -= (per_share * cover)[:, None] * _film_per_cover(trial, take)
        return out

    def point_blocks(self, state: ContactState, trial: ContactTrial) -> list[tuple[Longs, Floats]]:
        """Global nodes (p, m) and the blocks −Gᵀ C G (p, m, i, n, j) of closed points.

        Points with the same nodes are added up where that saves much, and points that are still on
        the master facet of the last step need its nodes once only, so there may be two groups of
        blocks. Open points contribute nothing and are left out.
        """
        return self.blocks_of(state, trial, np.nonzero(trial.kinematics.closed)[0])

    def blocks_of(
        self, state: ContactState, trial: ContactTrial, take: Longs
    ) -> list[tuple[Longs, Floats]]:
        """The same of some closed points ``take`` (p,)."""
        if trial.carried is not None:
            return self._tool_blocks(state, trial, take) if len(take) else []
        size = self.surface.target.stencil.shape[1] * self.surface.dim
        stayed = trial.projection.facet[take] == state.facet[take]
        if trial.projection.rays is not None:
            return [self._blocks(state, trial, take)] if len(take) else []
        if 5 * np.count_nonzero(stayed) * size**2 < WORTH_FOLDING:
            return [self._blocks(state, trial, take)] if len(take) else []
        parts = [(take[stayed], True), (take[~stayed], False)]
        return [
            _added_up(
                self.point_facets(state, trial, part), *self._blocks(state, trial, part, folded)
            )
            for part, folded in parts
            if len(part)
        ]

    def _blocks(
        self, state: ContactState, trial: ContactTrial, take: Longs, folded: bool = False
    ) -> tuple[Longs, Floats]:
        """Nodes and blocks of points; ``folded``: their facet is still that of the last step."""
        places, blocks = self._placed_blocks(state, trial, take, folded)
        if (every := self.surface.signs) is not None:
            signs = every[places]
            blocks = signs[:, :, :, None, None] * blocks * signs[:, None, None]
        return self.surface.nodes[places], blocks

    def of_nodes(
        self, rows: scipy.sparse.csr_matrix, trial: ContactTrial
    ) -> scipy.sparse.csr_matrix:
        """Rows (v, m·i) for control points of a tool, or for images, taken to the pair's nodes."""
        if trial.carried is not None:
            return (rows @ trial.carried.operator(self.surface.first_master)).tocsr()
        if (signs := self.surface.signs) is not None:
            return (rows @ scipy.sparse.diags(signs.reshape(-1))).tocsr()
        return rows

    def _tool_blocks(
        self, state: ContactState, trial: ContactTrial, take: Longs
    ) -> list[tuple[Longs, Floats]]:
        """The same with a tool as master; points of a slave facet are added up."""
        surface, carried = self.surface, trial.carried
        assert carried is not None
        places, blocks = self._placed_blocks(state, trial, take)
        added = _added_up(surface.slave.facet[take].astype(np.int64), places, blocks)
        places, blocks = carried.blocks(*added, surface.first_master)
        at = trial.projection.of(take)
        force = surface.slave.weight[take][:, None] * trial.traction[take]
        bending = carried.bending(surface.target.weights(at.facet, at.xi).T @ force)
        return [(surface.nodes[places], blocks), (surface.nodes[None, -2:], bending)]

    def _placed_blocks(
        self, state: ContactState, trial: ContactTrial, take: Longs, folded: bool = False
    ) -> tuple[Longs, Floats]:
        """Numbers (p, m) of the pair's nodes, or control points after them, and blocks."""
        rows, places = self.generalised_rows(state, trial, take)
        if folded:
            m = self.surface.target.stencil.shape[1]
            last, rows, places = rows[:, :, -m:], rows[:, :, :-m].copy(), places[:, :-m]
            rows[:, :, -m:] += last
        q, coordinates, m = rows.shape
        dim = self.surface.dim
        lead = 1 + self.surface.shape.directions
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

    def point_facets(self, state: ContactState, trial: ContactTrial, take: Longs) -> Longs:
        """Number (p,) of the facets that a point couples: the present, the last and its own.

        Points with the same two master facets have numbers one after the other.
        """
        masters = np.int64(len(self.surface.target.stencil))
        slave, before = self.surface.slave.facet[take], state.facet[take]
        slaves = np.int64(self.surface.slave.facet.max(initial=0)) + 1
        return (trial.projection.facet[take] * masters + before) * slaves + slave

    def generalised_rows(
        self, state: ContactState, trial: ContactTrial, take: Longs
    ) -> tuple[Floats, Longs]:
        """Coefficients (q, r, m) of z = (a, b_α, c, d, f_e) on nodes of the pair (q, m)."""
        assert trial.anchor is not None
        slave, target = self.surface.slave, self.surface.target
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

    def _master_rows(self, facet: Ints) -> Longs:
        """Nodes of the pair (q, m) that move master facets (q,)."""
        rows: Longs = self.surface.first_master + self.surface.target.stencil[facet].astype(
            np.int64
        )
        return rows

    # -- averaged pressure --------------------------------------------------------------------

    def vertex_coupling(self, state: ContactState, trial: ContactTrial) -> Coupling | None:
        """The sum over the vertices; None point by point; collective.

        A vertex at the seam of two ranks needs the whole R_A on both: it is exchanged.
        """
        rule, normal = self.rule, trial.normal_contact
        if not isinstance(rule, AveragedPressure):
            return None
        assert normal.active is not None
        left, right = self.vertex_sides(state, trial)
        vertices, nodes = rule.vertices, self.surface.nodes
        right, columns = completed(right, vertices, vertices.of_point, nodes, self.surface.dim)
        return Coupling(nodes, columns, left.T.tocsr() @ right)

    def vertex_sides(
        self, state: ContactState, trial: ContactTrial
    ) -> tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix]:
        """This rank's part of L_A/m_A = (1/m_A) ∂R_c/∂g_A and R_A = m_A ∂g_A/∂u (v, n·i).

        Their columns are the unknowns of the pair's nodes. Terms with unknowns of their own at the
        vertices take from them what these do to the bodies, and the gaps to them.
        """
        take, needs = np.nonzero(trial.kinematics.closed)[0], trial.normal_contact.needs()
        left = self._vertex_rows(trial, take, self.left_vectors(trial, take), needs)
        left = self.of_nodes(left, trial)
        right = self.of_nodes(self._gap_rows(state, trial, needs), trial)
        left.data /= np.repeat(self.area_of(trial), np.diff(left.indptr))
        return left, right

    def area_of(self, trial: ContactTrial) -> Floats:
        """Area (v,) that the gaps of the vertices are averaged over."""
        area = trial.normal_contact.area
        return self.surface.vertices.area if area is None else area

    def left_vectors(self, trial: ContactTrial, take: Longs) -> Floats:
        """Vectors d (p, k, i), Pa/m, of L at closed points ``take`` (p,); L_A = Σ_q w G_aᵀ d_A."""
        rule, normal = self.rule, trial.normal_contact
        assert isinstance(rule, AveragedPressure) and normal.stiffness is not None
        vertices, direction = rule.vertices, trial.kinematics.normal[take]
        by_pressure = direction - trial.response.d_traction_d_pressure[take]
        share = vertices.shape[take] * normal.stiffness[vertices.of_point[take]]
        if trial.projection.share is not None:
            share *= trial.projection.share[take][:, None]
        by_gap: Floats = share[:, :, None] * by_pressure[:, None, :]
        if normal.cover_slope is not None:
            film = _film_per_cover(trial, take)
            by_gap += normal.cover_slope[take][:, :, None] * film[:, None, :]
        return by_gap

    def _vertex_rows(
        self, trial: ContactTrial, take: Longs, along: Floats, active: Bools
    ) -> scipy.sparse.csr_matrix:
        """Σ_q w G_aᵀ d_A (v, m·i) of the points ``take`` (p,) and vectors d (p, k, i)."""
        surface, slave = self.surface, self.surface.slave
        facet = trial.projection.facet[take]
        master = surface.target.weights(facet, trial.projection.xi[take])
        shape = np.concatenate([slave.shape[take], -master], axis=1)
        weighted = slave.weight[take][:, None] * shape
        values = weighted[:, None, :, None] * along[:, :, None, :]
        return self._rows(take, facet, active).matrix(values)

    def _rows(self, take: Longs, facet: Ints, needs: Bools, chords: bool = False) -> VertexRows:
        """Places of the entries of points ``take`` (p,) on their master facets (p,).

        With ``chords`` the vertices of the slave's chords are behind the facets' nodes.
        """
        kept = self._known[chords]
        for known in kept:
            if known.fits(take, facet, needs):
                return known
        surface = self.surface
        key = surface.slave.facet[take].astype(np.int64) * len(surface.target.stencil) + facet
        nodes = [surface.slave_rows[take], self._master_rows(facet)]
        nodes += [surface.chain_rows[take]] if chords else []
        numbers = key, surface.vertices.of_point[take], np.concatenate(nodes, axis=1)
        rows = VertexRows(take, facet, needs, numbers, (self._places, surface.dim))
        kept[:] = [rows, *kept[:1]]
        return rows

    def _gap_rows(
        self, state: ContactState, trial: ContactTrial, needs: Bools
    ) -> scipy.sparse.csr_matrix:
        """R: Σ_q w N_A ∂(σ g)/∂u (v, m·i) of all points, with σ their share over the master."""
        at, every = trial.projection, np.nonzero(trial.coupled())[0]
        fades: Bools = np.zeros(len(every), dtype=bool)
        if at.share is not None:
            fades[:] = at.share[every] < 1.0
        if at.rays is not None:
            fades[:] = True
        plain, other = every[~fades], every[fades]
        along = trial.kinematics.normal[plain][:, None, :]
        assert isinstance(self.rule, AveragedPressure)
        shape = self.rule.shape[plain][:, :, None]
        out = self._vertex_rows(trial, plain, shape * along, needs)
        return out + self._varied_gap_rows(state, trial, other, needs) if len(other) else out

    def _varied_gap_rows(
        self, state: ContactState, trial: ContactTrial, take: Longs, needs: Bools
    ) -> scipy.sparse.csr_matrix:
        """The same of points ``take`` (p,) for which ∂(σ g)/∂u is not G_aᵀ n."""
        assert trial.anchor is not None
        at = trial.projection
        v = vary(trial.position[take], at.of(take), trial.anchor.of(take))
        rows = self.generalised_rows(state, trial, take)[0]
        # The gap does not know where the point came from.
        m = self.surface.target.stencil.shape[1]
        first = self.surface.slave.shape.shape[1] + m
        rows = np.delete(rows, slice(first, first + m), axis=2)
        change = v.d_gap
        if at.share is not None and at.share_slope is not None:
            change = at.share[take][:, None] * v.d_gap
            change += at.gap[take][:, None] * _share_variation(trial, take, v)
        d_gap = change.reshape(len(take), rows.shape[1], self.surface.dim)
        assert isinstance(self.rule, AveragedPressure)
        share = self.surface.slave.weight[take][:, None] * self.rule.shape[take]
        values = np.einsum("pk,pmi->pkmi", share, np.einsum("prm,pri->pmi", rows, d_gap))
        normal = trial.normal_contact
        if normal.grows is not None and normal.gap is not None and at.share_slope is not None:
            # Where a_A is what the master has, its change counts too: ∂g_A = (∂(σ g) − g_A ∂σ)/a_A.
            of_share = _share_variation(trial, take, v).reshape(d_gap.shape)
            mean = np.where(normal.grows, normal.gap, 0.0)[self.surface.vertices.of_point[take]]
            less = np.einsum("prm,pri->pmi", rows, of_share)
            values -= np.einsum("pk,pmi->pkmi", share * mean, less)
        return self._rows(take, at.facet[take], needs, at.rays is not None).matrix(values)


def _share_variation(trial: ContactTrial, take: Longs, v: Variations) -> Floats:
    """∂σ/∂z (p, r·j) of the points' share over the master.

    What depends on the ray's normal n does so relative to the master, which turns by b·m/|τ|, with
    m its own normal: δσ = σ_,ξ δξ + σ_,n·(δn − J n b·m/|τ|), J a turn to the left.
    """
    at = trial.projection
    assert at.share_slope is not None
    out: Floats = np.einsum("pa,par->pr", at.share_slope[take], v.d_xi)
    if at.share_turn is None:
        return out
    by_normal, tau = at.share_turn[take], at.tangents[take, 0]
    out += np.einsum("pi,pir->pr", by_normal, v.d_normal)
    turned = np.einsum("pi,pi->p", by_normal, left_of(at.normal[take]))
    out[:, 2:4] -= (turned / np.einsum("pi,pi->p", tau, tau))[:, None] * left_of(tau)
    return out


def _film_per_cover(trial: ContactTrial, take: Longs) -> Floats:
    """∂T/∂χ (p, i), Pa: the film's part of T is proportional to χ and along the slip."""
    slip = trial.kinematics.slip[take]
    assert trial.normal_contact.cover is not None
    cover = np.broadcast_to(trial.normal_contact.cover, trial.pressure.shape)[take]
    squared = np.einsum("pi,pi->p", slip, slip) * cover
    # Viscous work per |Δg_T|² and cover: the film's traction per slip for χ = 1.
    resistance = np.zeros_like(squared)
    viscous = trial.response.dissipation.viscous[take]
    np.divide(viscous, squared, out=resistance, where=squared > 0.0)
    out: Floats = resistance[:, None] * slip
    return out


def _added_up(key: Longs, nodes: Longs, blocks: Floats) -> tuple[Longs, Floats]:
    """Nodes (p, m) and blocks (p, m, i, n, j) of points with the same ``key`` (q,), added up."""
    # The order of the axes in memory, so that nothing is copied.
    plain = blocks.transpose(0, 1, 2, 4, 3)
    first, adding = adding_up(key)
    added = (adding @ plain.reshape(len(key), -1)).reshape(len(first), *plain.shape[1:])
    return nodes[first], added.transpose(0, 1, 2, 4, 3)
