"""What an explicit step costs: kernels, contact pairs, whole steps, several ranks.

``tribox bench explicit`` prints the tables, and so does ``python3 -m benchmarks.explicit``,
which with ``--ranks 2`` adds the comparison of one and two ranks, each started by mpirun. All times
are seconds of the processor (user and system), the least of several repetitions, on which other
work on the machine has little influence.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, get_args

import dolfinx
import numpy as np
from mpi4py import MPI

import tribox
from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.constraints import Platen, Prescribed, component_dofs
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.explicit.stable_step import ExplicitOptions
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.run.process import with_sources
from tribox.forms.bodies.materials import Hencky, Material, MooneyRivlin, NeoHookean, shear_and_bulk
from tribox.forms.bodies.solid import Formulation, Solid
from tribox.forms.contact.explicit import ExplicitContact
from tribox.forms.contact.explicit_compiled import explicit_contact
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import FrictionLaw
from tribox.forms.friction.parameters import FrictionMapParameters
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.surface import QUADRATURE_DEGREE, ContactSurface, NodalVector

SOURCES = Path(tribox.__file__).parents[1]
WIDTH, SPEED, PRESSURE = 1e-3, 0.05, 1e5
REPEAT, STEPS = 5, 20
# A waiting rank yields its core: waiting costs the others nothing and counts for little.
ENVIRONMENT = {**with_sources(os.environ), "OMPI_MCA_mpi_yield_when_idle": "1"}
Friction = Literal["film", "coulomb"]
SMALL, MIDDLE, LARGE = 1.0, 3.864, 9.66  # levels of about 1 700, 25 600 and 160 000 cells


def seconds() -> float:
    """Processor time of this process so far, s."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def best(action: Callable[[], None], repeat: int = REPEAT) -> float:
    """Least processor time of one call, s."""
    taken = []
    for _ in range(repeat):
        start = seconds()
        action()
        taken.append(seconds() - start)
    return min(taken)


@dataclass(frozen=True, slots=True)
class Sliding:
    """A pressed and dragged block on a film: a stepper, and what moves it.

    Attributes:
        stepper: makes the steps; top: driven sideways; dt: s.
        cells: of the whole mesh; points: of the contact, on this rank.
    """

    stepper: ExplicitStepper
    top: Prescribed
    dt: float
    cells: int
    points: int

    def run(self, steps: int = STEPS) -> None:
        """Make some steps."""
        for _ in range(steps):
            self.top.value += SPEED * self.dt
            self.stepper.advance(self.dt)


def law_of(friction: Friction, K_T: float) -> FrictionLaw:
    """Coulomb friction, or asperities beside a film, with a stiffness of stick ``K_T`` (Pa/m)."""
    if friction == "coulomb":
        return CoulombLaw(CoulombParameters(mu=0.2, K_T=K_T))
    return FrictionMap(
        FrictionMapParameters(
            mu_s=0.12,
            mu_d=0.1,
            A_d=1e-6,
            B=1e5,
            K_T=K_T,
            eta_b=8e-3,
            D_max=250e-9,
            alpha=0.5,
            V_star=1.0,
            V_star_at=10e-9,
            film_onset_pressure=1e3,
        )
    )


