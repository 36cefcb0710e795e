"""An explicit contact pair, in the plane or in space, whose geometry and loads are compiled.

The friction law stays the one of numpy, and so does the way from the gaps at the slave's vertices
to their pressures; everything else is two passes over the points in ``contact_pair.h``. Two sets
of arrays take turns, so that a step allocates almost nothing and the results of the step before
stay readable.
"""

from __future__ import annotations

import ctypes
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.contact.explicit import ExplicitContact, ExplicitTie
from tribox.forms.contact.kinematics import ContactKinematics
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import ROUNDOFF_DEPTH, TOUCHING, AveragedPressure
from tribox.forms.contact.state import (
    ContactMode,
    ContactState,
    ContactTrial,
    Fading,
    NormalContact,
)
from tribox.forms.contact.tie import TieTerm
from tribox.forms.native import library
from tribox.geometry.native.compiler import require_size
from tribox.geometry.surfaces.facet_search import TIE
from tribox.geometry.surfaces.facets import Floats, Ints
from tribox.geometry.surfaces.master import MasterFacets
from tribox.geometry.surfaces.projection import FacetSurface, Projection
from tribox.geometry.surfaces.surface import NodalVector


class CompiledContact(ExplicitContact):
    """See :class:`tribox.forms.contact.explicit.ExplicitContact`; the same results to round-off."""

    def __init__(self, term: ContactTerm, code: ctypes.CDLL) -> None:
        """Lay out the arrays; collective; ``code``: the library of its source in ``SOURCES``."""
        require_size(code.tribox_pair_size(), PairStructure, "contact_pair.h")
        super().__init__(term)
        self._code = code
        code.tribox_pair_hold_film.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
        code.tribox_pair_correct_film.argtypes = [ctypes.c_void_p, ctypes.c_double]
        code.tribox_pair_commit.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        self._adopted: ContactState | None
        self._lay_out()
        self._turn = 0
        self._nothing_ahead = np.zeros_like(term.state.ahead)

    def _lay_out(self) -> None:
        """Make the arrays that the loops work on, over the master's facets that are known."""
        term, self._load, self._adopted = self.term, np.zeros_like(self._values), None
        self._inputs = {n: np.ascontiguousarray(a) for n, a in self._input_arrays().items()}
        q, n = len(term.surface.slave.weight), len(term.surface.master.nodes)
        self._sets = [PairArrays(q, n, term.surface.dim) for _ in range(2)]
        for mine, other in (self._sets, self._sets[::-1]):
            self._connect(mine, other)

    def _input_arrays(self) -> dict[str, NDArray[Any]]:
        """What both sets of results read, by the fields of the structure."""
        surface = self.term.surface
        slave, master, vertices = surface.slave, surface.master, surface.vertices
        assert isinstance(master, MasterFacets)
        q, n, dim = len(slave.weight), len(master.nodes), surface.dim
        # Arrays that this object writes into (values, film, dry, damping) are read by the loops
        # where they lie: a step passes nothing but the address of the structure. Places of the last
        # search are infinite, so that the first step searches.
        return {
            "weight": slave.weight,
            "shape": slave.shape,
            "slope": slave.shape_derivative,
            "reference": slave.position,
            "direction": slave.tangents,
            "rows": self.exchange.slave_rows.astype(np.int64),
            "master": master.position,
            "facets": master.facets.astype(np.int32),
            "penalty": self.term.rule.point_stiffness(),
            "damping": np.zeros(q),
            "reach": slave.reach,
            "of_point": vertices.of_point.astype(np.int64),
            "vertex_shape": vertices.shape,
            "sums": np.zeros((2, vertices.count)),
            "nodal_pressure": np.zeros(vertices.count),
            "active": np.zeros(vertices.count, dtype=np.bool_),
            "values": self._values,
            "load": self._load,
            "searched_points": np.full((q, dim), np.inf),
            "searched_nodes": np.full((n, dim), np.inf),
            "tau": self.film_traction,
            "film": self.film,
            "dry": self._dry,
            "compliance": self.compliance,
            "candidate": np.zeros((q, 1), dtype=np.int32),
            **_neighbours(surface.target, master, q),
        }

    def _connect(self, mine: PairArrays, other: PairArrays) -> None:
        """Make one set start from the state that the other one holds."""
        pair, surface = mine.pair, self.term.surface
        pair.points, pair.corners = self._inputs["shape"].shape
        pair.facet_count, pair.facet_nodes = self._inputs["facets"].shape
        pair.nodes, pair.first_master = len(surface.master.nodes), self.exchange.first_master
        pair.vertices = surface.vertices.count
        pair.facet_vertices = self._inputs["of_point"].shape[1]
        pair.averaged = isinstance(self.term.rule, AveragedPressure)
        pair.touching, pair.roundoff = TOUCHING, ROUNDOFF_DEPTH
        pair.candidates, pair.tie = 1, TIE * surface.target.search.slack
        for name, array in self._inputs.items():
            mine.point(name, array)
        if "around" in self._inputs:
            pair.around_most = self._inputs["around"].shape[1]
        for before, result in BEFORE.items():
            mine.point(before, other.arrays[result])

    def _take_over(self, other: PairArrays) -> None:
        """Copy the term's state into the arrays that the next step reads, unless it is there."""
        state = self.term.state
        if state is self._adopted:
            return
        for name, value in (
            ("facet", state.facet),
            ("xi", state.xi + state.ahead),  # facets go on straight: the place opposite
            ("component", state.slip_components),
            ("length", state.slip_length),
            ("present", state.share),
            ("sunk", state.sunk),
        ):
            other.arrays[name][:] = value
        self._adopted = state

    def evaluate(self, u: NodalVector, dt: float, rate_dependent: bool = True) -> ContactTrial:
        if self._gather(u):
            self._lay_out()
        now, term, mode = self._sets[self._turn], self.term, self._mode(dt)
        self._take_over(self._sets[1 - self._turn])
        if self._code.tribox_pair_project(now.at):
            self.search_at(now.arrays["position"], now.arrays["current"])
            self._code.tribox_pair_project(now.at)
        normal = self._press(now, mode)
        self._enter_damping(normal, now.arrays["gap"], mode)
        arrays = now.arrays
        kinematics = now.kinematics()
        # The law itself is numpy's, between two loops: they have made what it is called with, and
        # add its traction to the pressure's.
        film = term.film.at(normal.pressure)[0]
        projection = now.projection()
        normal.cover = None
        if term.has_film:
            term.cover_rim(normal, projection)
        response = term.respond(kinematics, dt, normal, film, rate_dependent, look_inside=False)
        self._dry[:] = response.traction
        self._code.tribox_pair_load(now.at)
        self.trial = ContactTrial(
            position=arrays["position"],
            area_ratio=arrays["area_ratio"],
            projection=projection,
            kinematics=kinematics,
            normal_contact=normal,
            film=film,
            traction=arrays["traction"],
            response=response,
            dt=dt,
            faded=now.fading(),
        )
        return self.trial

    def _press(self, now: PairArrays, mode: ContactMode) -> NormalContact:
        """Pressure of the points that have been projected, and their kinematics; collective."""
        rule, inputs, arrays = self.term.rule, self._inputs, now.arrays
        gap = nodal = active = damping = None
        if isinstance(rule, AveragedPressure):
            gaps, covered = rule.vertices.total(inputs["sums"])
            gap, active, nodal, _ = rule.at_vertices(gaps, covered, mode, ROUNDOFF_DEPTH)
            if mode.dashpots is not None:
                damping = mode.dashpots.pressure(gap, nodal)
                nodal = nodal + damping
            # Between the two passes: gaps are summed over the points (and ranks) of a vertex, the
            # law of the penalty is numpy's, and the second pass takes its pressures to the points.
            inputs["nodal_pressure"][:] = nodal if self.term.active else 0.0
            inputs["active"][:] = active & self.term.active
        elif mode.dashpots is not None:
            spring = -rule.penalty * arrays["gap"]
            damping = mode.dashpots.pressure(arrays["gap"], spring)
            inputs["damping"][:] = damping
        self._code.tribox_pair_relate(now.at)
        pressure = arrays["pressure"]
        if gap is None and damping is not None:
            damping = np.where(arrays["closed"], damping, 0.0)
        normal = NormalContact(
            arrays["closed"], pressure, pressure, gap, nodal, active, damping=damping
        )
        if self.term.active:
            return normal
        pressure[:], arrays["closed"][:] = 0.0, False
        arrays["slip"][:] = arrays["way"][:] = 0.0
        return normal.opened()

    @property
    def searched_at(self) -> tuple[Floats, Floats] | None:
        """Places of points (q, i) and master nodes (n, i), m; see ``ExplicitContact``."""
        points, nodes = self._inputs["searched_points"], self._inputs["searched_nodes"]
        return (points, nodes) if np.isfinite(nodes).all() else None

    def search_at(self, points: Floats, facets: Floats) -> None:
        """Find candidate facets at these places of points and master nodes, and keep them."""
        nodes, target = facets, self.term.surface.target
        assert isinstance(target, FacetSurface)
        found, slack = target.search.table(points, nodes[target.facets])
        self._inputs["candidate"] = np.ascontiguousarray(found, dtype=np.int32)
        self._inputs["searched_points"][:] = points
        self._inputs["searched_nodes"][:] = nodes
        if "far_notes" in self._inputs:
            self._inputs["far_notes"][:] = -1.0
        for one in self._sets:
            one.pair.candidates, one.pair.slack = found.shape[1], slack
            one.point("candidate", self._inputs["candidate"])

    def add_forces(self, out: NodalVector) -> None:
        self.exchange.add(self._load, out)

    def hold_film(self) -> None:
        assert self.trial is not None
        viscous = np.ascontiguousarray(self.trial.response.dissipation.viscous)
        now = self._sets[self._turn]
        self._code.tribox_pair_hold_film(now.at, self.trial.dt, viscous.ctypes.data)

    def correct_film(
        self,
        velocity: NodalVector,
        keep: float,
        acceleration: NodalVector,
        gain: float,
        out: NodalVector,
    ) -> None:
        assert self.trial is not None
        self._gather_next(velocity, keep, acceleration, gain)
        now = self._sets[self._turn]
        self._code.tribox_pair_correct_film(now.at, self.trial.dt)
        parts = self.trial.response.dissipation
        self.trial.response = replace(
            self.trial.response,
            traction=now.arrays["friction"],
            dissipation=replace(
                parts, viscous=now.arrays["viscous"], numerical=parts.numerical + now.arrays["work"]
            ),
        )
        self.exchange.add(self._load, out)

    def commit(self) -> None:
        assert self.trial is not None
        trial, arrays = self.trial, self._sets[self._turn].arrays
        elastic = np.ascontiguousarray(trial.response.state.elastic_slip)
        self._code.tribox_pair_commit(self._sets[self._turn].at, elastic.ctypes.data)
        self._adopted = ContactState(
            facet=arrays["facet"],
            xi=arrays["xi"],
            ahead=self._nothing_ahead,
            slip_components=arrays["component"],
            slip_length=arrays["length"],
            gap=arrays["gap_after"],
            area_ratio=trial.area_ratio,
            share=arrays["present"] if trial.faded else self.term.state.share,
            sunk=arrays["sunk"] if trial.faded else self.term.state.sunk,
            friction=trial.response.state,
            friction_traction=trial.response.traction,
        )
        self.term.adopt(self._adopted)
        self._turn = 1 - self._turn


