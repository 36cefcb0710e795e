"""The compiled loops of a pair in the plane: its forces, and its tangent added where it belongs.

Axis letters as in :mod:`tribox.forms.contact.tangent`, whose formulas the loops have; they serve
meshed masters and tools, points that fade, and rays. What several ranks share, and rows that a
platen leads, are left to those formulas.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.contact.compiled_tangent import (
    Blocks,
    Entries,
    entries_of,
    packed,
    require_room,
    start_of,
)
from tribox.forms.contact.kinematics import Anchor, ContactKinematics
from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.state import ContactState, ContactTrial
from tribox.forms.contact.vertex_rows import Coupling
from tribox.forms.friction.law import FrictionState
from tribox.forms.native import library
from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.surface import ContactSurface

if TYPE_CHECKING:
    from tribox.forms.contact.tangent import PairTangent

SOURCE = "plane_pair.c"
_CORNERS, _MOVERS = 4, 4  # most that the loops have room for
_LONGS = ("corners", "movers", "first_master", "vertices")
_POINTERS = (
    *("weight", "shape", "slave_rows", "of_point", "vertex_shape", "around_start", "around"),
    *("chain_rows", "stencil", "signs", "turn", "bend"),
    *("facet", "share_of", "slope_of", "normal", "tangents", "distance", "curvature", "clamped"),
    *("chords", "share", "share_slope", "share_turn", "per_share"),
    *("position", "foot", "gap", "spring", "pressure_slope", "traction", "by_slip", "by_elastic"),
    *("by_pressure", "closed"),
    *("facet_before", "share_before", "slope_before", "anchor", "image", "slip_length"),
    *("needs", "area", "grown", "left"),
)
_KINDS = {
    **dict.fromkeys(("slave_rows", "of_point", "around_start", "around", "chain_rows"), np.int64),
    **dict.fromkeys(("stencil", "facet", "facet_before"), np.int32),
    **dict.fromkeys(("clamped", "closed", "needs"), np.uint8),
}


class _Pair(ctypes.Structure):
    """``Pair`` of the C source, field by field in the same order."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in _LONGS),
        *((name, ctypes.c_void_p) for name in _POINTERS),
    )


