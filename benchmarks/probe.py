"""``tribox run``, with the CPU time of its parts taken.

``python -m benchmarks.probe REPORT CASE ...`` runs the command as it is, in this process,
with the functions named in :data:`FRAME` and :data:`PROBES` replaced by timed ones, and writes what
it measured to the file REPORT (JSON). The parts of the solution count only inside an attempt at a
step; whatever else happens belongs to the part around it, and what belongs to none is "imports":
the start of Python, its imports, the reading of the case. The clock is that of the process's CPU
time, user and system.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import resource
import runpy
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial, wraps
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.timers import Stopwatch
from tribox.app.run.process import lasting_imports

if TYPE_CHECKING:
    from tribox.app.simulation.simulation import Simulation

# Function, as module and name in it, and the part of the run it counts for.
FRAME = {
    "tribox.app.run.run:build_model": "set-up",
    "tribox.app.run.run:Simulation.__init__": "set-up",
    "tribox.app.run.run:Recorder.__init__": "set-up",
    "tribox.app.run.run:Recorder.step": "output",
    "tribox.app.run.run:Recorder.load_step": "output",
    "tribox.app.run.run:Recorder.close": "output",
    "tribox.app.run.run:ClaimedRun.draw": "figures",
    "tribox.app.run.run:Simulation.run": "between steps",
    "tribox.app.implicit.stepper:ImplicitStepper.attempt": "rest of solver",
}
# The same inside an attempt at a step.
PROBES = {
    "tribox.app.equilibrium.equilibrium:Equilibrium._gathered": "solid residual",
    "tribox.app.equilibrium.tangent:Tangent._assemble_forms": "solid tangent",
    "tribox.app.equilibrium.equilibrium:Equilibrium.strain_energy": "solid residual",
    "tribox.geometry.surfaces.surface:ContactSurface.gather": "kinematics",
    "tribox.geometry.surfaces.facet_search:FacetSearch.candidates": "search",
    "tribox.geometry.surfaces.projection:FacetSurface.project": "projection",
    "tribox.forms.contact.penalty:ContactTerm.related": "kinematics",
    "tribox.forms.contact.penalty:ContactTerm.add_tangent": "tangent blocks",
    "tribox.forms.contact.penalty:ContactTerm.forces_at_nodes": "nodal forces",
    "tribox.app.equilibrium.equilibrium:Equilibrium._contact_forces": "merge into the residual",
    "tribox.app.equilibrium.tangent:Tangent._add_contact": "merge into the matrix",
}
# Parts that the solution itself tells apart, and those of PETSc's events.
TIMED = {
    "assembly": "constrained rows",
    "contact": "rest of contact",
    "pattern": "pattern",
    "factorisation": "numeric factorisation",
    "preconditioner": "numeric factorisation",
    "linear solve": "rest of solver",
}
EVENTS = {
    "MatLUFactorSym": "symbolic factorisation",
    "MatCholFctrSym": "symbolic factorisation",
    "MatLUFactorNum": "numeric factorisation",
    "MatCholFctrNum": "numeric factorisation",
    "PCSetUp": "numeric factorisation",
    "KSPSolve": "solve",
}
REPEATS = 3  # of the single factorisation; the fastest counts


@dataclass(slots=True)
class Probe:
    """Stopwatch of CPU time whose inner parts count only while a step is attempted.

    Attributes:
        watch: where the seconds add up; inside: whether a step is being attempted.
    """

    watch: Stopwatch = field(default_factory=lambda: Stopwatch(time.process_time))
    inside: bool = False

    @property
    def seconds(self) -> dict[str, float]:
        """CPU seconds by part."""
        return self.watch.seconds

    @contextmanager
    def __call__(self, part: str) -> Iterator[None]:
        """Stand in for the stopwatch of the solution."""
        self.begin(TIMED.get(part, part))
        try:
            yield
        finally:
            self.end()

    def begin(self, part: str) -> None:
        """Count towards ``part`` from here on, inside an attempt."""
        if self.inside:
            self.watch.begin(part)

    def end(self) -> None:
        """Go on with the part around."""
        if self.inside:
            self.watch.end()

    def timed(self, function: Callable[..., Any], part: str) -> Callable[..., Any]:
        """``function``, counted towards ``part`` inside an attempt."""

        @wraps(function)
        def call(*args: Any, **keywords: Any) -> Any:
            self.begin(part)
            try:
                return function(*args, **keywords)
            finally:
                self.end()

        return call

    def framed(self, function: Callable[..., Any], part: str) -> Callable[..., Any]:
        """``function``, counted towards ``part`` wherever it is called; an attempt opens probes."""

        @wraps(function)
        def call(*args: Any, **keywords: Any) -> Any:
            with self.watch(part):
                self.inside = part == "rest of solver"
                try:
                    return function(*args, **keywords)
                finally:
                    self.inside = False

        return call


def replace(where: str, wrap: Callable[[Callable[..., Any]], Callable[..., Any]]) -> None:
    """Replace the function at "module:name" or "module:class.name".

    Raises:
        AttributeError: there is none; the tables above must name what the program has.
    """
    module, _, name = where.partition(":")
    owner: Any = importlib.import_module(module)
    *outer, last = name.split(".")
    for step in outer:
        owner = getattr(owner, step)
    setattr(owner, last, wrap(getattr(owner, last)))


def install(probe: Probe) -> list[Simulation]:
    """Put the probes in; the list returned will hold the simulation once it has been made."""
    import tribox.app.equilibrium.equilibrium
    import tribox.app.run.run

    for where, part in FRAME.items():
        replace(where, partial(probe.framed, part=part))
    for where, part in PROBES.items():
        replace(where, partial(probe.timed, part=part))
    tribox.app.equilibrium.equilibrium.Stopwatch = lambda: probe  # type: ignore[attr-defined,assignment,misc]
    made: list[Simulation] = []

    def keep(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(simulation: Simulation, *args: Any, **keywords: Any) -> Any:
            made.append(simulation)
            laws = {type(term.law) for term in simulation.model.problem.contacts}
            for law in laws:
                law.update = probe.timed(law.update, "law")  # type: ignore[method-assign]
            return function(simulation, *args, **keywords)

        return call

    replace("tribox.app.simulation.simulation:Simulation.run", keep)
    return made


def measure(case: Sequence[str]) -> dict[str, Any]:
    """Run ``tribox run`` with the words ``case`` and return what the report holds."""
    probe = Probe()
    with lasting_imports():
        made = install(probe)
    probe.seconds["imports"] = time.process_time()
    with probe.watch("imports"), events(EVENTS, probe.begin, probe.end):
        before, sys.argv = sys.argv, ["tribox", "run", *case]
        try:
            runpy.run_module("tribox", run_name="__main__", alter_sys=True)
        except SystemExit as end:
            if end.code:
                raise
        finally:
            sys.argv = before
    ran = time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    (simulation,) = made
    once = one_factorisation(simulation)
    rows = simulation.rows
    return {
        "dofs": simulation.model.problem.new_vector().getSize(),
        "steps": len(rows),
        "attempts": sum(row.attempts for row in rows),
        "iterations": sum(row.newton_iterations for row in rows),
        "gross": most_in_gross_sliding(simulation),
        "seconds": dict(probe.seconds),
        "calls": dict(probe.watch.calls),
        "memory": peak,
        "factorisation": once,
        "afterwards": time.process_time() - ran,
    }


def most_in_gross_sliding(simulation: Simulation) -> int:
    """Most Newton iterations in a step that all points slid through; 0 without such a step.

    The step before must have slid from its beginning, too: the predictor repeats it.
    """
    rows = simulation.rows
    slid = [row.contact_area > 0.0 and row.stick_fraction == 0.0 for row in rows]
    whole = [a and b for a, b in pairwise(slid)]
    return max(
        (
            row.newton_iterations
            for row, before, now in zip(rows[2:], whole, whole[1:], strict=False)
            if before and now
        ),
        default=0,
    )


def one_factorisation(simulation: Simulation) -> float:
    """CPU seconds of one analysis and factorisation of the last tangent, MUMPS as it comes."""
    from petsc4py import PETSc

    assert simulation.implicit is not None
    tangent = simulation.implicit.stepper.snes.getJacobian()[0]
    fastest = float("inf")
    for _ in range(REPEATS):
        pc = PETSc.PC().create(simulation.model.problem.comm)
        pc.setOptionsPrefix("bench_")
        pc.setType("lu")
        pc.setFactorSolverType("mumps")
        pc.setOperators(tangent)
        started = time.process_time()
        pc.setUp()
        fastest = min(fastest, time.process_time() - started)
        pc.destroy()
    return fastest


def main() -> None:
    """Measure one command and write the report."""
    report, *case = sys.argv[1:]
    Path(report).write_text(json.dumps(measure(case), indent=1), encoding="utf-8")


# -- Lets a function hear of the events PETSc logs, as they begin and end --------------------------
#
# PETSc's own log keeps wall time only. Its callback interface, which petsc4py leaves out, is called
# through ctypes; see the manual page of ``PetscLogHandlerCreateLegacy``.

_EVENT = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_int, *[ctypes.c_void_p] * 4)
_OBJECT = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)


@contextmanager
def events(
    names: Mapping[str, str], begin: Callable[[str], None], end: Callable[[], None]
) -> Iterator[None]:
    """Call ``begin(part)`` and ``end()`` around the events named, within a ``with`` block.

    Args:
        names: part by name of PETSc's event, such as "MatLUFactorNum".
        begin: told that an event of the part begins.
        end: told that the event begun last ends.

    Raises:
        RuntimeError: PETSc refuses the callbacks.
    """
    parts = {PETSc.Log.Event(event).id: part for event, part in names.items()}

    def begun(event: int, *_: object) -> int:
        if event in parts:
            begin(parts[event])
        return 0

    def ended(event: int, *_: object) -> int:
        if event in parts:
            end()
        return 0

    # The names keep the callbacks alive until PETSc has let go of them.
    calls = (_EVENT(begun), _EVENT(ended), _OBJECT(lambda _: 0), _OBJECT(lambda _: 0))
    library = ctypes.CDLL(PETSc.__file__)
    handler = ctypes.c_void_p()
    # This process alone, as C passes a communicator: a pointer or an integer.
    pointer = MPI._sizeof(MPI.Comm) == ctypes.sizeof(ctypes.c_void_p)
    kind = ctypes.c_void_p if pointer else ctypes.c_int
    alone = kind.from_address(MPI._addressof(MPI.COMM_SELF))
    _check(library.PetscLogHandlerCreateLegacy(alone, *calls, ctypes.byref(handler)))
    _check(library.PetscLogHandlerStart(handler))
    try:
        yield
    finally:
        _check(library.PetscLogHandlerStop(handler))
        _check(library.PetscLogHandlerDestroy(ctypes.byref(handler)))


def _check(code: int) -> None:
    if code:
        raise RuntimeError(f"PETSc does not let its events be heard (error {code})")


if __name__ == "__main__":
    main()
