"""What ``tribox run`` does with a sweep: its values side by side, or in turn on the ranks here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app.case.case import Case
from app.errors import SolutionError
from app.results.directory import check_free, prepare
from app.results.earlier_sweep import sweep_labels
from app.results.inputs import NOTHING, KeptInputs, keep_inputs, write_case
from app.run.sweep import Part, collate, cores, part_command, run_side_by_side
from app.run.sweep_lines import sweep_lines


@dataclass(frozen=True, slots=True)
class SweepOptions:
    """How a sweep is run.

    Attributes:
        changes: options of the command line that each run gets too.
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

    check_free(directory, options.force, sweep_labels(directory))
    notes_on_building(case.sweep_cases()[0][1], runs_code=True)
    kept = _make_ready(case, directory)
    words = [*options.changes, "--np", str(options.ranks), "--inputs-of", str(directory)]
    parts = [
        Part(label, part_command(case_file, i, directory / label, words), directory / label)
        for i, (label, _) in enumerate(case.sweep_cases())
    ]
    jobs = options.jobs or max(1, cores() // options.ranks)
    try:
        with sweep_lines(len(parts)) as lines:
            run_side_by_side(parts, jobs, lines)
    finally:  # What has been computed is collated whatever became of the others.
        _put_together(case, directory, kept)
    print(f"results in {directory}")


def _run_in_turn(case: Case, directory: Path, force: bool) -> None:
    """All ranks of one mpirun take the values one after the other."""
    from mpi4py import MPI

    from app.run.run import on_first, run_case

    kept = NOTHING

    def make_ready() -> None:
        nonlocal kept
        check_free(directory, force, sweep_labels(directory))
        kept = _make_ready(case, directory)

    comm = MPI.COMM_WORLD
    on_first(comm, make_ready)
    failed = []
    for label, single in case.sweep_cases():
        try:
            run_case(single, directory / label, comm=comm, inputs_of=directory)
        except SolutionError as error:
            failed.append(f"{label} ({error})")
    if comm.rank == 0:
        _put_together(case, directory, kept)
    if failed:
        raise SolutionError(f"{len(failed)} runs of the sweep failed: {'; '.join(failed)}")


def _make_ready(case: Case, directory: Path) -> KeptInputs:
    """Clear the directory and write what is the same for all values."""
    prepare(directory)
    kept = keep_inputs(case, directory)
    write_case(case, directory, kept)
    return kept


def _put_together(case: Case, directory: Path, kept: KeptInputs) -> None:
    """Tables and figures over all values."""
    collate(case, directory, kept.sums)
    if case.output.figures:
        from app.figures.run_figures import draw_figures
        from app.results import read

        draw_figures(read(directory))
