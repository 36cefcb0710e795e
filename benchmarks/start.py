"""CPU time of the commands that need no solver, over that of Python with what they draw with.

Run from the top: ``python benchmarks/start.py [DIR]``, DIR being the results of a run. Each command
is a process of its own; its time is that of the CPU, user and system, the median of five.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SETTINGS = {"PYTHONPATH": str(ROOT / "src"), "MPLBACKEND": "Agg", "OMP_NUM_THREADS": "1"}
REPEATS = 5
BASE = "import numpy, matplotlib.pyplot"


def cpu_seconds(words: list[str]) -> float:
    """Median CPU seconds of a command."""
    taken = []
    for _ in range(REPEATS):
        before = os.times()
        subprocess.run(
            [sys.executable, *words], check=True, stdout=subprocess.DEVNULL, cwd=ROOT,
            env=os.environ | SETTINGS,
        )  # fmt: skip
        after = os.times()
        taken.append(
            after.children_user - before.children_user
            + after.children_system - before.children_system
        )  # fmt: skip
    return statistics.median(taken)


def main() -> None:
    """Print a table of the commands."""
    with tempfile.TemporaryDirectory() as scratch:
        results = sys.argv[1] if len(sys.argv) > 1 else str(Path(scratch) / "block-slide")
        if len(sys.argv) == 1:
            words = ["-m", "tribox", "run", "cases/block-slide.toml", "--out", results]
            subprocess.run([sys.executable, *words], check=True, cwd=ROOT)
        commands = {
            "--version": ["--version"],
            "schema": ["schema"],
            "map": ["map", "--out", str(Path(scratch) / "map"), "--force"],
            "plot": ["plot", results],
        }
        bare = cpu_seconds(["-c", "import numpy, matplotlib"])
        base = cpu_seconds(["-c", BASE])
        print(f"numpy, matplotlib {bare:.2f} s; with matplotlib.pyplot {base:.2f} s")
        print("| command | CPU (s) | more than numpy, matplotlib (s) | with pyplot (s) |")
        print("|---|---|---|---|")
        for name, words in commands.items():
            taken = cpu_seconds(["-m", "tribox", *words])
            print(f"| {name} | {taken:.2f} | {taken - bare:.2f} | {taken - base:.2f} |")


if __name__ == "__main__":
    main()
