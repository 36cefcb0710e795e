"""The iterative linear solver in space: cost and growth of a Newton iteration, one rank or several.

A box of nearly incompressible elastomer is pressed on an aluminium box and slid, with friction, on
meshes that are refined in all directions. ``mpirun -n 2 python3 -m benchmarks.scaling 10 20`` runs
two levels (elements along the elastomer's edge) and prints a line of JSON after each step.

All seconds but "wall" are processor time (user and system) of each rank: other work on the machine
hardly counts as such. It is that of all steps up to the line's.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.equilibrium.timers import Stopwatch
from tribox.app.implicit.stepper import ImplicitStepper, StepResult
from tribox.app.simulation.history import Row
from tribox.app.simulation.run_state import Observer, RunState
from tribox.app.simulation.simulation import Simulation

CASE = """
[geometry]
kind = "two-boxes"
cell = "hexahedron"
offset = ["OFFSET mm", "0.25 mm"]

[bodies.elastomer]
material = "neo-hookean"
E = "5 MPa"

[bodies.aluminium]
material = "neo-hookean"
E = "70 GPa"
nu = 0.33

[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "coulomb", mu = 0.2 }

[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0, z = 0 }

[[boundary]]
surface = "top"

[boundary.displacement]
x = [["1 s", "0 mm"], ["2 s", "SLIDE mm"]]
y = [["0 s", "0 mm"], ["1 s", "-0.04 mm"]]
z = 0

[[stage]]
name = "press"
duration = "1 s"

