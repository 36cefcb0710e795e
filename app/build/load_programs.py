"""How prescribed displacements and loads follow time and the driven displacement."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import dolfinx
import numpy as np

from tribox.app.case.boundary import COMPONENTS, DRIVEN, Boundary, Gravity
from tribox.app.case.time_tables import TimeTable
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Snapshot, scattered
from tribox.app.equilibrium.unknowns import NodalLoad, Platen, Prescribed
from tribox.app.errors import SolutionError
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
from tribox.geometry.surfaces.facets import Floats

# -- Prescribed displacements ----------------------------------------------------------------------

Program = Callable[[float, float], float | Floats]
"""Displacement (m) of one component, of all nodes or of each, at (time, driven displacement)."""


def turning(arm: Floats, axis: Floats, component: int, angle: TimeTable) -> Program:
    """One displacement component of points turned about an axis, by Rodrigues' formula.

    ``arm``: (n, 3), m, from the axis (3,), a unit vector; ``angle``: rad, over time.
    """
    across = np.cross(axis, arm)[:, component]
    outward = (arm - np.outer(arm @ axis, axis))[:, component]

    def value(time: float, driven: float) -> Floats:
        turn = angle(time)
        # cos − 1 without cancellation
        return across * np.sin(turn) - outward * 2.0 * np.sin(0.5 * turn) ** 2

    return value


def displaced_components(boundary: Boundary) -> Iterator[tuple[int, Program, object]]:
    """Components with a displacement, its value, and what says so."""
    table = boundary.displacement
    for index, name in enumerate(COMPONENTS):
        moved = getattr(table, name, None)
        if table is not None and moved == DRIVEN:
            share = table.driven_share(name)
            yield index, of_drive(share), (DRIVEN, share)
        elif isinstance(moved, TimeTable):
            yield index, of_time(moved), moved


def moved_components(boundary: Boundary) -> Iterator[tuple[int, TimeTable]]:
    """Components with a velocity, and that."""
    for index, name in enumerate(COMPONENTS):
        speed = getattr(boundary.velocity, name, None)
        if isinstance(speed, TimeTable):
            yield index, speed


def of_drive(share: float) -> Program:
    """A share of the driven displacement."""
    return lambda time, driven: share * driven


def of_time(value: Callable[[float], float]) -> Program:
    """A function of time alone."""
    return lambda time, driven: value(time)


# -- What boundaries remember of the state that a stage begins with: forces reached, and places ----

Acts = Callable[[str], bool]  # whether something acts in the stage of this name


AIDED = 4.0  # force over that of the weak springs of bodies that float, up to which it is theirs


@dataclass(frozen=True, slots=True)
class StageChange:
    """One stage gives way to another."""

    before: str  # its name; "" before the first one
    now: str  # the name of the other
    time: float  # s, of the change
    problem: Equilibrium  # at the last converged state, evaluated with what acted before


class Remembering(Protocol):
    """What has to be told of a new stage."""

    def begin(self, change: StageChange) -> None:
        """Take note of the state that a stage begins with; collective."""

    def snapshot(self, owned: int) -> Snapshot:
        """All that is remembered; ``owned`` is the number of unknowns of this rank."""

    def restore(self, kept: Snapshot) -> None:
        """Remember what :meth:`snapshot` has seen."""


@dataclass(slots=True)
class ReachedForce(Remembering):
    """The force that the displacement of a platen, or of a tool's component, has led to."""

    part: Platen | Prescribed  # what is moved
    stages: tuple[str, ...]  # in which its displacement is given
    holder: str = ""  # what is to hold that force then, in words; "": nothing does
    # N (per unit thickness), along its direction, at the end of the last of them; None before
    force: float | None = None
    since: str = ""  # the stage that begins with it

    def begin(self, change: StageChange) -> None:
        if change.before in self.stages and change.now not in self.stages:
            force, springs = change.problem.reaction(self.part), change.problem.held_weakly()
            if self.holder and springs > 0.0 and abs(force) <= AIDED * springs:
                raise SolutionError(
                    f"stage {change.now}: {self.holder} has no force to hold: up to time "
                    f"{change.time:.6g} s it only carries what nothing else presses on; let "
                    f"stage {change.before} go on until it is pressed"
                )
            self.force, self.since = force, change.now

    def snapshot(self, owned: int) -> Snapshot:
        return {"force": self.force, "since": self.since}

    def restore(self, kept: Snapshot) -> None:
        self.force, self.since = kept["force"], kept["since"]


