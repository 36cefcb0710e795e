"""Where the time of a run goes: the sliding test and the block-slide problem at several levels.

Each case is ``tribox run`` in a process of its own, one after the other; the numbers are those that
it leaves in ``summary.json``. From the repository: ``python3 -m benchmarks.run``; ``--level 4``
adds the block-slide problem refined four times. The runs of the sweep share the cores.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
LEVEL_1 = {"upper": (40, 20), "lower": (61, 15)}
# Column of the table, and the parts of summary.json["seconds"] that it adds up.
PARTS = {
    "assembly": ("assembly",),
    "contact": ("contact",),
    "pattern": ("pattern",),
    "factorisation": ("factorisation", "preconditioner set-up"),
    "solve": ("linear solve",),
    "output": ("output",),
}


@dataclass(frozen=True, slots=True)
class Measured:
    """One run.

    Attributes:
        name: of the run; dofs: unknowns; steps: converged; attempts: tried.
        iterations: of Newton, those of rejected attempts and the predictor's solves included.
        seconds: by column of the table, with "run" (from the open results directory to the
            written summary), "command" (the whole process) and "CPU" (which waits for nobody).
        memory: MiB, peak of the process.
    """

    name: str
    dofs: int
    steps: int
    attempts: int
    iterations: int
    seconds: dict[str, float]
    memory: float

    @property
    def rest(self) -> float:
        """Seconds of the run that no part claims: measures, predictor, Python between."""
        return self.seconds["run"] - sum(self.seconds[part] for part in PARTS)


def level_options(level: int) -> list[str]:
    """Options of ``tribox run`` that refine the block-slide problem ``level`` times."""
    options = []
    for block, (across, up) in LEVEL_1.items():
        options += ["--set", f"geometry.{block}.elements=[{across * level}, {up * level}]"]
    return options


def tribox(case: str, out: Path, options: Sequence[str]) -> tuple[float, float]:
    """Run a case of the repository into ``out``; returns its seconds by the clock and of CPU.

    Raises:
        subprocess.CalledProcessError: the run failed.
    """
    command = [sys.executable, "-m", "app", "run", f"cases/{case}.toml", "--out", str(out)]
    started, used = time.perf_counter(), _children()
    subprocess.run([*command, *options], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - started, _children() - used


def _children() -> float:
    """Seconds of CPU that finished child processes have used."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def read(name: str, directory: Path, took: tuple[float, float]) -> Measured:
    """The measures that a run has left in ``directory``; ``took``: see :func:`tribox`."""
    summary: dict[str, Any] = json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    given = summary["seconds"]
    seconds = {part: sum(given.get(key, 0.0) for key in keys) for part, keys in PARTS.items()}
    return Measured(
        name=name,
        dofs=summary["dofs"],
        steps=summary["steps"],
        attempts=summary["attempts"],
        iterations=summary["newton_iterations"],
        seconds={**seconds, "run": given["run"], "command": took[0], "CPU": took[1]},
        memory=max(summary["memory_MiB_per_rank"]),
    )


def measure(levels: Sequence[int], sweep: bool, where: Path) -> Iterator[Measured]:
    """Run everything, one run at a time, into sub-directories of ``where``."""
    for level in levels:
        out = where / f"block-slide-{level}"
        took = tribox("block-slide", out, level_options(level))
        yield read(f"block-slide, level {level}", out, took)
    if sweep:
        out = where / "sfa"
        took = tribox("sfa", out, [])
        parts = json.loads((out / "summary.json").read_text(encoding="utf-8"))["parts"]
        for label in parts:
            yield read(f"sfa, {label}", out / label, took)


def tables(runs: Sequence[Measured]) -> Iterator[str]:
    """Lines of the report, as Markdown."""
    yield (
        "| run | dofs | steps | attempts | Newton | per step | command (s) | CPU (s) | peak (MiB) |"
    )
    yield "|---" * 9 + "|"
    for run in runs:
        yield (
            f"| {run.name} | {run.dofs} | {run.steps} | {run.attempts} | {run.iterations} "
            f"| {run.iterations / run.steps:.2f} | {run.seconds['command']:.1f} "
            f"| {run.seconds['CPU']:.1f} "
            f"| {run.memory:.0f} |"
        )
    yield ""
    yield "| run | run (s) | " + " | ".join(PARTS) + " | rest | ms per Newton | contact/assembly |"
    yield "|---" * (len(PARTS) + 5) + "|"
    for run in runs:
        total = run.seconds["run"]
        shares = " | ".join(f"{100.0 * run.seconds[part] / total:.0f} %" for part in PARTS)
        yield (
            f"| {run.name} | {total:.2f} | {shares} | {100.0 * run.rest / total:.0f} % "
            f"| {1e3 * total / run.iterations:.1f} "
            f"| {run.seconds['contact'] / run.seconds['assembly']:.2f} |"
        )


def main() -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--level",
        type=int,
        action="append",
        choices=(1, 2, 4, 8),
        help="further level of block-slide; 1 and 2 are always run",
    )
    parser.add_argument("--no-sweep", action="store_true", help="leave the sliding test out")
    parser.add_argument("--no-blocks", action="store_true", help="leave block-slide out")
    chosen = parser.parse_args()
    levels = [] if chosen.no_blocks else sorted({1, 2, *(chosen.level or [])})
    load = os.getloadavg()[0]
    print(f"{len(os.sched_getaffinity(0))} cores, load average before: {load:.1f}\n")
    with tempfile.TemporaryDirectory() as where:
        runs = list(measure(levels, not chosen.no_sweep, Path(where)))
    print("\n".join(tables(runs)))


if __name__ == "__main__":
    main()
