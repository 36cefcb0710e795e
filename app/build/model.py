"""From a case to the objects that are solved: mesh, solids, contacts, loads and their programs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.build import mesh_notes
from tribox.app.build.boundary_conditions import Loads
from tribox.app.build.case_notes import notes_on
from tribox.app.build.contacts import BuiltContact, ContactBuilder
from tribox.app.build.load_programs import Onset, balancing, given
from tribox.app.build.mesh import make_mesh, of_case
from tribox.app.build.probes import PointPlaces, SurfaceLine, place_lines, place_probes
from tribox.app.build.tools import blocks_of_tools, make_tools, notes_on_tools
from tribox.app.case.bodies import Body, Elastomer, formulation_problems, formulations
from tribox.app.case.boundary import COMPONENTS
from tribox.app.case.case import Case
from tribox.app.case.own_code import OwnCodeError
from tribox.app.case.stage import Stage, solver_of
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.equilibrium.unknowns import Platen
from tribox.app.errors import InputError, TriboxError
from tribox.app.explicit.energies import ExplicitError
from tribox.app.implicit.linear_solver import Linear, chosen_solver
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.memory_solid import make_solid
from tribox.forms.bodies.solid import DEGREE, Solid
from tribox.forms.bodies.stability import stability_limits
from tribox.forms.contact.shared_slave import introduce
from tribox.geometry.meshes.blocks import Block, with_blocks
from tribox.geometry.meshes.mesh import NamedMesh
from tribox.geometry.meshes.partition import metis_is_available
from tribox.geometry.surfaces.facets import Floats, Ints


@dataclass(slots=True)
class Model:
    """A case made ready to be solved."""

    # the case asked for, without its sweep and with every default resolved. Written to a file and
    # read back, it gives the same numbers
    case: Case
    named: NamedMesh  # mesh with named bodies and surfaces
    problem: Equilibrium  # residual and tangent of everything together
    # each sets one load from (time, driven displacement), s and m
    programs: list[Callable[[float, float], None]] = field(default_factory=list)
    linear: Linear = "auto"  # the linear solver that was asked for
    section: Section = "plane-strain"  # what the mesh stands for
    # m, of the plane-strain slab, per unit of which the solver works; 1 otherwise
    thickness: float = 1.0
    # what the user should know before the run, one line each
    notes: list[str] = field(default_factory=list)
    # of the problem's platens, such as "top_x": surface and direction
    platen_names: list[str] = field(default_factory=list)
    loads: Loads | None = None  # what the boundaries prescribe
    # places of the probes that are points or lines
    probes: list[PointPlaces] = field(default_factory=list)
    lines: list[SurfaceLine] = field(default_factory=list)  # those of surfaces
    # s, m and –, time, driven displacement and share of the loads that are set (see
    # :meth:`set_loads`)
    loaded: tuple[float, float, float] = (0.0, 0.0, 1.0)
    loaded_in: str = ""  # the stage that they were set in
    # the state of the loads when the present stage began
    onset: Onset = field(default_factory=Onset)

    @property
    def film_onset(self) -> list[float]:
        """Pressure at which the film is whole, Pa, for each contact; 0 without a film."""
        return [contact.film_onset for contact in self.case.contact]

    def begin_stage(self, name: str) -> None:
        """Let a stage begin with the next :meth:`set_loads`, after the last step; collective."""
        if self.loads is not None and name != self.loads.stage:
            time, driven, _ = self.loaded
            self.onset = Onset(time, driven, list(balancing(self.problem)))
            self.loads.begin_stage(name, time, self.problem)
        self._choose_contacts(name)

    def _choose_contacts(self, stage: str) -> None:
        """Let the contacts of a stage act."""
        for table, term in zip(self.case.contact, self.problem.contacts, strict=True):
            acts = self.case.acts_in(table, stage)
            if term.active != acts:
                term.renew(active=acts)

    def snapshot(self) -> Snapshot:
        """Which loads are set, and what they remember of earlier stages."""
        return {
            "loaded": list(self.loaded),
            "loaded_in": self.loaded_in,
            "loads": None if self.loads is None else self.loads.snapshot(),
            "onset": [self.onset.time, self.onset.driven, self.onset.before],
        }

    def restore(self, kept: Snapshot) -> None:
        """Set the loads that :meth:`snapshot` has seen."""
        if self.loads is not None:
            self.loads.restore(kept["loads"])
            self.onset = Onset(*kept["onset"])
            # Between two stages the loads are still those of the one that they were set in.
            stage, self.loads.stage = self.loads.stage, kept["loaded_in"]
            self.set_loads(*kept["loaded"])
            self.loads.stage = stage
            self._choose_contacts(stage)

    def set_loads(self, time: float, driven: float, share: float = 1.0) -> None:
        """Set every prescribed displacement and load to its value at ``time`` (s).

        Args:
            time: s, since the start.
            driven: m, displacement of the driven boundaries so far.
            share: of what changes at once where the present stage begins, a force that acts from
                then on for instance. Where a stage's first step is made in pieces it grows over
                them: else the first piece would have to bear all of it, however short.
        """
        self.loaded = (time, driven, share)
        self.loaded_in = ""
        if self.loads is not None:
            self.loaded_in, self.loads.share = self.loads.stage, share
        if share == 1.0:
            self._run_programs(time, driven)
            return
        self._run_programs(self.onset.time, self.onset.driven)
        start = [getattr(part, name) for part, name in given(self.problem)]
        self._run_programs(time, driven)
        changed = zip(given(self.problem), start, self.onset.before, strict=True)
        for (part, name), at_once, before in changed:
            if isinstance(part, Platen) and not part.loaded:
                continue
            setattr(part, name, getattr(part, name) - (1.0 - share) * (at_once - before))

    def _run_programs(self, time: float, driven: float) -> None:
        for program in self.programs:
            program(time, driven)


@contextmanager
def failures_as(kind: type[TriboxError], where: str) -> Iterator[None]:
    """Raise what extreme numbers, or a state without a way on, lead to as an error of ours.

    Values of a case that are allowed one by one may overflow together. numpy's warnings of that are
    not shown: what becomes of it, forces that are no numbers, is looked for in each step.

    Raises:
        TriboxError: of this kind, in the place of an arithmetic error.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
        try:
            yield
        except ExplicitError as error:
            raise kind(f"{where}: {error}; check the loads, the motions and the mesh") from None
        except PETSc.Error as error:
            said = str(error).strip().splitlines()[-1]
            raise kind(f"{where}: PETSc gives up: {said}") from None
        except MemoryError:
            raise kind(f"{where}: there is not enough memory for so many cells") from None
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            said = " ".join(str(error).split()) or type(error).__name__
            raise kind(
                f"{where}: numbers out of range ({said}); check the magnitudes and units of the "
                "case: lengths, moduli, densities, penalties, velocities"
            ) from None