class CompiledPlane:
    """The loops for one pair."""

    def __init__(self, surface: ContactSurface) -> None:
        """Lay out what does not change."""
        self.surface, self._code = surface, library(SOURCE)
        self._code.tribox_plane_forces.restype = ctypes.c_double
        self._code.tribox_plane_kept_size.restype = ctypes.c_int64
        self._code.tribox_plane_pair_size.restype = ctypes.c_int64
        # A structure laid out otherwise in C would be read with its fields shifted: numbers, no
        # error.
        if self._code.tribox_plane_pair_size() != ctypes.sizeof(_Pair):
            raise RuntimeError(f"{SOURCE}: its structure Pair is not that of {__name__}")
        slave, target, vertices = surface.slave, surface.target, surface.vertices
        flat = vertices.of_point.reshape(-1)
        count = np.bincount(flat, minlength=vertices.count)
        self._room = max(1, int(count.max(initial=0))) * (_CORNERS + 2 * _MOVERS + 4)
        self._pair = _Pair(
            slave.shape.shape[1], target.stencil.shape[1], surface.first_master, vertices.count
        )
        self._alive: dict[str, NDArray[Any] | None] = {}
        self._set(
            weight=slave.weight,
            shape=slave.shape,
            slave_rows=surface.slave_rows,
            of_point=vertices.of_point,
            vertex_shape=vertices.shape,
            around_start=np.append(0, np.cumsum(count)),
            around=np.argsort(flat, kind="stable"),
            chain_rows=surface.chain_rows if surface.normals is not None else None,
            stencil=target.stencil,
            signs=surface.signs,
        )
        self._places = np.full((2, len(surface.nodes)), -1, dtype=np.int64)
        self._shares: tuple[Projection, Floats] | None = None  # of the trial seen last
        self._before: tuple[ContactState, Floats, Floats] | None = None  # of the state seen last

    def _set(self, **arrays: NDArray[Any] | None) -> None:
        """Give the structure arrays, which live as long as it has them."""
        for name, array in arrays.items():
            if array is not None and array is self._alive.get(name):
                continue
            kept = packed(array, _KINDS.get(name, np.float64))
            self._alive[name] = kept
            setattr(self._pair, name, None if kept is None else start_of(kept).value)

    def _see(self, trial: ContactTrial) -> None:
        """Take what forces depend on."""
        at, carried = trial.projection, trial.carried
        if self._shares is None or self._shares[0] is not at:
            self._shares = at, self.surface.target.weights(at.facet, at.xi)
        moved = (None, None) if carried is None else (carried.tangent[:, :, 2], carried.bend)
        self._set(
            facet=at.facet,
            share_of=self._shares[1],
            traction=trial.traction,
            turn=moved[0],
            bend=moved[1],
        )

    def _see_state(self, state: ContactState) -> tuple[Floats, Floats]:
        """Shares (q, m) of the place opposite at the last step, and slopes: found once a step."""
        if self._before is None or self._before[0] is not state:
            slopes = self.surface.target.slopes(state.facet, state.xi)[:, 0]
            shares = self.surface.target.weights(state.facet, state.xi) + state.ahead * slopes
            self._before = state, shares, slopes
        return self._before[1:]

    # -- slip ---------------------------------------------------------------------------------

    def relate(
        self,
        points: Floats,
        nodes: Floats,
        at: Projection,
        state: ContactState,
        closed: Bools,
        brought: tuple[FrictionState, Bools] | None = None,
    ) -> tuple[Anchor, ContactKinematics]:
        """As :func:`tribox.forms.contact.kinematics.relate`; the anchor of ``state`` as well.

        Args:
            points: (q, i), m, current; nodes: (n, i), m, current, that move the master.
            at: the points on the master.
            state: of the last step.
            closed: (q,) points in contact.
            brought: see :func:`tribox.forms.contact.shared_slave.brought_along`.
        """
        shares, slopes = self._see_state(state)
        components, length, more = state.slip_components, state.slip_length, None
        if brought is not None:
            slip, taken = brought[0].elastic_slip, brought[1]
            components = np.where(taken[:, None], 0.0, components)
            length = np.where(taken, np.linalg.norm(slip, axis=1), length)
            more = np.where(taken[:, None], slip, 0.0)
        if (images := self.surface.images) is not None:
            nodes = images.behind(nodes)
        self._set(
            position=points,
            foot=at.foot,
            normal=at.normal,
            distance=at.distance,
            clamped=at.clamped,
            closed=closed,
            facet_before=state.facet,
            share_before=shares,
            slope_before=slopes,
            slip_length=length,
            image=more,
        )
        given = packed(nodes), packed(components)
        anchor, image, slips, elastic = out = [np.empty_like(points) for _ in range(4)]
        count = ctypes.c_int64(len(points))
        self._code.tribox_plane_relate(
            ctypes.byref(self._pair), count, *map(start_of, (*given, *out))
        )
        moved = Anchor(anchor, components, image, length)
        return moved, ContactKinematics(at.normal, at.gap, closed, slips, elastic)

    # -- forces -------------------------------------------------------------------------------

    def forces(self, trial: ContactTrial) -> tuple[Floats, float]:
        """Residual (n, i), N/m, at the pair's nodes; sum of squares of what each point adds."""
        self._see(trial)
        out = np.zeros((len(self.surface.nodes), 2))
        count = ctypes.c_int64(len(trial.traction))
        squared = self._code.tribox_plane_forces(ctypes.byref(self._pair), count, start_of(out))
        if (images := self.surface.images) is not None:
            images.give_back(out, self.surface.first_master)
        return out, float(squared)

    # -- tangent ------------------------------------------------------------------------------

    def add(
        self, tangent: PairTangent, state: ContactState, trial: ContactTrial, entries: Entries
    ) -> tuple[Blocks, list[Coupling]] | None:
        """Add the tangent to a matrix; None: it was not, for others have a part in it.

        Raises:
            RuntimeError: the matrix has no room for an entry.
        """
        surface, rule = self.surface, tangent.rule
        first = packed(entries.first(surface.nodes), np.int32)
        if surface.vertices.comm.size > 1 or first.min(initial=0) < 0:
            return None
        averaged = isinstance(rule, AveragedPressure)
        take: Longs = np.nonzero(trial.coupled() if averaged else trial.kinematics.closed)[0]
        if not len(take):
            return [], []
        self._see(trial)
        self._set_point_fields(state, trial, averaged)
        self._set_vertex_fields(tangent, trial, averaged)
        made, _kept = entries_of(entries, first, first)
        kept = np.empty((len(take) if averaged else 0, self._code.tribox_plane_kept_size() // 8))
        both = ctypes.byref(self._pair), ctypes.byref(made)
        count = ctypes.c_int64(len(take))
        require_room(self._code.tribox_plane_points(*both, count, start_of(take), start_of(kept)))
        if averaged:
            slot = np.full(len(trial.traction), -1, dtype=np.int32)
            slot[take] = np.arange(len(take))
            numbers, sums = np.empty((3, self._room), np.int64), np.empty((2, self._room, 2))
            sizes = map(ctypes.c_int64, (len(surface.nodes), self._room))
            scratch = map(start_of, (self._places, numbers, sums))
            require_room(
                self._code.tribox_plane_vertices(
                    *both, start_of(slot), start_of(kept), *sizes, *scratch
                )
            )
        return [], []

    def _set_point_fields(self, state: ContactState, trial: ContactTrial, averaged: bool) -> None:
        """Fields of points that belong to a trial and the state before it."""
        at, response, anchor, target = (
            *(trial.projection, trial.response, trial.anchor, self.surface.target),
        )
        assert anchor is not None
        shares, slopes = self._see_state(state)
        stiffness = None if averaged else trial.normal_contact.stiffness
        self._set(
            slope_of=target.slopes(at.facet, at.xi),
            normal=trial.kinematics.normal,
            tangents=at.tangents,
            distance=at.distance,
            curvature=at.curvature,
            clamped=at.clamped,
            chords=None if at.rays is None else at.rays.change,
            position=trial.position,
            foot=at.foot,
            gap=at.gap,
            spring=trial.normal_contact.spring,
            pressure_slope=None if stiffness is None else -stiffness,
            by_slip=response.d_traction_d_slip,
            by_elastic=response.d_traction_d_elastic,
            by_pressure=response.d_traction_d_pressure,
            closed=trial.kinematics.closed,
            facet_before=state.facet,
            share_before=shares,
            slope_before=anchor.components * slopes,
            anchor=anchor.foot,
            image=anchor.slip_image,
            slip_length=anchor.slip_length,
        )

    def _set_vertex_fields(self, tangent: PairTangent, trial: ContactTrial, averaged: bool) -> None:
        """Fields of vertices, and of points that fade."""
        at, normal = trial.projection, trial.normal_contact
        every, fades = np.arange(len(trial.traction)), at.share_slope is not None
        grown = None
        if fades and normal.grows is not None and normal.gap is not None:
            grown = np.where(normal.grows, normal.gap, 0.0)
        self._set(
            share=at.share,
            share_slope=at.share_slope,
            share_turn=at.share_turn,
            per_share=tangent.per_share(trial, every) if fades else None,
            needs=normal.needs() if averaged else None,
            area=tangent.area_of(trial) if averaged else None,
            grown=grown,
            left=tangent.left_vectors(trial, every) if averaged else None,
        )


def compiled_plane(surface: ContactSurface) -> CompiledPlane | None:
    """The loops for a pair; None where they have no room for its facets."""
    sizes = surface.slave.shape.shape[1], surface.target.stencil.shape[1]
    fits = all(a <= b for a, b in zip(sizes, (_CORNERS, _MOVERS), strict=True))
    return CompiledPlane(surface) if fits else None