def _neighbours(target: Any, master: MasterFacets, points: int) -> dict[str, NDArray[Any]]:
    """How the master's facets hang together, by the fields of the structure."""
    if target.shape.directions == 1:
        n, goes_on = len(master.nodes), ~target.ends.is_open
        before, after = (_facet_at(master.facets[:, end], n) for end in (1, 0))
        # At a plane of symmetry the surface goes on as the image of the facet that ends there.
        return {
            "previous": np.where(goes_on & (before < 0), after, before),
            "next": np.where(goes_on & (after < 0), before, after),
        }
    around, corner, across, side, is_open = target.connectivity
    return {
        "around": around,
        "around_corner": corner,
        "across": across,
        "across_side": side,
        "open": is_open,
        "facet_notes": np.zeros((len(master.facets), FACET_NOTES)),
        "far_notes": np.full((points, FAR_NOTES), -1.0),
    }


def _facet_at(corner: Ints, nodes: int) -> Ints:
    """Facet (n,) that has each node as this corner (f,); −1 where none has."""
    out = np.full(nodes, -1, dtype=np.int32)
    out[corner] = np.arange(len(corner), dtype=np.int32)
    return out


def explicit_contact(term: ContactTerm, compiled: bool = True) -> ExplicitContact:
    """The pair, compiled where that is possible; collective.

    Args:
        compiled: False for numpy throughout.
    """
    if isinstance(term, TieTerm):
        return ExplicitTie(term)
    surface, target = term.surface, term.surface.target
    # The compiled loop takes the section's stretch as area ratio, which is wrong for rings.
    known = (
        isinstance(target, FacetSurface)
        and target.shape.degree == 1
        and target.ends.fade_length is None
        and not surface.axisymmetric
        and not term.neighbours
    )
    if not (compiled and known):
        return ExplicitContact(term)
    return CompiledContact(term, library(SOURCES[surface.dim]))


