"""Displacement, stress and strain at the points and lines that a case follows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model
from tribox.app.build.probes import PointPlaces, SurfaceLine
from tribox.app.results.contact_points import (
    SlaveFacets,
    contact_nodes,
    displacement_at,
    slave_facets,
)
from tribox.forms.bodies.deformation import Rows, centre_rows, rows_at
from tribox.forms.bodies.point_stress import StressAt, log_strain, mean_pressure, von_mises
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import (
    Floats,
    Ints,
    Longs,
    chains,
    distances_to_line,
    fitted_circle,
    line_curvatures,
    straight_angle,
    tangent_angles,
)

AXES = ("x", "y", "z")
_PLANE = (("xx", 0, 0), ("yy", 1, 1), ("zz", 2, 2), ("xy", 0, 1))
_SPACE = (*_PLANE, ("yz", 1, 2), ("xz", 0, 2))


def components(dim: int) -> tuple[tuple[str, int, int], ...]:
    """Name and indices of the components that a symmetric tensor has in ``dim`` dimensions."""
    return _SPACE if dim == 3 else _PLANE


@dataclass(frozen=True, slots=True)
class _Part:
    """The points in one body, on this rank; k counts pairs of a point and a cell around it."""

    point: Longs  # (k,) number among all points
    share: Floats  # (k,) of the cell in the point's values
    nodes: Ints  # (k, a) local nodes of the cell
    rows: Rows  # at the point
    centre: Rows | None  # where the volume is taken, if that is another place
    stress: StressAt  # of the body's material


def stress_and_strain(tensor: Sequence[tuple[str, int, int]]) -> tuple[str, ...]:
    """Columns that points and bodies have, of tensors with these :func:`components`."""
    return (
        *(f"cauchy_{ij}" for ij, _, _ in tensor),
        *("von_mises_stress", "pressure"),
        *(f"log_strain_{ij}" for ij, _, _ in tensor),
        *("J", "max_stretch"),
    )


class PointProbes:
    """The table of the points and lines; ``label``: of each row's first cells.

    On a side between cells of a body, displacement, Cauchy stress and logarithmic strain are the
    means of all cells there; all else in a row follows from these means.
    """

    def __init__(self, model: Model, probes: Sequence[PointPlaces]) -> None:
        self._problem, self._probes = model.problem, probes
        self._components = components(model.problem.dim)
        self._flows = model.problem.flows
        self._place = np.concatenate([probe.place for probe in probes])
        ends = np.cumsum([len(probe.place) for probe in probes])
        self._parts = [
            self._part(solid, probe, int(end) - len(probe.place))
            for probe, end in zip(probes, ends, strict=True)
            for solid in model.problem.solids
            if solid.name in probe.found
        ]

    def _part(self, solid: Solid, probe: PointPlaces, first: int) -> _Part:
        found, space = probe.found[solid.name], self._problem.space
        return _Part(
            point=found.point + first,
            share=probe.share[found.point],
            nodes=space.dofmap.list[found.cell],
            rows=rows_at(space, solid.section, found.cell, found.xi),
            centre=reduced_rows(solid, space, found.cell),
            stress=solid.stress_at(found.cell, found.xi),
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns after those that say when."""
        axes = AXES[: self._problem.dim]
        return (
            *("probe", "point", "distance", "body"),
            *(f"reference_{x}" for x in axes),
            *(f"displacement_{x}" for x in axes),
            *stress_and_strain(self._components),
            *["equivalent_plastic_strain"] * self._flows,
        )

    def rows(self) -> list[tuple[object, ...]]:
        """Rows at the present displacement, on the first rank; collective."""
        # What this rank's cells add to displacement, Cauchy stress, log strain and plastic strain.
        dim, problem = self._problem.dim, self._problem
        sums = np.zeros((len(self._place), dim + 19))
        nodal = problem.u.x.array.reshape(-1, dim)
        for part in self._parts:
            u = nodal[part.nodes]
            F = part.rows.deformation(u)
            centre = None if part.centre is None else part.centre.deformation(u)
            sigma, strain = part.stress.cauchy(F, centre), log_strain(F)
            tensors = np.concatenate([sigma, strain], axis=1).reshape(-1, 18)
            flow = part.stress.plastic_strain()
            flow = np.zeros(len(F)) if flow is None else flow
            found = np.concatenate([part.rows.displacement(u), tensors, flow[:, None]], axis=1)
            np.add.at(sums, part.point, part.share[:, None] * found)
        comm = problem.comm
        total = np.empty_like(sums) if comm.rank == 0 else None
        comm.Reduce(sums, total, op=MPI.SUM)
        if total is None:
            return []
        labels = [
            (probe.name, p, float(way), probe.bodies[p])
            for probe in self._probes
            for p, way in enumerate(probe.way)
        ]
        numbers: list[list[float]] = [list(map(float, row)) for row in self._columns(total)]
        return [(*label, *row) for label, row in zip(labels, numbers, strict=True)]

    def _columns(self, total: Floats) -> Floats:
        """The columns of numbers (p, …) from all ranks' sums."""
        dim = self._problem.dim
        sigma, strain = np.split(total[:, dim:-1].reshape(-1, 6, 3), 2, axis=1)
        # From the mean of ln V, as its eigenvalues are ln λ and its trace ln J: all of a row
        # belongs together.
        stretch = np.exp(np.linalg.eigvalsh(strain)[:, -1:])
        volume = np.exp(np.einsum("pii->p", strain))[:, None]
        scalars = np.stack([von_mises(sigma), mean_pressure(sigma)], axis=1)
        picked = [
            np.stack([tensor[:, i, j] for _, i, j in self._components], axis=1)
            for tensor in (sigma, strain)
        ]
        columns = [self._place, total[:, :dim], picked[0], scalars, picked[1], volume, stretch]
        return np.concatenate(columns + [total[:, -1:]] * self._flows, axis=1)


