"""``tribox bench``: where the CPU time of a case goes, mesh level by mesh level.

Each run is ``tribox run`` in a process of its own on one core, one after the other. Its time is
that of the CPU, user and system, so other work on the machine does not count; of several runs of
one level the one that took least is shown. With two sides to compare
(:mod:`tribox.app.bench.sides`) both run in turn.
"""

from __future__ import annotations

import importlib
import json
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from tribox.app.bench.comparison import Comparison, Ran, compare, compile_modules
from tribox.app.bench.jobs import LEVELS, Job, check_has_iterations, jobs_of, levels_of
from tribox.app.bench.process import run_python
from tribox.app.bench.sides import Side, sides_of
from tribox.app.bench.tables import CONTACT, FACTORISATION, PARTS, SOLIDS, Measured, tables
from tribox.app.errors import InputError

DEFAULT_CASE = Path(__file__).parents[2] / "cases" / "block-slide.toml"
# Other benchmarks by name: the module whose ``lines()`` measures and yields the report's lines.
NAMED = {"law": "tribox.app.bench.law", "explicit": "tribox.app.bench.explicit"}


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

    Args:
        what: mesh levels (default: 1, 2 and 4), or the name of one other benchmark.
        options: what else is asked for.

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
        words = ["-m", "tribox.app.bench.probe", str(report), *job.words, "--out", str(results)]
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
