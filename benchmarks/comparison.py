"""Runs two sides in turn, and reads what each took and found.

The runs alternate, first side, second side, first side, ..., so that both meet the machine in the
same states; of each side the run that took the least counts.
"""

from __future__ import annotations

import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tribox
from tribox.app.case.case import Case
from tribox.app.case.generators import BlocksGeometry, BoxesGeometry
from tribox.app.case.reading import load_case
from tribox.app.case.stage import solver_of
from tribox.app.errors import InputError, SolutionError
from tribox.app.results.reading import read_table

# -- Runs of tribox in processes of their own, with what they cost ---------------------------------

SOURCES = Path(tribox.__file__).parents[1]
# What MPI, once started in this process, has put into the environment must not reach another.
OF_MPI = ("PMIX_", "OMPI_COMM_WORLD", "OMPI_UNIVERSE", "PMI_")


@dataclass(frozen=True, slots=True)
class Cost:
    """What a process took, its children included.

    Attributes:
        cpu: seconds of the processor, user and system; clock: seconds that went by.
    """

    cpu: float
    clock: float


def run_python(words: Sequence[str], name: str, tree: Path = SOURCES) -> Cost:
    """Run Python with the packages of a tree of tribox, on one thread, and wait for its end.

    Args:
        words: of Python's command line.
        name: of what is run, for the message of a failure.
        tree: where its packages are; also the working directory, which mpi4py imports from.

    Raises:
        SolutionError: it failed; the message ends with what it said last.
    """
    before, started = _children(), time.perf_counter()
    done = subprocess.run(
        [sys.executable, *words],
        cwd=tree,
        env=environment(os.environ, tree),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    cost = Cost(_children() - before, time.perf_counter() - started)
    if done.returncode:
        said = done.stderr.strip().splitlines() or ["no word of why"]
        raise SolutionError(f"bench: {name} failed: {said[-1]}")
    return cost


def _children() -> float:
    """CPU seconds that finished child processes have used."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def environment(ours: Mapping[str, str], tree: Path) -> dict[str, str]:
    """That of a process on one core, which finds the packages of a tree before any others."""
    kept = {key: value for key, value in ours.items() if not key.startswith(OF_MPI)}
    path = os.pathsep.join(filter(None, (str(tree), kept.get("PYTHONPATH"))))
    fixed = {"PYTHONPATH": path, "PYTHONSAFEPATH": "1", "OMP_NUM_THREADS": "1"}
    return kept | fixed | {"MPLBACKEND": "Agg"}


# -- The two sides of a comparison: trees of tribox, numbers of ranks, or keys of the case ---------

# What the tree compared with must have.
OF_A_TREE = ("app", "forms", "geometry", "src/tribox")


@dataclass(frozen=True, slots=True)
class Side:
    """One side.

    Attributes:
        name: for the tables; tree: where the sources are that run; ranks: that it runs on.
        changes: KEY=VALUE, keys of the case that it changes.
    """

    name: str
    tree: Path = SOURCES
    ranks: int = 1
    changes: tuple[str, ...] = ()

    @property
    def probe(self) -> Path:
        """The tree's own probes; it had them in ``app`` once."""
        now, once = (self.tree.parent / at / "probe.py" for at in ("benchmarks", "app/bench"))
        return now if now.is_file() else once


def sides_of(against: Path | None, changes: Sequence[str], ranks: int) -> tuple[Side, Side] | None:
    """What is compared with what; None if nothing is.

    Args:
        against: another tree: its run is compared with that of this one.
        changes: KEY=VALUE: the case as it is is compared with the case so changed.
        ranks: of both sides, or, where nothing else differs, of the second.

    Raises:
        InputError: both are given, or the directory is no tree of tribox.
    """
    if against is not None and changes:
        raise InputError(
            f"bench: --against {against} and --with {changes[0]} both say what to compare with: "
            "give one of them"
        )
    if against is not None:
        return Side("old", tribox_tree(against), ranks), Side("new", SOURCES, ranks)
    if changes:
        return Side("as it is", SOURCES, ranks), Side("changed", SOURCES, ranks, tuple(changes))
    return (Side("1 rank"), Side(f"{ranks} ranks", SOURCES, ranks)) if ranks > 1 else None


def tribox_tree(directory: Path) -> Path:
    """Where the packages of a source tree of tribox are, as a whole path.

    Raises:
        InputError: it does not.
    """
    for name in OF_A_TREE:
        if not (directory / name).exists():
            reason = f"it has no {name}" if directory.is_dir() else "there is no such directory"
            raise InputError(f"bench: --against {directory}: not a source tree of tribox: {reason}")
    return (directory / "src").resolve()


# -- What ``tribox bench`` runs: cases at mesh levels, every value of a sweep by itself ------------

LEVELS = (1, 2, 4)
HIGHEST = 64


@dataclass(frozen=True, slots=True)
class Job:
    """One run to be measured.

    Attributes:
        name: for the tables; level: how finely it is meshed, 1 being the case as it is.
        words: what ``tribox run`` is called with, but for the results directory.
    """

    name: str
    level: int
    words: tuple[str, ...]

    def __str__(self) -> str:
        """For messages."""
        return f"{self.name}, level {self.level}"


def levels_of(words: Sequence[str], names: Sequence[str]) -> tuple[int, ...]:
    """The mesh levels that words ask for, none for none.

    Raises:
        InputError: a word is no level.
    """
    for word in words:
        if not (word.isdecimal() and 1 <= int(word) <= HIGHEST):
            raise InputError(
                f'bench: "{word}" is neither a mesh level (1 to {HIGHEST}) nor one of: '
                + ", ".join(names)
            )
    return tuple(sorted({int(word) for word in words}))


def jobs_of(case_file: Path, levels: Sequence[int], changes: Sequence[str] = ()) -> Iterator[Job]:
    """The runs of a case at some mesh levels, every value of its sweep by itself.

    Raises:
        InputError: the case is wrong, or has a mesh that cannot be refined.
    """
    case = load_case(case_file, changes)
    refined = {level: level_options(case, level) for level in levels}
    labels = [label for label, _ in case.sweep_cases()]
    path = str(case_file.resolve())
    for level, options in refined.items():
        words = (path, *set_options(changes), *options)
        if not labels:
            yield Job(case_file.stem, level, words)
        for part, label in enumerate(labels):
            yield Job(label, level, (*words, "--part", str(part)))


def check_has_iterations(case_file: Path, changes: Sequence[str]) -> None:
    """Refuse a case without implicit stages: the tables of one run are about Newton iterations.

    Raises:
        InputError: all stages are explicit.
    """
    case = load_case(case_file, changes)
    if all(solver_of(stage, case.solver.kind) == "explicit" for stage in case.stage):
        raise InputError(
            f"bench: {case_file}: all stages are explicit, and the tables are of Newton "
            'iterations; compare with --against, --with or --np, or time "tribox bench explicit"'
        )


def set_options(changes: Sequence[str]) -> tuple[str, ...]:
    """Options of ``tribox run`` that change keys of the case, given as KEY=VALUE."""
    return tuple(word for change in changes for word in ("--set", change))


def level_options(case: Case, level: int) -> list[str]:
    """Options of ``tribox run`` that mesh the two blocks of ``case`` ``level`` times as finely.

    Raises:
        InputError: the mesh is not that of two blocks or boxes and the level is not 1.
    """
    if level == 1:
        return []
    if not isinstance(case.geometry, BlocksGeometry | BoxesGeometry):
        raise InputError(
            f'bench: level {level} needs geometry.kind = "two-blocks" or "two-boxes", found '
            f'"{case.geometry.kind}", which only level 1 takes'
        )
    options = []
    for name, block in (("upper", case.geometry.upper), ("lower", case.geometry.lower)):
        if block.elements is not None:
            change = f"elements={[count * level for count in block.elements]}"
        else:
            assert block.size is not None
            change = f"size={block.size / level!r}"
        options += ["--set", f"geometry.{name}.{change}"]
    return options


# -- Runs two sides in turn, and reads what each took and found ------------------------------------

TREE_PROBE = Path(__file__).with_name("tree_probe.py")
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
            command = [str(TREE_PROBE), str(side.probe), str(report), *words]
        else:
            command = ["-m", "tribox", "run", *words, "--np", str(side.ranks)]
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
    words = [sys.executable, "-m", "compileall", "-q", "tribox"]
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
