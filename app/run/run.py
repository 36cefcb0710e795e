"""Runs a case into a results directory: what ``tribox run`` does, callable from Python."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Self

import numpy as np
from mpi4py import MPI

from tribox.app.build.mesh import of_case
from tribox.app.build.model import build_model
from tribox.app.case.case import Case, given_keys
from tribox.app.case.geometry import MeshGeometry
from tribox.app.case.reading import load_past_case
from tribox.app.case.stage import LoadStep
from tribox.app.checkpoint.checkpointer import Checkpointer
from tribox.app.checkpoint.resume import Found, find_checkpoint, go_on, started_line, version_notes
from tribox.app.errors import InputError, Interrupted, OutputError, SolutionError
from tribox.app.implicit.linear_solver import silence
from tribox.app.implicit.stepper import StepResult
from tribox.app.results.claim import Claim, check_may_begin_anew
from tribox.app.results.directory import sha256_of
from tribox.app.results.inputs import INPUTS, NOTHING, keep_inputs, kept_inputs
from tribox.app.results.probes import ProbeRecorder, shape_line
from tribox.app.results.recorder import Recorder
from tribox.app.results.saving import Saving, on_first
from tribox.app.run import ranks
from tribox.app.run.process import give_memory_back
from tribox.app.run.progress import Reporter, Together
from tribox.app.simulation.explicit_stage import notes_on_steps
from tribox.app.simulation.history import Row, energy_gap, time_text
from tribox.app.simulation.run_state import Observer, RunState
from tribox.app.simulation.simulation import Simulation
from tribox.geometry.meshes.drawing import mesh_drawing
from tribox.geometry.meshes.gmsh_model import MeshError
from tribox.geometry.surfaces.facets import Floats


class Interruption(Observer):
    """Context in which a signal to stop is noted, and obeyed after the step it came in.

    SIGINT, SIGTERM, SIGHUP unless it was ignored before, and SIGUSR1, by which ranks are told.
    Ranks that stop at different places wait for each other for ever. Ctrl-C, or the same signal
    again, does what it would have done outside, at once. A write that has failed on a rank ends
    the run likewise.

    Attributes:
        noted: called at once when a signal comes, on this rank alone.
        asked: whether one has come to this rank, or has stopped all.
    """

    def __init__(self, comm: MPI.Comm, saving: Saving) -> None:
        self._comm, self._saving = comm, saving
        self.noted: Callable[[], None] | None = None
        self.asked = False
        self._before: dict[signal.Signals, signal._HANDLER] = {}

    def __enter__(self) -> Self:
        self._before = ranks.taken(dict.fromkeys(ranks.stopping_signals(), self._note))
        if self._before:
            # PETSc, unless told not to, takes this one too, and ends the process at a closed pipe.
            signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        return self

    def __exit__(self, *error: object) -> None:
        self.restore()

    def ready(self, state: RunState) -> None:
        """Stop here if any rank has been asked to, or could not write."""
        self.look()

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Stop here if any rank has been asked to, or could not write."""
        self.look()

    def load_step(
        self, state: RunState, load_step: LoadStep, row: Row, steady: bool | None
    ) -> None:
        """Stop here if any rank could not write."""
        self._saving.raise_together(self._comm)

    def _note(self, number: int, frame: FrameType | None) -> None:
        first, self.asked = not self.asked, True
        self.restore(ranks.repeats(number))
        if not first:
            return
        # mpirun, if it is the one that was asked, will not wait for long.
        if self._comm.rank == 0 and not ranks.tell_exit_code(ranks.INTERRUPTED):
            ranks.say_stopping()  # else the process that waits for the ranks has said it
        if self.noted is not None:
            self.noted()

    def restore(self, numbers: Collection[int] | None = None) -> None:
        """Take no more signals, or none of these numbers."""
        by_mpirun = self._comm.size > 1 or ranks.EXIT_CODE in os.environ
        if numbers is None and self.asked and by_mpirun and signal.SIGUSR1 in self._before:
            # One more may be still to come: the second of mpirun's, or as another rank came first.
            self._before[signal.SIGUSR1] = signal.SIG_IGN
        chosen = [n for n in self._before if numbers is None or n in numbers]
        ranks.give_back({number: self._before.pop(number) for number in chosen})

    def look(self) -> None:
        """Interrupted, or OutputError, if any rank is to stop or cannot write; collective."""
        self._saving.raise_together(self._comm)
        if self._comm.allreduce(self.asked, op=MPI.LOR):
            self.asked = True
            raise Interrupted


NOTES_REPEATED = 3  # at most, beside a failure


