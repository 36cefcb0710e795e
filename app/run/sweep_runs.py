"""What ``tribox run`` does with a sweep: its values side by side, or in turn on the ranks here."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from tribox.app.case.case import Case
from tribox.app.checkpoint.same_case import is_whole
from tribox.app.errors import (
    InputError,
    Interrupted,
    OutputError,
    SaidOnce,
    SolutionError,
    TriboxError,
    folded,
)
from tribox.app.results import read
from tribox.app.results.claim import (
    Claim,
    check_may_begin_anew,
    claimed,
    command,
    is_beginning,
    is_done,
)
from tribox.app.results.directory import json_of, unwritable, write_json, write_table
from tribox.app.results.inputs import NOTHING, KeptInputs, keep_inputs, kept_inputs, write_case
from tribox.app.run.process import (
    PARENT,
    lasting_imports,
    ranks_around,
    tribox_command,
    with_sources,
)
from tribox.app.run.ranks import INTERRUPTED, Forwarding, RunOptions
from tribox.app.simulation.history import COLUMNS

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import TaskID

# -- What a sweep tells: labelled lines, or on a terminal one line for each value that is running --

_PASSING = re.compile(r"(step|row|time step) +\d+  |          step of ")


def is_passing(line: str) -> bool:
    """Whether a line of a run is of the moment: on a step that others follow."""
    return _PASSING.match(line) is not None


class SweepLines(AbstractContextManager["SweepLines"]):
    """Prints the lines of every value, labelled; a note that several values have is said once."""

    def __init__(self) -> None:
        self._once = SaidOnce()

    def begin(self, label: str) -> None:
        """A value is begun."""

    def say(self, label: str, line: str) -> None:
        """A running value has printed a line."""
        if self._once.is_new(line):
            print(f"[{label}] {line}", flush=True)

    def end(self, label: str, code: int) -> None:
        """A value has ended, with this exit code."""

    def __exit__(self, *error: object) -> None:
        """Nothing more will be said."""


class SweepScreen(SweepLines):
    """On a terminal: one line for each running value, the others of its lines above."""

    def __init__(self, count: int, console: Console) -> None:
        from rich.progress import Progress, TextColumn, TimeElapsedColumn
        from rich.table import Column

        super().__init__()
        self._count, self._ended = count, [0, 0]  # well and badly
        whole = Column(no_wrap=True)  # the last column has what these leave
        last = Column(no_wrap=True, overflow="ellipsis", ratio=1)
        self._lines = Progress(
            TextColumn("{task.description}", markup=False, table_column=whole),
            TimeElapsedColumn(table_column=whole.copy()),
            TextColumn("{task.fields[line]}", markup=False, table_column=last),
            console=console,
            transient=True,
            expand=True,
            redirect_stderr=False,
        )
        self._all = self._lines.add_task("sweep", line="")
        self._tasks: dict[str, TaskID] = {}

    def __enter__(self) -> Self:
        """Show the lines."""
        self._lines.start()
        return self

    def begin(self, label: str) -> None:
        """A value is begun: it has a line from now on."""
        self._tasks[label] = self._lines.add_task(label, line="starting")

    def say(self, label: str, line: str) -> None:
        """Show a line in the place of the value's last; print it above if it is to stay."""
        if is_passing(line):
            self._lines.update(self._tasks[label], line=" ".join(line.split()))
        elif self._once.is_new(line):
            text = folded(f"[{label}] {line}", self._lines.console.width)
            self._lines.console.print(text, markup=False, soft_wrap=True)

    def end(self, label: str, code: int) -> None:
        """The value's line goes."""
        self._lines.remove_task(self._tasks.pop(label))
        self._ended[code != 0] += 1
        failed = f", {self._ended[1]} of them failed" if self._ended[1] else ""
        said = f"{sum(self._ended)} of {self._count} values done{failed}"
        self._lines.update(self._all, line=said)

    def __exit__(self, *error: object) -> None:
        """Take the lines away."""
        self._lines.stop()


def sweep_lines(count: int) -> SweepLines:
    """What tells of a sweep of ``count`` values on this standard output."""
    if not sys.stdout.isatty():
        return SweepLines()
    from rich.console import Console

    console = Console(highlight=False)
    return SweepLines() if console.is_dumb_terminal else SweepScreen(count, console)


# -- What ``tribox run`` does with a sweep: its values side by side, or in turn on the ranks here --


