"""Runs the values of a sweep, side by side where cores allow, and collates what they gave."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tribox.app.case.case import Case
from tribox.app.errors import InputError, Interrupted, OutputError, SolutionError, TriboxError
from tribox.app.results import read
from tribox.app.results.directory import json_of, write_json, write_table
from tribox.app.results.lock import command
from tribox.app.results.status import is_done
from tribox.app.run.forwarding import Forwarding
from tribox.app.run.process import PARENT, tribox_command, with_sources
from tribox.app.run.ranks import INTERRUPTED
from tribox.app.run.sweep_lines import SweepLines
from tribox.app.simulation.history import COLUMNS

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

    Raises:
        InputError: all parts that failed were refused.
        SolutionError: a part failed; the others have been run.
        OutputError: a part could not write its results.
        Interrupted: a signal came, which the running parts have obeyed too; none followed.
        TriboxError: a part could not be started or ended oddly, such as well and without a summary
            that says so.
    """
    lock = threading.Lock()
    waiting = list(parts)
    codes: dict[str, int] = {}
    with Forwarding(signal.SIGTERM, signal.SIGTERM) as forwarding:

        def work() -> None:
            while True:
                with lock:
                    if not waiting or forwarding.asked:
                        return
                    part = waiting.pop(0)
                codes[part.label] = _run_part(part, lines, lock, forwarding)
                if codes[part.label] == INTERRUPTED:
                    with lock:
                        waiting.clear()

        threads = [threading.Thread(target=work) for _ in range(min(jobs, len(parts)))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
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


def part_command(case_file: Path, index: int, directory: Path, options: Sequence[str]) -> list[str]:
    """The command that runs one value of the sweep in ``case_file``."""
    return tribox_command(
        *("run", str(case_file), "--part", str(index), "--out", str(directory), *options)
    )


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

    Args:
        case: with the sweep.
        directory: of the results.
        status: of the sweep: running, done, interrupted or failed.
        inputs: SHA-256 of the files that the case reads, by their names.

    Columns are those of the history, with the part's ``label``, the swept ``value`` (in SI, where
    it is a number), ``steady``, ``kind`` and ``name`` before them, and behind them those of pairs,
    tools and probes. The first row of a load step is of the ``run``, all pairs together; below it
    stand each ``pair``, where there are several, each ``tool`` and each ``probe`` of a surface.
    Parts that were not run, or not to their end, give what they have; ``summary.json`` tells, and
    holds the SHA-256 of the ``inputs``, by their names.
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
