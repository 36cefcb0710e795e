"""``tribox bench``: where the CPU time of a case goes, mesh level by mesh level.

Each run is ``tribox run`` in a process of its own on one core, one after the other. Its time is
that of the CPU, user and system, so other work on the machine does not count; of several runs of
one level the one that took least is shown. With two sides to compare
(:mod:`benchmarks.comparison`) both run in turn.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

from benchmarks.comparison import (
    LEVELS,
    Comparison,
    Job,
    Ran,
    Side,
    check_has_iterations,
    compare,
    compile_modules,
    jobs_of,
    levels_of,
    run_python,
    sides_of,
)
from tribox.app.errors import InputError
from tribox.app.run.ranks import end_with

# -- The tables of ``tribox bench``, as Markdown ---------------------------------------------------

# The parts an attempt at a step consists of, by what they belong to.
SOLIDS = ("solid residual", "solid tangent", "constrained rows")
CONTACT_FORCES = (
    "search",
    "projection",
    "kinematics",
    "law",
    "nodal forces",
    "merge into the residual",
    "rest of contact",
)
CONTACT_TANGENT = ("tangent blocks", "merge into the matrix")
CONTACT = (*CONTACT_FORCES, *CONTACT_TANGENT)
FACTORISATION = ("symbolic factorisation", "numeric factorisation")
SOLVE = ("solve",)
SOLVER = (*SOLIDS, *CONTACT, "pattern", *FACTORISATION, *SOLVE, "rest of solver")
SET_UP = ("imports", "set-up")
PARTS = (*SET_UP, *SOLVER, "between steps", "output", "figures")


@dataclass(frozen=True, slots=True)
class Measured:
    """One run.

    Attributes:
        name: of the run; level: of its mesh; dofs: unknowns; steps: converged; attempts: tried.
        iterations: of Newton, those of rejected attempts and the predictor's solves included.
        gross: most iterations in a step of gross sliding; 0 without such a step.
        command: CPU seconds of the whole process; seconds: by part; calls: of each part.
        factorisation: CPU seconds of one analysis and factorisation of the last tangent.
        memory: MiB, largest resident memory of the process.
    """

    name: str
    level: int
    dofs: int
    steps: int
    attempts: int
    iterations: int
    gross: int
    command: float
    seconds: dict[str, float]
    calls: dict[str, int]
    factorisation: float
    memory: float

    def sum(self, parts: Sequence[str]) -> float:
        """CPU seconds of some parts."""
        return sum(self.seconds.get(part, 0.0) for part in parts)

    @property
    def without_set_up(self) -> float:
        """CPU seconds of the command but for imports and the making of mesh, forms and contact."""
        return self.command - self.sum(SET_UP)

    @property
    def bare(self) -> float:
        """CPU seconds of solid assembly, factorisation and solve."""
        return self.sum((*SOLIDS, *FACTORISATION, *SOLVE))

    @property
    def tangents(self) -> int:
        """Tangents assembled and factorised."""
        return self.calls["solid tangent"]

    @property
    def solid_tangent(self) -> float:
        """CPU seconds of one assembly of the solids' tangent."""
        return self.seconds["solid tangent"] / self.tangents

    @property
    def evaluations(self) -> int:
        """Residuals evaluated."""
        return self.calls["merge into the residual"]

    @property
    def solves(self) -> int:
        """Linear solves: those of the iterations, and the predictor's with an old factor."""
        return self.calls["solve"]

    @property
    def full_bare(self) -> float:
        """CPU seconds of a full iteration without contact: a residual, a new tangent, a solve."""
        return (
            self.sum(("solid residual",)) / self.evaluations
            + self.sum(("solid tangent", "constrained rows", *FACTORISATION)) / self.tangents
            + self.sum(SOLVE) / self.solves
        )

    @property
    def full_contact(self) -> float:
        """CPU seconds that contact and all else add to a full iteration."""
        return (
            self.sum(CONTACT_FORCES) / self.evaluations
            + self.sum((*CONTACT_TANGENT, "pattern")) / self.tangents
            + self.sum(("rest of solver",)) / self.iterations
        )


