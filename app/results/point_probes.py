"""Displacement, stress and strain at the points and lines that a case follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model
from tribox.app.build.probes import PointPlaces
from tribox.forms.bodies.deformation import Rows, centre_rows, rows_at
from tribox.forms.bodies.point_stress import StressAt, log_strain, mean_pressure, von_mises
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Floats, Ints, Longs

AXES = ("x", "y", "z")
_PLANE = (("xx", 0, 0), ("yy", 1, 1), ("zz", 2, 2), ("xy", 0, 1))
_SPACE = (*_PLANE, ("yz", 1, 2), ("xz", 0, 2))


def components(dim: int) -> tuple[tuple[str, int, int], ...]:
    """Name and indices of the components that a symmetric tensor has in ``dim`` dimensions."""
    return _SPACE if dim == 3 else _PLANE


@dataclass(frozen=True, slots=True)
class _Part:
    """The points in one body, on this rank; k counts pairs of a point and a cell around it.

    Attributes:
        point: (k,) number among all points; share: (k,) of the cell in the point's values.
        nodes: (k, a) local nodes of the cell.
        rows, centre: at the point, and where the volume is taken, if that is another place.
        stress: of the body's material.
    """

    point: Longs
    share: Floats
    nodes: Ints
    rows: Rows
    centre: Rows | None
    stress: StressAt


class PointProbes:
    """The table of the points and lines.

    On a side between cells of a body, displacement, Cauchy stress and logarithmic strain are the
    means of all cells there; all else in a row follows from these means.

    Attributes:
        columns: names of the columns after those that say when; label: of each row's first cells.
    """

    def __init__(self, model: Model, probes: Sequence[PointPlaces]) -> None:
        """Tabulate the shape functions at the points.

        Args:
            model: what is solved.
            probes: one at least.
        """
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
        tensor = [name for name, _, _ in self._components]
        return (
            *("probe", "point", "distance", "body"),
            *(f"reference_{x}" for x in axes),
            *(f"displacement_{x}" for x in axes),
            *(f"cauchy_{ij}" for ij in tensor),
            *("von_mises_stress", "pressure"),
            *(f"log_strain_{ij}" for ij in tensor),
            *("J", "max_stretch"),
            *["equivalent_plastic_strain"] * self._flows,
        )

    def rows(self) -> list[tuple[object, ...]]:
        """Rows at the present displacement, on the first rank; collective."""
        sums, comm = self._sums(), self._problem.comm
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

    def _sums(self) -> Floats:
        """What this rank's cells add to displacement, Cauchy stress, log strain and plastic strain.

        Returns:
            (p, dim + 9 + 9 + 1) of all points, zero where this rank has no cell.
        """
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
        return sums

    def _columns(self, total: Floats) -> Floats:
        """The columns of numbers (p, …) from all ranks' sums."""
        dim = self._problem.dim
        sigma, strain = np.split(total[:, dim:-1].reshape(-1, 6, 3), 2, axis=1)
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
    if solid.carried is None:
        return None
    return centre_rows(space, solid.section, cells)
