"""The compiled loops of a pair in space: its forces, and its tangent added where it belongs.

Axis letters: q, p points, g groups of points that touch the same facets, k vertices of a slave
facet, m nodes that move a point, i space, v vertices, n nodes.

What the loops compute is that of :mod:`tribox.forms.contact.kinematics` and
:mod:`tribox.forms.contact.tangent`; those do what the loops leave: rows and columns that are not in
the matrix at hand as a whole.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.state import ContactState, ContactTrial
from tribox.forms.contact.vertex_rows import Coupling, NodeRows, completed, outside_parts
from tribox.forms.native import library
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
from tribox.geometry.surfaces.master import MasterFacets
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.surface import ContactSurface

if TYPE_CHECKING:
    from tribox.forms.contact.tangent import PairTangent

SOURCE = "contact_tangent.c"
_SHAPES, _MOVERS, _CORNERS = 16, 64, 9  # most that the loops have room for
_LONGS = ("shapes", "movers", "corners", "first_master", "vertices")
_MASTER = ("powers", "coefficients", "extraction", "stencil")
_SLAVE = ("signs", "weight", "shape", "slave_rows")
_TRIAL = (
    *("facet", "xi", "normal", "tangents", "gap", "curvature", "clamped", "along"),
    *("position", "foot", "spring", "pressure_slope", "traction", "by_slip", "by_elastic"),
    "by_pressure",
)
_STATE = ("facet_before", "xi_before", "ahead", "components", "anchor", "image", "slip_length")

Blocks = list[tuple[Longs, Floats]]


@dataclass(frozen=True, slots=True)
class PointGroups:
    """Points ``take`` (p,) by groups: ``group`` (p,), and a point of each group (g,)."""

    take: Longs
    group: Longs
    point: Longs

    @classmethod
    def of(cls, take: Longs, key: Longs) -> PointGroups:
        """Points with the same ``key`` (p,) make up a group."""
        _, first, group = np.unique(key, return_index=True, return_inverse=True)
        return cls(take, group.reshape(-1).astype(np.int64), take[first])

    def ordered(self, which: Bools) -> tuple[Longs, Longs]:
        """Where the points of some groups (g,) begin, (c + 1,), and these points, one by one."""
        here = which[self.group]
        order = np.argsort(self.group[here], kind="stable")
        count = np.bincount(self.group[here], minlength=len(which))[which]
        ends = np.append(0, np.cumsum(count)).astype(np.int64)
        return ends, np.ascontiguousarray(self.take[here][order])


class _Pair(ctypes.Structure):
    """``Pair`` of the C source, field by field in the same order."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in _LONGS),
        *((name, ctypes.c_void_p) for name in (*_MASTER, *_SLAVE, *_TRIAL, *_STATE)),
    )


class _Entries(ctypes.Structure):
    _fields_ = tuple(
        (name, ctypes.c_void_p)
        for name in ("indptr", "indices", "values", "row_first", "column_first")
    )


@dataclass(frozen=True, slots=True)
class Entries:
    """The part of a matrix that contacts may add to in place: rows and columns of one rank.

    Attributes:
        indptr, indices: its pattern, columns in ascending order; values: its values, N/m.
        first: from global nodes (n,) to the numbers (n,) int32 of their first unknowns in it; −1 of
            nodes that are not in it with all their unknowns, one after the other.
    """

    indptr: Ints
    indices: Ints
    values: Floats
    first: Callable[[Longs], Ints]


