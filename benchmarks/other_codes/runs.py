"""Runs one code on the problem and notes what it took and what forces it found.

A record is one JSON file: what ran, with which settings and versions, CPU time and clock of the
command, and for each step the forces and the Newton iterations. Uses the standard library only.
"""

from __future__ import annotations

import csv
import json
import os
import platform
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.other_codes.inputs import MICRO, case_text, deck, forces_in, iterations_in
from benchmarks.other_codes.problem import Problem

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
# Of CalculiX: the largest residual at a node over the mean force at nodes, which is some 1e-4 of
# the contact force here: 1e-9 of it, while tribox and GetFEM stop at 1e-8.
RESIDUAL = 1e-5


@dataclass(frozen=True, slots=True)
class Record:
    """One run of one code.

    Attributes:
        code: which, with what sets this run apart; version: of it.
        settings: that matter, in words.
        dofs: unknowns; cpu, clock: of the command, s; memory: largest resident size, MiB.
        forces: along x and y on the lower body, N, by step: friction and the normal force.
        iterations: of Newton's method by step.
    """

    code: str
    version: str
    settings: str
    dofs: int
    cpu: float
    clock: float
    memory: float
    forces: list[tuple[float, float]]
    iterations: list[int] = field(default_factory=list)


def timed(command: Sequence[str], place: Path, **environment: str) -> tuple[float, float, float]:
    """Run a command on one thread: its CPU seconds, the clock's, and its memory in MiB.

    Raises:
        SystemExit: it failed.
    """
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        command, cwd=place, env=os.environ | one | environment, capture_output=True, text=True
    )
    clock, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{command[0]} failed:\n{(done.stdout + done.stderr)[-2000:]}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return cpu, clock, after.ru_maxrss / 1024.0


def run_tribox(problem: Problem, place: Path, *, tree: Path = ROOT, calculix: bool) -> Record:
    """``tribox run`` of the sources in ``tree``; ``calculix``: with its strain energy."""
    (place / "case.toml").write_text(case_text(problem, calculix=calculix))
    summary, took, forces, iterations = _tribox("case.toml", place, tree)
    versions = summary["versions"]
    return Record(
        f"tribox, {'energy as CalculiX' if calculix else 'energy as GetFEM'}",
        ", ".join(f"{name} {versions[name]}" for name in ("tribox", "dolfinx", "petsc")),
        f"q1, penalty, direct solver, tolerance {problem.tolerance:g}",
        problem.dofs, *took, forces, iterations,
    )  # fmt: skip


def run_block_slide(problem: Problem, place: Path, *, tree: Path = ROOT) -> Record:
    """``tribox run cases/block-slide.toml``, figures and fields included, for FElupe."""
    case = str(tree / "cases" / "block-slide.toml")
    summary, took, forces, iterations = _tribox(case, place, tree)
    return Record(
        "tribox, block-slide",
        f"tribox {summary['versions']['tribox']}",
        "the case as it is: both bodies, fields, figures",
        summary["dofs"], *took, forces, iterations,
    )  # fmt: skip