def build_model(case: Case, comm: MPI.Comm, runs_code: bool = True) -> Model:
    """Mesh, forms and loads of a case; InputError, naming its file, if it is wrong; collective."""
    try:
        return _built(case, comm, runs_code)
    except InputError as error:
        raise of_case(case, error) from None


@failures_as(InputError, "the case")
def _built(case: Case, comm: MPI.Comm, runs_code: bool) -> Model:
    named = make_mesh(case, comm)
    section = case.geometry.section_in(named.mesh.geometry.dim)
    bodies = resolved_bodies(case.bodies, named)
    tool_blocks = blocks_of_tools(case, named)
    u = displacement_on(named, bodies, list(tool_blocks.values()))
    probes = place_probes(case, named, u.function_space, section)
    lines = place_lines(case, named, u.function_space)
    materials = materials_of(bodies, comm, runs_code)
    solids = make_solids(bodies, named, u, section, materials)
    loads = _loads(case, named, u, section)
    tools = make_tools(case, named, tool_blocks, loads)
    by_name = {tool.name: tool for tool in tools.members}
    builder = ContactBuilder(
        case, named, u.function_space, section, materials, runs_code, by_name, loads
    )
    contacts = [builder.build(index) for index in range(len(case.contact))]
    terms = [contact.term for contact in contacts]
    introduce(terms)
    problem = Equilibrium(
        u,
        solids,
        terms,
        [*loads.prescribed, *tools.prescribed],
        [*loads.platens, *tools.platens],
        loads.forms.loads,
        [*loads.nodal_loads, *tools.nodal_loads],
        tools.members,
    )
    resolved = _resolved(case.model_copy(update={"bodies": bodies}), contacts, problem)
    changing = [c.program for c in contacts if c.program is not None]
    programs = [*loads.programs, *tools.programs, *changing]
    linear = case.solver.linear
    model = Model(resolved, named, problem, programs, linear, section, case.geometry.slab)
    model.platen_names, model.loads, model.probes = loads.platen_names, loads, probes
    model.lines = lines
    model.begin_stage(case.stage[0].name)
    model.notes = _notes(case, model, contacts, loads)
    return model


