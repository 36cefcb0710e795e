"""``tribox bench``: where the CPU time of a case goes, mesh level by mesh level.

Each run is ``tribox run`` in a process of its own on one core, one after the other. Its time is
that of the CPU, user and system, so other work on the machine does not count; of several runs of
one level the one that took least is shown.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from app.bench.tables import Measured, tables
from app.case.case import Case
from app.case.generators import BlocksGeometry
from app.case.reading import load_case
from app.errors import InputError, SolutionError

ROOT = Path(__file__).resolve().parents[2]
DEFAULT_CASE = ROOT / "cases" / "block-slide.toml"
LEVELS = (1, 2, 4)
HIGHEST = 64
# Other benchmarks by name: the module whose ``lines()`` measures and yields the report's lines.
NAMED = {"law": "app.bench.law", "explicit": "app.bench.explicit"}
# What MPI, once started in this process, has put into the environment must not reach another.
OF_MPI = ("PMIX_", "OMPI_COMM_WORLD", "OMPI_UNIVERSE", "PMI_")


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


def run_bench(
    what: Sequence[str], case_file: Path | None, out: Path | None, repeat: int | None, force: bool
) -> None:
    """Measure, print the tables, and write them if asked to.

    Args:
        what: mesh levels (default: 1, 2 and 4), or the name of one other benchmark.
        case_file: case to run; default: block-slide.
        out: directory for ``bench.md`` and ``bench.json``; None: print only.
        repeat: runs of each level; default: 3 below level 4, else 1.
        force: replace files that are there.

    Raises:
        InputError: there is no such level, benchmark or case, or it cannot be refined.
        SolutionError: a run failed.
    """
    targets = [out / name for name in ("bench.md", "bench.json")] if out else []
    for path in targets:
        if path.exists() and not force:
            raise InputError(f"{path}: exists already; replace it with --force")
    name = _named(what)
    if name is not None:
        if case_file is not None or repeat is not None:
            raise InputError(f"bench {name}: takes neither --case nor --repeat")
        _finish(importlib.import_module(NAMED[name]).lines(), None, targets)
        return
    jobs = list(jobs_of(case_file or DEFAULT_CASE, _levels(what)))
    runs = [fastest(job, repeat or (3 if job.level < 4 else 1)) for job in jobs]
    _finish(tables(runs), runs, targets)


def _named(what: Sequence[str]) -> str | None:
    """The other benchmark asked for, if one is."""
    found = [word for word in what if word in NAMED]
    if found and len(what) > 1:
        raise InputError(f"bench {found[0]}: stands alone, found {' '.join(what)}")
    return found[0] if found else None


def _levels(what: Sequence[str]) -> tuple[int, ...]:
    for word in what:
        if not (word.isdecimal() and 1 <= int(word) <= HIGHEST):
            raise InputError(
                f'bench: "{word}" is neither a mesh level (1 to {HIGHEST}) nor one of: '
                + ", ".join(NAMED)
            )
    return tuple(sorted({int(word) for word in what})) or LEVELS


def _finish(lines: Iterator[str], runs: Sequence[Measured] | None, targets: Sequence[Path]) -> None:
    """Print the report as it comes and write the files."""
    kept = []
    for line in lines:
        print(line, flush=True)
        kept.append(line)
    if targets:
        from app.results.directory import write_json, write_text

        targets[0].parent.mkdir(parents=True, exist_ok=True)
        write_text(targets[0], "\n".join(kept) + "\n")
        if runs is not None:
            write_json(targets[1], {"runs": [asdict(run) for run in runs]})


def jobs_of(case_file: Path, levels: Sequence[int]) -> Iterator[Job]:
    """The runs of a case at some mesh levels, every value of its sweep by itself.

    Raises:
        InputError: the case is wrong, or has a mesh that cannot be refined.
    """
    case = load_case(case_file)
    refined = {level: level_options(case, level) for level in levels}
    labels = [label for label, _ in case.sweep_cases()]
    for level, options in refined.items():
        words = (str(case_file), *options)
        if not labels:
            yield Job(case_file.stem, level, words)
        for part, label in enumerate(labels):
            yield Job(label, level, (*words, "--part", str(part)))


def level_options(case: Case, level: int) -> list[str]:
    """Options of ``tribox run`` that mesh the two blocks of ``case`` ``level`` times as finely.

    Raises:
        InputError: the mesh is not that of two blocks and the level is not 1.
    """
    if level == 1:
        return []
    if not isinstance(case.geometry, BlocksGeometry):
        raise InputError(
            f'bench: level {level} needs geometry.kind = "two-blocks", found '
            f'"{case.geometry.kind}", which only level 1 takes'
        )
    options = []
    for name, block in (("upper", case.geometry.upper), ("lower", case.geometry.lower)):
        if block.elements is not None:
            across, up = block.elements
            change = f"elements=[{across * level}, {up * level}]"
        else:
            assert block.size is not None
            change = f"size={block.size / level!r}"
        options += ["--set", f"geometry.{name}.{change}"]
    return options


def fastest(job: Job, repeat: int) -> Measured:
    """The run of a job that took the least CPU time of ``repeat``.

    Raises:
        SolutionError: a run failed.
    """
    runs = []
    for count in range(1, repeat + 1):
        tell = f"{job.name}, level {job.level}: run {count} of {repeat}"
        print(tell, file=sys.stderr, flush=True)
        runs.append(measure(job))
    return min(runs, key=lambda run: run.command)


def measure(job: Job) -> Measured:
    """Run a job once.

    Raises:
        SolutionError: it failed; the message ends with what it said last.
    """
    with tempfile.TemporaryDirectory() as scratch:
        report, results = Path(scratch) / "report.json", Path(scratch) / "results"
        command = [sys.executable, "-m", "app.bench.probe", str(report), *job.words]
        before = _children()
        done = subprocess.run(
            [*command, "--out", str(results)],
            env=_environment(os.environ),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        used = _children() - before
        if done.returncode:
            said = done.stderr.strip().splitlines() or ["no word of why"]
            raise SolutionError(f"bench: {job.name}, level {job.level} failed: {said[-1]}")
        found = json.loads(report.read_text(encoding="utf-8"))
    afterwards = found.pop("afterwards")
    return Measured(name=job.name, level=job.level, command=used - afterwards, **found)


def _children() -> float:
    """CPU seconds that finished child processes have used."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _environment(ours: Mapping[str, str]) -> dict[str, str]:
    """That of a process on one core, which finds this program wherever it is started."""
    kept = {key: value for key, value in ours.items() if not key.startswith(OF_MPI)}
    path = os.pathsep.join(filter(None, (str(ROOT), kept.get("PYTHONPATH"))))
    return kept | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