Figure = Callable[[Measured], str]


def _milliseconds(parts: Sequence[str]) -> Figure:
    return lambda run: f"{1e3 * run.sum(parts) / run.iterations:.2f}"


RUNS: dict[str, Figure] = {
    "dofs": lambda run: f"{run.dofs}",
    "steps": lambda run: f"{run.steps}",
    "attempts": lambda run: f"{run.attempts}",
    "Newton": lambda run: f"{run.iterations}",
    "tangents factorised": lambda run: f"{run.tangents}",
    "linear solves": lambda run: f"{run.solves}",
    "residuals evaluated": lambda run: f"{run.evaluations}",
    "most in gross sliding": lambda run: f"{run.gross}" if run.gross else "–",
    "command (s)": lambda run: f"{run.command:.2f}",
    "without set-up (s)": lambda run: f"{run.without_set_up:.2f}",
    "peak memory (MiB)": lambda run: f"{run.memory:.0f}",
}
ITERATION: dict[str, Figure] = {
    "whole iteration (ms)": _milliseconds(SOLVER),
    "solid assembly (ms)": _milliseconds(SOLIDS),
    "factorisation (ms)": _milliseconds(FACTORISATION),
    "solve (ms)": _milliseconds(SOLVE),
    "contact (ms)": _milliseconds(CONTACT),
    **{f"– {part} (ms)": _milliseconds((part,)) for part in CONTACT},
    "pattern (ms)": _milliseconds(("pattern",)),
    "rest (ms)": _milliseconds(("rest of solver",)),
    "full iteration without contact (ms)": lambda run: f"{1e3 * run.full_bare:.2f}",
    "one solid tangent assembly (ms)": lambda run: f"{1e3 * run.solid_tangent:.2f}",
    "one MUMPS factorisation (ms)": lambda run: f"{1e3 * run.factorisation:.2f}",
    "**whole / (solid assembly + factorisation + solve)**": (
        lambda run: f"**{run.sum(SOLVER) / run.bare:.3f}**"
    ),
    "**the same of a full iteration**": (
        lambda run: f"**{1.0 + run.full_contact / run.full_bare:.3f}**"
    ),
    "**contact / one solid tangent assembly**": (
        lambda run: f"**{run.sum(CONTACT) / run.iterations / run.solid_tangent:.2f}**"
    ),
    "whole / one MUMPS factorisation": (
        lambda run: f"{run.sum(SOLVER) / run.iterations / run.factorisation:.2f}"
    ),
    "command without set-up / one MUMPS factorisation": (
        lambda run: f"{run.without_set_up / run.factorisation:.0f}"
    ),
}
GROWTH: dict[str, Callable[[Measured], float]] = {
    "dofs": lambda run: run.dofs,
    "Newton iterations": lambda run: run.iterations,
    "CPU without set-up": lambda run: run.without_set_up,
    "one iteration": lambda run: run.sum(SOLVER) / run.iterations,
    "solid assembly": lambda run: run.sum(SOLIDS) / run.iterations,
    "contact": lambda run: run.sum(CONTACT) / run.iterations,
    "one MUMPS factorisation": lambda run: run.factorisation,
    "peak memory": lambda run: run.memory,
}


def tables(runs: Sequence[Measured]) -> Iterator[str]:
    """Lines of the report: runs, CPU by part, one iteration, growth from level to level."""
    yield from _table("run", runs, RUNS)
    yield from ("", "CPU seconds of the command by part (share of the command):", "")
    parts = {part: _share(part) for part in PARTS}
    yield from _table("part", runs, parts)
    yield from ("", "One Newton iteration, mean of the run, CPU time:", "")
    yield from _table("", runs, ITERATION)
    steps = [
        (before, after)
        for before, after in pairwise(sorted(runs, key=lambda run: (run.name, run.level)))
        if before.name == after.name
    ]
    if steps:
        yield from ("", "Growth from level to level:", "")
        yield "| |" + "|".join(f" {_name(a, runs)} → {b.level} " for a, b in steps) + "|"
        yield "|---" * (len(steps) + 1) + "|"
        for row, value in GROWTH.items():
            cells = " | ".join(f"× {value(b) / value(a):.2f}" for a, b in steps)
            yield f"| {row} | {cells} |"


