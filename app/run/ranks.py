"""``tribox run --np N``: starts the ranks by mpirun, and sees that signals reach them."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tribox.app.errors import InputError
from tribox.app.run.forwarding import Forwarding
from tribox.app.run.process import end_with_parent, tribox_command, with_sources

EXIT_CODE = "TRIBOX_EXIT_CODE"
"""Variable of the environment: file into which the first rank writes the exit code of all.

mpirun prints a page wherever a rank ends with another code than 0.
"""
INTERRUPTED = 130


def run_on_ranks(count: int, arguments: Sequence[str]) -> int:
    """Run tribox on ranks and wait for them.

    mpirun, told to end, gives its ranks a quarter of a second and kills them. So signals to stop
    go to the ranks themselves, by SIGUSR1, which mpirun passes on; these finish their step.

    Args:
        count: number of ranks.
        arguments: of the command line of each.

    Returns:
        The exit code.

    Raises:
        InputError: there is no mpirun.
    """
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        raise InputError(f"--np {count}: there is no mpirun here")
    python = tribox_command(*arguments, before=("-m", "mpi4py"))
    command = [mpirun, "-n", str(count), *python]
    with tempfile.TemporaryDirectory(prefix="tribox-") as place:
        told = Path(place) / "exit-code"
        code, asked = _supervise(command, told)
        if told.exists():
            return int(told.read_text(encoding="ascii"))
    return INTERRUPTED if asked else code


def tell_exit_code(code: int) -> bool:
    """Tell the process that waits for these ranks what to end with.

    Returns:
        Whether there is one; the ranks themselves are then to end with 0.
    """
    if EXIT_CODE not in os.environ:
        return False
    try:
        Path(os.environ[EXIT_CODE]).write_text(f"{code}", encoding="ascii")
    except OSError:
        return False  # mpirun tells it, on a page
    return True


def _supervise(command: Sequence[str], told: Path) -> tuple[int, bool]:
    """Exit code of mpirun, and whether it was asked to stop."""
    # Open MPI refuses more ranks than cores otherwise, with a page of advice.
    oversubscribed = {"PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe"}
    environment = with_sources(oversubscribed | dict(os.environ))
    with Forwarding(signal.SIGUSR1, signal.SIGTERM) as forwarding:
        process = subprocess.Popen(
            command,
            env=environment | {EXIT_CODE: str(told)},
            stdin=subprocess.DEVNULL,
            text=True,
            process_group=0,
            preexec_fn=lambda: end_with_parent(signal.SIGUSR1),
        )
        forwarding.add(process)
        code = process.wait()
    return code, forwarding.asked > 0