def sliding(
    refine: float,
    friction: Friction = "film",
    formulation: Formulation = "q1-sri",
    compiled: bool = True,
) -> Sliding:
    """The blocks of cases/block-slide.toml, pressed together and set in motion; collective.

    ``refine``: level of the mesh, 1 for 40 by 20 and 61 by 15 cells.
    """
    G, K = shear_and_bulk(5e6, 0.45)
    upper = Block(WIDTH, WIDTH / 2, (round(40 * refine), round(20 * refine)))
    lower = Block(2 * WIDTH, WIDTH / 2, (round(61 * refine), round(15 * refine)))
    pair = ("elastomer_contact", "aluminium_contact")
    named = generate(TwoBlocks(upper, lower, WIDTH / 2), MPI.COMM_WORLD, [pair])
    space = dolfinx.fem.functionspace(named.mesh, ("Lagrange", 1, (2,)))
    u = dolfinx.fem.Function(space)
    solids = [
        Solid("elastomer", u, named.cells("elastomer"), NeoHookean(G, K), formulation, 1100.0),
        Solid("aluminium", u, named.cells("aluminium"), NeoHookean(10 * G, 10 * K), "q1", 2700.0),
    ]
    slave, master = (named.facets(name) for name in pair)
    h = WIDTH / round(40 * refine)
    law = law_of(friction, 10.0 * G / h)
    surface = ContactSurface(space, slave, master, QUADRATURE_DEGREE[2])
    term = ContactTerm(surface, law, 3.0 * K / h, 10e-9)
    held = [Prescribed(component_dofs(space, named.facets("bottom"), k)) for k in (0, 1)]
    held.append(Prescribed(component_dofs(space, named.facets("top"), 0)))
    platen = Platen(component_dofs(space, named.facets("top"), 1), force=-PRESSURE * WIDTH)
    problem = Equilibrium(u, solids, [term], held, [platen])
    stepper = ExplicitStepper(problem, ExplicitOptions(compiled=compiled, check_every=100))
    cells = named.mesh.topology.index_map(2).size_global
    dt = stepper.options.dt_safety * stepper.stable_step()
    return Sliding(stepper, held[2], dt, cells, len(term.surface.slave.weight))


# -- kernels --------------------------------------------------------------------------------


def kernel_table(cells: int = 160) -> Iterator[str]:
    """Nanoseconds per cell of one evaluation of the internal forces, on cells² quadrilaterals."""
    G, K = shear_and_bulk(5e6, 0.45)
    materials: dict[str, Material] = {
        "neo-Hooke": NeoHookean(G, K),
        "Mooney-Rivlin": MooneyRivlin(0.4 * G, 0.1 * G, K),
        "Hencky": Hencky(G, K),
    }
    mesh = dolfinx.mesh.create_rectangle(
        MPI.COMM_SELF, [[0, 0], [1, 1]], [cells, cells], dolfinx.mesh.CellType.quadrilateral
    )
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,))))
    u.x.array[:] = 1e-3 / cells * np.random.default_rng(0).standard_normal(len(u.x.array))
    out = np.zeros_like(u.x.array)
    every = np.arange(cells * cells, dtype=np.int32)
    yield f"| internal forces, {cells * cells} cells | ns/cell |"
    yield "|---|---|"
    formulations: tuple[Formulation, ...] = ("q1", "q1-sri")
    for name, material in materials.items():
        for formulation in formulations:
            solid = Solid(name, u, every, material, formulation, 1.0)
            took = best(partial(_four_times, Bodies(u, [solid]), u.x.array, out))
            yield f"| {name}, {formulation} | {1e9 * took / 4.0 / cells**2:.1f} |"


def _four_times(internal: Bodies, u: Floats, out: Floats) -> None:
    for _ in range(4):
        internal.evaluate(u, out)


def contact_table(refine: float = SMALL) -> Iterator[str]:
    """Milliseconds of one evaluation of a contact pair and its forces, in numpy and compiled."""
    yield "| contact pair | points | numpy (ms) | compiled (ms) | ratio |"
    yield "|---|---|---|---|---|"
    for friction in get_args(Friction):
        case = sliding(refine, friction)
        case.run(3 * STEPS)
        problem, took = case.stepper.problem, []
        for compiled in (False, True):
            contact = explicit_contact(problem.contacts[0], compiled)
            out = NodalVector(problem.space)
            action = partial(_many_contacts, contact, case.stepper.state.u, case.dt, out, friction)
            took.append(1e3 * best(action) / STEPS)
        numbers = f"{took[0]:.3f} | {took[1]:.3f} | {took[0] / took[1]:.1f}"
        yield f"| {friction} | {case.points} | {numbers} |"


def _many_contacts(
    contact: ExplicitContact, u: NodalVector, dt: float, out: NodalVector, friction: Friction
) -> None:
    for _ in range(STEPS):
        contact.evaluate(u, dt)
        if friction == "film":
            contact.hold_film()
        contact.add_forces(out)


# -- steps --------------------------------------------------------------------------------