class CompiledTangent:
    """The loops for one pair."""

    def __init__(self, surface: ContactSurface, code: ctypes.CDLL) -> None:
        """Lay out what does not change.

        Args:
            surface: of the pair, see :func:`compiled_tangent`.
            code: the library of ``SOURCE``.
        """
        self.surface, self._code = surface, code
        code.tribox_tangent_pair_size.restype = ctypes.c_int64
        # A structure laid out otherwise in C would be read with its fields shifted: numbers, no
        # error.
        if code.tribox_tangent_pair_size() != ctypes.sizeof(_Pair):
            raise RuntimeError(f"{SOURCE}: its structure Pair is not that of {__name__}")
        code.tribox_nodal_forces.restype = ctypes.c_double
        target, slave = surface.target, surface.slave
        assert isinstance(target, FacetSurface)
        powers, coefficients = target.shape.polynomials
        self._fixed: dict[str, NDArray[Any] | None] = {
            "powers": packed(powers, np.int32),
            "coefficients": packed(coefficients),
            "extraction": packed(target.extraction),
            "stencil": packed(target.stencil, np.int32),
            "signs": packed(surface.signs),
            "weight": packed(slave.weight),
            "shape": packed(slave.shape),
            "slave_rows": packed(surface.slave_rows, np.int64),
        }
        self._sizes = {
            "shapes": target.shape.count,
            "movers": target.stencil.shape[1],
            "corners": slave.shape.shape[1],
            "first_master": surface.first_master,
            "vertices": surface.vertices.of_point.shape[1],
        }
        self._of_point = packed(surface.vertices.of_point, np.int64)

    # -- forces -------------------------------------------------------------------------------

    def forces(self, trial: ContactTrial) -> tuple[Floats, float]:
        """Residual (n, i), N, at the pair's nodes; the sum of squares of what each point adds."""
        at = trial.projection
        pair, _alive = self._pair(
            {"facet": at.facet, "xi": at.xi, "traction": trial.traction},
        )
        out = np.zeros((len(self.surface.nodes), 3))
        count = ctypes.c_int64(len(at.facet))
        squared = self._code.tribox_nodal_forces(ctypes.byref(pair), count, start_of(out))
        if (images := self.surface.images) is not None:
            images.give_back(out, self.surface.first_master)
        return out, float(squared)

    # -- tangent ------------------------------------------------------------------------------

    def add(
        self, tangent: PairTangent, state: ContactState, trial: ContactTrial, entries: Entries
    ) -> tuple[Blocks, list[Coupling]] | None:
        """Add the tangent to a part of a matrix; collective.

        Returns:
            What is not in that part: blocks of points, and couplings; None where points fade, and
            nothing was added.

        Raises:
            RuntimeError: the matrix has no room for an entry.
        """
        if trial.projection.share_slope is not None:
            return None
        first = packed(entries.first(self.surface.nodes), np.int32)
        closed = np.nonzero(trial.kinematics.closed)[0]
        pair, _alive = self._pair(self._varying(tangent, state, trial))
        groups = PointGroups.of(closed, tangent.point_facets(state, trial, closed))
        # Add the blocks of the groups whose nodes are all in the matrix; those of the others.
        nodes = self._nodes_of(groups.point, trial.projection.facet, state.facet)
        inside = np.all(first[nodes] >= 0, axis=1)
        ends, points = groups.ordered(inside)
        scratch = np.empty(9 * nodes.shape[1] ** 2)
        made, _kept = entries_of(entries, first, first)
        count = ctypes.c_int64(len(ends) - 1)
        require_room(
            self._code.tribox_add_point_blocks(
                ctypes.byref(pair),
                ctypes.byref(made),
                count,
                *map(start_of, (ends, points, scratch)),
            )
        )
        stayed = (trial.projection.facet == state.facet)[groups.point]
        # A point that stayed on its master facet has the same nodes now and at the last step: the
        # columns of the closest point ξ̄ and of the material point Ȳ_n fall together.
        folded = nodes[:, : nodes.shape[1] - self._sizes["movers"]]
        parts = (folded, ~inside & stayed), (nodes, ~inside & ~stayed)
        blocks = [self._blocks_of(pair, groups, *part) for part in parts if part[1].any()]
        if not isinstance(tangent.rule, AveragedPressure):
            return blocks, []
        sides = self._vertex_sides(tangent, state, trial, pair, groups)
        return blocks, self._add_product(*sides, tangent.area_of(trial), entries, first)

    def _vertex_sides(
        self,
        tangent: PairTangent,
        state: ContactState,
        trial: ContactTrial,
        pair: _Pair,
        groups: PointGroups,
    ) -> tuple[NodeRows, NodeRows]:
        """This rank's rows L_A and R_A, with the groups of closed points."""
        needs, closed = trial.normal_contact.needs(), groups.take
        places = self._vertex_places(pair, groups, needs)
        left = self._vertex_rows(pair, groups, places, tangent.left_vectors(trial, closed))
        coupled = np.nonzero(trial.coupled())[0]
        # Open points at the rim couple too, where the film's cover depends on their vertices' gaps.
        if len(coupled) != len(closed):
            groups = PointGroups.of(coupled, tangent.point_facets(state, trial, coupled))
            places = self._vertex_places(pair, groups, needs)
        normal = trial.kinematics.normal[coupled]
        along = self.surface.vertices.shape[coupled][:, :, None] * normal[:, None, :]
        right = self._vertex_rows(pair, groups, places, along)
        return left, right

    def _varying(
        self, tangent: PairTangent, state: ContactState, trial: ContactTrial
    ) -> dict[str, NDArray[Any] | None]:
        """Fields of the structure that belong to a trial and the state before it."""
        at, response, anchor = trial.projection, trial.response, trial.anchor
        assert anchor is not None
        # Pressures of points by themselves change with their own gaps, in the loops; averaged ones
        # with those of all points around a vertex, which come in as a product of matrices
        # afterwards.
        slope = None
        if not isinstance(tangent.rule, AveragedPressure):
            assert trial.normal_contact.stiffness is not None
            slope = -trial.normal_contact.stiffness
        return {
            "facet": at.facet,
            "xi": at.xi,
            "normal": at.normal,
            "tangents": at.tangents,
            "gap": at.distance,
            "curvature": at.curvature,
            "clamped": at.clamped,
            "along": at.along,
            "position": trial.position,
            "foot": at.foot,
            "spring": trial.normal_contact.spring,
            "pressure_slope": slope,
            "traction": trial.traction,
            "by_slip": response.d_traction_d_slip,
            "by_elastic": response.d_traction_d_elastic,
            "by_pressure": response.d_traction_d_pressure,
            "facet_before": state.facet,
            "xi_before": state.xi,
            "ahead": state.ahead,
            "components": anchor.components,
            "anchor": anchor.foot,
            "image": anchor.slip_image,
            "slip_length": anchor.slip_length,
        }

    def _pair(
        self, varying: dict[str, NDArray[Any] | None]
    ) -> tuple[_Pair, list[NDArray[Any] | None]]:
        """The structure with some fields, and the arrays that must live as long as it does."""
        kinds = {"facet": np.int32, "facet_before": np.int32, "clamped": np.uint8}
        arrays = dict(self._fixed)
        for name, array in varying.items():
            arrays[name] = packed(array, kinds.get(name, np.float64))
        pair = _Pair(**self._sizes)
        for name, array in arrays.items():
            setattr(pair, name, None if array is None else array.ctypes.data)
        return pair, list(arrays.values())

    def _nodes_of(self, point: Longs, now: Ints, before: Ints) -> Longs:
        """The pair's nodes (g, m) of points on the master facets (q,) now and at the last step."""
        surface, stencil = self.surface, self._fixed["stencil"]
        assert stencil is not None
        masters = [surface.first_master + stencil[facet[point]] for facet in (now, before)]
        return np.concatenate([surface.slave_rows[point], *masters], axis=1)

    def _blocks_of(
        self, pair: _Pair, groups: PointGroups, nodes: Longs, which: Bools
    ) -> tuple[Longs, Floats]:
        """Global nodes (p, m) and blocks (p, m, i, n, j) of some of the groups (g,)."""
        ends, points = groups.ordered(which)
        width = nodes.shape[1]
        blocks = np.zeros((len(ends) - 1, width, 3, width, 3))
        self._code.tribox_point_blocks(
            *(ctypes.byref(pair), ctypes.c_int64(len(blocks)), start_of(ends), start_of(points)),
            *(ctypes.c_int64(width), start_of(blocks)),
        )
        if (signs := self._fixed["signs"]) is not None:
            by_node = signs[nodes[which]]
            blocks = by_node[:, :, :, None, None] * blocks * by_node[:, None, None]
        return self.surface.nodes[nodes[which]], blocks

    def _vertex_places(self, pair: _Pair, groups: PointGroups, needs: Bools) -> tuple[Any, ...]:
        """Row ends (v + 1,), nodes (e,) and the place (g, k, m) of the groups' entries."""
        k, size = self._sizes["vertices"], self._sizes["corners"] + self._sizes["movers"]
        count, nodes, g = len(needs), len(self.surface.nodes), len(groups.point)
        indptr, node = np.empty(count + 1, dtype=np.int64), np.empty(g * k * size, dtype=np.int64)
        place = np.empty((g, k, size), dtype=np.int32)
        scratch = [np.empty(length, dtype=np.int64) for length in (nodes, count + 1, g * k)]
        point, needed = packed(groups.point, np.int64), packed(needs, np.uint8)
        self._code.tribox_vertex_places(
            *(
                ctypes.byref(pair),
                ctypes.c_int64(g),
                start_of(point),
                start_of(self._of_point),
                start_of(needed),
            ),
            *(ctypes.c_int64(count), ctypes.c_int64(nodes), *map(start_of, scratch)),
            *(start_of(indptr), start_of(node), start_of(place)),
        )
        return indptr, node[: indptr[-1]], place

    def _vertex_rows(
        self, pair: _Pair, groups: PointGroups, places: tuple[Any, ...], along: Floats
    ) -> NodeRows:
        """Σ_q w G_aᵀ d_A of the groups' points and vectors d (p, k, i)."""
        indptr, node, place = places
        data = np.zeros((len(node), 3))
        take, along = packed(groups.take, np.int64), packed(along)
        arrays = take, groups.group, place, along, data
        count = ctypes.c_int64(len(take))
        self._code.tribox_vertex_rows(ctypes.byref(pair), count, *map(start_of, arrays))
        signs = self._fixed["signs"]
        return NodeRows(indptr, node, data if signs is None else signs[node] * data)

    def _add_product(
        self, left: NodeRows, right: NodeRows, area: Floats, entries: Entries, first: Ints
    ) -> list[Coupling]:
        """Add Σ_A L_A R_Aᵀ/m_A to the matrix; what is not in it; collective."""
        vertices, nodes = self.surface.vertices, self.surface.nodes
        columns, of_column = nodes, first
        if vertices.comm.size > 1:
            right, columns = self._completed(right)
            of_column = packed(entries.first(columns), np.int32)
        made, _kept = entries_of(entries, first, of_column)
        counts = len(nodes) + 1, len(left.node), len(left.node), len(columns)
        scratch = [np.empty(count, dtype=np.int64) for count in counts]
        node_of, right_node = _one_each(of_column, len(entries.indptr) - 1, right.node)
        sums, area = np.empty((len(columns), 3, 4)), packed(area)
        # Three components as vectors of four, which the loop multiplies and adds in one go.
        padded = np.zeros((len(right.node), 4))
        padded[:, :3] = right.data
        require_room(
            self._code.tribox_add_product(
                *(ctypes.byref(made), ctypes.c_int64(vertices.count), start_of(area)),
                *(ctypes.c_int64(len(nodes)), *map(start_of, (left.indptr, left.node, left.data))),
                *(ctypes.c_int64(len(columns)), *map(start_of, (right.indptr, right_node, padded))),
                *(*map(start_of, scratch), start_of(node_of), start_of(sums)),
            )
        )
        outside = first < 0, of_column < 0
        if not (outside[0][left.node].any() or outside[1][right.node].any()):
            return []
        whole = left.matrix(len(nodes)), right.matrix(len(columns))
        # L_A R_Aᵀ/m_A: the loop divides by itself, here the rows of L take the division.
        whole[0].data /= np.repeat(area, np.diff(whole[0].indptr))
        return outside_parts(whole, (nodes, columns), outside)

    def _completed(self, right: NodeRows) -> tuple[NodeRows, Longs]:
        """R with the other ranks' parts of shared vertices, and its columns' nodes; collective."""
        surface, vertices = self.surface, self.surface.vertices
        matrix = right.matrix(len(surface.nodes))
        whole, columns = completed(matrix, vertices, vertices.of_point, surface.nodes, surface.dim)
        blocks = whole.tobsr(blocksize=(1, surface.dim))
        indptr, node = (packed(a, np.int64) for a in (blocks.indptr, blocks.indices))
        return NodeRows(indptr, node, packed(blocks.data.reshape(-1, surface.dim))), columns


