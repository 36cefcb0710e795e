"""Runs of tribox in processes of their own, with what they cost."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import tribox
from tribox.app.errors import SolutionError

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