def step_table(refinements: tuple[float, ...] = (SMALL, MIDDLE, LARGE)) -> Iterator[str]:
    """What whole steps cost with contact and friction, by their parts."""
    yield (
        "| cells | points | friction | ms per step | ns per cell | million cells/s | assembly "
        "| contact | time integration | one generated assembly (ns/cell) | step / that |"
    )
    yield "|---" * 11 + "|"
    for refine, friction in itertools.product(refinements, get_args(Friction)):
        case = sliding(refine, friction)
        case.run(3 * STEPS)
        before = dict(case.stepper.problem.timer.seconds)
        steps = case.stepper.steps
        whole = best(case.run) / STEPS
        spent = {
            part: value - before.get(part, 0.0)
            for part, value in case.stepper.problem.timer.seconds.items()
        }
        total = sum(spent.values())
        assert case.stepper.steps == steps + REPEAT * STEPS
        shares = " | ".join(
            f"{100.0 * spent[part] / total:.0f} %"
            for part in ("assembly", "contact", "time integration")
        )
        problem = case.stepper.problem
        internal = problem.bodies
        out = np.zeros_like(problem.u.x.array)
        one = best(lambda i=internal, o=out: i.evaluate(problem.u.x.array, o))  # type: ignore[misc]
        yield (
            f"| {case.cells} | {case.points} | {friction} | {1e3 * whole:.3f} "
            f"| {1e9 * whole / case.cells:.0f} | {1e-6 * case.cells / whole:.2f} | {shares} "
            f"| {1e9 * one / case.cells:.0f} | {whole / one:.2f} |"
        )


# -- ranks --------------------------------------------------------------------------------


def rank_worker(refine: float, friction: Friction) -> None:
    """Print the processor time of a step, the largest of all ranks, as JSON; collective."""
    comm = MPI.COMM_WORLD
    case = sliding(refine, friction)
    case.run(STEPS)
    taken = []
    # Many short stretches: a rank that waits for one that another program keeps from its core
    # counts as busy, and only a stretch without that measures the cost of a step.
    for _ in range(8 * REPEAT):
        comm.barrier()
        start = seconds()
        case.run(STEPS // 2)
        taken.append(2.0 * comm.allreduce(seconds() - start, op=MPI.MAX) / STEPS)
    if comm.rank == 0:
        print(json.dumps({"cells": case.cells, "seconds": min(taken)}))


def rank_table(refine: float = LARGE, ranks: tuple[int, ...] = (1, 2)) -> Iterator[str]:
    """Steps on several ranks: the time of the slowest rank's processor."""
    yield "| friction | ranks | cells | ms per step | faster than one |"
    yield "|---|---|---|---|---|"
    for friction in get_args(Friction):
        alone = 0.0
        for count in ranks:
            worker = [
                __file__,
                "--worker",
                str(refine),
                "--friction",
                friction,
            ]
            command = [sys.executable, *worker]
            if count > 1:
                command = ["mpirun", "--oversubscribe", "-n", str(count), *command]
            done = subprocess.run(
                command, cwd=SOURCES, env=ENVIRONMENT, check=True, capture_output=True, text=True
            )
            found = json.loads(done.stdout.strip().splitlines()[-1])
            alone = alone or found["seconds"]
            yield (
                f"| {friction} | {count} | {found['cells']} | {1e3 * found['seconds']:.3f} "
                f"| {alone / found['seconds']:.2f} |"
            )


def explicit_table(ranks: int = 1) -> Iterator[str]:
    """Lines of the report, as Markdown: kernels, contact pairs, steps; several ranks if asked."""
    yield from kernel_table()
    yield ""
    yield from contact_table()
    yield ""
    yield from step_table()
    if ranks > 1:
        yield ""
        yield from rank_table(ranks=(1, ranks))


def lines() -> Iterator[str]:
    """Measure; lines of the report, as Markdown."""
    yield f"{len(os.sched_getaffinity(0))} cores, load average: {os.getloadavg()[0]:.1f}"
    yield ""
    yield from explicit_table()


def main() -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ranks", type=int, default=1, help="compare one rank with so many")
    parser.add_argument("--worker", type=float, help=argparse.SUPPRESS)
    parser.add_argument("--friction", default="film", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.worker:
        rank_worker(chosen.worker, chosen.friction)
        return
    print(f"{len(os.sched_getaffinity(0))} cores, load average: {os.getloadavg()[0]:.1f}\n")
    for line in explicit_table(chosen.ranks):
        print(line, flush=True)


if __name__ == "__main__":
    main()
