"""Averages, extremes and energies of the bodies that a case follows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model
from tribox.app.results.cell_strain import strain_of
from tribox.app.results.point_probes import AXES, components, reduced_rows
from tribox.forms.bodies.deformation import BodyPoints
from tribox.forms.bodies.point_stress import mean_pressure, von_mises
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.ordering import order_by_place

AS_LARGE = 1e-9  # relative difference below which two stresses are as large


class BodyProbes:
    """The table of the bodies: integrals over the quadrature points of full integration.

    Means of tensors, of pressure and of the von Mises stress are over the deformed volume.
    """

    def __init__(self, model: Model, probes: Sequence[tuple[str, str]]) -> None:
        """Tabulate the shape functions at the quadrature points.

        Args:
            model: what is solved.
            probes: names of the probes, each with its body's.
        """
        solids = {solid.name: solid for solid in model.problem.solids}
        self._model = model
        self._components = components(model.problem.dim)
        self._probes = [(name, _Body(model, solids[body])) for name, body in probes]
        self._flows = model.problem.flows
        self._branches = max((len(s.dissipated_by_part) for s in model.problem.solids), default=0)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns after those that say when."""
        axes = AXES[: self._model.problem.dim]
        tensor = [name for name, _, _ in self._components]
        return (
            *("probe", "body", "volume"),
            *(f"centre_{x}" for x in axes),
            *(f"cauchy_{ij}" for ij in tensor),
            *("von_mises_stress", "pressure"),
            *(f"log_strain_{ij}" for ij in tensor),
            *("J", "max_stretch", "max_von_mises_stress"),
            *(f"max_von_mises_{x}" for x in axes),
            "strain_energy",
            *[f"{kind}equivalent_plastic_strain" for kind in ("", "max_")] * self._flows,
            *(f"viscous_dissipation_{branch + 1}" for branch in range(self._branches)),
        )

    def rows(self) -> list[tuple[object, ...]]:
        """Rows at the present displacement, on the first rank; collective."""
        found = [
            (
                *(name, body.solid.name, *map(float, body.values(self._components))),
                *(body.plastic_strain() if self._flows else ()),
                *body.by_branch(self._branches),
            )
            for name, body in self._probes
        ]
        return found if self._model.problem.comm.rank == 0 else []


class _Body:
    """One body and its quadrature points on this rank."""

    def __init__(self, model: Model, solid: Solid) -> None:
        self.solid = solid
        self._problem, self._thickness = model.problem, model.thickness
        space = model.problem.space
        self._points = BodyPoints(space, solid)
        self._nodes = space.dofmap.list[solid.cells]
        self._centre = reduced_rows(solid, space, solid.cells)
        self._stress = solid.stress_at(solid.cells, None)
        local = float(self._points.weight.sum())
        self._reference = float(model.problem.comm.allreduce(local, op=MPI.SUM))

    def values(self, tensor: Sequence[tuple[str, int, int]]) -> Floats:
        """The columns of numbers, on all ranks; collective."""
        comm, dim = self._problem.comm, self._problem.dim
        u = self._problem.u.x.array.reshape(-1, dim)[self._nodes]
        F = self._points.deformation(u)
        count, shape = len(F), (-1, 3, 3)
        centre = None
        if self._centre is not None:
            centre = np.tile(self._centre.deformation(u), (count, 1, 1))
        # Component by component, each in one row of memory, all that follows is faster.
        F = np.ascontiguousarray(F.reshape(shape).transpose(1, 2, 0)).transpose(2, 0, 1)
        sigma, measures = self._stress.cauchy(F, centre), strain_of(F, dim)
        strain = measures.log_strain
        place = (self._points.place + self._points.displacement(u)).reshape(-1, dim)
        weight = self._points.weight.reshape(-1) * measures.J
        mises = von_mises(sigma)
        parts = [np.ones(len(F)), *place.T]
        parts += [sigma[:, i, j] for _, i, j in tensor] + [mises, mean_pressure(sigma)]
        parts += [strain[:, i, j] for _, i, j in tensor]
        local = np.array([weight @ part for part in parts] + [self.solid.strain_energy()])
        total = np.empty_like(local)
        comm.Allreduce(local, total, op=MPI.SUM)
        volume, means, energy = total[0], total[1:-1] / total[0], total[-1]
        stretch = float(measures.max_stretch.max(initial=0.0))
        largest = comm.allreduce(stretch, op=MPI.MAX)
        reference = self._points.place.reshape(-1, dim)
        extreme, where = _largest(mises, reference, comm)
        t = self._thickness
        tail = [volume / self._reference, largest, extreme, *where, energy * t]
        return np.array([volume * t, *means, *tail])

    def by_branch(self, count: int) -> list[float]:
        """What each of ``count`` branches has dissipated, J, 0 of those it has not; collective."""
        local = np.zeros(count)
        mine = self.solid.dissipated_by_part
        local[: len(mine)] = mine
        total = np.empty_like(local)
        self._problem.comm.Allreduce(local, total, op=MPI.SUM)
        return [float(lost) * self._thickness for lost in total]

    def plastic_strain(self) -> tuple[float, float]:
        """Mean over the undeformed volume and largest equivalent plastic strain; collective."""
        found, comm = self._stress.plastic_strain(), self._problem.comm
        if found is None:
            return 0.0, 0.0
        total = comm.allreduce(float(self._points.weight.reshape(-1) @ found), op=MPI.SUM)
        largest = comm.allreduce(float(found.max(initial=0.0)), op=MPI.MAX)
        return total / self._reference, largest


def _largest(values: Floats, place: Floats, comm: MPI.Comm) -> tuple[float, Floats]:
    """The largest of all ranks' values and the place of it, the first in x; collective."""
    largest = comm.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)
    equal = np.concatenate(comm.allgather(place[values >= largest - AS_LARGE * abs(largest)]))
    return largest, equal[order_by_place(equal)[0]]