def run_case(
    case: Case,
    directory: str | Path,
    *,
    force: bool = False,
    quiet: bool = False,
    comm: MPI.Comm = MPI.COMM_WORLD,
    inputs_of: Path | None = None,
    resume: bool = False,
    extend: bool = False,
) -> Simulation:
    """Run one case (without its sweep) and write its results; collective.

    Returns the finished simulation: ``rows`` is the history, ``model`` what was solved.

    Raises:
        InputError: the case, the mesh or the directory cannot be used; nothing has been changed.
        SolutionError: a step could not be solved; the state before it has been saved.
        OutputError: results cannot be written; what has been written is valid.
        Interrupted: a signal has stopped the run; its state has been saved.
    """
    give_memory_back()
    directory = Path(directory)
    claim = Claim(directory, force or resume or extend)
    on_first(comm, lambda: claim.take(resume or extend))
    try:
        found = _to_go_on(directory, extend, comm) if resume or extend else None
        with meshed(case, directory if found else None, comm) as whole:
            claimed = ClaimedRun(whole, claim, found, comm)
            claimed.run(resume, extend, inputs_of, quiet)
            return claimed.simulation
    finally:
        claim.release()


def _to_go_on(directory: Path, extend: bool, comm: MPI.Comm) -> Found | None:
    """The checkpoint to go on from, or None if the run may begin anew; collective."""
    found = find_checkpoint(directory, comm)
    if found is None:
        if extend:
            raise InputError(f"--extend: {directory} holds no checkpoint to go on from")
        on_first(comm, lambda: check_may_begin_anew(directory))
    return found


