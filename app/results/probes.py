"""Follows the probes of a case through its history into tables: one row per step and point."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model
from tribox.app.errors import InputError
from tribox.app.implicit.stepper import StepResult
from tribox.app.results import point_probes
from tribox.app.results.directory import PROBE_TABLES, GrowingTable, has_rows, header_of
from tribox.app.results.fields import strain_of
from tribox.app.results.reading import read_table
from tribox.app.results.saving import Saving, on_first
from tribox.app.simulation.history import Row
from tribox.app.simulation.motion_history import KEYS
from tribox.app.simulation.run_state import Interval, Observer, RunState
from tribox.forms.bodies.deformation import quadrature_rows
from tribox.forms.bodies.point_stress import mean_pressure, von_mises
from tribox.forms.bodies.solid import Solid
from tribox.forms.bodies.viscous_points import Viscoelastic
from tribox.geometry.surfaces.facets import Floats, order_by_place


class Table(Protocol):
    """What a table of probes offers."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns after those that say when, known once there are rows."""
        ...

    def rows(self) -> list[tuple[object, ...]]:
        """Rows after the last step, on the first rank; collective."""
        ...


class ProbeRecorder(Observer):
    """Observer that follows the probes; all ranks take part, the first one writes."""

    def __init__(
        self, model: Model, directory: Path, saving: Saving | None = None, after: int | None = None
    ) -> None:
        """Make the tables; those of a run that goes on end ``after`` a step; collective."""
        self._saving, self._after = saving or Saving(directory), after
        self._problem = model.problem
        self._tables = {directory / name: table for name, table in _tables(model).items()}
        self._files: dict[Path, GrowingTable] = {}
        self._compared = after is None
        if after is not None and self._problem.comm.rank == 0:
            with self._saving:
                for path in self._tables:
                    if has_rows(path):
                        self._files[path] = GrowingTable(path, (), after)

    def _refuse_other_columns(self) -> None:
        """See that tables which are gone on with have the columns of this version; collective."""

        def look() -> None:
            for path, table in self._tables.items():
                there, columns = header_of(path), (*KEYS, *table.columns)
                if there and there != columns:
                    new = ", ".join(sorted(set(columns) ^ set(there))) or "their order"
                    raise InputError(
                        f"{path}: does not have the columns of this version ({new}); the run "
                        "cannot go on there: begin it anew, or go on with the version that began it"
                    )

        on_first(self._problem.comm, look)

    def sync(self) -> None:
        """See that the rows written so far are on the disk; for the first rank."""
        for file in self._files.values():
            file.sync()

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """Append a step's rows; collective; InputError if the table has other columns."""
        if not self._tables:
            return
        with self._problem.timer("output"):
            self._problem.spread(state.stepper.x)
            new = {
                path: [(row.step, row.time, row.stage, *values) for values in table.rows()]
                for path, table in self._tables.items()
            }
            if not self._compared:  # some tables know their columns with their first rows
                self._refuse_other_columns()
                self._compared = True
            for path, rows in new.items():
                with self._saving:
                    self._write(path, rows)

    def _write(self, path: Path, rows: list[tuple[object, ...]]) -> None:
        """Append rows; there are none but on the first rank."""
        if not rows:
            return
        columns = (*KEYS, *self._tables[path].columns)
        if path not in self._files:
            self._files[path] = GrowingTable(path, columns, self._after)
        self._files[path].extend(rows)


def _tables(model: Model) -> dict[str, Table]:
    """The tables by the names of their files."""
    probes = model.case.probe
    bodies = [(p.name, p.body) for p in probes if p.kind == "body" and p.body]
    contacts = [(p.name, p.contact, p.points) for p in probes if p.contact]
    tables: dict[str, Table] = {}
    points_table, body_table, contact_table, shape_table, node_table = PROBE_TABLES
    if model.probes:
        tables[points_table] = point_probes.PointProbes(model, model.probes)
    if bodies:
        tables[body_table] = BodyProbes(model, bodies)
    if contacts:
        tables[contact_table] = point_probes.ContactProbes(model, contacts)
    if model.lines:
        tables[shape_table], tables[node_table] = (
            point_probes.ShapeTable(model),
            point_probes.NodeTable(model),
        )
    return tables


UNLOADED = 1e-3  # contact force that is left of that of a load step whose end counts as loaded