@dataclass(slots=True)
class MovedOn(Remembering):
    """Displacements that a velocity moves on from where they are when it begins to act."""

    part: Prescribed  # what is prescribed
    speed: TimeTable  # m/s, over time
    acts: Acts  # in which stages
    start: Floats = field(init=False)  # (c,), m, displacements when it began to act
    time: float = 0.0  # s, when that was

    def __post_init__(self) -> None:
        """Begin undeformed."""
        self.start = np.zeros(len(self.part.dofs))

    def value(self, time: float, driven: float) -> Floats:
        """Displacements (c,), m, at ``time`` (s)."""
        return self.start + (self.speed.integral(time) - self.speed.integral(self.time))

    def begin(self, change: StageChange) -> None:
        if self.acts(change.now) and not (change.before and self.acts(change.before)):
            self.start = change.problem.u.x.array[self.part.dofs].copy()
            self.time = change.time

    def snapshot(self, owned: int) -> Snapshot:
        return {"start": scattered(self.part.dofs, self.start, owned), "time": self.time}

    def restore(self, kept: Snapshot) -> None:
        self.start, self.time = kept["start"][self.part.dofs], kept["time"]


@dataclass(slots=True)
class Released(Remembering):
    """Forces that are given up, of what held a surface or of a contact, taken off over a stage."""

    load: NodalLoad  # forces at its unknowns, those at the start of the stage for a factor of one
    stage: str  # its name
    duration: float  # s
    # forces (n,), N per unit thickness, on the owned unknowns that are given up; collective
    given_up: Callable[[Equilibrium], Floats]
    time: float = 0.0  # s, when it began

    def factor(self, stage: str, time: float) -> float:
        """Share of the forces that acts at ``time`` (s) of a stage."""
        if stage != self.stage:
            return 0.0
        return min(max(1.0 - (time - self.time) / self.duration, 0.0), 1.0)

    def begin(self, change: StageChange) -> None:
        if change.now == self.stage:
            self.load.shares = self.given_up(change.problem)[self.load.dofs]
            self.time = change.time

    def snapshot(self, owned: int) -> Snapshot:
        return {"reactions": scattered(self.load.dofs, self.load.shares, owned), "time": self.time}

    def restore(self, kept: Snapshot) -> None:
        self.load.shares, self.time = kept["reactions"][self.load.dofs], kept["time"]


# -- Loads that have forms: pressures, tractions, foundations, gravity -----------------------------

Setter = Callable[[float, float], None]  # sets a load from (time, driven displacement), s and m


@dataclass(slots=True)
class LoadsWithForms:
    """Collects loads, and on what each acts."""

    named: NamedMesh  # the mesh
    u: dolfinx.fem.Function  # displacement, m
    section: Section  # what the mesh stands for
    thickness: float  # m, of a plane-strain slab; 1 otherwise
    loads: list[Load] = field(default_factory=list)  # the loads
    # of each its surface; "" for one that acts on a body
    surfaces: list[str] = field(default_factory=list)
    # of each the body that it acts on all over; "" for one on a surface
    bodies: list[str] = field(default_factory=list)

    def of_boundary(self, boundary: Boundary, stage: Callable[[], str]) -> Iterator[Setter]:
        """Take in the loads of a boundary; yields what sets them."""
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
            yield (FollowerPressure(self.u, facets, section), lambda time, driven: [pressure(time)])
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
            yield (load, lambda time, driven: [*foundation.base_at(time, driven, dim), *springs])

    def gravity(
        self, table: Gravity, density: dict[str, float], stage: Callable[[], str]
    ) -> Iterator[Setter]:
        """Take in the weight of bodies; yields what sets it; ``density``: kg/m³, of each body."""
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


# -- Loads that change at once where a stage begins ------------------------------------------------


@dataclass(frozen=True, slots=True)
class Onset:
    """The loads that balanced the state with which a stage begins."""

    time: float = 0.0  # s, when it begins
    driven: float = 0.0  # m, displacement of the driven boundaries then
    before: Sequence[float | Floats] = ()  # value of each of the loads :func:`given`


def given(problem: Equilibrium) -> Iterator[tuple[object, str]]:
    """What loads are given as. Displacements at the very start are places, springs supports."""
    for name in ("force", "end"):
        yield from ((platen, name) for platen in problem.platens)
    yield from ((load, "factor") for load in problem.nodal_loads if not load.takes_over)
    yield from ((load, "amount") for load in problem.loads if not isinstance(load, Foundation))


def balancing(problem: Equilibrium) -> Iterator[float | Floats]:
    """Values of the loads :func:`given` that acted in the last state; collective.

    What a displacement has led to is given up beside them (:meth:`Loads.finish`): a force that
    takes over from it begins with nothing, and a spring draws from where its surface is.
    """
    for part, name in given(problem):
        value = getattr(part, name)
        if isinstance(part, Platen) and not part.loaded:
            value = 0.0 if name == "force" else _place(problem, part)
        yield value


def _place(problem: Equilibrium, platen: Platen) -> float:
    """Mean displacement of a platen's nodes, m; collective."""
    count = len(np.unique(platen.dofs // problem.dim))
    sums = problem.comm.allreduce(np.array([platen.total(problem.u.x.array), count]))
    return float(sums[0] / sums[1])