class ClaimedRun:
    """A case in a directory that is this run's, and who tells and keeps what comes of it.

    Attributes:
        claim: on the results directory; found: checkpoint that it goes on from, or None.
        steps: notes on explicit time steps; simulation: what is run.
        saving: keeps errors of writing files; recorder: of the results.
        reporter: tells the user, on the first rank; None on the others.
    """

    recorder: Recorder

    def __init__(self, case: Case, claim: Claim, found: Found | None, comm: MPI.Comm) -> None:
        """Build the model; InputError if it cannot be run; collective."""
        self._case, self._comm, self.claim, self.found = case, comm, claim, found
        model = build_model(case, comm)
        try:
            self.steps, self.simulation = notes_on_steps(model), Simulation(model)
        except InputError as error:
            raise of_case(case, error) from None
        self.saving = Saving(claim.directory)
        self.reporter: Reporter | None = None

    def run(self, resume: bool, extend: bool, inputs_of: Path | None, quiet: bool) -> None:
        """Run it; see :func:`run_case`; ``resume``: whether it was to go on."""
        comm, simulation, directory = self._comm, self.simulation, self.claim.directory
        resumed = self.found is not None
        with Interruption(comm, self.saving) as interruption:
            self.recorder = self._recorder(extend, inputs_of)
            interruption.noted = partial(self.recorder.mark, "interrupted")
            told: list[Observer] = [self.recorder]
            if comm.rank == 0:
                log = directory / "log.txt"
                self.reporter = Reporter(log, self._case, self.saving, quiet, resumed=resumed)
                told.insert(0, self.reporter)
            try:
                self._say_begin(resume)
                after = simulation.state.step if resumed else None
                probes = ProbeRecorder(simulation.model, directory, self.saving, after)
                checkpointer = Checkpointer(simulation, self.recorder, probes, directory)
                everybody = Together(*told, probes, interruption, checkpointer)
                self._run(checkpointer, interruption, everybody)
                interruption.restore()
                self.draw()
                self._say_end()
                self.saving.raise_together(comm)
            except (SolutionError, OutputError, Interrupted) as error:
                self._say_failure(error)
                if not isinstance(error, OutputError):
                    self.draw()
                raise
            finally:
                if self.reporter:
                    self.reporter.close()

    def _recorder(self, extend: bool, inputs_of: Path | None) -> Recorder:
        """Make the directory ready and begin its files, or go on with them; collective."""
        simulation, directory, found = self.simulation, self.claim.directory, self.found
        kept, seen = NOTHING, None  # but on the first rank, which writes

        def make_ready() -> None:
            nonlocal kept
            if found is not None:
                kept = kept_inputs(self._case)
                return
            self.claim.clear(begins=True)
            kept = keep_inputs(self._case, directory, inputs_of)

        on_first(self._comm, make_ready)
        if found is not None:
            try:
                seen = go_on(simulation, found, directory, extend)
            except InputError:
                silence()  # PETSc has had no use for the options of a solver that solves nothing
                raise
        keys = given_keys(self._case)
        recorder = Recorder(simulation.model, directory, keys, kept, self.saving, seen)
        if found is not None:
            recorder.go_on(simulation.state)
        return recorder

    def _run(
        self, checkpointer: Checkpointer, interruption: Interruption, observer: Observer
    ) -> None:
        """Run to an end, and save the state where ranks end early, together or one alone."""
        recorder, simulation = self.recorder, self.simulation
        try:
            try:
                interruption.look()  # what has come while the files were begun
                simulation.run(observer)
                checkpointer.close("done")
            except (SolutionError, OutputError, Interrupted) as error:
                stopped = isinstance(error, Interrupted)
                status, why = ("interrupted", []) if stopped else ("failed", [str(error)])
                if not isinstance(error, OutputError):
                    try:
                        checkpointer.close(status)
                    except OutputError as more:  # there are results to be saved yet
                        self.saving.note(str(more))
                recorder.close(simulation, status, *why)
                raise
        except (SolutionError, OutputError, Interrupted):
            raise
        except BaseException as error:
            # An error of one rank alone: the others are not here, so nothing collective may follow.
            # A second signal may come while the state is being saved for the first; whoever is
            # called back just then, by a library in C, may make another error of it. The kernel
            # sends two when a sweep is killed whose threads end one after the other.
            stopped = interruption.asked or isinstance(error, KeyboardInterrupt)
            how = ("interrupted",) if stopped else ("failed", repr(error))
            recorder.rescue(simulation, *how)
            if stopped:
                raise KeyboardInterrupt from error
            raise
        recorder.close(simulation, "done")

    # -- what is told -------------------------------------------------------------------------

    def _say_begin(self, resume: bool) -> None:
        """The notes on a case, those on its explicit time steps, and from where a run goes on."""
        reporter, simulation, found = self.reporter, self.simulation, self.found
        if reporter is None:
            return
        for note in simulation.model.notes:
            reporter.say(f"note: {note}")
        for note in self.steps:
            reporter.tell(f"note: {note}")
        if found is None:
            if resume:
                reporter.tell("no checkpoint yet: begins anew")
            return
        for note in (*found.notes, *version_notes(found.about)):
            reporter.say(f"note: {note}")
        reporter.tell(started_line(found, simulation))
        ends = [one["time"] for one in self.recorder.load_steps]
        explicit = simulation.explicit
        reporter.go_on(simulation.state, ends, explicit.steps if explicit else 0)

    def _say_warnings(self, reporter: Reporter) -> None:
        """The warnings that came up during the run."""
        for warning in self.recorder.warnings[len(self.simulation.model.notes) :]:
            reporter.say(f"warning: {warning}")

    def _say_end(self) -> None:
        """Warnings, figures of the run, its tools and shapes, and the place of the results."""
        if (reporter := self.reporter) is None:
            return
        self._say_warnings(reporter)
        shapes = self.recorder.shapes().items() if self.recorder.first else ()
        for line in (
            *(_closing_line(self.simulation), *tool_lines(self.simulation.state)),
            *(shape_line(name, shape) for name, shape in shapes),
            f"results in {self.claim.directory}",
        ):
            reporter.tell(line)

    def _say_failure(self, error: SolutionError | OutputError | Interrupted) -> None:
        """What ended the run, for the log, and what is saved."""
        if (reporter := self.reporter) is None:
            return
        if isinstance(error, Interrupted):
            reporter.say(f"interrupted; the results so far are in {self.claim.directory}")
            return
        reporter.note(f"failed: {error}")
        if isinstance(error, OutputError):
            return
        self._say_warnings(reporter)
        # What was said long ago may explain it.
        for note in self.simulation.model.notes[:NOTES_REPEATED]:
            reporter.say(f"noted before the run: {note}")
        reporter.say(self._saved_line())

    def _saved_line(self) -> str:
        """Where the last converged state of a failed run is."""
        state, directory = self.simulation.state, self.claim.directory
        if state.step == 0:
            return f"no step was solved, so {directory} holds no state"
        # An explicit run fails between two rows; its last output may be that of the row before.
        time, files = self.recorder.last_output
        when = time_text(time, state.rows[-1].dt)
        what = "converged" if self.simulation.explicit is None else "valid"
        return (
            f"the last {what} state, step {state.step} at time {when}, is saved in {directory}: "
            f"{files}, and the steps that led there in history.csv"
        )

    def draw(self) -> None:
        """Draw the figures of a run, however it ended, from its files; collective.

        If the case asks for them and there is a step to show. The first rank draws and the others
        wait: of a failed run mpirun would end it with the first of them. A figure that cannot be
        drawn is a warning: the results are there, and can be drawn again.
        """
        model, reporter = self.simulation.model, self.reporter
        if reporter is not None and model.case.output.figures and self.simulation.state.step > 0:
            from tribox.app.figures.run_figures import draw_figures
            from tribox.app.results import read

            with self.saving, model.problem.timer("figures"):
                try:
                    draw_figures(read(self.claim.directory))
                except OSError:
                    raise
                except Exception as error:
                    reporter.say(f"warning: the figures could not be drawn: {error!r}")
        self._comm.barrier()