def _one_each(of_column: Ints, count: int, node: Longs) -> tuple[Ints, Longs]:
    """One number for each node of ``of_column`` (n,), which may hold some of them twice."""
    there = np.nonzero(of_column >= 0)[0]
    node_of = np.full(count, -1, dtype=np.int32)
    node_of[of_column[there]] = there
    number = np.arange(len(of_column))
    number[there] = node_of[of_column[there]]
    return node_of, number[node]


def packed(array: Any, kind: Any = np.float64) -> Any:
    """An array as the loops read it, copied only where it is not; None stays None."""
    return None if array is None else np.ascontiguousarray(array, dtype=kind)


def start_of(array: NDArray[Any]) -> ctypes.c_void_p:
    """Where an array begins, for the loops."""
    return ctypes.c_void_p(array.__array_interface__["data"][0])


def entries_of(entries: Entries, rows: Ints, columns: Ints) -> tuple[_Entries, tuple[Any, ...]]:
    """The structure, and the arrays that must live as long as it does."""
    arrays = entries.indptr, entries.indices, entries.values, rows, columns
    return _Entries(*(array.ctypes.data for array in arrays)), arrays


def require_room(failed: int) -> None:
    """Refuse what loops could not add.

    Raises:
        RuntimeError: they failed.
    """
    if failed:
        raise RuntimeError("contact: an entry of the tangent is not in the matrix's pattern")


def compiled_tangent(surface: ContactSurface) -> CompiledTangent | None:
    """The loops for a pair; None in the plane and over rigid surfaces."""
    target = surface.target
    if surface.dim != 3 or not isinstance(target, FacetSurface):
        return None
    sizes = target.shape.count, target.stencil.shape[1], surface.slave.shape.shape[1]
    fits = all(a <= b for a, b in zip(sizes, (_SHAPES, _MOVERS, _CORNERS), strict=True))
    if not fits or not isinstance(surface.master, MasterFacets):
        return None
    return CompiledTangent(surface, library(SOURCE))