def reduced_rows(solid: Solid, space: object, cells: Ints) -> Rows | None:
    """Rows at which a body with selective reduced integration takes the volume; None for others."""
    if not solid.reduced:
        return None
    return centre_rows(space, solid.section, cells)


# -- Values along surfaces: the slaves of pairs, and the lines of nodes that a case follows --------

AT_VERTEX = 1e-9  # share of a segment up to which a point lies at its end
AS_THIN = 1e-7  # relative difference up to which two places are as thin


@dataclass(frozen=True, slots=True)
class _Along:
    """How the values of one probe follow from those of the vertices."""

    name: str  # of the probe
    pair: int  # number of the contact
    first: Longs  # (p,) vertices on either side of each point
    second: Longs  # likewise
    share: Floats  # (p,) of the second
    way: Floats  # (p,) m, undeformed arc length; NaN in space
    at_vertices: bool  # whether the points are the vertices, each with an area of its own


class ContactProbes:
    """The table of the contact lines: nodal values, linear between the vertices."""

    def __init__(self, model: Model, probes: Sequence[tuple[str, str, int | None]]) -> None:
        """Find the points of ``probes``: name, pair, number or None for vertices; collective."""
        self._model = model
        labels = [contact.label for contact in model.case.contact]
        self._asked = [(name, labels.index(pair), points) for name, pair, points in probes]
        self._labels = labels
        self._facets = slave_facets(model)
        self._along: list[_Along] = []
        self._names: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns after those that say when; known from the first rows on."""
        return ("probe", "pair", "point", "arc_length", *self._names)

    def rows(self) -> list[tuple[object, ...]]:
        """Rows after the last step, on the first rank; collective."""
        values = contact_nodes(self._model)
        if values is None:
            return []
        pair = values.pop("pair")
        if not self._along:
            places = self._facets, values["reference"], pair
            self._along = [_along(*places, *asked) for asked in self._asked]
            self._names = tuple(_names(values))
        return [row for along in self._along for row in self._rows_of(along, values)]

    def _rows_of(self, along: _Along, values: dict[str, Floats]) -> Iterator[tuple[object, ...]]:
        table = np.concatenate([v.reshape(len(v), -1) for v in values.values()], axis=1)
        first, second, share = table[along.first], table[along.second], along.share[:, None]
        # At a vertex its own value, also where that of the neighbour is no number.
        found = np.where(share == 0.0, first, (1.0 - share) * first + share * second)
        if not along.at_vertices:
            found[:, self._names.index("area")] = np.nan
        label = (along.name, self._labels[along.pair])
        for p, (way, row) in enumerate(zip(along.way, found, strict=True)):
            yield (*label, p, float(way), *map(float, row))


def _names(values: dict[str, Floats]) -> Iterator[str]:
    """Names of the columns of arrays (v,) and (v, i)."""
    for name, array in values.items():
        if array.ndim == 1:
            yield name
        else:
            yield from (f"{name}_{x}" for x in AXES[: array.shape[1]])


def _along(
    facets: SlaveFacets, place: Floats, of: Ints, name: str, pair: int, points: int | None
) -> _Along:
    """The points of a probe among the vertices of a pair; ``of`` all pairs, at (v, i), m."""
    mine = np.flatnonzero(of == pair)
    if facets.kind != "line":
        none = np.zeros(len(mine))
        return _Along(name, pair, mine, mine, none, np.full(len(mine), np.nan), True)
    order, way = arc_length(facets.nodes[np.isin(facets.nodes[:, 0], mine)], place)
    if points is None:
        return _Along(name, pair, order, order, np.zeros(len(order)), way, True)
    at = np.linspace(0.0, way[-1], points)
    left = np.clip(np.searchsorted(way, at, side="right") - 1, 0, len(way) - 2)
    length = way[left + 1] - way[left]
    share = (at - way[left]) / np.where(length > 0.0, length, 1.0)
    # At the end of a segment the next one begins: its first vertex counts alone.
    left += share > 1.0 - AT_VERTEX
    share[(share < AT_VERTEX) | (share > 1.0 - AT_VERTEX)] = 0.0
    second = order[np.minimum(left + 1, len(order) - 1)]
    return _Along(name, pair, order[left], second, share, at, False)


def arc_length(facets: Longs, place: Floats) -> tuple[Longs, Floats]:
    """Vertices (n,) of a surface in the plane one after the other, and their arc length (n,), m.

    Of segments (f, 2) at places (v, i), m, as :func:`chains` says; it goes on between pieces.
    """
    order: list[Longs] = []
    way: list[Floats] = []
    end = 0.0
    for piece in chains(facets):
        steps = np.linalg.norm(np.diff(place[piece], axis=0), axis=1)
        order.append(piece)
        way.append(end + np.cumsum([0.0, *steps]))
        end = float(way[-1][-1])
    return np.concatenate(order), np.concatenate(way)


def line_places(model: Model) -> list[tuple[SurfaceLine, Floats, Floats]]:
    """Each line of nodes, its places (n, i), m, and the opposite one's (m, i); collective."""
    found = []
    for line in model.lines:
        moved = displacement_at(model, np.concatenate([line.nodes, line.opposite]))
        own = line.place + moved[: len(line.nodes)]
        found.append((line, own, line.opposite_place + moved[len(line.nodes) :]))
    return found