def _closing_line(simulation: Simulation) -> str:
    """Steps, iterations, penetration and energy balance of a finished run."""
    rows = simulation.rows
    depth = ""
    if simulation.model.case.contact:
        depth = f"largest penetration {max(row.max_penetration for row in rows):.3g} m, "
    explicit = simulation.explicit
    counted = f"{sum(row.newton_iterations for row in rows)} Newton iterations"
    if linear := sum(row.linear_iterations for row in rows):
        counted += f", {linear} linear iterations"
    if explicit is not None:
        counted += f", {explicit.steps} time steps"
    return (
        f"{len(rows)} steps, {counted}, "
        f"{depth}energy balanced to {abs(energy_gap(rows)):.1e}"
        f" of the {'work or kinetic energy' if explicit else 'external work'}"
    )


# -- What a run tells of its rigid tools at its end: a line each -----------------------------------

ROUND_OFF = 1e-10  # of the largest force of the run, or its moment on the size of the mesh


def tool_lines(state: RunState) -> Iterator[str]:
    """A line on each tool: how far it has come, and the force and moment of the bodies on it."""
    columns, rows = state.tools.columns, state.tools.rows
    if not rows:
        return
    kinds = {
        kind: [at for at, name in enumerate(columns) if name.rpartition("_")[0] == kind]
        for kind in ("displacement", "force", "moment")
    }
    values = {kind: np.array([[row[at] for at in ats] for row in rows], dtype=np.float64)
              for kind, ats in kinds.items()}  # fmt: skip
    names, turned = columns.index("tool"), columns.index("rotation")
    noise = ROUND_OFF * float(np.max(np.abs(values["force"])))
    for tool in state.model.problem.tools:
        mine = np.array([row[names] == tool.name for row in rows])
        moved = _vector(values["displacement"][mine][-1], 0.0)
        angle = float(rows[int(np.flatnonzero(mine)[-1])][turned])
        yield (
            f"tool {tool.name}: moved by {moved} m"
            + (f", turned by {angle:.4g} rad" if angle else "")
            + f"; force on it {_end_and_most(values['force'][mine], 'N', noise)}"
            + f"; moment {_end_and_most(values['moment'][mine], 'N m', noise * tool.motion.length)}"
        )


def _end_and_most(values: Floats, unit: str, noise: float) -> str:
    """The last of vectors (s, i), and the size of the largest."""
    most = float(np.max(np.linalg.norm(np.where(np.abs(values) > noise, values, 0.0), axis=1)))
    return f"{_vector(values[-1], noise)} {unit}, at most {most:.4g} {unit}"


def _vector(components: Floats, noise: float) -> str:
    """Components, those that are noise as 0; one alone without brackets."""
    texts = [f"{0.0 if abs(one) <= noise else one:.4g}" for one in components]
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"


# -- The mesh of a run's drawing: made when it begins, and the same one when it goes on  ----------


@contextmanager
def meshed(case: Case, directory: Path | None, comm: MPI.Comm) -> Iterator[Case]:
    """Context with the case whose drawing, if any, is meshed; InputError; collective.

    The mesh is that of the results in ``directory`` where they are of the same drawing, so that a
    run goes on with the mesh it began with, whatever gmsh would make of the drawing today. Within
    the context the mesh is a file, which may be copied.
    """
    geometry = case.geometry
    if not isinstance(geometry, MeshGeometry) or not geometry.is_drawing or geometry.meshed:
        yield case
        return
    with TemporaryDirectory() as place:
        where = Path(place) / f"{geometry.mesh.stem}.msh"

        def make() -> Path:
            kept = None if directory is None else _kept(geometry, directory)
            if kept is not None:
                return kept
            source = "" if case.source is None else f"{case.source}: "
            try:
                mesh_drawing(geometry.mesh, where, geometry.meshing())
            except MeshError as error:
                raise InputError(f"{source}geometry.mesh: {error}") from None
            return where

        yield case.with_mesh(comm.bcast(on_first(comm, make)))


def _kept(geometry: MeshGeometry, directory: Path) -> Path | None:
    """The mesh in a results directory, if it is one of this drawing."""
    began = load_past_case(directory / "case.toml").geometry
    if not isinstance(began, MeshGeometry) or began.meshed is None or not began.meshed.is_file():
        return None
    copy = directory / INPUTS / began.mesh.name
    same = copy.is_file() and sha256_of(copy) == sha256_of(geometry.mesh)
    return began.meshed if same else None
