"""Kills runs at random moments, has them go on, and compares what they write with runs left alone.

python3 -m tests.app.checkpoint.campaign 20 --seed 1
"""

import argparse
import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.app.checkpoint.going_on import unlike, unlike_tables
from tests.app.checkpoint.small_cases import COARSE, changed
from tests.app.conftest import BLOCK, BOXES, SLID
from tests.app.run.test_signals import SWEEP, of_run
from tests.app.simulation.test_explicit_run import THROWN
from tests.ranks import LIMIT, ROOT, called, mpi_environment
from tribox.app.case.toml_files import toml_text
from tribox.app.results import read

SLACK = 0.01  # s, the most that a kill comes after the row that was drawn
OUTPUT = {"figures": False, "fields_every": 3, "checkpoint_every": 2, "checkpoint_interval": 0.3}
DENSE = {"bodies.elastomer.density": 1100, "bodies.aluminium.density": 2700}
SPACE = {"geometry.upper.elements": [3, 2, 3], "geometry.lower.elements": [4, 2, 4], "output": {}}
SOFT = {"bodies.aluminium.E": "50 MPa", "contact.0.penalty_factor": 1}
THROUGH = [["0 s", 0], ["50 us", "0.4 MPa"]]
CASES = {
    "implicit 2D": changed(BLOCK, COARSE | {"stage.1.steps": 24}),
    "implicit 3D": changed(BOXES, SPACE | {"stage.1.steps": 12}),
    "explicit 2D": changed(SLID, {"stage.1.duration": "40 us", "stage.1.steps": 30}),
    "thrown 2D": changed(THROWN, {"stage.0.steps": 40}),
    "explicit 3D": changed(BOXES, SPACE | DENSE | SOFT
     | {"boundary.1.displacement.x": [["50 us", "0 mm"], ["300 us", "0.05 mm"]],
     "boundary.1.platen.pressure": THROUGH,
     "stage": [{"name": "all", "duration": "300 us", "steps": 30}],
     "solver": {"kind": "explicit"}}),
    "sweep": changed(BLOCK + SWEEP, COARSE | {"stage.1.steps": 6}),
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Killed:
    """A run killed after a row of so many, and the steps it went on after; None: anew."""

    kind: str
    row: int
    rows: int
    after: str
    unlike: list[str]

    def __str__(self) -> str:
        result = "; ".join(self.unlike) or "same bytes"
        return f"| {self.kind} | {self.row} of {self.rows} | {self.after} | {result} |"


def start(path: Path, out: Path, *words: str) -> subprocess.Popen[str]:
    """Start a run as a process."""
    return subprocess.Popen(
        [sys.executable, "-m", "tribox", "run", str(path), "--out", str(out), *words],
        cwd=ROOT,
        env=mpi_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> str:
    """Wait for a run that is to come to its end; what it said."""
    said, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, said
    return said


def rows_in(out: Path) -> int:
    """Rows that a run, or all runs of a sweep, have written so far."""
    found = 0
    for path in (*out.glob("history.csv"), *out.glob("*/history.csv")):
        with contextlib.suppress(FileNotFoundError):
            found += max(path.read_bytes().count(b"\n") - 1, 0)
    return found


def kill_after(process: subprocess.Popen[str], out: Path, rows: int, delay: float) -> None:
    """Kill a run, with all its processes at once, a while after it has written so many rows."""
    ends = time.monotonic() + LIMIT
    while rows_in(out) < rows:
        assert process.poll() is None and time.monotonic() < ends, "the run ended too early"
        time.sleep(0.002)
    time.sleep(delay)
    processes = of_run(out)
    for sent in (signal.SIGSTOP, signal.SIGKILL):  # none is left that ends the others in good order
        for number in processes:
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, sent)
    process.kill()
    process.communicate()
    while of_run(out):
        time.sleep(0.01)


def differences(kind: str, reference: Path, out: Path) -> list[str]:
    """In what the results of two runs, or of two sweeps, differ."""
    if kind != "sweep":
        return unlike(reference, out)
    found = unlike_tables(reference / "sweep.csv", out / "sweep.csv", "sweep.csv")
    for part in sorted(path.parent.name for path in reference.glob("*/history.csv")):
        found += [f"{part}: {line}" for line in unlike(reference / part, out / part)]
    return found


def went_on_after(kind: str, out: Path) -> str:
    """The steps after which runs were gone on with."""
    runs = sorted(path.parent for path in out.glob("*/history.csv")) if kind == "sweep" else [out]
    steps = [read(run).summary["resumed"] for run in runs]
    return ", ".join(f"step {one[0]}" if one else "-" for one in steps)


def left_alone(kind: str, directory: Path) -> tuple[Path, Path]:
    """A case file and the results of its run, which nobody disturbs; it is run once."""
    path, reference = directory / f"{kind}.toml", directory / f"{kind} reference"
    if not reference.exists():
        data = CASES[kind] | {"title": kind, "output": OUTPUT}
        path.write_text(toml_text(data), encoding="utf-8")
        code, said = called("run", path, "--out", reference)
        assert code == 0, said
    return path, reference


def campaign(kinds: Sequence[str], seed: int, directory: Path) -> Iterator[Killed]:
    """Kill a run of each of these kinds of cases at a random moment, and let it go on."""
    chance = random.Random(seed)
    for number, kind in enumerate(kinds):
        path, reference = left_alone(kind, directory)
        rows, out = rows_in(reference), directory / f"{kind} {seed} {number}"
        # Of the first third: on a quick machine the last may be written before the kill comes.
        row, delay = chance.randrange(1, rows // 3), chance.uniform(0.0, SLACK)
        process = start(path, out)
        try:
            kill_after(process, out, row, delay)
        finally:
            process.kill()
        reached = rows_in(out)
        finish(start(path, out, "--resume"))
        after, found = went_on_after(kind, out), differences(kind, reference, out)
        yield Killed(kind, reached, rows, after, found)


def main() -> None:
    """Print what became of each run; exit code 1 if any went on otherwise."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("moments", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", choices=CASES, default=list(CASES))
    options = parser.parse_args()
    kinds = [options.kinds[n % len(options.kinds)] for n in range(options.moments)]
    wrong = 0
    print("| case | killed after row | went on after | files |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as directory:
        for killed in campaign(kinds, options.seed, Path(directory)):
            print(killed, flush=True)
            wrong += bool(killed.unlike)
    sys.exit(int(wrong > 0))


if __name__ == "__main__":
    main()