def _share(part: str) -> Figure:
    def cell(run: Measured) -> str:
        seconds = run.sum((part,))
        return f"{seconds:.3f} ({100.0 * seconds / run.command:.0f} %)"

    return cell


def _name(run: Measured, runs: Sequence[Measured]) -> str:
    """Heading of a run: its level, and its name where there are several."""
    several = len({other.name for other in runs}) > 1
    levels = len({other.level for other in runs}) > 1
    level = f"level {run.level}"
    return f"{run.name}, {level}" if several and levels else run.name if several else level


def _table(corner: str, runs: Sequence[Measured], rows: dict[str, Figure]) -> Iterator[str]:
    """One column for each run."""
    yield f"| {corner} | " + " | ".join(_name(run, runs) for run in runs) + " |"
    yield "|---" * (len(runs) + 1) + "|"
    for row, figure in rows.items():
        yield f"| {row} | " + " | ".join(figure(run) for run in runs) + " |"


# -- ``tribox bench``: where the CPU time of a case goes, mesh level by mesh level -----------------

ROOT = Path(__file__).parents[1]
DEFAULT_CASE = ROOT / "cases" / "block-slide.toml"
PROBE = Path(__file__).with_name("probe.py")
# Other benchmarks by name: the module whose ``lines()`` measures and yields the report's lines.
NAMED = {"law": "benchmarks.law", "explicit": "benchmarks.explicit"}


@dataclass(frozen=True, slots=True)
class Options:
    """What ``tribox bench`` is asked for beside levels.

    Attributes:
        case_file: case to run; default: block-slide.
        out: directory for ``bench.md`` and ``bench.json``; None: print only.
        repeat: runs of each level and side; default: 3 below level 4, else 1.
        force: replace files that are there.
        overrides: KEY=VALUE, keys of the case to change.
        against: tree of another version to compare with.
        changes: KEY=VALUE, what the case is changed by to be compared with itself.
        ranks: that runs are made on.
    """

    case_file: Path | None = None
    out: Path | None = None
    repeat: int | None = None
    force: bool = False
    overrides: tuple[str, ...] = ()
    against: Path | None = None
    changes: tuple[str, ...] = ()
    ranks: int = 1

    def runs(self, level: int) -> int:
        """Runs of one level."""
        return self.repeat or (3 if level < 4 else 1)

    @property
    def given(self) -> list[str]:
        """The options that are given, by their names on the command line, but --out and --force."""
        names = {
            "--case": self.case_file,
            "--repeat": self.repeat,
            "--set": self.overrides,
            "--against": self.against,
            "--with": self.changes,
            "--np": self.ranks > 1,
        }
        return [name for name, value in names.items() if value]


def run_bench(what: Sequence[str], options: Options) -> None:
    """Measure, print the tables, and write them if asked to.

    ``what``: mesh levels (default: 1, 2 and 4), or the name of one other benchmark.

    Raises:
        InputError: there is no such level, benchmark, tree or case, or it cannot be refined.
        SolutionError: a run failed.
    """
    out = options.out
    targets = [out / name for name in ("bench.md", "bench.json")] if out else []
    for path in targets:
        if path.exists() and not options.force:
            raise InputError(f"{path}: exists already; replace it with --force")
    name = _named(what)
    if name is not None:
        if options.given:
            raise InputError(f"bench {name}: does not take {options.given[0]}")
        _write(_printed(importlib.import_module(NAMED[name]).lines()), None, targets)
        return
    levels = levels_of(what, list(NAMED)) or LEVELS
    sides = sides_of(options.against, options.changes, options.ranks)
    case_file = options.case_file or DEFAULT_CASE
    jobs = list(jobs_of(case_file, levels, options.overrides))
    if options.changes:  # a wrong key is told before anything is measured
        list(jobs_of(case_file, levels, (*options.overrides, *options.changes)))
    if sides is None:
        check_has_iterations(case_file, options.overrides)
        runs = [fastest(job, options.runs(job.level)) for job in jobs]
        _write(_printed(tables(runs)), {"runs": [asdict(run) for run in runs]}, targets)
        return
    _compare(jobs, sides, options, targets)


