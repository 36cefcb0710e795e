"""What ``tribox run`` does with a sweep: its values side by side, or in turn on the ranks here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from app.case.case import Case, resolved_toml
from app.errors import SolutionError
from app.results.claim import Claim, claimed
from app.results.directory import unwritable, write_text
from app.run.sweep import Part, collate, cores, part_command, run_side_by_side
from app.run.sweep_lines import sweep_lines


@dataclass(frozen=True, slots=True)
class SweepOptions:
    """How a sweep is run.

    Attributes:
        changes: options of the command line that change the case.
        ranks: MPI ranks of each run.
        force: replace results that are there.
        jobs: runs at a time; None: as many as the cores allow.
    """

    changes: Sequence[str] = ()
    ranks: int = 1
    force: bool = False
    jobs: int | None = None


def run_sweep(
    case: Case, case_file: Path, directory: Path, options: SweepOptions, around: int
) -> None:
    """Run all values of a sweep, collate what they give and draw it.

    Args:
        case: with the sweep.
        case_file: where it was read from.
        directory: of the results.
        options: of the sweep.
        around: ranks that this process was started with; with more than one, all of them take the
            values one after the other.

    Raises:
        InputError: the case or the directory cannot be used; nothing has been changed.
        SolutionError: a run failed; the others have been made.
    """
    if around > 1:
        _run_in_turn(case, directory, options.force)
        return
    from app.run.building import notes_on_building

    with claimed(directory, options.force) as claim:
        notes_on_building(case.sweep_cases()[0][1])
        _make_ready(case, claim)
        words = [*options.changes, "--np", str(options.ranks)]
        parts = [
            Part(label, part_command(case_file, i, directory / label, words), directory / label)
            for i, (label, _) in enumerate(case.sweep_cases())
        ]
        jobs = options.jobs or max(1, cores() // options.ranks)
        with _put_together(case, directory), sweep_lines(len(parts)) as lines:
            run_side_by_side(parts, jobs, lines)
    print(f"results in {directory}")


def _run_in_turn(case: Case, directory: Path, force: bool) -> None:
    """All ranks of one mpirun take the values one after the other."""
    from mpi4py import MPI

    from app.run.run import on_first, run_case

    comm = MPI.COMM_WORLD
    claim = Claim(directory, force)
    on_first(comm, claim.take)
    try:
        on_first(comm, lambda: _make_ready(case, claim))
        failed = []
        with _put_together(case, directory) if comm.rank == 0 else nullcontext():
            for label, single in case.sweep_cases():
                try:
                    run_case(single, directory / label, comm=comm)
                except SolutionError as error:
                    failed.append(f"{label} ({error})")
            if failed:
                text = f"{len(failed)} runs of the sweep failed: {'; '.join(failed)}"
                raise SolutionError(text)
    finally:
        claim.release()


def _make_ready(case: Case, claim: Claim) -> None:
    claim.clear()
    try:
        write_text(claim.directory / "case.toml", resolved_toml(case))
        collate(case, claim.directory, "running")
    except OSError as error:
        raise unwritable(claim.directory, error) from None


@contextmanager
def _put_together(case: Case, directory: Path) -> Iterator[None]:
    """Context after which there are tables and figures over all values, whatever became of them."""
    status = "failed"
    try:
        yield
        status = "done"
    except KeyboardInterrupt:
        status = "interrupted"
        raise
    finally:
        _collate_and_draw(case, directory, status)


def _collate_and_draw(case: Case, directory: Path, status: str) -> None:
    try:
        collate(case, directory, status)
        if case.output.figures:
            from app.figures.run_figures import draw_figures
            from app.results import read

            draw_figures(read(directory))
    except OSError as error:
        raise unwritable(directory, error) from None