def run_sweep(
    case: Case, case_file: Path, directory: Path, options: RunOptions, changes: Sequence[str] = ()
) -> None:
    """Run all values of a sweep, with options ``changes``, collate what they give and draw it.

    InputError, with nothing changed; SolutionError if a run failed, after the others.
    """
    if ranks_around() > 1:
        _run_in_turn(case, directory, options)
        return
    with lasting_imports():
        from tribox.app.run.building import notes_on_building

    with claimed(directory, options.force or options.goes_on, options.goes_on) as claim:
        notes_on_building(case.sweep_cases()[0][1], runs_code=True)
        to_run = _to_run(case, directory, options)
        kept = _make_ready(case, claim, options.goes_on)
        words = [*changes, "--np", str(options.ranks), "--inputs-of", str(directory)]
        parts = []
        for index, label in to_run:
            where = directory / label
            how = [f"--{name}" for name, given in options.how(where).items() if given]
            how += ["--part", str(index), "--out", str(where)]
            parts.append(Part(label, tribox_command("run", str(case_file), *how, *words), where))
        jobs = options.jobs or max(1, cores() // options.ranks)
        with _put_together(case, directory, kept), sweep_lines(len(parts)) as lines:
            run_side_by_side(parts, jobs, lines)
    print(f"results in {directory}")


def _run_in_turn(case: Case, directory: Path, options: RunOptions) -> None:
    """All ranks of one mpirun take the values one after the other."""
    from mpi4py import MPI

    from tribox.app.results.saving import on_first
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


def _to_run(case: Case, directory: Path, options: RunOptions) -> list[tuple[int, str]]:
    """Number and label of the values that are not done, or to be done again or for longer."""
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

            draw_figures(read(directory))
    except OSError as error:
        raise unwritable(directory, error) from None


# -- Runs the values of a sweep, side by side where cores allow, and collates what they gave -------

NO_SUMMARY = "failed: it ended with exit code 0 and wrote no summary of a finished run"
KEPT = ("status", "warnings", "steps", "newton_iterations")  # of the summary of a part


@dataclass(frozen=True, slots=True)
class Part:
    """One value of a sweep: its label, the command that runs it, and where its results go."""

    label: str
    command: list[str]
    directory: Path


def run_side_by_side(parts: Sequence[Part], jobs: int, lines: SweepLines) -> None:
    """Run all parts as processes, at most ``jobs`` at a time; their lines go to ``lines``.

    InputError if all that failed were refused; SolutionError if a part failed, after the others;
    OutputError; Interrupted by a signal, which running parts have obeyed; TriboxError of one that
    ended oddly, such as well and without a summary that says so.
    """
    lock, stopped = threading.Lock(), threading.Event()
    with Forwarding(signal.SIGTERM, signal.SIGTERM) as forwarding:

        def work(part: Part) -> int:
            if forwarding.asked or stopped.is_set():
                return INTERRUPTED
            code = _run_part(part, lines, lock, forwarding)
            if code == INTERRUPTED:
                stopped.set()
            return code

        with ThreadPoolExecutor(jobs) as pool:
            codes = dict(zip((part.label for part in parts), pool.map(work, parts), strict=True))
    if forwarding.asked or INTERRUPTED in codes.values():
        raise Interrupted
    failed = {label: code for label, code in codes.items() if code != 0}
    if failed:
        names = ", ".join(failed)
        text = f"{len(failed)} of {len(parts)} runs of the sweep failed: {names}"
        raise _error_of(set(failed.values()))(text)


def _error_of(codes: set[int]) -> type[TriboxError]:
    """What to raise where parts have failed with these exit codes."""
    for kind in (OutputError, SolutionError):
        if kind.exit_code in codes:
            return kind
    return InputError if codes == {InputError.exit_code} else TriboxError


def _run_part(part: Part, lines: SweepLines, lock: threading.Lock, forwarding: Forwarding) -> int:
    before = _summary_file(part.directory)
    with lock:
        lines.begin(part.label)
    process = subprocess.Popen(
        part.command,
        env=with_sources(os.environ) | {PARENT: str(os.getpid())},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        bufsize=1,
        process_group=0,
    )
    forwarding.add(process)
    assert process.stdout is not None
    for line in process.stdout:
        with lock:
            lines.say(part.label, line.rstrip())
    code = process.wait()
    forwarding.remove(process)
    with lock:
        if code == 0 and (_summary_file(part.directory) == before or not is_done(part.directory)):
            code = TriboxError.exit_code
            lines.say(part.label, NO_SUMMARY)
        lines.end(part.label, code)
    return code


def _summary_file(directory: Path) -> tuple[int, int] | None:
    """Which summary a directory holds, to tell one that is new from one that was there."""
    try:
        about = (directory / "summary.json").stat()
    except OSError:
        return None
    return about.st_ino, about.st_mtime_ns


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0))