def _named(what: Sequence[str]) -> str | None:
    """The other benchmark asked for, if one is."""
    found = [word for word in what if word in NAMED]
    if found and len(what) > 1:
        raise InputError(f"bench {found[0]}: stands alone, found {' '.join(what)}")
    return found[0] if found else None


def _compare(
    jobs: Sequence[Job], sides: tuple[Side, Side], options: Options, targets: Sequence[Path]
) -> None:
    """Compare both sides job by job, and print each as soon as it is known."""
    for side in sides:
        compile_modules(side)
    found: list[Comparison] = []

    def lines() -> Iterator[str]:
        for job in jobs:
            found.append(compare(job, sides, options.runs(job.level)))
            yield from (*job_table(found[-1]), "")
        yield from all_jobs(found)

    kept = _printed(lines())
    _write(kept, {"comparisons": [one.figures() for one in found]}, targets)


def _printed(lines: Iterator[str]) -> list[str]:
    """The lines of a report, each printed as it comes."""
    kept = []
    for line in lines:
        print(line, flush=True)
        kept.append(line)
    return kept


def _write(
    lines: Sequence[str], numbers: Mapping[str, object] | None, targets: Sequence[Path]
) -> None:
    """Write the report, and the numbers where there are any, if there are files to write."""
    if targets:
        from tribox.app.results.directory import write_json, write_text

        targets[0].parent.mkdir(parents=True, exist_ok=True)
        write_text(targets[0], "\n".join(lines) + "\n")
        if numbers is not None:
            write_json(targets[1], numbers)


def fastest(job: Job, repeat: int) -> Measured:
    """The run of a job that took the least CPU time of ``repeat``.

    Raises:
        SolutionError: a run failed.
    """
    runs = []
    for count in range(1, repeat + 1):
        print(f"{job}: run {count} of {repeat}", file=sys.stderr, flush=True)
        runs.append(measure(job))
    return min(runs, key=lambda run: run.command)


def measure(job: Job) -> Measured:
    """Run a job once.

    Raises:
        SolutionError: it failed; the message ends with what it said last.
    """
    with tempfile.TemporaryDirectory() as scratch:
        report, results = Path(scratch) / "report.json", Path(scratch) / "results"
        words = [str(PROBE), str(report), *job.words, "--out", str(results)]
        cost = run_python(words, str(job))
        found = json.loads(report.read_text(encoding="utf-8"))
    afterwards = found.pop("afterwards")
    return Measured(name=job.name, level=job.level, command=cost.cpu - afterwards, **found)


# -- The tables of a comparison, as Markdown: both sides of each job, then all jobs together -------

# Parts that are shown as one; all others by themselves.
TOGETHER: dict[str, tuple[str, ...]] = {
    "solids": SOLIDS,
    "contact": CONTACT,
    "factorisation": FACTORISATION,
}
SHORTEST = 0.05  # s; a ratio to less than this is noise
COUNTS = {
    "dofs": "dofs",
    "steps": "steps",
    "attempts (explicit: time steps)": "attempts",
    "Newton iterations": "iterations",
    "tangents": "tangents",
}


def job_table(found: Comparison) -> Iterator[str]:
    """Both sides of a job, and the second over the first."""
    first, second = found.first, found.second
    yield f"| {found.job} | {first.side} | {second.side} | {second.side} / {first.side} |"
    yield "|---|---|---|---|"
    for name, a, b in (
        ("command, CPU (s)", first.cost.cpu, second.cost.cpu),
        ("command, clock (s)", first.cost.clock, second.cost.clock),
    ):
        yield f"| {name} | {a:.2f} | {b:.2f} | **{b / a:.3f}** |"
    for name, attribute in COUNTS.items():
        c, d = getattr(first, attribute), getattr(second, attribute)
        yield f"| {name} | {c} | {d} | {f'{d / c:.3f}' if c else '–'} |"
    yield f"| largest difference of the forces | | | {forces(found)} |"
    clock = "clock" if found.by_clock else "CPU"
    parts = [grouped(run) for run in (first, second)]
    for part in in_order([*parts[0], *parts[1]]):
        a, b = (seconds.get(part, 0.0) for seconds in parts)
        ratio = f"{b / a:.2f}" if a >= SHORTEST else "–"
        yield f"| {part}, {clock} (s) | {a:.3f} | {b:.3f} | {ratio} |"


