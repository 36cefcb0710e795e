"""Loads of a case that have forms: pressures, tractions, foundations, gravity."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import dolfinx
import numpy as np

from tribox.app.case.boundary import Boundary, Gravity
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.loads import (
    BodyForce,
    DeadTraction,
    FollowerPressure,
    Foundation,
    Load,
    reference_area,
)
from tribox.geometry.meshes.mesh import NamedMesh

Setter = Callable[[float, float], None]
"""Sets a load from (time, driven displacement), s and m."""


@dataclass(slots=True)
class LoadsWithForms:
    """Collects loads, and on what each acts.

    Attributes:
        named: the mesh; u: displacement, m; section: what the mesh stands for.
        thickness: m, of a plane-strain slab; 1 otherwise.
        loads: the loads; surfaces: of each its surface; "" for one that acts on a body.
        bodies: of each the body that it acts on all over; "" for one on a surface.
    """

    named: NamedMesh
    u: dolfinx.fem.Function
    section: Section
    thickness: float
    loads: list[Load] = field(default_factory=list)
    surfaces: list[str] = field(default_factory=list)
    bodies: list[str] = field(default_factory=list)

    def of_boundary(self, boundary: Boundary, stage: Callable[[], str]) -> Iterator[Setter]:
        """Take in the loads of a boundary; yields what sets them.

        Args:
            boundary: what is loaded, how, and in which stages.
            stage: name of the present stage.
        """
        dim = self.named.mesh.geometry.dim
        for load, amount in self._of_surface(boundary, dim):
            self._take(load, surface=boundary.surface)

            def program(
                time: float,
                driven: float,
                load: Load = load,
                amount: Callable[[float, float], Sequence[float]] = amount,
            ) -> None:
                acts = boundary.acts_in(stage())
                load.amount = np.array(amount(time, driven)) * float(acts)

            yield program

    def _of_surface(
        self, boundary: Boundary, dim: int
    ) -> Iterator[tuple[Load, Callable[[float, float], Sequence[float]]]]:
        """The loads of a boundary, each with its value at (time, driven displacement)."""
        if all(
            getattr(boundary, k) is None for k in ("pressure", "traction", "force", "foundation")
        ):
            return
        facets, section = self.named.facets(boundary.surface), self.section
        pressure, traction, force = boundary.pressure, boundary.traction, boundary.force
        if pressure is not None:
            yield (
                FollowerPressure(self.u, facets, section),
                lambda time, driven: [pressure(time)],
            )
        if traction is not None:
            yield (
                DeadTraction(self.u, facets, section),
                lambda time, driven: traction.at(time, dim),
            )
        if force is not None:
            area = reference_area(self.named.mesh, facets, section) * self.thickness
            yield (
                DeadTraction(self.u, facets, section),
                lambda time, driven: [part / area for part in force.at(time, dim)],
            )
        if (foundation := boundary.foundation) is not None:
            load = Foundation(self.u, facets, section)
            springs = [foundation.normal, foundation.tangential]
            load.amount = np.array([0.0] * dim + springs)
            yield (
                load,
                lambda time, driven: [*foundation.base_at(time, driven, dim), *springs],
            )

    def gravity(
        self, table: Gravity, density: dict[str, float], stage: Callable[[], str]
    ) -> Iterator[Setter]:
        """Take in the weight of bodies; yields what sets it.

        Args:
            table: the acceleration, and in which stages it acts.
            density: kg/m³, of each body.
            stage: name of the present stage.
        """
        dim = self.named.mesh.geometry.dim
        local = self.named.mesh.topology.index_map(dim).size_local
        for name, value in density.items():
            cells = self.named.cells(name)
            load = BodyForce(self.u, cells[cells < local], value, self.section)
            self._take(load, body=name)

            def program(time: float, driven: float, load: Load = load) -> None:
                acts = not table.stages or stage() in table.stages
                load.amount = np.array(table.at(time, dim)) * float(acts)

            yield program

    def _take(self, load: Load, surface: str = "", body: str = "") -> None:
        self.loads.append(load)
        self.surfaces.append(surface)
        self.bodies.append(body)
