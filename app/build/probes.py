"""Finds the places of a case's probes in its mesh."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.case.case import Case
from tribox.app.case.probe import Probe
from tribox.app.case.table import ABSENT, Place, Problem
from tribox.app.case.validation import format_problem
from tribox.app.errors import InputError
from tribox.forms.bodies.kinematics import Section
from tribox.geometry.meshes.mesh import NamedMesh
from tribox.geometry.meshes.places import CellPlaces, nearest_place, places_in
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs, chains, order_by_place

EQUALLY_NEAR = 1e-10  # over the largest coordinate: distances of nodes that count as equal
BEYOND = 1.01  # end of a piece over the length of its line up to which it is that of the line


@dataclass(frozen=True, slots=True)
class PointPlaces:
    """The points of one probe in the mesh, the same on all ranks but for ``found``."""

    name: str  # of the probe
    place: Floats  # (p, i), m, undeformed
    way: Floats  # (p,) m, along the line from its first point; 0 for a point
    bodies: tuple[str, ...]  # (p,) name of the body that each point lies in
    found: dict[str, CellPlaces]  # by body, the cells of this rank that its points lie in
    # (p,) 1 over the number of cells around a point on all ranks, over which values are averaged
    share: Floats


@dataclass(frozen=True, slots=True)
class SurfaceLine:
    """The line of nodes that a probe follows, the same on all ranks."""

    probe: Probe  # the probe
    nodes: Longs  # (n,) global nodes one after the other from the left end
    place: Floats  # (n, i), m, undeformed
    way: Floats  # (n,), m, undeformed arc length
    opposite: Longs  # (m,) global nodes of the other line, none without
    opposite_place: Floats  # (m, i), m
    straight: Bools  # (2, n) nodes of the straight pieces, none at all without
    bend: Bools  # (n,) of the bend


def place_lines(
    case: Case, named: NamedMesh, space: dolfinx.fem.FunctionSpace
) -> list[SurfaceLine]:
    """The lines of nodes of probes; collective; InputError if a surface, or piece, is no line."""
    return [
        _surface_line(probe, ("probe", index), named, space)
        for index, probe in enumerate(case.probe)
        if probe.kind == "surface"
    ]


def _surface_line(
    probe: Probe, at: Place, named: NamedMesh, space: dolfinx.fem.FunctionSpace
) -> SurfaceLine:
    assert probe.surface is not None
    nodes, place = _line_of((*at, "surface"), probe.surface, named, space)
    opposite, other = nodes[:0], place[:0]
    if probe.opposite is not None:
        opposite, other = _line_of((*at, "opposite"), probe.opposite, named, space)
    way = np.cumsum([0.0, *np.linalg.norm(np.diff(place, axis=0), axis=1)])
    pieces = [_within(way, piece, 2, (*at, "straight")) for piece in probe.straight or ()]
    bend = probe.bend
    if bend is None:
        ends = probe.straight or ((0.0, 0.0), (float(way[-1]), float(way[-1])))
        bend = (ends[0][1], ends[1][0])
    chosen = _within(way, bend, 3, (*at, "bend"))
    straight = np.array(pieces, dtype=bool).reshape(len(pieces), len(way))
    return SurfaceLine(probe, nodes, place, way, opposite, other, straight, chosen)


def _within(way: Floats, piece: tuple[float, float], least: int, at: Place) -> Bools:
    """Nodes (n,) of a piece of a line."""
    if piece[1] > BEYOND * way[-1]:
        reason = f"ends at {piece[1]:.4g} m; the line is {way[-1]:.4g} m long"
        raise _refused(at, reason)
    slack = EQUALLY_NEAR * way[-1]
    found: Bools = (way >= piece[0] - slack) & (way <= piece[1] + slack)
    if found.sum() < least:
        reason = (
            f"{piece[0]:.4g} m to {piece[1]:.4g} m holds {found.sum()} of the nodes of the line, "
            f"which is {way[-1]:.4g} m long; {least} are needed"
        )
        raise _refused(at, reason)
    return found


def _line_of(
    at: Place, surface: str, named: NamedMesh, space: dolfinx.fem.FunctionSpace
) -> tuple[Longs, Floats]:
    """Global nodes (n,) of a surface in the plane, one after the other, and places; collective."""
    if surface not in named.surfaces:
        known = f"no such surface; there are {', '.join(named.surfaces)}"
        raise _refused(at, known, surface)
    local = _segments(space, named.facets(surface))
    comm, dim = named.mesh.comm, named.mesh.geometry.dim
    index = space.dofmap.index_map
    numbers = index.local_to_global(local.reshape(-1)).reshape(local.shape)
    places = space.tabulate_dof_coordinates()[local.reshape(-1), :dim].reshape(*local.shape, dim)
    every = np.concatenate(comm.allgather(numbers)).astype(np.int64)
    where = np.concatenate(comm.allgather(places)).reshape(-1, dim)
    nodes, first, inverse = np.unique(every, return_index=True, return_inverse=True)
    # Numbered by place: the line begins at the same end however the mesh is shared out.
    order = order_by_place(where[first])
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    pieces = list(chains(rank[inverse.reshape(-1)].reshape(-1, 2)))
    chain = pieces[0]
    if len(pieces) > 1 or len(np.unique(chain)) < len(chain):
        found = f"is in {len(pieces)} pieces" if len(pieces) > 1 else "closes on itself"
        reason = f"{found}; a probe follows one line with two ends"
        raise _refused(at, reason, surface)
    return nodes[order][chain], where[first][order][chain]


def _segments(space: dolfinx.fem.FunctionSpace, facets: Ints) -> Ints:
    """Local nodes (s, 2) of the pieces between the nodes of owned facets in the plane."""
    topology, layout = space.mesh.topology, space.dofmap.dof_layout
    topology.create_connectivity(1, 2)
    topology.create_connectivity(2, 1)
    cells, sides = topology.connectivity(1, 2), topology.connectivity(2, 1)
    found: list[Ints] = [np.empty((0, 2), dtype=np.int32)]
    for facet in facets[facets < topology.index_map(1).size_local]:
        cell = int(cells.links(facet)[0])
        side = int(np.nonzero(sides.links(cell) == facet)[0][0])
        closure = space.dofmap.cell_dofs(cell)[layout.entity_closure_dofs(1, side)]
        along = [closure[0], *closure[2:], closure[1]]  # a node within comes after the corners
        found.append(np.array(list(itertools.pairwise(along)), dtype=np.int32))
    return np.concatenate(found)


def place_probes(
    case: Case, named: NamedMesh, space: dolfinx.fem.FunctionSpace, section: Section
) -> list[PointPlaces]:
    """Places of points and lines of probes; collective; InputError where one is in no one body."""
    for index, probe in enumerate(case.probe):
        for problem in probe.section_problems(section, ("probe", index)):
            raise InputError(format_problem(problem))
    points = [(i, probe) for i, probe in enumerate(case.probe) if probe.kind in ("point", "line")]
    finder = _Finder(named, space)
    return [finder.find(probe, ("probe", index)) for index, probe in points]


class _Finder:
    """Finds places in the cells that ranks own."""

    def __init__(self, named: NamedMesh, space: dolfinx.fem.FunctionSpace) -> None:
        self._mesh, self._space = named.mesh, space
        owned = self._mesh.topology.index_map(self._mesh.topology.dim).size_local
        cells = {name: named.cells(name) for name in named.bodies}
        self._cells = {name: local[local < owned] for name, local in cells.items()}

    def find(self, probe: Probe, at: Place) -> PointPlaces:
        """The places of a point or a line, ``at`` being where the probe stands in the case."""
        place, way = _asked(probe)
        among = [probe.body] if probe.body is not None else list(self._cells)
        if probe.at == "node":
            place, among = self._nearest_node(place[0], among, at)
        found = {name: places_in(self._mesh, self._cells[name], place) for name in among}
        local = [np.bincount(cells.point, minlength=len(place)) for cells in found.values()]
        count = self._mesh.comm.allreduce(np.stack(local), op=MPI.SUM)
        self._refuse(probe, at, place, among, count)
        body = np.argmax(count, axis=0)
        bodies = tuple(among[b] for b in body)
        share = 1.0 / count[body, np.arange(len(place))]
        return PointPlaces(probe.name, place, way, bodies, found, share)

    def _refuse(
        self, probe: Probe, at: Place, place: Floats, among: Sequence[str], count: Longs
    ) -> None:
        """An error for the first point that lies in no body, or in more than one."""
        wrong = np.flatnonzero(np.count_nonzero(count, axis=0) != 1)
        if not len(wrong):
            return
        p = int(wrong[0])
        where = f"probe {probe.name!r}: " + (
            "" if probe.point is not None else f"point {p + 1} of {len(place)}, {_text(place[p])}, "
        )
        inside = [name for name, n in zip(among, count[:, p], strict=True) if n]
        if inside:
            reason = f"{where}lies where {' and '.join(inside)} touch; choose one with body"
        else:
            reason = f"{where}lies outside {self._distance(place[p], among)}"
        key = "point" if probe.point is not None else "line"
        shown = list(probe.point) if probe.point is not None else ABSENT
        raise _refused((*at, key), reason, shown)

    def _distance(self, point: Floats, among: Sequence[str]) -> str:
        """How far a point is from the bodies, and where they are nearest; collective."""
        found = []
        for name in among:
            mine = (*nearest_place(self._mesh, self._cells[name], point), name)
            found.append(min(self._mesh.comm.allgather(mine), key=lambda item: item[0]))
        distance, place, name = min(found, key=lambda item: item[0])
        which = "the body" if len(among) == 1 else "all bodies; the nearest is"
        return f'{which} "{name}", by {distance:.4g} m; it begins at {_text(place)}'

    def _nearest_node(
        self, point: Floats, among: Sequence[str], at: Place
    ) -> tuple[Floats, list[str]]:
        """The node (1, i) nearest to a point, of equally near ones the first in x; and its body."""
        comm, dim = self._mesh.comm, self._mesh.geometry.dim
        coordinates = self._space.tabulate_dof_coordinates()[:, :dim]
        slack = EQUALLY_NEAR * comm.allreduce(np.abs(coordinates).max(initial=0.0), op=MPI.MAX)
        near = {}
        for name in among:
            nodes = np.unique(self._space.dofmap.list[self._cells[name]])
            near[name] = _nearest(coordinates[nodes], point, slack, comm)
        least = min(distance for distance, _ in near.values())
        bodies = [name for name, (distance, _) in near.items() if distance <= least + slack]
        if len(bodies) > 1:
            reason = f"nodes of {' and '.join(bodies)} are equally near; choose one with body"
            raise _refused((*at, "point"), reason, point.tolist())
        return near[bodies[0]][1][None], bodies


def _asked(probe: Probe) -> tuple[Floats, Floats]:
    """Places (p, i), m, as the case has them, and their way (p,) along the line."""
    if probe.line is None:
        return np.array([probe.point]), np.zeros(1)
    start, end = np.array(probe.line.start), np.array(probe.line.to)
    share = np.linspace(0.0, 1.0, probe.line.points)
    return start + share[:, None] * (end - start), share * float(np.linalg.norm(end - start))


def _nearest(places: Floats, point: Floats, slack: float, comm: MPI.Comm) -> tuple[float, Floats]:
    """Distance of the nearest of all ranks' places (n, i), and that place; collective."""
    away = np.linalg.norm(places - point, axis=1)
    least = comm.allreduce(float(away.min(initial=np.inf)), op=MPI.MIN)
    equal = np.concatenate(comm.allgather(places[away <= least + slack]))
    return least, equal[order_by_place(equal)[0]]


def _refused(at: Place, reason: str, found: object = ABSENT) -> InputError:
    return InputError(format_problem(Problem(at, reason, found)))


def _text(place: Floats) -> str:
    return f"({', '.join(f'{c:.4g}' for c in place)}) m"