[[stage]]
name = "slide"
duration = "1 s"
"""
PARTS = ("assembly", "contact", "pattern", "preconditioner", "factorisation", "linear solve")
MEBIBYTE = 2**20


def case_of(
    level: int,
    nu: float,
    steps: tuple[int, int],
    solver: dict[str, Any],
    slide: float = 0.05,
    offset: float = 0.25,
) -> Case:
    """The case with ``level`` elements along the elastomer and half as many again below.

    Args:
        level: elements along each horizontal edge of the elastomer; even.
        nu: Poisson's ratio of the elastomer.
        steps: of pressing and of sliding.
        solver: the case's table of that name.
        slide: mm, way of the elastomer's top.
        offset: mm, from the aluminium's edge to the elastomer's; 0.5 − ``offset`` is left to slide.
    """
    data = tomllib.loads(CASE.replace("SLIDE", str(slide)).replace("OFFSET", str(offset)))
    upper, lower = (level, level // 2, level), (3 * level // 2, level // 2, 3 * level // 2)
    for name, width, counts in (("upper", "1 mm", upper), ("lower", "1.5 mm", lower)):
        box = {"width": width, "height": "0.5 mm", "depth": width, "elements": list(counts)}
        data["geometry"][name] = box
    data["bodies"]["elastomer"]["nu"] = nu
    for stage, count in zip(data["stage"], steps, strict=True):
        stage["steps"] = count
    data["solver"] = solver
    return Case.model_validate(data)


@dataclass
class Account(Observer):
    """What the steps of a run took; prints and keeps a line of numbers after each of them.

    Attributes:
        start: processor time at the start, s; begun: when the steps began; wall: by the clock.
        newton, tangents, rejected: iterations, tangents made, attempts that failed.
        iterations: of the linear solver, by solve.
        lines: numbers after each step; seconds and memory are lists over the ranks.
    """

    label: dict[str, Any]
    start: float = field(default_factory=time.process_time)
    begun: float = 0.0
    wall: float = 0.0
    newton: int = 0
    tangents: int = 0
    rejected: int = 0
    iterations: list[int] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)

    def begin(self) -> None:
        """Begin with the steps."""
        self.begun, self.wall = time.process_time(), time.perf_counter()

    def monitor(self, ksp: PETSc.KSP, iteration: int, norm: float) -> None:
        """Count an iteration of the linear solver."""
        if iteration == 0:
            self.iterations.append(0)
        else:
            self.iterations[-1] = iteration

    def step(self, state: RunState, row: Row, result: object) -> None:
        """Count a step's Newton iterations and report."""
        assert isinstance(result, StepResult)
        self.newton += result.iterations
        self.tangents += result.factorisations
        comm = state.model.named.mesh.comm
        numbers = self.label | self.shared(state) | {"ranks": comm.gather(self.here(state))}
        if comm.rank == 0:
            self.lines.append(json.dumps(numbers))
            print(self.lines[-1], flush=True)

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Count a step that failed."""
        self.rejected += 1

    def here(self, state: RunState) -> dict[str, Any]:
        """Numbers of this rank so far."""
        problem, now = state.model.problem, time.process_time()
        parts = {part: problem.timer.seconds.get(part, 0.0) for part in PARTS}
        return {
            "seconds": {"set-up": self.begun - self.start, "steps": now - self.begun, **parts},
            "wall": time.perf_counter() - self.wall,
            "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MEBIBYTE,
            "owned": problem.owned,
            "points": sum(len(term.surface.slave.weight) for term in problem.contacts),
        }

    def shared(self, state: RunState) -> dict[str, Any]:
        """Numbers of the run so far, the same on all ranks."""
        problem, row = state.model.problem, state.rows[-1]
        stepper, solves = state.stepper, self.iterations
        assert isinstance(stepper, ImplicitStepper)
        return {
            "dofs": problem.size,
            "nonzeros": stepper.solver.matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"],
            "linear": "direct" if stepper.solver.direct else "krylov",
            "stage": row.stage,
            "steps": len(state.rows),
            "newton": self.newton,
            "tangents": self.tangents,
            "rejected": self.rejected,
            "solves": len(solves),
            "linear_iterations": sum(solves) / max(len(solves), 1),
            "most_iterations": max(solves, default=0),
            "patterns": problem.pattern_changes,
            "normal_force": row.normal_force,
            "tangential_force": row.tangential_force,
            "master_facets": len(problem.contacts[0].surface.master.facets),
        }


def account(case: Case, comm: MPI.Comm, label: dict[str, Any]) -> Account:
    """Run a case and account for its time; collective."""
    out = Account(label)
    model = build_model(case, comm)
    model.problem.timer = Stopwatch(time.process_time)
    simulation = Simulation(model)
    assert isinstance(simulation.stepper, ImplicitStepper)
    simulation.stepper.solver.ksp.setMonitor(out.monitor)
    out.begin()
    simulation.run(out)
    return out


def setting(text: str) -> tuple[str, str | int | float]:
    """A PETSc option "name=value"; without a value it is true."""
    name, _, value = text.partition("=")
    for kind in (int, float):
        try:
            return name, kind(value)
        except ValueError:
            continue
    return name, value or True


def main(arguments: list[str] | None = None) -> None:
    """Run levels; see the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("levels", type=int, nargs="+")
    parser.add_argument("--nu", type=float, default=0.45)
    parser.add_argument("--linear", default="krylov")
    parser.add_argument("--partition", choices=("contact", "cells"), default="contact")
    parser.add_argument("--steps", type=int, nargs=2, default=(2, 3))
    parser.add_argument("--slide", type=float, default=0.05, help="mm")
    parser.add_argument("--offset", type=float, default=0.25, help="mm")
    parser.add_argument("--petsc", nargs="*", type=setting, default=[], metavar="NAME=VALUE")
    parser.add_argument("--out", type=Path, help="file that a line per level is added to")
    given = parser.parse_args(arguments)
    comm = MPI.COMM_WORLD
    for level in given.levels:
        solver = {key: getattr(given, key) for key in ("linear", "partition")}
        solver["petsc"] = dict(given.petsc)
        motion = {"slide": given.slide, "offset": given.offset}
        case = case_of(level, given.nu, tuple(given.steps), solver, **motion)
        label = {"level": level, "nu": given.nu, **motion, **solver}
        lines = account(case, comm, label).lines
        if comm.rank == 0 and given.out:
            with given.out.open("a") as file:
                file.writelines(line + "\n" for line in lines)


if __name__ == "__main__":
    main()
