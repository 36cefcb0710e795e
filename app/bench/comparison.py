"""Runs two sides in turn, and reads what each took and found.

The runs alternate, first side, second side, first side, ..., so that both meet the machine in the
same states; of each side the run that took the least counts.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tribox.app.bench.jobs import Job, set_options
from tribox.app.bench.process import Cost, run_python
from tribox.app.bench.sides import Side
from tribox.app.errors import InputError
from tribox.app.results.directory import read_table

PROBE = Path(__file__).with_name("tree_probe.py")
TRIALS = 3  # of a run that compiles something the first time
# A force that is less than this share of the largest is compared with that share: it is round-off.
SMALL = 1e-2
Table = list[dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Ran:
    """One run.

    Attributes:
        side: its name; cost: of the command, s.
        dofs, steps, attempts, iterations, tangents: counts of the whole run; in explicit stages an
            attempt is a time step.
        parts: seconds by part, of the processor, or on several ranks by the first one's clock.
        history: the rows of ``history.csv``.
    """

    side: str
    cost: Cost
    dofs: int
    steps: int
    attempts: int
    iterations: int
    tangents: int
    parts: dict[str, float]
    history: Table

    def figures(self) -> dict[str, Any]:
        """What is kept in ``bench.json``."""
        counts = ("dofs", "steps", "attempts", "iterations", "tangents")
        return {
            "side": self.side,
            "cpu": self.cost.cpu,
            "clock": self.cost.clock,
            **{name: getattr(self, name) for name in counts},
            "seconds": self.parts,
        }


@dataclass(frozen=True, slots=True)
class Difference:
    """How far the forces of two histories are apart.

    Attributes:
        worst: over the largest in the column, or over a hundredth of the largest of all forces
            where that is more; infinite where the histories cannot be compared.
        where: column and row, or why they cannot be compared.
    """

    worst: float
    where: str


@dataclass(frozen=True, slots=True)
class Comparison:
    """A job on both sides: the fastest run of each.

    Attributes:
        job: what ran; first, second: the sides; forces: how far their forces are apart.
        by_clock: whether what counts is the clock, not the processor's time.
    """

    job: Job
    first: Ran
    second: Ran
    forces: Difference
    by_clock: bool

    def figures(self) -> dict[str, Any]:
        """What is kept in ``bench.json``."""
        return {
            "name": self.job.name,
            "level": self.job.level,
            "options": self.job.words[1:],
            "sides": [self.first.figures(), self.second.figures()],
            "forces": [self.forces.worst, self.forces.where],
        }


def compare(job: Job, sides: tuple[Side, Side], repeat: int) -> Comparison:
    """Run a job on both sides in turn, ``repeat`` times each.

    Raises:
        SolutionError: a run failed.
    """
    runs: tuple[list[Ran], list[Ran]] = ([], [])
    by_clock = any(side.ranks > 1 for side in sides)
    for count in range(1, repeat + 1):
        for side, kept in zip(sides, runs, strict=True):
            tell = f"{job}, {side.name}: run {count} of {repeat}"
            print(tell, file=sys.stderr, flush=True)
            kept.append(run_warm(job, side, not by_clock))
    first, second = (min(k, key=lambda r: r.cost.clock if by_clock else r.cost.cpu) for k in runs)
    return Comparison(job, first, second, force_difference(first, second), by_clock)


def run_warm(job: Job, side: Side, probed: bool) -> Ran:
    """Run a job on one side, again where it has compiled a form or a kernel, which is kept."""
    for _ in range(TRIALS):
        started = time.time()
        found = run(job, side, probed)
        if not compiled_since(started):
            break
        print(f"{job}, {side.name}: something was compiled, so again", file=sys.stderr, flush=True)
    return found


def run(job: Job, side: Side, probed: bool) -> Ran:
    """Run a job on one side.

    Args:
        job: what to run.
        side: how.
        probed: under the probes of the side's tree, on one rank; else ``tribox run`` as it is,
            whose own clock tells the parts.

    Raises:
        SolutionError: the run failed.
    """
    with tempfile.TemporaryDirectory() as scratch:
        report, results = Path(scratch) / "report.json", Path(scratch) / "results"
        words = [*job.words, *set_options(side.changes), "--out", str(results)]
        if probed:
            command = [str(PROBE), str(report), *words]
        else:
            command = ["-m", side.package, "run", *words, "--np", str(side.ranks)]
        cost = run_python(command, f"{job}, {side.name}", side.tree)
        summary = json.loads((results / "summary.json").read_text(encoding="utf-8"))
        if probed:
            parts = json.loads(report.read_text(encoding="utf-8"))["seconds"]
        else:
            parts = {k: v for k, v in summary["seconds"].items() if k != "run"}
        return Ran(
            side.name,
            cost,
            summary["dofs"],
            summary["steps"],
            summary["attempts"],
            summary["newton_iterations"],
            summary["factorisations"],
            parts,
            read_table(results / "history.csv"),
        )


def compiled_since(started: float) -> bool:
    """Whether a form or kernel was compiled into its cache; ``started``: s since 1970."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    caches = (home / "fenics", Path(tempfile.gettempdir()) / f"tribox-{os.getuid()}")
    return any(path.stat().st_mtime > started for cache in caches for path in cache.rglob("*.so"))


def compile_modules(side: Side) -> None:
    """Have a side's modules compiled, so that none of its runs does it."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    words = [sys.executable, "-m", "compileall", "-q", *side.packages]
    done = subprocess.run(words, cwd=side.tree, **quiet)  # type: ignore[call-overload]
    if done.returncode:
        print(f"note: {side.tree}: modules are compiled anew in each run", file=sys.stderr)


def force_difference(first: Ran, second: Ran) -> Difference:
    """Compare all columns of forces, row by row.

    Raises:
        InputError: a history holds no forces.
    """
    before, after = first.history, second.history
    if len(before) != len(after):
        return Difference(math.inf, f"{len(before)} and {len(after)} rows")
    for a, b in zip(before, after, strict=True):
        if not math.isclose(a["time"], b["time"], rel_tol=1e-9):
            return Difference(math.inf, f"row {a['step']:.0f} at {a['time']:g} and {b['time']:g} s")
    columns = [name for name in before[0] if "force" in name and name in after[0]]
    if not columns:
        raise InputError("bench: history.csv has no column of forces")
    sizes = {n: max(abs(row[n]) for row in (*before, *after)) for n in columns}
    floor = SMALL * max(sizes.values())
    found = [
        Difference(_apart(a[n], b[n], max(sizes[n], floor)), f"{n}, row {a['step']:.0f}")
        for n in columns
        for a, b in zip(before, after, strict=True)
    ]
    return max(found, key=lambda difference: difference.worst)


def _apart(a: float, b: float, size: float) -> float:
    """Difference of two numbers over a size; infinite where one of them is none."""
    if a == b:
        return 0.0
    return abs(a - b) / size if math.isfinite(a) and math.isfinite(b) else math.inf