def _loads(case: Case, named: NamedMesh, u: dolfinx.fem.Function, section: Section) -> Loads:
    """What the boundaries of a case prescribe; collective."""
    loads = Loads(named, u, section, case.geometry.slab, case.stage)
    for boundary in case.boundary:
        loads.add(boundary)
    if case.gravity is not None:
        density = {name: body.density for name, body in case.bodies.items()}
        known = {name: value for name, value in density.items() if value is not None}
        loads.programs += loads.forms.gravity(case.gravity, known, lambda: loads.stage)
    loads.finish(_released_surfaces(case))
    if case.is_explicit and any(one.component < 0 for one in loads.constraints):
        raise InputError(
            "boundary: a plane of symmetry that is across no axis does not go with explicit stages"
        )
    return loads


def _released_surfaces(case: Case) -> dict[str, list[tuple[int, str]]]:
    """Of each name that releases contacts their numbers, with each surface that is a body's."""
    found: dict[str, list[tuple[int, str]]] = {}
    for name in dict.fromkeys(name for stage in case.stage for name in stage.release):
        for number, contact in enumerate(case.contact):
            if name in case.names_of(contact):
                surfaces = (contact.slave, contact.master)
                mine = [(number, s) for s in surfaces if s not in case.tools]
                found.setdefault(name, []).extend(mine)
    return found


def _resolved(case: Case, contacts: Sequence[BuiltContact], problem: Equilibrium) -> Case:
    """The case with the defaults filled in that follow from its mesh, and without its sweep.

    Keys that only override another one, such as the `solver` of a stage, stay as they are.
    """
    solver = case.solver
    without_metis = problem.comm.size > 1 and not metis_is_available()
    chosen = {
        "linear": chosen_solver(problem, solver.linear),
        "partition": "cells" if without_metis else solver.partition,
    }
    return case.model_copy(
        update={
            "geometry": case.geometry.resolved(problem.dim),
            "contact": tuple(contact.table for contact in contacts),
            "solver": solver.model_copy(update=chosen),
            "sweep": None,
        }
    )


def _notes(asked: Case, model: Model, contacts: Sequence[BuiltContact], loads: Loads) -> list[str]:
    """All that is said of a case before it runs; collective."""
    named, problem, case = model.named, model.problem, model.case
    notes = [
        *notes_on(case),
        *notes_on_tools(case),
        *notes_on_branches(case.bodies, case.stage),
        *notes_on_materials(case.bodies, {s.name: s.material for s in problem.solids}),
        *named.notes,
        *mesh_notes.locking_bodies(
            named, problem.solids, problem.space.element.basix_element.degree
        ),
        *mesh_notes.bending_bodies(case, named, problem),
        *mesh_notes.large_mesh(case, named),
        *mesh_notes.notes_on_slips(case, named),
        *mesh_notes.many_cells(case, named),
        *mesh_notes.bonded_bodies(named),
        *mesh_notes.notes_on_ranks(asked, named),
        *(note for contact in contacts for note in contact.notes),
        *loads.notes,
    ]
    notes += mesh_notes.drifting(case, named, problem, loads)
    if any(solver_of(stage, case.solver.kind) == "implicit" for stage in case.stage):
        notes += mesh_notes.notes_on_supports(problem, getattr(case.geometry, "gap", 0.0) == 0.0)
    return notes


def body_dofs(model: Model, name: str) -> Ints:
    """Owned local unknowns (n, i) of a body's nodes."""
    space, dim = model.problem.space, model.problem.dim
    nodes = np.unique(space.dofmap.list[model.named.cells(name)])
    nodes = nodes[nodes < space.dofmap.index_map.size_local]
    return (nodes[:, None] * dim + np.arange(dim)).astype(np.int32)


def initial_velocity(model: Model) -> Floats:
    """Velocity of the owned unknowns, m/s, as the bodies of the case say."""
    velocity = np.zeros(model.problem.owned)
    for name, body in model.case.bodies.items():
        if body.velocity is not None:
            components = [getattr(body.velocity, c) for c in COMPONENTS[: model.problem.dim]]
            velocity[body_dofs(model, name)] = components
    return velocity