def _summary_of_part(path: Path) -> dict[str, Any] | None:
    """What the summary of a part holds; None where it is cut off, or not one of this version."""
    try:
        summary: dict[str, Any] = json_of(path.read_text(encoding="utf-8"))
        whole = {*KEPT, "load_steps"} <= summary.keys() and all(
            {"steady", *COLUMNS} <= row.keys() for row in summary["load_steps"]
        )
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return None
    return summary if whole else None


def _details(directory: Path) -> dict[int, list[dict[str, Any]]]:
    """Rows of pairs, tools and probes of surfaces of a run, by the steps that load steps end with.

    A probe's ``springback`` is its largest bend at the end of a load step so far less that now.
    """
    results = read(directory)
    found: dict[int, list[dict[str, Any]]] = {}
    try:
        ends = [int(step) for step in results.table("load_steps").columns.get("step", ())]
        found |= {step: [] for step in ends}
        for kind, file in (("pair", "contacts"), ("tool", "tools"), ("probe", "shape_probes")):
            table = results.table(file)
            parts = list(table.parts(kind)) if len(table) else []
            for name, own in parts if kind != "pair" or len(parts) > 1 else ():
                most = 0.0
                for record in own.where("step", *ends).records():
                    del record[kind]
                    if "bend_angle" in record:
                        most = max(most, record["bend_angle"], key=abs)
                        record["springback"] = most - record["bend_angle"]
                    found[int(record["step"])].append({"kind": kind, "name": name, **record})
    except InputError:  # a table of a run that was killed: its load steps are told still
        pass
    return found


def collate(
    case: Case, directory: Path, status: str, inputs: Mapping[str, str] | None = None
) -> None:
    """Write ``sweep.csv``, with rows for each load step of each part, and ``summary.json``.

    Columns are those of the history, with the part's ``label``, the swept ``value`` (in SI, where
    it is a number), ``steady``, ``kind`` and ``name`` before them, and behind them those of pairs,
    tools and probes. The first row of a load step is of the ``run``, all pairs together; below it
    stand each ``pair``, where there are several, each ``tool`` and each ``probe`` of a surface.
    Parts that were not run, or not to their end, give what they have; ``summary.json`` tells, and
    holds the SHA-256 of the ``inputs``, by their names.

    Args:
        inputs: SHA-256 of the files that the case reads, by their names.
    """
    rows: list[dict[str, Any]] = []
    parts: dict[str, Any] = {}
    for label, single in case.sweep_cases():
        value = case.swept_value(single)
        path = directory / label / "summary.json"
        if not path.is_file():
            parts[label] = {"status": "not run"}
            continue
        summary = _summary_of_part(path)
        if summary is None:
            parts[label] = {"status": "cannot be read"}
            continue
        parts[label] = {key: summary[key] for key in KEPT}
        details = _details(path.parent)
        for load_step in summary["load_steps"]:
            steady = load_step["steady"]
            first = {"label": label, "value": "" if value is None else value}
            first["steady"] = -1 if steady is None else int(steady)
            whole = {name: load_step[name] for name in COLUMNS}
            rows.append(first | {"kind": "run", "name": ""} | whole)
            same = {name: whole[name] for name in ("step", "time", "stage", "velocity")}
            rows += [first | one | same for one in details.get(int(load_step["step"]), ())]
    columns = dict.fromkeys(("label", "value", "steady", "kind", "name", *COLUMNS))
    columns |= dict.fromkeys(name for row in rows for name in row)
    filled = ([row.get(name, math.nan) for name in columns] for row in rows)
    write_table(directory / "sweep.csv", tuple(columns), filled)
    kept = dict(inputs or {})
    about = {"title": case.title, "status": status, "command": command()}
    summary = about | {"inputs": kept, "parts": parts}
    write_json(directory / "summary.json", summary)
