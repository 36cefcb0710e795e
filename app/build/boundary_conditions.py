"""The boundary conditions of a case: what holds and moves surfaces, and what loads them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.build import load_programs
from tribox.app.case import boundary as tables
from tribox.app.case.boundary import COMPONENTS, Boundary, Rotation, Spring
from tribox.app.case.stage import Stage
from tribox.app.case.time_tables import TimeTable
from tribox.app.equilibrium.constraints import Platen, Prescribed, component_dofs
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.slanted import SlantedPlaten, node_groups
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.equilibrium.unknowns import NodalLoad, place_text
from tribox.app.errors import InputError
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.loads import mean_normal, reference_area
from tribox.geometry.meshes.mesh import NamedMesh, group_dofs
from tribox.geometry.surfaces.facets import Floats, Ints, Longs

ON_AXIS = 1e-9  # distance over the largest radius up to which a node lies on the axis of symmetry
FLAT = 0.99  # mean normal component from which a surface counts as flat and across the direction
PLANE = 1e-8  # one less the length of the mean normal up to which a surface is a plane
TANGENTIAL = 1e-6  # mean normal component below which a direction runs along the surface


@dataclass(frozen=True, slots=True)
class Constraint:
    """A displacement component of a surface; those of equal sources agree at shared nodes."""

    surface: str  # its name
    component: int  # 0 is x; −1 for a direction along no axis
    source: object  # what prescribes it
    part: Prescribed | Platen  # what does so in the equilibrium
    acts: load_programs.Acts  # in which stages
    given: load_programs.Acts  # in which of them the displacement itself is given

    @property
    def dofs(self) -> Ints:
        """Owned local unknowns."""
        return self.part.dofs

    @property
    def yields(self) -> bool:
        """Whether it is a spring, which need not bear what a node bore before."""
        return isinstance(self.part, Platen) and self.part.stiffness > 0.0


class Loads:
    """Collects what the boundaries prescribe, and the programs that move it.

    Attributes:
        prescribed, platens: for the equilibrium; forms: its loads with forms.
        nodal_loads: its forces at nodes; nodal_surfaces: surface or group of each of them.
        constraints: what is prescribed or moves as one, by surface.
        platen_names: of the platens, such as "top_x": surface and direction.
        notes: what the user should know of them, one line each.
        programs: each sets one load from (time, driven displacement), s and m.
        stage: name of the present stage; remembering: what is told of a new one.
        share: of what changes at once where it begins (:meth:`Model.set_loads`).
    """

    def __init__(
        self,
        named: NamedMesh,
        u: dolfinx.fem.Function,
        section: Section,
        thickness: float,
        stages: Sequence[Stage] = (),
    ) -> None:
        """None yet, but for the axis of symmetry; ``u``, ``thickness``: m, of a slab, or 1."""
        self.named, self.u, self.section, self.thickness = named, u, section, thickness
        self._stages = {stage.name: stage for stage in stages}
        self.prescribed: list[Prescribed] = []
        self.platens: list[Platen] = []
        self.platen_names: list[str] = []
        self.notes: list[str] = []
        self.forms = load_programs.LoadsWithForms(named, u, section, thickness)
        self.nodal_loads: list[NodalLoad] = []
        self.nodal_surfaces: list[str] = []
        self.programs: list[Callable[[float, float], None]] = []
        self.stage, self.share = "", 1.0
        self.remembering: list[load_programs.Remembering] = []
        self.constraints: list[Constraint] = []
        if section == "axisymmetric":
            self._constrain_axis()

    def add(self, boundary: Boundary) -> None:
        """Add one boundary."""
        self._hold(boundary)
        group = boundary.surface in self.named.groups
        if boundary.platen is not None:
            self._platen(boundary, boundary.platen)
        if boundary.spring is not None:
            self._spring(boundary, boundary.spring)
        if boundary.symmetry:
            self._symmetry(boundary)
        if group and boundary.force is not None:
            self._force_on_group(boundary)
        else:
            self.programs += self.forms.of_boundary(boundary, lambda: self.stage)

    # -- stages -------------------------------------------------------------------------------

    def begin_stage(self, name: str, time: float, problem: Equilibrium) -> None:
        """Let loads be those of a stage beginning at ``time``, s, once they are set; collective."""
        if name == self.stage:
            return
        change = load_programs.StageChange(self.stage, name, time, problem)
        self.stage = name
        for one in self.remembering:
            one.begin(change)

    def finish(self, pairs: Mapping[str, Sequence[tuple[int, str]]] | None = None) -> None:
        """Add what the stages release, and see that corners agree (InputError); collective.

        ``pairs``: contacts by the names that release them: number, and each surface of a body.
        """
        pairs = pairs or {}
        for stage in self._stages.values():
            for name in stage.release:
                for number, surface in pairs.get(name, ()):
                    self._release_contact(number, surface, stage)
                if name not in pairs:
                    self._release(name, stage)
        for before, now in itertools.pairwise(self._stages):
            self._let_go(before, self._stages[now])
        self.check_corners()

    def acting(self, stage: str) -> list[Constraint]:
        """The constraints that act in a stage."""
        return [one for one in self.constraints if one.acts(stage)]

    def held(self) -> list[Longs]:
        """By axis, global nodes of all ranks that stay where they are in all stages; collective."""
        space, out = self.u.function_space, []
        for axis in range(space.dofmap.index_map_bs):
            # Held at zero in all stages, as a plane of symmetry is.
            parts = [
                one.dofs
                for one in self.constraints
                if one.component == axis
                and isinstance(one.source, TimeTable)
                and not any(one.source.values)
                and all(map(one.given, self._stages))
            ]
            joined: Ints = np.concatenate([np.empty(0, dtype=np.int32), *parts])
            local = np.unique(joined)
            local = (local // space.dofmap.index_map_bs).astype(np.int32)
            mine = space.dofmap.index_map.local_to_global(local)
            out.append(np.unique(np.concatenate(space.mesh.comm.allgather(mine))))
        return out

    def snapshot(self) -> Snapshot:
        """What is remembered of the stages so far."""
        space = self.u.function_space
        owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        return {"stage": self.stage, "parts": [one.snapshot(owned) for one in self.remembering]}

    def restore(self, kept: Snapshot) -> None:
        """Remember what :meth:`snapshot` has seen."""
        self.stage = kept["stage"]
        for one, values in zip(self.remembering, kept["parts"], strict=True):
            one.restore(values)

    def _acts(self, boundary: Boundary) -> load_programs.Acts:
        """In which stages what a boundary holds does so: not from a release of it on."""
        names = list(self._stages)
        gone = [at for at, s in enumerate(self._stages.values()) if boundary.surface in s.release]
        free = {name for at in gone[:1] for name in names[at:]}
        return lambda stage: boundary.acts_in(stage) and stage not in free

    def _release(self, surface: str, stage: Stage) -> None:
        """Let what holds a surface be taken off over a stage."""
        held = [one for one in self.constraints if one.surface == surface]
        others = [one for one in self.constraints if one.surface != surface]
        self._take_off(surface, held, stage, [one for one in others if one.acts(stage.name)])

    def _let_go(self, before: str, stage: Stage) -> None:
        """Let what displacements of the stage ``before`` have led to fade where they end.

        Over the pieces of the first step, if it is cut: a force may take over, or nothing.
        """
        gone = [one for one in self.constraints if one.given(before) and one.surface]
        gone = [one for one in gone if not one.given(stage.name)]
        kept = [one for one in self.constraints if one.given(stage.name) and not one.yields]
        kept += [one for one in gone if one.surface in stage.release]
        for one in gone:
            if one.surface not in stage.release:
                self._take_off(one.surface, [one], stage, kept, at_once=True)
                kept = [*kept, one]  # each node's force is given up once

    def _release_contact(self, pair: int, surface: str, stage: Stage) -> None:
        """Let the forces of a contact on one of its surfaces be taken off over a stage."""
        dim = self.named.mesh.geometry.dim
        dofs = np.sort(np.concatenate([self._dofs(surface, axis) for axis in range(dim)]))
        self._fade(surface, dofs, stage, lambda problem: problem.pair_forces(pair))

    def _take_off(
        self,
        surface: str,
        held: Sequence[Constraint],
        stage: Stage,
        others: Sequence[Constraint],
        at_once: bool = False,
    ) -> None:
        """Take off the forces of what holds a surface; ``others`` bear those of their nodes."""

        def reactions(problem: Equilibrium) -> Floats:
            forces = problem.unbalanced.copy()
            for one in others:
                forces[one.dofs] = 0.0
            return forces

        dofs = np.unique(np.concatenate([one.dofs for one in held]))
        self._fade(surface, dofs, stage, reactions, at_once)

    def _fade(
        self,
        surface: str,
        dofs: Ints,
        stage: Stage,
        given_up: Callable[[Equilibrium], Floats],
        at_once: bool = False,
    ) -> None:
        """Take off forces at unknowns of a surface evenly over a stage, or where it begins."""
        load = self._at_nodes(surface, dofs, np.zeros(len(dofs)))
        load.takes_over = True
        released = load_programs.Released(load, stage.name, stage.duration or np.inf, given_up)
        self.remembering.append(released)

        def program(time: float, driven: float) -> None:
            share = 1.0 - self.share if at_once else released.factor(self.stage, time)
            load.factor = share if self.stage == stage.name else 0.0

        self.programs.append(program)

    # -- displacements ------------------------------------------------------------------------

    def _hold(self, boundary: Boundary) -> None:
        """Prescribe displacements, velocities and rotations."""
        acts = self._acts(boundary)
        for component, value, source in load_programs.displaced_components(boundary):
            dofs = self._dofs(boundary.surface, component)
            self._prescribe(boundary.surface, dofs, component, (value, source), acts)
        for component, speed in load_programs.moved_components(boundary):
            self._move(boundary, component, speed)
        if boundary.rotation is not None:
            self._rotate(boundary.surface, boundary.rotation, acts)

    def _dofs(self, surface: str, component: int) -> Ints:
        """Owned local unknowns of one component of a surface or group; collective."""
        space, group = self.u.function_space, self.named.groups.get(surface)
        if group is not None:
            return group_dofs(space, group, component)
        return component_dofs(space, self.named.facets(surface), component)

    def _prescribe(
        self,
        surface: str,
        dofs: Ints,
        component: int,
        how: tuple[load_programs.Program, object],
        acts: load_programs.Acts,
    ) -> Prescribed:
        value, source = how
        part = Prescribed(dofs)
        self.prescribed.append(part)
        self.constraints.append(Constraint(surface, component, source, part, acts, acts))

        def program(time: float, driven: float) -> None:
            part.acts = acts(self.stage)
            part.value = value(time, driven)

        self.programs.append(program)
        return part

    def _move(self, boundary: Boundary, component: int, speed: TimeTable) -> None:
        """Prescribe a velocity; what begins in the middle of a run goes on from where it is."""
        acts, dofs = self._acts(boundary), self._dofs(boundary.surface, component)
        value, source = load_programs.of_time(speed.integral), ("velocity", speed)
        if all(map(acts, self._stages)) and not any(
            speed.values
        ):  # held, as by a displacement of 0
            self._fix(boundary.surface, dofs, component, acts)
            return
        if not boundary.stages:
            self._prescribe(boundary.surface, dofs, component, (value, source), acts)
            return
        # The part is made with its program, and what moves it on is made with the part.
        moved: list[load_programs.MovedOn] = []

        def from_there(time: float, driven: float) -> Floats:
            return moved[0].value(time, driven)

        where = (*source, boundary.stages)
        part = self._prescribe(boundary.surface, dofs, component, (from_there, where), acts)
        moved.append(load_programs.MovedOn(part, speed, acts))
        self.remembering += moved

    def _constrain_axis(self) -> None:
        """Constrain the nodes on the axis of symmetry: their u_x is 0."""
        space = self.u.function_space
        x = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local, 0]
        largest = space.mesh.comm.allreduce(float(x.max(initial=0.0)), op=MPI.MAX)
        nodes = np.nonzero(np.abs(x) <= ON_AXIS * largest)[0]
        dofs = (nodes * space.dofmap.index_map_bs).astype(np.int32)
        self._fix("the axis x = 0", dofs, 0, lambda stage: True)

    def _fix(self, surface: str, dofs: Ints, component: int, acts: load_programs.Acts) -> None:
        """Prescribe a displacement of zero."""
        still = TimeTable.constant(0.0)
        self._prescribe(surface, dofs, component, (load_programs.of_time(still), still), acts)

    def _rotate(self, surface: str, rotation: Rotation, acts: load_programs.Acts) -> None:
        """Turn a surface rigidly; displacements along the axis are not touched."""
        space = self.u.function_space
        centre = np.zeros(3)
        if rotation.centre is not None:
            centre[: len(rotation.centre)] = rotation.centre
        axis = np.eye(3)[COMPONENTS.index(rotation.axis)]
        for name in rotation.decided():
            component = COMPONENTS.index(name)
            dofs = self._dofs(surface, component)
            arm = space.tabulate_dof_coordinates()[dofs // space.dofmap.index_map_bs] - centre
            turned = load_programs.turning(arm, axis, component, rotation.angle)
            self._prescribe(surface, dofs, component, (turned, rotation), acts)

    def _symmetry(self, boundary: Boundary) -> None:
        """Hold a flat surface along its normal."""
        facets = self.named.facets(boundary.surface)
        normal = mean_normal(self.named.mesh, facets)
        here, length = f'boundary "{boundary.surface}": symmetry', float(np.linalg.norm(normal))
        if length < 1.0 - PLANE:
            raise InputError(f"{here}: the surface must be flat; its mean normal is {length:.6g}")
        acts, normal = self._acts(boundary), np.asarray(normal / length, dtype=np.float64)
        main = int(np.argmax(np.abs(normal)))
        if abs(normal[main]) > 1.0 - PLANE:
            self._fix(boundary.surface, self._dofs(boundary.surface, main), main, acts)
            return
        if self.section == "axisymmetric":
            raise InputError(f"{here}: a ring has planes of symmetry across its axis only")
        platen = SlantedPlaten.on(self.u.function_space, facets, normal)
        platen.displacement = 0.0
        self._tie(boundary, -1, platen, acts)

        def program(time: float, driven: float) -> None:
            platen.acts = acts(self.stage)

        self.programs.append(program)

    # -- platens ------------------------------------------------------------------------------

    def _platen(self, boundary: Boundary, table: tables.Platen) -> None:
        """Let a surface move as one, under a force or with a displacement."""
        surface, mesh = boundary.surface, self.named.mesh
        facets = self.named.facets(surface)
        direction = np.array(tables.unit_vector(table.direction, mesh.geometry.dim))
        outward = float(mean_normal(mesh, facets) @ direction)
        self._heed_direction(surface, table, outward)
        # Travel and force of a platen count into the body, whichever way the direction is given.
        inward = -float(np.sign(outward))
        platen = self._as_one(boundary, table.direction, table.mass)
        if table.pressure is not None:
            given, scale = table.pressure, inward * reference_area(mesh, facets, self.section)
        else:
            given = table.force or TimeTable.constant(0.0)
            scale = inward / self.thickness
        held_after = table.displacement_stages if table.hold_force else ()
        reached = load_programs.ReachedForce(platen, held_after, f"the platen on {surface}")
        if table.hold_force:
            self.remembering.append(reached)
        travel, stages, acts = table.displacement, table.displacement_stages, self._acts(boundary)

        def program(time: float, driven: float) -> None:
            platen.acts, platen.force, platen.displacement = acts(self.stage), 0.0, None
            if not platen.acts:
                return
            if travel is not None and self.stage in stages:
                platen.displacement = inward * travel(time)
            else:
                platen.force = scale * given(time) if reached.force is None else reached.force

        self.programs.append(program)

    def _heed_direction(self, surface: str, table: tables.Platen, outward: float) -> None:
        """Refuse a platen that moves along itself, and say where a surface is not across."""
        along = table.direction if isinstance(table.direction, str) else list(table.direction)
        if abs(outward) < TANGENTIAL:
            shown = f'"{along}"' if isinstance(along, str) else along
            raise InputError(
                f'boundary "{surface}": platen.direction = {shown} '
                "is tangential to the surface; a platen presses along its normal"
            )
        if abs(outward) < FLAT:
            self.notes.append(
                f'boundary "{surface}": the platen\'s surface is curved or oblique (mean '
                f"normal {abs(outward):.2g} along {along}): all of it moves as "
                "one along that direction, and a pressure counts on all of its area"
            )

    def _as_one(
        self, boundary: Boundary, direction: str | tuple[float, ...], mass: float
    ) -> Platen:
        """A platen on a surface, with an extra mass (kg; of a slab, for its thickness)."""
        space, surface = self.u.function_space, boundary.surface
        mass /= self.thickness
        acts, component = self._acts(boundary), -1
        if isinstance(direction, str):
            component = COMPONENTS.index(direction)
            platen = Platen(self._dofs(surface, component), mass=mass)
        else:
            normal = np.array(tables.unit_vector(direction, self.named.mesh.geometry.dim))
            platen = SlantedPlaten.on(space, self.named.facets(surface), normal, mass)
        self._tie(boundary, component, platen, acts)
        return platen

    def _tie(
        self, boundary: Boundary, component: int, platen: Platen, acts: load_programs.Acts
    ) -> None:
        """Take a platen in."""
        self.platens.append(platen)
        direction = COMPONENTS[component] if component >= 0 else "n"
        self.platen_names.append(f"{boundary.surface}_{direction}")
        table, spring = boundary.platen, boundary.spring

        def given(stage: str) -> bool:
            held = table is None or stage in table.displacement_stages
            return acts(stage) and (held or spring is not None)

        one = Constraint(boundary.surface, component, object(), platen, acts, given)
        self.constraints.append(one)

    def _spring(self, boundary: Boundary, spring: Spring) -> None:
        platen = self._as_one(boundary, spring.direction, spring.mass)
        platen.stiffness = spring.stiffness / self.thickness
        end, acts = spring.end, self._acts(boundary)

        def program(time: float, driven: float) -> None:
            platen.acts = acts(self.stage)
            platen.end = end(time) if isinstance(end, TimeTable) else driven

        self.programs.append(program)

    # -- forces at nodes ----------------------------------------------------------------------

    def _at_nodes(self, surface: str, dofs: Ints, shares: Floats) -> NodalLoad:
        load = NodalLoad(dofs, shares)
        self.nodal_loads.append(load)
        self.nodal_surfaces.append(surface)
        return load

    def _force_on_group(self, boundary: Boundary) -> None:
        """A total force on points, or along edges."""
        assert boundary.force is not None
        group, space = self.named.groups[boundary.surface], self.u.function_space
        shares = group.shares(space)
        for name in boundary.force.given():
            component, table = COMPONENTS.index(name), getattr(boundary.force, name)
            dofs = group_dofs(space, group, component)
            share = np.asarray(shares[dofs // space.dofmap.index_map_bs] / self.thickness)
            load = self._at_nodes(boundary.surface, dofs, share)
            self.programs.append(_force_program(load, table, boundary, lambda: self.stage))

    # -- corners ------------------------------------------------------------------------------

    def check_corners(self) -> None:
        """See that surfaces agree at shared nodes; InputError if two do not; collective."""
        mine = list(self._disagreements())
        mine += self._stuck()
        problems = sorted(set(itertools.chain(*self.named.mesh.comm.allgather(mine))))
        if problems:
            raise InputError(f"boundary: {problems[0]}")

    def _stuck(self) -> Iterator[str]:
        """Stages in which nothing is left that an oblique surface could move at a node."""
        for stage in self._stages or [""]:
            acting = self.acting(stage)
            oblique = [one.part for one in acting if isinstance(one.part, SlantedPlaten)]
            held = [one.dofs for one in acting if isinstance(one.part, Prescribed)]
            if not oblique:
                continue
            try:
                dofs = np.concatenate([*held, np.empty(0, dtype=np.int32)])
                node_groups(oblique, dofs, self.named.mesh.geometry.dim)
            except ValueError:
                names = sorted({o.surface for o in acting if isinstance(o.part, SlantedPlaten)})
                yield (
                    f"at a node of {' or '.join(names)} other boundaries hold all that it could "
                    "move in its oblique direction; let one of them end before it"
                )

    def _disagreements(self) -> Iterator[str]:
        names = list(self._stages) or [""]
        for a, b in itertools.combinations(self.constraints, 2):
            if not any(a.acts(name) and b.acts(name) for name in names):
                continue
            shared: Ints = np.intersect1d(a.dofs, b.dofs)
            if not shared.size:
                continue
            both = (
                f'"{a.surface}" and "{b.surface}" share a node, at {self._place(shared)}, and both '
                "decide its displacement in "
            )
            if a.component >= 0 and b.component >= 0:
                if a.component == b.component and a.source != b.source:
                    yield (
                        f"{both}{COMPONENTS[a.component]}, each in its own way; let one of them "
                        "leave it out"
                    )
            elif _decides_oblique(a, b):
                yield f"{both}an oblique direction; let one of them end before it"

    def _place(self, dofs: Ints) -> str:
        """Where the first of some unknowns is, in words."""
        space = self.u.function_space
        where = space.tabulate_dof_coordinates()[dofs[0] // space.dofmap.index_map_bs]
        return place_text(where[: self.named.mesh.geometry.dim])


def _decides_oblique(a: Constraint, b: Constraint) -> bool:
    """Whether two constraints, one along no axis, cannot stand at one node together."""
    if isinstance(a.part, SlantedPlaten) and isinstance(b.part, SlantedPlaten):
        return bool(abs(a.part.normal @ b.part.normal) > 1.0 - PLANE)
    oblique, other = (a, b) if isinstance(a.part, SlantedPlaten) else (b, a)
    assert isinstance(oblique.part, SlantedPlaten)
    # What is prescribed beside it is left out of what it eliminates.
    return isinstance(other.part, Platen) and oblique.part.normal[other.component] != 0.0


def _force_program(
    load: NodalLoad, table: TimeTable, boundary: Boundary, stage: Callable[[], str]
) -> Callable[[float, float], None]:
    def program(time: float, driven: float) -> None:
        load.factor = table(time) if boundary.acts_in(stage()) else 0.0

    return program
