"""How a process ends: one line, an exit code, and no rank that waits for another."""

from __future__ import annotations

import errno
import sys
import traceback
from collections.abc import Sequence
from typing import NoReturn

from tribox.app.errors import InputError, OutputError, SolutionError, TriboxError, as_line, tell
from tribox.app.run.process import is_first_rank, ranks_around
from tribox.app.run.ranks import INTERRUPTED, tell_exit_code

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)


def end_with(error: Exception) -> NoReturn:
    """End the program for an error: with a line if it is one of ours, else with its traceback."""
    if isinstance(error, TriboxError):
        together = isinstance(error, SolutionError | OutputError)
        _leave(error.said, error.exit_code, together)
    if isinstance(error, OSError) and error.errno in _FULL:
        where = error.filename or "what is printed"
        _say_once(f"{where}: cannot be written ({error.strerror})")
        _abort(OutputError.exit_code)
    if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        _say_once(f"{as_line(str(error.filename))}: {error.strerror}")
        _abort(InputError.exit_code)
    if isinstance(error, RuntimeError) and (line := _of_a_kernel(error)):
        print(f"tribox: {as_line(line)}", file=sys.stderr)  # it may be this rank's alone
        _abort(1)
    if ranks_around() == 1:
        raise error
    traceback.print_exception(error)
    _abort(1)


def _of_a_kernel(error: RuntimeError) -> str:
    """What kept a C source from being compiled; "" where that is not what went wrong."""
    from tribox.geometry.native.compiler import KernelError

    return str(error) if isinstance(error, KernelError) else ""


def end_interrupted(together: bool) -> NoReturn:
    """End the program after a signal.

    Args:
        together: whether all ranks are here, their state saved.
    """
    if together:
        _leave(["interrupted; the results so far are saved"], INTERRUPTED, True)
    _say_once("interrupted")
    _abort(INTERRUPTED)


def _leave(lines: Sequence[str], code: int, together: bool) -> NoReturn:
    """End with lines and a code; ``together`` if all ranks do so here."""
    for line in lines:
        _say_once(line)
    sys.exit(0 if together and tell_exit_code(code) else code)


def _abort(code: int) -> NoReturn:
    """End this process, and with it ranks that would wait for it for ever."""
    if ranks_around() > 1:
        from mpi4py import MPI

        sys.stderr.flush()
        MPI.COMM_WORLD.Abort(code)
    sys.exit(code)


def _say_once(line: str) -> None:
    """Print a line to standard error, on the first rank only."""
    if is_first_rank():
        tell(f"tribox: {line}", sys.stderr)
