"""How a process ends: one line, an exit code, and no rank that waits for another."""

from __future__ import annotations

import errno
import os
import stat
import sys
import tempfile
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from tribox.app.errors import InputError, OutputError, SolutionError, TriboxError, as_line, tell
from tribox.app.run.process import is_first_rank, ranks_around
from tribox.app.run.ranks import INTERRUPTED, tell_exit_code

# -- Where compiled forms are kept, if the usual place cannot be written ---------------------------

VARIABLE = "XDG_CACHE_HOME"


def ensure_cache() -> None:
    """See that the cache of DOLFINx and matplotlib can be written, before either is imported.

    Where it cannot (a read-only file system, another's home), the variable that both go by is set
    to a directory of this user's own among temporary files; ranks and runs of a sweep inherit it.

    Raises:
        InputError: that directory is not this user's alone.
    """
    usual = Path(os.environ.get(VARIABLE) or os.path.expanduser("~/.cache"))
    if usual.is_absolute() and _writable(usual):
        return
    ours = Path(tempfile.gettempdir()) / f"tribox-{os.getuid()}"
    if not _made_for_us(ours):
        raise InputError(
            f"{usual}: cannot be written, and {ours} is not yours alone; compiled forms need a "
            f"directory, named by {VARIABLE}"
        )
    os.environ[VARIABLE] = str(ours)
    if is_first_rank():
        print(f"note: {usual} cannot be written: compiled forms go to {ours}", file=sys.stderr)


def _writable(directory: Path) -> bool:
    """Whether files can be made in a directory, or it can be made itself."""
    for place in (directory, *directory.parents):
        if os.path.lexists(place):
            return place.is_dir() and os.access(place, os.W_OK | os.X_OK)
    return False


def _made_for_us(directory: Path) -> bool:
    """Make a directory that only this user writes; False where it is another's, or a link."""
    try:
        directory.mkdir(mode=0o700, exist_ok=True)
        found = directory.lstat()
    except OSError:
        return False
    others = stat.S_IWGRP | stat.S_IWOTH
    return (
        stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & others
    )


# -- How a process ends: one line, an exit code, and no rank that waits for another ----------------

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