# -- The structure that the compiled loops of an explicit contact pair work on, and its arrays -----
#
# Axis letters: q slave points, n master nodes, i space, α surface directions.

SOURCES = {2: "plane_contact.c", 3: "space_contact.c"}  # by the dimension of space
FACET_NOTES, FAR_NOTES = 10, 13  # numbers that the projection in space notes

_LONGS = (
    *("points", "corners", "candidates", "nodes", "first_master", "vertices", "averaged"),
    *("facet_count", "facet_nodes", "facet_vertices", "around_most"),
)
_DOUBLES = ("touching", "roundoff", "slack", "tie", "moved")
_INPUTS = (
    *("weight", "shape", "slope", "reference", "direction", "rows", "master", "facets"),
    *("previous", "next", "around", "around_corner", "across", "across_side", "open"),
    *("facet_notes", "far_notes", "penalty", "reach", "damping"),
    *("of_point", "vertex_shape", "sums", "nodal_pressure", "active"),
    *("candidate", "searched_points", "searched_nodes", "values", "load"),
)
# Of the state before the step, by the results that they are after it.
BEFORE = {
    "facet_before": "facet",
    "xi_before": "xi",
    "component_before": "component",
    "length_before": "length",
    "share_before": "present",
    "sunk_before": "sunk",
}
_VECTORS = ("position", "foot", "normal", "slip", "way", "elastic", "traction", "friction")
_RESULTS = (
    *("current", "position", "area_ratio", "xi", "foot", "normal", "tangent", "gap", "slip"),
    *("way", "elastic", "pressure", "traction", "component", "length", "gap_after", "friction"),
    *("viscous", "work", "share", "present", "sunk", "lost"),
    *("facet", "clamped", "on_surface", "closed"),
)
_FILM = ("tau", "film", "dry", "compliance")


