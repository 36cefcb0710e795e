"""Runs a case into a results directory: what ``tribox run`` does, callable from Python."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mpi4py import MPI

from app.build.model import Model, build_model
from app.case.case import Case
from app.case.given import given_keys
from app.checkpoint.checkpointer import Checkpointer
from app.checkpoint.resume import Found, find_checkpoint, go_on, started_line, version_notes
from app.errors import InputError, SolutionError
from app.results.directory import check_free, prepare
from app.results.earlier_sweep import sweep_labels
from app.results.inputs import NOTHING, keep_inputs, kept_inputs
from app.results.probes import ProbeRecorder
from app.results.recorder import Recorder
from app.run.interruption import Interruption
from app.run.progress import Reporter, Together
from app.simulation.explicit_stage import notes_on_steps
from app.simulation.history import energy_gap
from app.simulation.observer import Observer
from app.simulation.simulation import Simulation
from app.simulation.time_text import time_text


def run_case(
    case: Case,
    directory: Path,
    *,
    force: bool = False,
    quiet: bool = False,
    comm: MPI.Comm = MPI.COMM_WORLD,
    inputs_of: Path | None = None,
    resume: bool = False,
    extend: bool = False,
) -> Simulation:
    """Run one case (without its sweep) and write its results; collective.

    Args:
        case: what to run; friction laws in Python are run, as the caller is code itself.
        directory: results directory; made if missing.
        force: replace results that are there.
        quiet: print warnings and errors only.
        comm: ranks that work together.
        inputs_of: results directory of the sweep, whose copies of mesh and laws are linked.
        resume: go on from the last checkpoint in the directory; from the start if there is none.
        extend: the same, and past the end if the case has further stages.

    Returns:
        The finished simulation: ``rows`` is the history, ``model`` what was solved.

    Raises:
        InputError: the case, the mesh or the directory cannot be used; nothing has been changed.
        SolutionError: a step could not be solved; the state before it has been saved.
    """
    found = find_checkpoint(directory, comm) if resume or extend else None
    force = force or resume or extend
    if found is None:
        on_first(comm, lambda: check_free(directory, force, sweep_labels(directory)))
    model = build_model(case, comm)
    steps = notes_on_steps(model)
    simulation = Simulation(model)
    if found is None:
        recorder = _recorder(case, model, directory, inputs_of)
    else:
        recorder = _resumed(case, simulation, found, directory, extend)
    log, after = directory / "log.txt", None if found is None else simulation.state.step
    reporter = Reporter(log, case, quiet, resumed=found is not None) if comm.rank == 0 else None
    told: list[Observer] = [reporter, recorder] if reporter else [recorder]
    try:
        _say_notes(reporter, model.notes, steps, quiet)
        _say_resumed(reporter, simulation, found, quiet)
        probes = ProbeRecorder(model, directory, after)
        checkpointer = Checkpointer(simulation, recorder, directory)
        with Interruption(comm) as interruption:
            everybody = Together(*told, probes, interruption, checkpointer)
            _run(simulation, recorder, checkpointer, everybody)
        draw_run(simulation, directory, reporter)
        if reporter:
            _say_end(reporter, simulation, recorder, quiet)
    except (SolutionError, KeyboardInterrupt) as error:
        if reporter:
            _say_failure(reporter, simulation, recorder, error)
        draw_run(simulation, directory, reporter)
        raise
    finally:
        if reporter:
            reporter.close()
    return simulation


def _recorder(case: Case, model: Model, directory: Path, inputs_of: Path | None) -> Recorder:
    """Clear the directory, copy what the case reads into it and begin the files; collective."""
    kept = NOTHING  # but on the first rank, which writes

    def make_ready() -> None:
        nonlocal kept
        prepare(directory)
        kept = keep_inputs(case, directory, inputs_of)

    on_first(model.problem.comm, make_ready)
    return Recorder(model, directory, given_keys(case), kept)


def _resumed(
    case: Case, simulation: Simulation, found: Found, directory: Path, extend: bool
) -> Recorder:
    """Put the run where its checkpoint was taken, and go on with its files; collective.

    Raises:
        InputError: case, mesh or tables are not those that the run began with.
    """
    comm, kept = simulation.model.problem.comm, NOTHING

    def look() -> None:
        nonlocal kept
        kept = kept_inputs(case)

    on_first(comm, look)
    seen = go_on(simulation, found, directory, extend, kept.sums)
    recorder = Recorder(simulation.model, directory, given_keys(case), kept, seen)
    recorder.go_on(simulation.state)
    return recorder


def _say_notes(
    reporter: Reporter | None, notes: Sequence[str], steps: Sequence[str], quiet: bool
) -> None:
    """The notes on a case, and those on the time steps of its explicit stages."""
    if reporter is None:
        return
    for note in notes:
        reporter.say(f"note: {note}")
    for note in steps:
        reporter.say(f"note: {note}", always=not quiet)


def _say_resumed(
    reporter: Reporter | None, simulation: Simulation, found: Found | None, quiet: bool
) -> None:
    """From where a run goes on."""
    if reporter is not None and found is not None:
        for note in (*found.notes, *version_notes(found.about)):
            reporter.say(f"note: {note}")
        reporter.say(started_line(found, simulation), always=not quiet)


def _say_warnings(reporter: Reporter, recorder: Recorder) -> None:
    """The warnings that came up during the run."""
    for warning in recorder.warnings[len(recorder.model.notes) :]:
        reporter.say(f"warning: {warning}")


def _say_end(reporter: Reporter, simulation: Simulation, recorder: Recorder, quiet: bool) -> None:
    """Warnings, figures of the run and the place of the results."""
    _say_warnings(reporter, recorder)
    for line in (_closing_line(simulation), f"results in {recorder.directory}"):
        reporter.say(line, always=not quiet)


def _say_failure(
    reporter: Reporter,
    simulation: Simulation,
    recorder: Recorder,
    error: SolutionError | KeyboardInterrupt,
) -> None:
    """What ended the run, for the log, and what is saved."""
    if isinstance(error, KeyboardInterrupt):
        reporter.say(f"interrupted; the results so far are in {recorder.directory}")
        return
    reporter.note(f"failed: {error}")
    _say_warnings(reporter, recorder)
    reporter.say(_saved_line(simulation, recorder))


def _saved_line(simulation: Simulation, recorder: Recorder) -> str:
    """Where the last converged state of a failed run is."""
    state, directory = simulation.state, recorder.directory
    if state.step == 0:
        return f"no step was solved, so {directory} holds no state"
    # An explicit run fails between two rows; its last output may be that of the row before.
    time, files = recorder.last_output
    when = time_text(time, simulation.rows[-1].dt)
    what = "converged" if simulation.explicit is None else "valid"
    return (
        f"the last {what} state, step {state.step} at time {when}, is saved in {directory}: "
        f"{files}, and the steps that led there in history.csv"
    )


def _closing_line(simulation: Simulation) -> str:
    """Steps, iterations, penetration and energy balance of a finished run."""
    rows = simulation.rows
    deepest = max(row.max_penetration for row in rows)
    depth = f"{deepest:.3g} m"
    explicit = simulation.explicit
    counted = f"{sum(row.newton_iterations for row in rows)} Newton iterations"
    if explicit is not None:
        counted += f", {explicit.steps} time steps"
    return (
        f"{len(rows)} steps, {counted}, "
        f"largest penetration {depth}, energy balanced to {abs(energy_gap(rows)):.1e}"
        f" of the {'work or kinetic energy' if explicit else 'external work'}"
    )


def _run(
    simulation: Simulation, recorder: Recorder, checkpointer: Checkpointer, observer: Observer
) -> None:
    try:
        simulation.run(observer)
    except SolutionError as error:
        checkpointer.close("failed")
        recorder.close(simulation, "failed", str(error))
        raise
    except KeyboardInterrupt:
        checkpointer.close("interrupted")
        recorder.close(simulation, "interrupted")
        raise
    except BaseException:
        # An error of one rank alone: the others are not here, so nothing collective may follow.
        recorder.rescue(simulation)
        raise
    checkpointer.close("done")
    recorder.close(simulation, "done")


def draw_run(simulation: Simulation, directory: Path, reporter: Reporter | None) -> None:
    """Draw the figures of a run, however it ended, from its files; collective.

    If the case asks for them and there is a step to show. The first rank draws and the others wait:
    of a failed run mpirun would end it with the first of them. A figure that cannot be drawn is a
    warning: the results are there, and can be drawn again.
    """
    if reporter is not None and simulation.model.case.output.figures and simulation.state.step > 0:
        _draw(simulation, directory, reporter)
    simulation.model.problem.comm.barrier()


def _draw(simulation: Simulation, directory: Path, reporter: Reporter) -> None:
    from app.figures.run_figures import draw_figures
    from app.results import read

    with simulation.model.problem.timer("figures"):
        try:
            draw_figures(read(directory))
        except Exception as error:
            reporter.say(f"warning: the figures could not be drawn: {error!r}")


def on_first(comm: MPI.Comm, action: Callable[[], None]) -> None:
    """Do something on the first rank; if it raises, raise on all."""
    problem: str | None = None
    if comm.rank == 0:
        try:
            action()
        except InputError as error:
            problem = str(error)
    problem = comm.bcast(problem)
    if problem is not None:
        raise InputError(problem)