def _tribox(
    case: str, place: Path, tree: Path
) -> tuple[dict[str, Any], tuple[float, float, float], list[tuple[float, float]], list[int]]:
    """Summary of a run, what it took, and its forces and iterations by step."""
    command = [sys.executable, "-m", "tribox", "run", case, "--out", str(place / "results")]
    took = timed(command, place, PYTHONPATH=str(tree / "src"), PYTHONSAFEPATH="1")
    with (place / "results" / "history.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    summary = json.loads((place / "results" / "summary.json").read_text())
    forces = [(-float(row["force_x"]), float(row["force_y"])) for row in rows]
    return summary, took, forces, [int(float(row["newton_iterations"])) for row in rows]


def run_calculix(problem: Problem, place: Path, *, own: bool) -> Record:
    """``ccx``; ``own``: at its own tolerance, else at one like that of the others."""
    (place / "blocks.inp").write_text(deck(problem, tolerance=None if own else RESIDUAL))
    took = timed(["ccx", "blocks"], place)
    unit = 1.0 if own else MICRO
    said = subprocess.run(["ccx", "-v"], capture_output=True, text=True).stdout
    version = re.search(r"Version (\S+)", said)
    tolerance = "its own tolerance" if own else f"tolerance {RESIDUAL:g} of the mean nodal force"
    found = forces_in((place / "blocks.dat").read_text())
    if len(found) != problem.press_steps + problem.slide_steps:
        sys.exit(f"ccx: {len(found)} increments were solved")
    return Record(
        f"CalculiX, {'own tolerance' if own else 'equal tolerance'}",
        f"CalculiX {version[1] if version else '?'}, SPOOLES",
        f"C3D8, surface to surface penalty, *STATIC, DIRECT, {tolerance}",
        problem.dofs,
        *took,
        [(x / unit, -y / unit) for _, x, y, _ in found],
        iterations_in((place / "blocks.sta").read_text()),
    )


def run_getfem(problem: Problem, place: Path, *, way: str) -> Record:
    """``getfem_blocks.py`` by this Python, which must have GetFEM."""
    (place / "problem.json").write_text(json.dumps(problem.figures()))
    script = str(HERE / "getfem_blocks.py")
    took = timed([sys.executable, script, "problem.json", "report.json", way], place)
    report = json.loads((place / "report.json").read_text())
    return Record(
        f"GetFEM, {way}",
        f"GetFEM {_debian_version('python3-getfem')}, MUMPS",
        f"FEM_QK(3,1), ray tracing, tolerance {problem.tolerance:g}",
        report["dofs"],
        *took,
        [(row["forces"][0], -row["forces"][1]) for row in report["steps"]],
        [row["iterations"] for row in report["steps"]],
    )


def _debian_version(package: str) -> str:
    """Version of a package of Debian; GetFEM does not tell its own."""
    if shutil.which("dpkg-query") is None:
        return "?"
    asked = ["dpkg-query", "-W", "-f", "${Version}", package]
    return subprocess.run(asked, capture_output=True, text=True).stdout or "?"


def run_felupe(problem: Problem, place: Path) -> Record:
    """``felupe_slide.py`` by this Python, which must have FElupe: block-slide on a plane."""
    took = timed([sys.executable, str(HERE / "felupe_slide.py"), "report.json"], place)
    report = json.loads((place / "report.json").read_text())
    return Record(
        "FElupe, rigid plane",
        f"FElupe {report['version']}, Python {platform.python_version()}",
        "quadrilaterals, node-to-plane penalty, SciPy's direct solver, tolerance 1e-8",
        report["dofs"],
        *took,
        [(-row["forces"][0], row["forces"][1]) for row in report["steps"]],
        [row["iterations"] for row in report["steps"]],
    )


RUNS: dict[str, tuple[Callable[..., Record], dict[str, object]]] = {
    "tribox": (run_tribox, {"calculix": False}),
    "tribox-energy-of-calculix": (run_tribox, {"calculix": True}),
    "calculix": (run_calculix, {"own": False}),
    "calculix-own-tolerance": (run_calculix, {"own": True}),
    "getfem": (run_getfem, {"way": "penalty"}),
    "getfem-multipliers": (run_getfem, {"way": "multipliers"}),
    "felupe": (run_felupe, {}),
    "block-slide": (run_block_slide, {}),
}


def fastest(name: str, problem: Problem, repeat: int, tree: Path) -> Record:
    """The run of a code that took the least CPU time of some."""
    function, options = RUNS[name]
    if function in (run_tribox, run_block_slide):
        options = options | {"tree": tree}
    found = []
    for count in range(repeat):
        print(f"{name}: run {count + 1} of {repeat}", file=sys.stderr, flush=True)
        with tempfile.TemporaryDirectory() as scratch:
            found.append(function(problem, Path(scratch), **options))
    return min(found, key=lambda record: record.cpu)


def write(record: Record, path: Path) -> None:
    """Write a record."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(record), indent=1) + "\n")


def read(path: Path) -> Record:
    """A record that was written."""
    data = json.loads(path.read_text())
    return Record(**data | {"forces": [(x, y) for x, y in data["forces"]]})


# -- The tables of what the codes took and found, as Markdown, from their records ------------------

SPACE = (
    "tribox",
    "tribox-energy-of-calculix",
    "getfem",
    "getfem-multipliers",
    "calculix",
    "calculix-own-tolerance",
)
PLANE = ("block-slide", "felupe")


def tables(records: Mapping[str, Record], problem: Problem) -> Iterator[str]:
    """Cost and forces of the codes in space, then of those in the plane."""
    ends = {
        "pressed": problem.press_steps - 1,
        "slip begins": problem.press_steps + 2,
        "slid": problem.press_steps + problem.slide_steps - 1,
    }
    in_space = {name: records[name] for name in SPACE if name in records}
    if in_space:
        yield from ("## Press and slide in space", "", *costs(in_space), "")
        yield from (*forces(in_space, ends), "")
    in_plane = {name: records[name] for name in PLANE if name in records}
    if in_plane:
        yield from ("## block-slide, level 1", "", *costs(in_plane), "")
        yield from forces(in_plane, {"pressed": 9, "slid": 39})


def costs(records: Mapping[str, Record]) -> Iterator[str]:
    """What each took, and over the first of them."""
    yield (
        "| code | version | settings | dofs | Newton iterations | CPU (s) | clock (s) | "
        "memory (MiB) | **CPU over the first** |"
    )
    yield "|---" * 9 + "|"
    first = next(iter(records.values()))
    for one in records.values():
        yield (
            f"| {one.code} | {one.version} | {one.settings} | {one.dofs} | "
            f"{sum(one.iterations)} | {one.cpu:.1f} | {one.clock:.1f} | {one.memory:.0f} | "
            f"**{one.cpu / first.cpu:.2f}** |"
        )


def forces(records: Mapping[str, Record], steps: Mapping[str, int]) -> Iterator[str]:
    """Normal force and friction at some steps, each over that of the first code."""
    heads = [f"{what}, {when} (N)" for when in steps for what in ("normal", "friction")]
    yield "| code | " + " | ".join(heads) + " |"
    yield "|---" * (len(heads) + 1) + "|"
    first = next(iter(records.values()))
    for one in records.values():
        cells = []
        for step in steps.values():
            size = first.forces[step][1]
            pairs = [(one.forces[step][axis], first.forces[step][axis]) for axis in (1, 0)]
            cells += [_cell(mine, other, size, one is first) for mine, other in pairs]
        yield f"| {one.code} | " + " | ".join(cells) + " |"


def _cell(mine: float, other: float, size: float, alone: bool) -> str:
    """A force, and how far it is from the first code's; one that is round-off is 0."""
    if max(abs(mine), abs(other)) < 1e-6 * abs(size):
        return "0"
    apart = "" if alone or other == 0.0 else f" ({100.0 * (mine / other - 1.0):+.2f} %)"
    return f"{mine:.4f}{apart}"