def final_shapes(directory: Path, ends: Mapping[int, float]) -> dict[str, dict[str, float | None]]:
    """The last row of each probe of a surface by its name, with its springback, rad.

    That is the bend angle at the end of the load step in which it was largest, less the last one.
    Where tools have let go, only load steps count in which they pressed: a bend that was coined
    may open by less than nothing.

    Args:
        ends: last step of each load step, and the normal force of all pairs there, N.
    """
    path, found = directory / PROBE_TABLES[3], {}
    if not has_rows(path):
        return {}
    rows, felt = read_table(path), UNLOADED * max(ends.values(), default=0.0)
    loaded = {step for step, force in ends.items() if force > felt}
    if max(ends, default=0) in loaded or not loaded:  # nothing was let go, or nothing pressed
        loaded = set(ends)
    if len(ends) == 1:  # nothing was let go
        loaded = set()
    for name in dict.fromkeys(str(row["probe"]) for row in rows):
        mine = [row for row in rows if row["probe"] == name]
        bent = [float(row["bend_angle"]) for row in mine if int(row["step"]) in loaded]
        last = {key: value for key, value in mine[-1].items() if key not in (*KEYS, "probe")}
        last["springback"] = max(bent, key=abs, default=math.nan) - last["bend_angle"]
        found[name] = {k: float(v) if math.isfinite(v) else None for k, v in last.items()}
    return found


TO_AND_FRO = 1.2  # largest turn over the bend angle from which a line is not bent in one sense
TURNED = 1.0  # deg, by which any line may be turned so
OFF = 0.1  # of the rise of an arc of its length and turn, that a line lies off a circle at most


def shape_line(name: str, shape: Mapping[str, Any]) -> str:
    """What the log says of a shape of :func:`final_shapes` in the end."""
    springback = shape["springback"]
    back = "" if springback is None else f", springback {math.degrees(springback):.4g} deg"
    radius = "straight"
    if shape["radius"] is not None:
        radius, off = f"radius {shape['radius']:.4g} m", shape["off_circle"]
        if off > OFF * shape["length"] * abs(shape["bend_angle"]) / 8.0:
            radius += f" of a circle that it lies {off:.2g} m off (bend = [...] picks one bend)"
    thick = ""
    if shape["mean_thickness"] is not None:
        least, most = shape["min_thickness"], shape["max_thickness"]
        thick = f", thickness {least:.4g} to {most:.4g} m"
    bent, most = (math.degrees(shape[key]) for key in ("bend_angle", "largest_turn"))
    if most > TO_AND_FRO * abs(bent) + TURNED:
        return (
            f"probe {name}: bent to and fro, by up to {most:.4g} deg between two places and by "
            f"{bent:.4g} deg from end to end: the angle and springback of one bend are those "
            f"between two straight pieces beside it (straight = [...]){thick}"
        )
    return f"probe {name}: bent by {bent:.4g} deg{back}, {radius}{thick}"


# -- Averages, extremes and energies of the bodies that a case follows -----------------------------

AS_LARGE = 1e-9  # relative difference below which two stresses are as large


class BodyProbes:
    """The table of the bodies: integrals over the quadrature points of full integration.

    Means of tensors, of pressure and of the von Mises stress are over the deformed volume.
    """

    def __init__(self, model: Model, probes: Sequence[tuple[str, str]]) -> None:
        """Tabulate at the quadrature points; ``probes``: their names, each with its body's."""
        solids = {solid.name: solid for solid in model.problem.solids}
        self._model = model
        self._components = point_probes.components(model.problem.dim)
        self._probes = [(name, _Body(model, solids[body])) for name, body in probes]
        self._flows = model.problem.flows
        self._branches = max((len(s.dissipated_by_part) for s in model.problem.solids), default=0)
        self._softens = any(_softens(solid) for solid in model.problem.solids)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns after those that say when."""
        axes = point_probes.AXES[: self._model.problem.dim]
        return (
            *("probe", "body", "volume"),
            *(f"centre_{x}" for x in axes),
            *point_probes.stress_and_strain(self._components),
            "max_von_mises_stress",
            *(f"max_von_mises_{x}" for x in axes),
            "strain_energy",
            *[f"{kind}equivalent_plastic_strain" for kind in ("", "max_")] * self._flows,
            *(f"viscous_dissipation_{branch + 1}" for branch in range(self._branches)),
            *["softening_dissipation"] * self._softens,
        )

    def rows(self) -> list[tuple[object, ...]]:
        """Rows at the present displacement, on the first rank; collective."""
        problem = self._model.problem
        energies = [solid.name for solid in problem.solids], problem.bodies.strain_energies()
        energy = dict(zip(*energies, strict=True))
        found = [
            (
                *(name, body.solid.name),
                *map(float, body.values(self._components, energy[body.solid.name])),
                *(body.plastic_strain() if self._flows else ()),
                *body.by_branch(self._branches),
                *([body.by_softening()] if self._softens else ()),
            )
            for name, body in self._probes
        ]
        return found if problem.comm.rank == 0 else []


class BodyPoints:
    """The quadrature points of a body's own cells, those of full integration.

    Attributes:
        weight: (q, c) m² or m³, of whole rings with axial symmetry; place: (q, c, i), m.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace, solid: Solid) -> None:
        """Tabulate the shape functions of the displacement's ``space``."""
        degree = solid.full_degree
        self._rows, self.weight = quadrature_rows(space, solid.section, solid.cells, degree)
        self.place: Floats = np.stack([rows.place for rows in self._rows])

    def deformation(self, u: Floats) -> Floats:
        """Deformation gradients (q, c, 3, 3) of nodal displacements ``u`` (c, a, i), m."""
        return np.stack([rows.deformation(u) for rows in self._rows])

    def displacement(self, u: Floats) -> Floats:
        """Displacements (q, c, i), m."""
        return np.stack([rows.displacement(u) for rows in self._rows])


