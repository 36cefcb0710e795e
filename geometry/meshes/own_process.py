"""Starts the process that gmsh reads foreign files in, and tells what became of it."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import tribox
from tribox.geometry.meshes.gmsh_model import MeshError

REFUSED = 9
"""Exit code of the process where it knows what is wrong: the line is on standard output."""

MODULE = "tribox.geometry.meshes.foreign"

# Variables by which a process is taken for a rank of the MPI run that its parent is a rank of.
_OF_RANKS = ("OMPI_", "PMIX_", "PRTE_", "PMI_", "HYDRA_")


def ask(task: str, source: Path, last: str, seconds: float, memory: int) -> bytes:
    """The answer of `tribox.geometry.meshes.foreign` in a process of its own.

    Args:
        task: "read" or "draw".
        source: The file it is about.
        last: The task's further argument.
        seconds: Processor time that is enough for it.
        memory: Bytes that are enough for it.

    Raises:
        MeshError: gmsh cannot use the file, broke down or took too long; the message names it.
    """
    command = [sys.executable, "-P", "-m", MODULE, task, os.fspath(source), last]
    limit = int(seconds) + 1
    try:
        # No memory, locks or threads are shared with it, as they would be after a fork alone.
        with subprocess.Popen(
            command,
            env=_environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        ) as process:
            try:
                _limit(process.pid, limit, memory)
                answer, _ = process.communicate(timeout=WAITING * limit)
            except BaseException:
                process.kill()
                raise
    except subprocess.TimeoutExpired:
        raise MeshError(f"{source}: gmsh has not come to an end in {WAITING * limit} s") from None
    except OSError as error:
        raise MeshError(f"{source}: no process to read it in ({error.strerror})") from None
    if process.returncode == REFUSED:
        raise MeshError(answer.decode(errors="surrogateescape"))
    if process.returncode != 0 or not answer:
        raise MeshError(f"{source}: {_end(process.returncode, limit)}")
    return answer


WAITING = 10
"""Seconds on the clock for one of processor time: other programs may want the cores too."""


def _limit(pid: int, seconds: int, memory: int) -> None:
    """Let a process use so much processor time (s) and memory (bytes)."""
    try:
        resource.prlimit(pid, resource.RLIMIT_CPU, (seconds, seconds + 1))
        resource.prlimit(pid, resource.RLIMIT_AS, (memory, memory))
    except ProcessLookupError:  # it has ended already
        pass
    except ValueError:  # a stricter limit is there
        pass


def _environment() -> dict[str, str]:
    """The environment without MPI's variables, and with the place of this package."""
    root = str(Path(tribox.__file__).parents[1])
    kept = {key: value for key, value in os.environ.items() if not key.startswith(_OF_RANKS)}
    before = kept.get("PYTHONPATH")
    kept["PYTHONPATH"] = root if not before else f"{root}{os.pathsep}{before}"
    return kept


def _end(code: int, seconds: int) -> str:
    """How a process ended that gave no answer."""
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return (
            f"gmsh was stopped; it may use {seconds} s of processor time, and the memory there is"
        )
    if code < 0:
        return f"gmsh broke down on it ({signal.Signals(-code).name}): the file is damaged"
    return "gmsh ended without a mesh: the file is damaged"
