"""What ``tribox run`` does with a sweep: its values side by side, or in turn on the ranks here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from tribox.app.case.case import Case
from tribox.app.checkpoint.same_case import is_whole
from tribox.app.errors import InputError, SolutionError
from tribox.app.results.claim import Claim, claimed
from tribox.app.results.directory import checkpoint_numbers, unwritable
from tribox.app.results.inputs import NOTHING, KeptInputs, keep_inputs, kept_inputs, write_case
from tribox.app.results.status import check_may_begin_anew, is_beginning, is_done
from tribox.app.run.process import lasting_imports
from tribox.app.run.sweep import Part, collate, cores, part_command, run_side_by_side
from tribox.app.run.sweep_lines import sweep_lines


@dataclass(frozen=True, slots=True)
class SweepOptions:
    """How a sweep is run.

    Attributes:
        changes: options of the command line that each run gets too.
        ranks: MPI ranks of each run.
        force: replace results that are there.
        jobs: runs at a time; None: as many as the cores allow.
        resume: go on with values that are not done; extend: with all, past their end.
    """

    changes: Sequence[str] = ()
    ranks: int = 1
    force: bool = False
    jobs: int | None = None
    resume: bool = False
    extend: bool = False

    @property
    def goes_on(self) -> bool:
        """Whether a sweep that is there goes on."""
        return self.resume or self.extend

    def how(self, directory: Path) -> dict[str, bool]:
        """How the value in a directory goes on: one that never got far, from its start."""
        begun = checkpoint_numbers(directory) and not is_beginning(directory)
        extend = self.extend and bool(begun)
        return {"resume": self.goes_on and not extend, "extend": extend}


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
        _run_in_turn(case, directory, options)
        return
    with lasting_imports():
        from tribox.app.run.building import notes_on_building

    with claimed(directory, options.force or options.goes_on, options.goes_on) as claim:
        notes_on_building(case.sweep_cases()[0][1], runs_code=True)
        to_run = _to_run(case, directory, options)
        kept = _make_ready(case, claim, options.goes_on)
        words = [*options.changes, "--np", str(options.ranks), "--inputs-of", str(directory)]
        parts = []
        for index, label in to_run:
            where = directory / label
            how = [f"--{name}" for name, given in options.how(where).items() if given]
            parts.append(Part(label, part_command(case_file, index, where, [*how, *words]), where))
        jobs = options.jobs or max(1, cores() // options.ranks)
        with _put_together(case, directory, kept), sweep_lines(len(parts)) as lines:
            run_side_by_side(parts, jobs, lines)
    print(f"results in {directory}")


def _run_in_turn(case: Case, directory: Path, options: SweepOptions) -> None:
    """All ranks of one mpirun take the values one after the other."""
    from mpi4py import MPI

    from tribox.app.results.first_rank import on_first
    from tribox.app.run.run import run_case

    comm = MPI.COMM_WORLD
    kept, goes_on = NOTHING, options.goes_on
    claim = Claim(directory, options.force or goes_on)
    on_first(comm, lambda: claim.take(goes_on))

    to_run: list[tuple[int, str]] = []

    def make_ready() -> None:
        nonlocal kept, to_run
        to_run = _to_run(case, directory, options)
        kept = _make_ready(case, claim, goes_on)

    try:
        on_first(comm, make_ready)
        failed = []
        waiting = comm.bcast([(*one, options.how(directory / one[1])) for one in to_run])
        with _put_together(case, directory, kept) if comm.rank == 0 else nullcontext():
            for index, label, how in waiting:
                single = case.sweep_cases()[index][1]
                try:
                    run_case(single, directory / label, comm=comm, inputs_of=directory, **how)
                except SolutionError as error:
                    failed.append(f"{label} ({error})")
            if failed:
                text = f"{len(failed)} runs of the sweep failed: {'; '.join(failed)}"
                raise SolutionError(text)
    finally:
        claim.release()


def _to_run(case: Case, directory: Path, options: SweepOptions) -> list[tuple[int, str]]:
    """Number and label of the values that are not done, or to be done again or for longer.

    Raises:
        InputError: a value that is done is that of another case, or is to be extended first; or
            there is nothing to extend.
    """
    out = []
    goes_on = options.goes_on and not is_beginning(directory)
    for index, (label, single) in enumerate(case.sweep_cases()):
        where = directory / label
        if where.is_symlink():
            raise InputError(f"{where}: is a link, and tribox writes through none; remove it")
        if goes_on and is_done(where):
            if is_whole(where, single):
                continue
            if not options.extend:
                raise InputError(
                    f"{where}: is done, and the case goes on past its end: use --extend"
                )
        out.append((index, label))
    if options.extend and not out:
        raise InputError(
            "--extend: the sweep is done, and the case has no stage after its end: add one, or "
            "make the last one longer (duration and steps)"
        )
    return out


def _make_ready(case: Case, claim: Claim, goes_on: bool) -> KeptInputs:
    """Clear the directory, unless its sweep goes on, and write what is the same for all values."""
    directory = claim.directory
    begun = goes_on and (directory / "case.toml").is_file() and not is_beginning(directory)
    if not begun:
        if goes_on:
            check_may_begin_anew(directory)
        claim.clear(begins=True)
    try:
        kept = kept_inputs(case) if begun else keep_inputs(case, directory)
        write_case(case, directory, kept)
        collate(case, directory, "running", kept.sums)
    except OSError as error:
        raise unwritable(directory, error) from None
    return kept


@contextmanager
def _put_together(case: Case, directory: Path, kept: KeptInputs) -> Iterator[None]:
    """Context after which there are tables and figures over all values, whatever became of them."""
    status = "failed"
    try:
        yield
        status = "done"
    except KeyboardInterrupt:
        status = "interrupted"
        raise
    finally:
        _collate_and_draw(case, directory, status, kept)


def _collate_and_draw(case: Case, directory: Path, status: str, kept: KeptInputs) -> None:
    try:
        collate(case, directory, status, kept.sums)
        if case.output.figures:
            from tribox.app.figures.run_figures import draw_figures
            from tribox.app.results import read

            draw_figures(read(directory))
    except OSError as error:
        raise unwritable(directory, error) from None