def forces(found: Comparison) -> str:
    """How far the forces are apart, and where."""
    if found.forces.worst == 0.0:
        return "the same"
    return f"{found.forces.worst:.1e} ({found.forces.where})"


def grouped(run: Ran) -> dict[str, float]:
    """Seconds by part, some parts as one; parts of the program's own clock stay as they are."""
    of = {part: name for name, parts in TOGETHER.items() for part in parts}
    sums: dict[str, float] = {}
    for part, seconds in run.parts.items():
        name = of.get(part, part)
        sums[name] = sums.get(name, 0.0) + seconds
    return sums


def in_order(parts: Sequence[str]) -> list[str]:
    """Parts in the order of the run, unknown ones last."""
    of = {part: name for name, several in TOGETHER.items() for part in several}
    known = list(dict.fromkeys(of.get(part, part) for part in PARTS))
    return [p for p in known if p in parts] + sorted(set(parts) - set(known))


def all_jobs(found: Sequence[Comparison]) -> Iterator[str]:
    """One row for each job: what the command took on both sides, counts and forces."""
    first, second = found[0].first.side, found[0].second.side
    yield (
        f"| run | dofs | CPU {first} (s) | CPU {second} (s) | **CPU {second} / {first}** | "
        f"clock {first} (s) | clock {second} (s) | **clock {second} / {first}** | "
        "Newton iterations | forces apart by |"
    )
    yield "|---" * 10 + "|"
    for one in found:
        a, b = one.first, one.second
        yield (
            f"| {one.job} | {b.dofs} | {a.cost.cpu:.2f} | {b.cost.cpu:.2f} | "
            f"**{b.cost.cpu / a.cost.cpu:.3f}** | {a.cost.clock:.2f} | {b.cost.clock:.2f} | "
            f"**{b.cost.clock / a.cost.clock:.3f}** | {a.iterations} → {b.iterations} | "
            f"{forces(one)} |"
        )


def _options(words: Sequence[str]) -> tuple[list[str], Options]:
    """What is measured, and the options, of a command line."""
    parser = argparse.ArgumentParser("tribox bench", description=__doc__)
    add = parser.add_argument
    add("what", nargs="*", help="mesh levels (default: 1 2 4), or law, or explicit")
    add("--case", type=Path, help="case file to run (default: cases/block-slide.toml)")
    add("--out", type=Path, help="directory for bench.md and bench.json (default: print)")
    add("--repeat", type=int, help="runs of each level; the fastest is shown")
    add("--force", action="store_true", help="replace files that are there")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="change a key of the case")
    add("--against", type=Path, metavar="DIR", help="compare with the tribox of this checkout")
    changes = "compare the case with itself so changed; may be repeated"
    add("--with", action="append", default=[], dest="changes", metavar="KEY=VALUE", help=changes)
    ranks = "MPI ranks of both runs; compare with one rank if nothing else"
    add("--np", type=int, default=1, help=ranks)
    a = parser.parse_intermixed_args(words)
    if a.np < 1 or (a.repeat is not None and a.repeat < 1):
        parser.error("--np and --repeat must be at least 1")
    set_, changed = tuple(a.set), tuple(a.changes)
    return a.what, Options(a.case, a.out, a.repeat, a.force, set_, a.against, changed, a.np)


def main() -> None:
    """Measure what the command line asks for."""
    try:
        run_bench(*_options(sys.argv[1:]))
    except Exception as error:
        end_with(error)


if __name__ == "__main__":
    main()
