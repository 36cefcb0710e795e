"""The boundary conditions of a case: displacements, rotations, platens and pressures."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import dolfinx
import numpy as np
from mpi4py import MPI

from app.case.boundary import COMPONENTS, DRIVEN, Boundary, Rotation, Spring
from app.case.time_tables import TimeTable
from app.equilibrium.constraints import Platen, Prescribed, component_dofs
from app.errors import InputError
from forms.bodies.kinematics import Section
from forms.bodies.loads import FollowerPressure, Load, mean_normal, reference_area
from geometry.meshes.mesh import NamedMesh
from geometry.surfaces.facets import Floats, Ints

ON_AXIS = 1e-9  # distance over the largest radius up to which a node lies on the axis of symmetry
FLAT = 0.99  # mean normal component from which a surface counts as flat and across the direction
TANGENTIAL = 1e-6  # mean normal component below which a direction runs along the surface

Program = Callable[[float, float], float | Floats]
"""Displacement (m) of one component, of all nodes or of each, at (time, driven displacement)."""


@dataclass(frozen=True, slots=True)
class Constraint:
    """A displacement component of a surface; those of equal sources agree at shared nodes.

    Attributes:
        surface: its name; component: 0 is x; source: what prescribes it.
        dofs: owned local unknowns.
    """

    surface: str
    component: int
    source: object
    dofs: Ints


class Loads:
    """Collects what the boundaries prescribe, and the programs that move it.

    Attributes:
        prescribed, platens, loads: for the equilibrium.
        constraints: what is prescribed or moves as one, by surface; pressed: surface of each
            load.
        platen_names: of the platens, such as "top_x": surface and direction.
        notes: what the user should know of them, one line each.
        programs: each sets one load from (time, driven displacement), s and m.
        stage: name of the present stage, which says whether a platen's force or displacement is
            given.
    """

    def __init__(
        self, named: NamedMesh, u: dolfinx.fem.Function, section: Section, thickness: float
    ) -> None:
        """Begin with none, but for the axis of symmetry, which stays where it is.

        Args:
            named: the mesh.
            u: displacement, m.
            section: what the mesh stands for.
            thickness: m, of a plane-strain slab; 1 otherwise.
        """
        self.named, self.u, self.section, self.thickness = named, u, section, thickness
        self.prescribed: list[Prescribed] = []
        self.platens: list[Platen] = []
        self.platen_names: list[str] = []
        self.notes: list[str] = []
        self.loads: list[Load] = []
        self.programs: list[Callable[[float, float], None]] = []
        self.stage = ""
        self.pressed: list[str] = []
        self.constraints: list[Constraint] = []
        if section == "axisymmetric":
            self._constrain_axis()

    def add(self, boundary: Boundary) -> None:
        """Add one boundary."""
        facets, space = self.named.facets(boundary.surface), self.u.function_space
        for component, value, source in _components(boundary):
            dofs = component_dofs(space, facets, component)
            self._prescribe(boundary.surface, dofs, component, value, source)
        if boundary.rotation is not None:
            self._rotate(boundary.surface, facets, boundary.rotation)
        if boundary.platen is not None:
            self._platen(boundary, facets)
        if boundary.spring is not None:
            self._spring(boundary.surface, boundary.spring, facets)
        if boundary.pressure is not None:
            load = FollowerPressure(self.u, facets, self.section)
            self.loads.append(load)
            self.pressed.append(boundary.surface)
            table = boundary.pressure
            self.programs.append(lambda time, driven: load.set(table(time)))

    def _prescribe(
        self, surface: str, dofs: Ints, component: int, value: Program, source: object
    ) -> None:
        constrained = Prescribed(dofs)
        self.prescribed.append(constrained)
        self.constraints.append(Constraint(surface, component, source, dofs))

        def program(time: float, driven: float) -> None:
            constrained.value = value(time, driven)

        self.programs.append(program)

    def _constrain_axis(self) -> None:
        """Constrain the nodes on the axis of symmetry: their u_x is 0."""
        space = self.u.function_space
        x = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local, 0]
        largest = space.mesh.comm.allreduce(float(x.max(initial=0.0)), op=MPI.MAX)
        nodes = np.nonzero(np.abs(x) <= ON_AXIS * largest)[0]
        dofs = (nodes * space.dofmap.index_map_bs).astype(np.int32)
        still = TimeTable.constant(0.0)
        self._prescribe("the axis x = 0", dofs, 0, lambda time, driven: 0.0, still)

    def _rotate(self, surface: str, facets: Ints, rotation: Rotation) -> None:
        """Turn a surface rigidly; displacements along the axis are not touched."""
        space = self.u.function_space
        centre = np.zeros(3)
        if rotation.centre is not None:
            centre[: len(rotation.centre)] = rotation.centre
        axis = np.eye(3)[COMPONENTS.index(rotation.axis)]
        for name in rotation.decided():
            component = COMPONENTS.index(name)
            dofs = component_dofs(space, facets, component)
            arm = space.tabulate_dof_coordinates()[dofs // space.dofmap.index_map_bs] - centre
            turned = _turning(arm, axis, component, rotation.angle)
            self._prescribe(surface, dofs, component, turned, rotation)

    def check_corners(self) -> None:
        """See that surfaces which share nodes do not prescribe different things there; collective.

        Raises:
            InputError: two boundaries disagree at a shared node.
        """
        mine = [
            f'"{a.surface}" and "{b.surface}" share a node and both decide its displacement in '
            f"{COMPONENTS[a.component]}, each in its own way; let one of them leave it out"
            for a, b in itertools.combinations(self.constraints, 2)
            if a.component == b.component
            and a.source != b.source
            and np.intersect1d(a.dofs, b.dofs).size
        ]
        problems = sorted(set(itertools.chain(*self.named.mesh.comm.allgather(mine))))
        if problems:
            raise InputError(f"boundary: {problems[0]}")

    def _platen(self, boundary: Boundary, facets: Ints) -> None:
        assert boundary.platen is not None
        component = COMPONENTS.index(boundary.platen.direction)
        mesh = self.named.mesh
        platen = self._as_one(boundary.surface, facets, component, boundary.platen.mass)
        outward = mean_normal(mesh, facets, component)
        if abs(outward) < TANGENTIAL:
            raise InputError(
                f'boundary "{boundary.surface}": platen.direction = "{boundary.platen.direction}" '
                "is tangential to the surface; a platen presses along its normal"
            )
        if abs(outward) < FLAT:
            self.notes.append(
                f'boundary "{boundary.surface}": the platen\'s surface is curved or oblique (mean '
                f"normal {abs(outward):.2g} along {boundary.platen.direction}): all of it moves as "
                "one along that direction, and a pressure counts on all of its area"
            )
        inward = -float(np.sign(outward))
        if boundary.platen.pressure is not None:
            table, scale = (
                boundary.platen.pressure,
                inward * reference_area(mesh, facets, self.section),
            )
        else:
            assert boundary.platen.force is not None
            table, scale = boundary.platen.force, inward / self.thickness
        travel, stages = boundary.platen.displacement, boundary.platen.displacement_stages

        def program(time: float, driven: float) -> None:
            if travel is not None and self.stage in stages:
                platen.force, platen.displacement = 0.0, inward * travel(time)
            else:
                platen.force, platen.displacement = scale * table(time), None

        self.programs.append(program)

    def _as_one(self, surface: str, facets: Ints, component: int, mass: float) -> Platen:
        """A platen on a surface, with an extra mass (kg; of a slab, for its thickness)."""
        dofs = component_dofs(self.u.function_space, facets, component)
        platen = Platen(dofs, mass=mass / self.thickness)
        self.platens.append(platen)
        self.platen_names.append(f"{surface}_{COMPONENTS[component]}")
        self.constraints.append(Constraint(surface, component, object(), platen.dofs))
        return platen

    def _spring(self, surface: str, spring: Spring, facets: Ints) -> None:
        platen = self._as_one(surface, facets, COMPONENTS.index(spring.direction), spring.mass)
        platen.stiffness = spring.stiffness / self.thickness
        end = spring.end

        def program(time: float, driven: float) -> None:
            platen.end = end(time) if isinstance(end, TimeTable) else driven

        self.programs.append(program)


def _turning(arm: Floats, axis: Floats, component: int, angle: TimeTable) -> Program:
    """One displacement component of points turned about an axis, by Rodrigues' formula.

    Args:
        arm: (n, 3) from the axis to the points, m.
        axis: (3,) unit vector.
        component: of the displacement.
        angle: rad, over time.
    """
    across = np.cross(axis, arm)[:, component]
    outward = (arm - np.outer(arm @ axis, axis))[:, component]

    def value(time: float, driven: float) -> Floats:
        turn = angle(time)
        # cos − 1 without cancellation
        out: Floats = across * np.sin(turn) - outward * 2.0 * np.sin(0.5 * turn) ** 2
        return out

    return value


def _components(boundary: Boundary) -> Iterator[tuple[int, Program, object]]:
    """Prescribed components, their value at (time, driven displacement), and what says so."""
    table = boundary.displacement
    for index, name in enumerate(COMPONENTS):
        moved = getattr(table, name, None)
        if table is not None and moved == DRIVEN:
            share = table.driven_share(name)
            yield index, _of_drive(share), (DRIVEN, share)
        elif isinstance(moved, TimeTable):
            yield index, _of_time(moved.__call__), moved
        speed = getattr(boundary.velocity, name, None)
        if isinstance(speed, TimeTable):
            yield index, _of_time(speed.integral), ("velocity", speed)


def _of_drive(share: float) -> Program:
    return lambda time, driven: share * driven


def _of_time(value: Callable[[float], float]) -> Program:
    return lambda time, driven: value(time)
