"""Where compiled forms are kept, if the usual place cannot be written."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from pathlib import Path

from tribox.app.errors import InputError
from tribox.app.run.process import is_first_rank

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