class NodeTable:
    """The table of the nodes of the lines: a row for each."""

    columns = (
        *("probe", "point", "arc_length"),
        *(f"{kind}_{x}" for kind in ("reference", "displacement") for x in AXES[:2]),
        *("tangent_angle", "curvature", "thickness"),
    )

    def __init__(self, model: Model) -> None:
        self._model = model

    def rows(self) -> list[tuple[object, ...]]:
        """Rows at the present displacement, on the first rank; collective."""
        found: list[tuple[object, ...]] = []
        for line, own, other in line_places(self._model):
            if self._model.problem.comm.rank == 0:
                parts = (line.way, *line.place.T, *(own - line.place).T, tangent_angles(own))
                table = np.stack([*parts, line_curvatures(own), thickness(own, other)], axis=1)
                rows = enumerate(table.tolist())
                found += [(line.probe.name, point, *row) for point, row in rows]
        return found


class ShapeTable:
    """The table of the shapes of the lines: a row for each line."""

    columns = (
        *("probe", "angle", "bend_angle", "largest_turn", "radius", "off_circle", "length"),
        *("mean_thickness", "min_thickness", "max_thickness", "thinnest_at"),
    )

    def __init__(self, model: Model) -> None:
        self._model = model

    def rows(self) -> list[tuple[object, ...]]:
        """Rows at the present displacement, on the first rank; collective."""
        found = line_places(self._model)
        if self._model.problem.comm.rank > 0:
            return []
        return [(line.probe.name, *shape_of(line, *places)) for line, *places in found]


def shape_of(line: SurfaceLine, own: Floats, other: Floats) -> tuple[float, ...]:
    """Numbers of a line's row, with the places (n, i) and (m, i), m, of it and the opposite one."""
    angle = _angle(line, own)
    radius, off = fitted_circle(own[line.bend])
    length = np.linalg.norm(np.diff(own, axis=0), axis=1)
    thick = thickness(own, other)
    # Trapezoidal rule along the line: each node has half of the segments beside it.
    share = np.concatenate([length, [0.0]]) + np.concatenate([[0.0], length])
    mean = float(share @ thick / share.sum())
    thin = np.nan
    if len(other):  # of equally thin places the first
        thin = float(line.way[np.argmax(thick <= (1.0 + AS_THIN) * thick.min())])
    spread = (mean, float(thick.min()), float(thick.max()), thin)
    turned = (angle, angle - _angle(line, line.place), _largest_turn(line, own))
    return (*turned, radius, off, float(length.sum()), *spread)


def _angle(line: SurfaceLine, place: Floats) -> float:
    """Angle, rad, from the first straight piece to the second, or from end to end, at places."""
    angles = tangent_angles(place)
    if not len(line.straight):
        return float(angles[-1] - angles[0])
    first, second = (
        straight_angle(place[piece], float(angles[piece].mean())) for piece in line.straight
    )
    return second - first


def _largest_turn(line: SurfaceLine, place: Floats) -> float:
    """Angle, rad, by which two places of a line are turned against each other the most.

    Beyond the bend angle's size where the line is bent to and fro, as a hat or a dome is. Places
    are those from the first straight piece to the second, or all.
    """
    inside = np.flatnonzero(line.straight.any(axis=0)) if len(line.straight) else [0, -1]
    turned = tangent_angles(place) - tangent_angles(line.place)
    return float(np.ptp(turned[inside[0] : inside[-1] + 1 or None]))


def thickness(own: Floats, other: Floats) -> Floats:
    """Distances (n,), m, of nodes (n, i) from the line opposite (m, i); NaN without one."""
    return distances_to_line(own, other) if len(other) else np.full(len(own), np.nan)