# -- The bodies of a case: their materials, and the formulation of their elements ------------------


Bodies = Mapping[str, Body]


def resolved_bodies(bodies: Bodies, named: NamedMesh) -> dict[str, Body]:
    """The bodies, with the formulation that suits the elements; InputError if one does not go."""
    cell = named.mesh.topology.cell_name()
    for name, reason in formulation_problems(bodies, cell):
        raise InputError(f"bodies.{name}.formulation: {reason}")
    # On curved cells first order would not follow the surface that the integrals are over.
    curved = named.order == 2
    chosen = dict.fromkeys(bodies, "q2") if curved else formulations(bodies, cell)
    return {
        name: body.model_copy(update={"formulation": chosen[name]}) for name, body in bodies.items()
    }


def displacement_on(
    named: NamedMesh, bodies: Bodies, blocks: Sequence[Block] = ()
) -> dolfinx.fem.Function:
    """The displacement (m) of all bodies, of the degree that formulations ask for; collective."""
    degree = max(DEGREE[body.formulation] for body in bodies.values() if body.formulation)
    element = ("Lagrange", degree, (named.mesh.geometry.dim,))
    space = with_blocks(dolfinx.fem.functionspace(named.mesh, element), blocks)
    return dolfinx.fem.Function(space, name="displacement")


def materials_of(bodies: Bodies, comm: MPI.Comm, runs_code: bool = True) -> dict[str, Material]:
    """The materials of all bodies; collective; InputError if one in Python cannot be used."""
    made: dict[str, Material] = {}
    problem: str | None = None
    for name, body in bodies.items():
        try:
            made[name] = body.material_of(runs_code)
        except OwnCodeError as error:
            problem = problem or f"bodies.{name}.{error.key}: {error}"
    # A file may be missing on one rank alone: all raise, or none.
    problem = next((p for p in comm.allgather(problem) if p), None)
    if problem is not None:
        raise InputError(problem)
    return made


def notes_on_branches(bodies: Bodies, stages: Sequence[Stage]) -> Iterator[str]:
    """Where branches are relaxed, and what the temperature makes of their times."""
    for name, body in bodies.items():
        if getattr(body, "prony", None) is None:
            continue
        assert isinstance(body, Elastomer)
        without = [stage.name for stage in stages if not stage.rate_dependent]
        if without and len(without) == len(stages):
            yield (
                f"bodies.{name}.prony: no stage feels rates (rate_dependent = false): the body is "
                "relaxed throughout, with its long-term moduli"
            )
        elif without:
            yield (
                f"bodies.{name}.prony: relaxed in stages without rates ({', '.join(without)}), "
                "which have the long-term moduli"
            )
        if body.shift is not None:
            factor = math.exp(body.shift.log_factor)
            times = ", ".join(f"{time:.3g} s" for time in body.branch_times())
            yield (
                f"bodies.{name}.shift: relaxation times are {factor:.3g} times those of prony at "
                f"{body.shift.temperature:.5g} K: {times}"
            )
            for note in body.shift.notes():
                yield f"bodies.{name}.shift: {note}"


def notes_on_materials(bodies: Bodies, materials: Mapping[str, Material]) -> list[str]:
    """Elastomers whose energy is not stable within stretches that a run may reach."""
    notes = []
    for name, body in bodies.items():
        if getattr(materials[name].elastic, "always_stable", False):
            continue
        if limits := stability_limits(materials[name]):
            where = ", ".join(f"{test} beyond a stretch of {at:.3g}" for test, at in limits.items())
            notes.append(
                f"bodies.{name}: the {body.called} energy with these constants is not stable "
                f"(Drucker) in {where}: there more strain needs less stress, and steps may fail"
            )
    return notes


def make_solids(
    bodies: Bodies,
    named: NamedMesh,
    u: dolfinx.fem.Function,
    section: Section,
    materials: Mapping[str, Material],
) -> list[Solid]:
    """The forms of resolved bodies.

    Args:
        u: displacement, m.

    Raises:
        InputError: an energy in Python depends on what there is not in this section.
    """
    made = []
    for name, body in bodies.items():
        assert body.formulation is not None
        material, cells, density = materials[name], named.cells(name), body.density or 0.0
        try:
            made.append(make_solid(name, u, cells, material, body.formulation, density, section))
        except OwnCodeError as error:
            raise InputError(f"bodies.{name}.{error.key}: {error}") from None
    return made