class PairStructure(ctypes.Structure):
    """``Pair`` of the C header, field by field in the same order."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in _LONGS),
        *((name, ctypes.c_double) for name in _DOUBLES),
        *((name, ctypes.c_void_p) for name in (*_INPUTS, *BEFORE, *_RESULTS, *_FILM)),
    )


class PairArrays:
    """One set of results, and the structure that points at them.

    Attributes:
        arrays: by the field of the structure; pair: the structure; at: reference to it.
    """

    def __init__(self, points: int, nodes: int, dim: int) -> None:
        """Allocate the results of ``points`` over ``nodes`` of the master in ``dim`` dimensions."""
        self.arrays: dict[str, NDArray[Any]] = {}
        shapes = {
            "current": (nodes, dim),
            "xi": (points, dim - 1),
            "component": (points, dim - 1),
            "tangent": (points, dim - 1, dim),
            **dict.fromkeys(_VECTORS, (points, dim)),
        }
        kinds: dict[str, type] = {"facet": np.int32}
        kinds |= dict.fromkeys(("clamped", "on_surface", "closed"), np.bool_)
        self.pair = PairStructure()
        self.at = ctypes.byref(self.pair)
        for name in _RESULTS:
            array: NDArray[Any] = np.zeros(
                shapes.get(name, (points,)), dtype=kinds.get(name, np.float64)
            )
            self.arrays[name] = array
            self.point(name, array)

    def point(self, name: str, array: NDArray[Any]) -> None:
        """Point the structure's field at an array, which the caller must keep alive."""
        assert array.flags.c_contiguous
        setattr(self.pair, name, array.ctypes.data)

    def projection(self) -> Projection:
        """The arrays as a projection, without what only its variation needs."""
        a = self.arrays
        fades = self.pair.averaged and a["position"].shape[1] == 2
        return Projection(
            *(a["facet"], a["xi"], a["foot"], a["normal"], a["tangent"], a["gap"]),
            *(a["clamped"], a["on_surface"]),
            share=a["share"] if fades else None,
        )

    def kinematics(self) -> ContactKinematics:
        """The arrays as kinematics without variations."""
        names = ("normal", "gap", "closed", "slip", "way", "elastic")
        return ContactKinematics(*(self.arrays[name] for name in names))

    def fading(self) -> Fading | None:
        """What fades in the step; None with the pressure point by point."""
        if not self.pair.averaged:
            return None
        return Fading(self.arrays["present"], self.arrays["sunk"], self.arrays["lost"])
