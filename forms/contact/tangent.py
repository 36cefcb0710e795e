"""Slip, forces and tangent of one contact pair, by compiled loops.

With the rows G of the generalised coordinates z = (a, b_α, c, d) of
:mod:`tribox.forms.contact.kinematics`,

    K_c = −Gᵀ C G  +  Σ_A (1/m_A) L_A R_Aᵀ.

C is block diagonal per point: its rows a hold w ∂t/∂z at fixed averaged pressure, its rows b_β hold
−w t ⊗ ∂ξ^β/∂z, since the closest point moves under the load. The sum over the vertices is that of
the averaged pressure, with H_A = 1 where they are active and

    R_A = Σ_q w N_A G_aᵀ n = m_A ∂g_A/∂u,
    L_A = Σ_q w G_aᵀ (K_A H_A N_A (n − ∂T/∂t_N) + ∂T/∂χ ∂χ/∂g_A);

χ is the film's cover at the rim (:mod:`tribox.forms.contact.pressure`). Point by point there is no
such sum, and ∂t/∂z holds K_N ∂g/∂z.

Axis letters: q points of the slave, p some of them, g groups of points that touch the same facets,
k vertices of a slave facet, v vertices, m nodes that move a point, n nodes of the pair, i space.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from tribox.forms.contact.kinematics import Anchor, ContactKinematics
from tribox.forms.contact.pair_loops import (
    MOST,
    Entries,
    PairFields,
    Target,
    pair_library,
    require_room,
)
from tribox.forms.contact.pressure import AveragedPressure, NormalRule
from tribox.forms.contact.state import ContactState, ContactTrial
from tribox.forms.contact.vertex_rows import Coupling, NodeRows, completed
from tribox.forms.friction.law import FrictionState
from tribox.geometry.native.compiler import packed, start_of
from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.projection import FacetSurface, Projection
from tribox.geometry.surfaces.surface import ContactSurface

__all__ = ["Coupling", "PairTangent"]


@dataclass(frozen=True, slots=True)
class PointGroups:
    """Points ``take`` (p,) by groups: ``group`` (p,), and a point of each group (g,)."""

    take: Longs
    key: Longs  # (p,), the same within a group
    group: Longs
    point: Longs

    @classmethod
    def of(cls, take: Longs, key: Longs) -> PointGroups:
        """Points with the same ``key`` (p,) make up a group."""
        _, first, group = np.unique(key, return_index=True, return_inverse=True)
        return cls(take, key, group.reshape(-1).astype(np.int64), take[first])

    def ordered(self) -> tuple[Longs, Longs]:
        """Where the points of the groups begin, (g + 1,), and these points, one by one."""
        count = np.bincount(self.group, minlength=len(self.point))
        order = self.take[np.argsort(self.group, kind="stable")]
        return np.append(0, np.cumsum(count)).astype(np.int64), packed(order, np.int64)


class PairTangent:
    """The loops for one pair.

    Attributes:
        surface: of the pair; rule: from gaps to pressure.
    """

    def __init__(self, surface: ContactSurface, rule: NormalRule) -> None:
        """Lay out what does not change.

        Raises:
            ValueError: facets with more nodes than the loops have room for.
        """
        self.surface, self.rule = surface, rule
        self._code = pair_library(surface.dim)
        slave, target, vertices = surface.slave, surface.target, surface.vertices
        meshed = target if isinstance(target, FacetSurface) and surface.dim == 3 else None
        # In space the loops find the shares of a mesh's nodes themselves; others are given to them.
        self._given = meshed is None
        shapes = 0 if meshed is None else meshed.shape.count
        sizes = slave.shape.shape[1], target.stencil.shape[1], shapes
        if any(size > most for size, most in zip(sizes, MOST[surface.dim], strict=True)):
            raise ValueError(f"contact: facets with {sizes} corners, movers and shapes")
        self._pair = PairFields(
            **dict(zip(("corners", "movers", "shapes"), sizes, strict=True)),
            first_master=surface.first_master,
            vertices=vertices.of_point.shape[1],
        )
        self._pair.set(
            weight=slave.weight,
            shape=slave.shape,
            slave_rows=surface.slave_rows,
            of_point=vertices.of_point,
            vertex_shape=rule.shape if isinstance(rule, AveragedPressure) else vertices.shape,
            chain_rows=surface.chain_rows if surface.normals is not None else None,
            stencil=target.stencil,
            signs=surface.signs,
        )
        if meshed is not None:
            powers, coefficients = meshed.shape.polynomials
            self._pair.set(powers=powers, coefficients=coefficients, extraction=meshed.extraction)
        self._shares: tuple[Projection, Floats] | None = None  # of the trial seen last
        self._before: tuple[ContactState, Floats, Floats] | None = None  # of the state seen last
        self._groups: list[PointGroups] = []  # met last

    # -- slip -----------------------------------------------------------------------------------

    def relate(
        self,
        points: Floats,
        nodes: Floats,
        at: Projection,
        state: ContactState,
        closed: Bools,
        brought: tuple[FrictionState, Bools] | None = None,
    ) -> tuple[Anchor, ContactKinematics]:
        """Places of the last step, moved with the master, and slip since then.

        The slip of a step is as long as the way on a curved master. That of a point that closes
        within the step counts in full, from the place that it was opposite: a share of it would
        depend on penalty and step. An open point does not slip.

        Args:
            points: (q, i), m, current; nodes: (n, i), m, current, that move the master.
            at: the points on the master.
            state: of the last step.
            closed: (q,) points in contact.
            brought: see :func:`tribox.forms.contact.shared_slave.brought_along`.
        """
        components, length, more = state.slip_components, state.slip_length, None
        if brought is not None:
            slip, taken = brought[0].elastic_slip, brought[1]
            components = np.where(taken[:, None], 0.0, components)
            length = np.where(taken, np.linalg.norm(slip, axis=1), length)
            more = packed(np.where(taken[:, None], slip, 0.0))
        self._see_state(state)
        self._see_points(points, at, closed)
        self._pair.set(components=components, slip_length=length)
        anchor, image, way, elastic = out = [np.empty_like(points) for _ in range(4)]
        given = None
        if self._given:
            images = self.surface.images
            given = packed(nodes if images is None else images.behind(nodes))
        else:  # where they are is rounded as the feet of projections are
            foot, tangents = self.surface.target.places(state.facet, state.xi, nodes)
            anchor[:] = foot + np.einsum("qb,qbi->qi", state.ahead, tangents)
            image[:] = np.einsum("qb,qbi->qi", components, tangents)
            image += 0.0 if more is None else more
        arrays = (None if array is None else start_of(array) for array in (given, more))
        self._run("tribox_pair_relate", len(points), *arrays, *map(start_of, out))
        moved = Anchor(anchor, components, image, length)
        slips: Floats = np.where(closed[:, None], way, 0.0)
        return moved, ContactKinematics(at.normal, at.gap, closed, slips, way, elastic)

    # -- forces ---------------------------------------------------------------------------------

    def forces(self, trial: ContactTrial) -> tuple[Floats, float]:
        """Residual (n, i), N per unit thickness, at the pair's nodes.

        The second is the sum of the squares of what each point adds, but for moments on a tool,
        which grow with how far off its centre lies.
        """
        self._see(trial)
        out = np.zeros((len(self.surface.nodes), self.surface.dim))
        squared = self._run("tribox_pair_forces", len(trial.traction), start_of(out))
        if (images := self.surface.images) is not None:
            images.give_back(out, self.surface.first_master)
        return out, float(squared)

    # -- tangent --------------------------------------------------------------------------------

    def add(self, state: ContactState, trial: ContactTrial, entries: Entries) -> list[Coupling]:
        """Add the tangent to a part of a matrix; what is not in that part; collective.

        Raises:
            RuntimeError: the matrix has no room for an entry.
        """
        nodes = self.surface.nodes
        target = Target(entries, (nodes, nodes), self._code, self.surface.dim)
        self._see_all(state, trial)
        start, order = self._grouped(trial, state, trial.kinematics.closed).ordered()
        pair, width = self._pair.structure, self.surface.dim * (self._width + 2)
        scratch = np.empty(width * self.surface.dim * (pair.corners + pair.movers))
        arrays = map(start_of, (start, order, scratch))
        made = ctypes.byref(target.structure)
        require_room(self._run("tribox_pair_blocks", made, len(start) - 1, *arrays))
        out = target.beside()
        return [*out, *self._through_vertices(state, trial, entries)]

    def _through_vertices(
        self, state: ContactState, trial: ContactTrial, entries: Entries
    ) -> list[Coupling]:
        """Add Σ_A L_A R_Aᵀ/m_A to the matrix; what is not in it; collective."""
        if not isinstance(self.rule, AveragedPressure):
            return []
        surface, vertices = self.surface, self.surface.vertices
        left, right = self._sides(state, trial)
        columns = surface.nodes
        if vertices.comm.size > 1:  # at the seam of two ranks both need the whole R_A
            whole = right.matrix(len(columns))
            shared = vertices, vertices.of_point, columns, surface.dim
            matrix, columns = completed(whole, *shared)
            right = NodeRows.of(matrix, surface.dim)
        target = Target(entries, (surface.nodes, columns), self._code, surface.dim)
        self._add_product(left, right, self.area_of(trial), target)
        return target.beside()

    def _add_product(self, left: NodeRows, right: NodeRows, area: Floats, target: Target) -> None:
        rows, columns, dim = len(target.rows), len(target.columns), self.surface.dim
        counts = rows + 1, len(left.node), len(left.node), columns, columns
        scratch = [np.empty(count, dtype=np.int64) for count in counts]
        node_of, right_node = _one_each(target, right.node)
        # Components as vectors of four, which the loop multiplies and adds in one go.
        padded, sums = np.zeros((len(right.node), 4)), np.empty((columns, dim, 4))
        padded[:, :dim] = right.data
        lefts = left.indptr, left.node, packed(left.data)
        rights = right.indptr, right_node, padded
        area = packed(area)
        made = ctypes.byref(target.structure)
        require_room(
            self._code.tribox_add_product(
                *(made, ctypes.c_int64(len(area)), start_of(area), ctypes.c_int64(rows)),
                *(*map(start_of, lefts), ctypes.c_int64(columns), *map(start_of, rights)),
                *(*map(start_of, scratch), start_of(node_of), start_of(sums)),
            )
        )

    # -- rows of the vertices -------------------------------------------------------------------

    def vertex_sides(
        self, state: ContactState, trial: ContactTrial
    ) -> tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix]:
        """This rank's part of L_A/m_A = (1/m_A) ∂R_c/∂g_A and R_A = m_A ∂g_A/∂u (v, n·i).

        Their columns are the unknowns of the pair's nodes. Terms with unknowns of their own at the
        vertices take from them what these do to the bodies, and the gaps to them.
        """
        self._see_all(state, trial)
        left, right = (side.matrix(len(self.surface.nodes)) for side in self._sides(state, trial))
        left.data /= np.repeat(self.area_of(trial), np.diff(left.indptr))
        return left, right

    def _sides(self, state: ContactState, trial: ContactTrial) -> tuple[NodeRows, NodeRows]:
        """L and R, with the points whose gaps count: at the rim open ones too, see ``coupled``."""
        groups = self._grouped(trial, state, trial.coupled())
        known = self._places(groups, self.surface.vertices.of_point, trial.normal_contact.needs())
        vectors = self.left_vectors(trial, groups.take)
        vectors[~trial.kinematics.closed[groups.take]] = 0.0
        return self._rows(groups, known, vectors), self._gap_rows(trial, groups, known)

    def _grouped(self, trial: ContactTrial, state: ContactState, which: Bools) -> PointGroups:
        """Points (q,) that count, by the facets that they touch."""
        take = np.nonzero(which)[0]
        slave = self.surface.slave.facet[take].astype(np.int64)
        key = slave
        if trial.carried is None:
            # Those with the same two master facets, now and before, come one after the other.
            masters = np.int64(len(self.surface.target.stencil))
            slaves = np.int64(self.surface.slave.facet.max(initial=0)) + 1
            both = trial.projection.facet[take].astype(np.int64) * masters + state.facet[take]
            key = both * slaves + slave
        for known in self._groups:
            if np.array_equal(known.key, key) and np.array_equal(known.take, take):
                return known
        made = PointGroups.of(take, key)
        self._groups = [made, *self._groups[:1]]
        return made

    def _places(self, groups: PointGroups, of_point: Longs, needs: Bools) -> tuple[Any, ...]:
        """Row ends (v + 1,), nodes (e,) and the place (g, k, m) of the groups' entries.

        Args:
            groups: of points.
            of_point: (q, k) the rows that they have a part in.
            needs: (v,) rows that there are; others would fill products with zeros.
        """
        count, g, k = len(needs), len(groups.point), of_point.shape[1]
        size = self._gap_width
        indptr, node = np.empty(count + 1, dtype=np.int64), np.empty(g * k * size, dtype=np.int64)
        place = np.empty((g, k, size), dtype=np.int32)
        counts = len(self.surface.nodes), count + 1, g * k
        scratch = [np.empty(length, dtype=np.int64) for length in counts]
        point, of_point = packed(groups.point, np.int64), packed(of_point, np.int64)
        needed = packed(needs, np.uint8)
        self._run(
            "tribox_vertex_places",
            *(g, start_of(point), k, start_of(of_point), start_of(needed), count),
            *(len(self.surface.nodes), *map(start_of, scratch)),
            *(start_of(indptr), start_of(node), start_of(place)),
        )
        return indptr, node[: indptr[-1]], place

    def _rows(self, groups: PointGroups, known: tuple[Any, ...], along: Floats) -> NodeRows:
        """Σ_q w G_aᵀ d_A of the groups' points and vectors d (p, k, i)."""
        indptr, node, place = known
        data = np.zeros((len(node), self.surface.dim))
        take, along = packed(groups.take, np.int64), packed(along)
        arrays = start_of(take), start_of(groups.group), start_of(place)
        more = place.shape[1], start_of(along), start_of(data)
        self._run("tribox_vertex_rows", len(take), *arrays, *more)
        return NodeRows(indptr, node, self._signed(node, data))

    def _gap_rows(
        self, trial: ContactTrial, groups: PointGroups, known: tuple[Any, ...]
    ) -> NodeRows:
        """R: Σ_q w N_A ∂(σ g)/∂u of the groups' points, with σ their share over the master.

        Where a_A is what the master has, its change counts too: ∂g_A = (∂(σ g) − g_A ∂σ)/a_A.
        """
        (indptr, node, place), normal = known, trial.normal_contact
        grown = None
        if normal.grows is not None and normal.gap is not None:
            grown = packed(np.where(normal.grows, normal.gap, 0.0))
        data = np.zeros((len(node), self.surface.dim))
        take = packed(groups.take, np.int64)
        arrays = start_of(take), start_of(groups.group), start_of(place)
        mean = None if grown is None else start_of(grown)
        self._run("tribox_gap_rows", len(take), *arrays, mean, start_of(data))
        return NodeRows(indptr, node, self._signed(node, data))

    def slip_rows(self, take: Longs, along: Floats) -> tuple[Longs, Floats]:
        """Nodes (p, n) and the change (p, n, i) of the slips of points ``take`` along (p, i)."""
        width, dim = self._width, self.surface.dim
        nodes, values = np.zeros((len(take), width), np.int64), np.zeros((len(take), width, dim))
        take, along = packed(take, np.int64), packed(along)
        more = start_of(along), width, start_of(nodes), start_of(values)
        self._run("tribox_slip_rows", len(take), start_of(take), *more)
        signs = self.surface.signs
        return nodes, values if signs is None else signs[nodes] * values

    def _signed(self, node: Longs, data: Floats) -> Floats:
        """Entries (e, i) for images taken to the nodes that they are of."""
        return data if (signs := self.surface.signs) is None else signs[node] * data

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
            film = film_per_cover(trial, take)
            by_gap += normal.cover_slope[take][:, :, None] * film[:, None, :]
        return by_gap

    def _per_share(self, trial: ContactTrial) -> Floats:
        """∂t/∂σ (q, i), Pa: change of the traction with the share of a point over the master."""
        share, normal = trial.projection.share, trial.normal_contact
        assert share is not None
        per_share = np.where(share > 0.0, 1.0 / np.where(share > 0.0, share, 1.0), 0.0)
        by_pressure = trial.kinematics.normal - trial.response.d_traction_d_pressure
        out: Floats = (per_share * normal.spring)[:, None] * by_pressure
        if normal.cover is not None:
            cover = np.broadcast_to(normal.cover, share.shape)
            every = np.arange(len(share))
            out -= (per_share * cover)[:, None] * film_per_cover(trial, every)
        return out

    # -- what the loops read --------------------------------------------------------------------

    @property
    def _gap_width(self) -> int:
        """Nodes that a point's gap depends on."""
        pair = self._pair.structure
        master, rays = 2 if pair.turn else pair.movers, 4 if pair.chords else 0
        return int(pair.corners + master + rays)

    @property
    def _width(self) -> int:
        """Nodes that a point's slip depends on, at most."""
        return self._gap_width + int(self._pair.structure.movers)

    def _run(self, name: str, *arguments: Any) -> Any:
        """Call a loop; plain numbers are 64 bits long."""
        given = (ctypes.c_int64(a) if isinstance(a, int) else a for a in arguments)
        return getattr(self._code, name)(ctypes.byref(self._pair.structure), *given)

    def _see(self, trial: ContactTrial) -> None:
        """Take what forces depend on."""
        at, carried = trial.projection, trial.carried
        if self._given and (self._shares is None or self._shares[0] is not at):
            self._shares = at, self.surface.target.weights(at.facet, at.xi)
        dim = self.surface.dim
        self._pair.set(
            facet=at.facet,
            xi=at.xi,
            share_of=self._shares[1] if self._shares else None,
            traction=trial.traction,
            turn=None if carried is None else carried.tangent[:, :, dim],
            bend=None if carried is None else carried.bend,
        )

    def _see_points(self, points: Floats, at: Projection, closed: Bools) -> None:
        """Take what slips depend on: (q, i), m, and whether (q,) they are in contact."""
        self._pair.set(
            position=points,
            foot=at.foot,
            normal=at.normal,
            tangents=at.tangents,
            distance=at.distance,
            clamped=at.clamped,
            closed=closed,
        )

    def _see_state(self, state: ContactState) -> None:
        """Take the places of the last step: given shares are found once a step."""
        if self._given and (self._before is None or self._before[0] is not state):
            slopes = self.surface.target.slopes(state.facet, state.xi)
            ahead = np.einsum("qb,qbm->qm", state.ahead, slopes)
            shares = self.surface.target.weights(state.facet, state.xi) + ahead
            self._before = state, shares, slopes
        before = (None, None) if self._before is None else self._before[1:]
        self._pair.set(
            facet_before=state.facet,
            xi_before=state.xi,
            ahead=state.ahead,
            share_before=before[0],
            slope_before=before[1],
        )

    def _see_all(self, state: ContactState, trial: ContactTrial) -> None:
        """Take what the tangent depends on."""
        at, response, anchor = trial.projection, trial.response, trial.anchor
        normal = trial.normal_contact
        assert anchor is not None
        self._see(trial)
        self._see_state(state)
        self._see_points(trial.position, at, trial.kinematics.closed)
        # Pressures of points by themselves change with their own gaps; averaged ones with those of
        # all points around a vertex.
        slope = None
        if not isinstance(self.rule, AveragedPressure):
            assert normal.stiffness is not None
            slope = -normal.stiffness
        fades = at.share_slope is not None
        self._pair.set(
            slope_of=self.surface.target.slopes(at.facet, at.xi) if self._given else None,
            curvature=at.curvature,
            along=at.along,
            chords=None if at.rays is None else at.rays.change,
            share=at.share,
            share_slope=at.share_slope,
            share_turn=at.share_turn,
            per_share=self._per_share(trial) if fades else None,
            gap=at.gap,
            spring=normal.spring,
            pressure_slope=slope,
            by_slip=response.d_traction_d_slip,
            by_elastic=response.d_traction_d_elastic,
            by_pressure=response.d_traction_d_pressure,
            components=anchor.components,
            anchor=anchor.foot,
            image=anchor.slip_image,
            slip_length=anchor.slip_length,
        )


def _one_each(target: Target, node: Longs) -> tuple[NDArray[np.int32], Longs]:
    """Nodes of a matrix's columns (c,), and nodes (e,) with one number for each of these.

    The columns may hold some of them twice.
    """
    of_column = target.column_first
    there = np.nonzero(of_column >= 0)[0]
    node_of = np.full(target.size, -1, dtype=np.int32)
    node_of[of_column[there]] = there
    number = np.arange(len(of_column))
    number[there] = node_of[of_column[there]]
    return node_of, number[node]


def film_per_cover(trial: ContactTrial, take: Longs) -> Floats:
    """∂T/∂χ (p, i), Pa: the film's part of T is proportional to χ and along the slip."""
    slip = trial.kinematics.slip[take]
    assert trial.normal_contact.cover is not None
    cover = np.broadcast_to(trial.normal_contact.cover, trial.pressure.shape)[take]
    squared = np.einsum("pi,pi->p", slip, slip) * cover
    # Viscous work per |Δg_T|² and cover: the film's traction per slip for χ = 1.
    resistance = np.zeros_like(squared)
    viscous = trial.response.dissipation.viscous[take]
    np.divide(viscous, squared, out=resistance, where=squared > 0.0)
    return resistance[:, None] * slip
