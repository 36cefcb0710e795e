"""Finds the places of a case's probes in its mesh."""

from __future__ import annotations

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
from tribox.geometry.surfaces.facets import Floats, Longs
from tribox.geometry.surfaces.ordering import order_by_place

EQUALLY_NEAR = 1e-10  # over the largest coordinate: distances of nodes that count as equal


@dataclass(frozen=True, slots=True)
class PointPlaces:
    """The points of one probe in the mesh, the same on all ranks but for ``found``.

    Attributes:
        name: of the probe.
        place: (p, i), m, undeformed.
        way: (p,) m, along the line from its first point; 0 for a point.
        bodies: (p,) name of the body that each point lies in.
        found: by body, the cells of this rank that its points lie in; share: (p,) 1 over the
            number of cells around a point on all ranks, over which values are averaged.
    """

    name: str
    place: Floats
    way: Floats
    bodies: tuple[str, ...]
    found: dict[str, CellPlaces]
    share: Floats


def place_probes(
    case: Case, named: NamedMesh, space: dolfinx.fem.FunctionSpace, section: Section
) -> list[PointPlaces]:
    """The places of all probes that are points or lines; collective.

    Args:
        case: with the probes.
        named: the mesh.
        space: of the displacement.
        section: what the mesh stands for.

    Raises:
        InputError: a probe does not go with the mesh, lies outside, or where two bodies touch.
    """
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
        raise InputError(format_problem(Problem((*at, key), reason, shown)))

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
            raise InputError(format_problem(Problem((*at, "point"), reason, point.tolist())))
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


def _text(place: Floats) -> str:
    return f"({', '.join(f'{c:.4g}' for c in place)}) m"