class _Body:
    """One body and its quadrature points on this rank."""

    def __init__(self, model: Model, solid: Solid) -> None:
        self.solid = solid
        self._problem, self._thickness = model.problem, model.thickness
        space = model.problem.space
        self._points = BodyPoints(space, solid)
        self._nodes = space.dofmap.list[solid.cells]
        self._centre = point_probes.reduced_rows(solid, space, solid.cells)
        self._stress = solid.stress_at(solid.cells, None)
        local = float(self._points.weight.sum())
        self._reference = float(model.problem.comm.allreduce(local, op=MPI.SUM))

    def values(self, tensor: Sequence[tuple[str, int, int]], energy: float) -> Floats:
        """The columns, on all ranks, of components and this rank's energy, J/m; collective."""
        comm, dim = self._problem.comm, self._problem.dim
        u = self._problem.u.x.array.reshape(-1, dim)[self._nodes]
        F = self._points.deformation(u)
        count, shape = len(F), (-1, 3, 3)
        centre = None
        if self._centre is not None:
            centre = np.tile(self._centre.deformation(u), (count, 1, 1))
        # Component by component, each in one row of memory, all that follows is faster.
        F = np.ascontiguousarray(F.reshape(shape).transpose(1, 2, 0)).transpose(2, 0, 1)
        sigma, measures = self._stress.cauchy(F, centre), strain_of(F)
        strain = measures.log_strain
        place = (self._points.place + self._points.displacement(u)).reshape(-1, dim)
        weight = self._points.weight.reshape(-1) * measures.J
        mises = von_mises(sigma)
        # Integrals over the deformed volume: that of 1 is the volume, the others over it are means.
        parts = [np.ones(len(F)), *place.T]
        parts += [sigma[:, i, j] for _, i, j in tensor] + [mises, mean_pressure(sigma)]
        parts += [strain[:, i, j] for _, i, j in tensor]
        local = np.array([weight @ part for part in parts] + [energy])
        total = comm.allreduce(local)
        volume, means, stored = total[0], total[1:-1] / total[0], total[-1]
        largest = comm.allreduce(float(measures.max_stretch.max(initial=0.0)), op=MPI.MAX)
        extreme, where = _largest(mises, self._points.place.reshape(-1, dim), comm)
        t = self._thickness
        tail = [volume / self._reference, largest, extreme, *where, stored * t]
        return np.array([volume * t, *means, *tail])

    def by_branch(self, count: int) -> list[float]:
        """What each of ``count`` branches has dissipated, J, 0 of those it has not; collective."""
        local = np.zeros(count)
        mine = self.solid.dissipated_by_part
        local[: len(mine)] = mine
        total = self._problem.comm.allreduce(local)
        return [float(lost) * self._thickness for lost in total]

    def by_softening(self) -> float:
        """What softening has dissipated, J: what the branches have not; collective."""
        local = 0.0
        if _softens(self.solid):
            local = float(self.solid.dissipated[0] - self.solid.dissipated_by_part.sum())
        return self._problem.comm.allreduce(local, op=MPI.SUM) * self._thickness

    def plastic_strain(self) -> tuple[float, float]:
        """Mean over the undeformed volume and largest equivalent plastic strain; collective."""
        found, comm = self._stress.plastic_strain(), self._problem.comm
        if found is None:
            return 0.0, 0.0
        total = comm.allreduce(float(self._points.weight.reshape(-1) @ found), op=MPI.SUM)
        largest = comm.allreduce(float(found.max(initial=0.0)), op=MPI.MAX)
        return total / self._reference, largest


def _softens(solid: Solid) -> bool:
    """Whether a body softens by its largest load."""
    return isinstance(solid.material, Viscoelastic) and solid.material.softening is not None


def _largest(values: Floats, place: Floats, comm: MPI.Comm) -> tuple[float, Floats]:
    """The largest of all ranks' values and the place of it, the first in x; collective."""
    largest = comm.allreduce(float(values.max(initial=-np.inf)), op=MPI.MAX)
    equal = np.concatenate(comm.allgather(place[values >= largest - AS_LARGE * abs(largest)]))
    return largest, equal[order_by_place(equal)[0]]
