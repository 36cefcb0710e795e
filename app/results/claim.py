"""A results directory that is free, or may be cleared, and then belongs to one process."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import json
import math
import os
import platform
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

from tribox.app.errors import InputError
from tribox.app.results.directory import (
    BEGINNING,
    LOCK,
    check_free,
    check_no_links,
    json_of,
    open_own,
    prepare,
    unwritable,
)

# -- The lock of a results directory: one process at a time writes there ---------------------------

TRIES, PAUSE = 5, 0.05  # who only looks whether a directory is locked holds it for a moment
_HELD = (errno.EAGAIN, errno.EACCES)


def command() -> str | None:
    """The command of this process as it can be typed again; None where a script runs the case."""
    if Path(sys.argv[0]).name not in ("tribox", "__main__.py"):
        return None
    return shlex.join(["tribox", *sys.argv[1:]])


def owner_of(directory: Path) -> dict[str, Any] | None:
    """Who is writing into a results directory: pid, host, started, command; None: nobody."""
    path = directory / LOCK
    try:
        descriptor = open_own(path, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        return None
    except OSError as error:
        owner = _told(path)
        return owner if error.errno in _HELD or _lives(owner) else None
    finally:
        os.close(descriptor)


def in_use(directory: Path, owner: dict[str, Any]) -> str:
    """That a directory is being written, by whom, and what to do."""
    who = f"process {owner.get('pid', '?')} on {owner.get('host', '?')}"
    since = f", started {owner['started']}" if "started" in owner else ""
    command = f": {owner['command']}" if "command" in owner else ""
    return (
        f"{directory}: tribox is writing there ({who}{since}{command}); wait for it or stop it, "
        "or name another directory with --out"
    )


def _told(path: Path) -> dict[str, Any]:
    """The table that a file in JSON holds; empty where it holds none, or is none."""
    try:
        found = json_of(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _lives(owner: dict[str, Any]) -> bool:
    """Whether an owner may still live; of those on other hosts nothing is known."""
    if owner.get("host") != platform.node():
        return bool(owner)
    try:
        os.kill(int(owner["pid"]), 0)
    except (KeyError, ValueError, TypeError, ProcessLookupError):
        return False
    except OSError:
        return True
    return int(owner["pid"]) != os.getpid()


def _same(descriptor: int, path: Path) -> bool:
    """Whether an open file is the one that has this name."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


# -- The sub-directories of a sweep whose results a directory holds --------------------------------


def sweep_labels(directory: Path) -> tuple[str, ...]:
    """Their names, from the case file beside them; none without a sweep."""
    if not (directory / "case.toml").is_file():
        return ()
    # Not before: most directories are new, and the tables of a case take a while to import.
    from tribox.app.case.reading import load_past_case

    try:
        case = load_past_case(directory / "case.toml")
    except InputError:
        return ()
    return case.sweep.labels if case.sweep is not None else ()


# -- A results directory that is free, or may be cleared, and then belongs to one process ----------


class Claim:
    """A results directory, from the first look at it until all is written.

    Holds ``tribox.lock`` in it; the kernel frees it however the process ends. Where the file system
    knows no such locks, the process and the host named in it decide.
    """

    def __init__(self, directory: Path, force: bool) -> None:
        """Nothing is done yet; ``force``: results that are there may be cleared."""
        self.directory, self._force = directory, force
        self._path = directory / LOCK
        self._descriptor: int | None = None
        self._made: list[Path] = []

    def take(self, goes_on: bool = False) -> None:
        """See that results may be written, and lock the directory; nothing is cleared yet.

        InputError if it holds results, not to go on with, or is in use; OutputError.
        """
        if goes_on:
            check_not_in_use(self.directory)
            check_no_links(self.directory)
        else:
            self._check()
        try:
            missing = [self.directory, *self.directory.parents]
            self._made = [path for path in missing if not path.exists()]
            self.directory.mkdir(parents=True, exist_ok=True)
            for tries in range(TRIES):
                if self._lock():
                    break
                if tries + 1 == TRIES:
                    raise InputError(in_use(self.directory, _told(self._path)))
                time.sleep(PAUSE)
            assert self._descriptor is not None
            owner = {
                "pid": os.getpid(),
                "host": platform.node(),
                "started": datetime.now().astimezone().isoformat(timespec="seconds"),
                "command": command() or " ".join(["tribox", *sys.argv[1:]]),
            }
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, (json.dumps(owner) + "\n").encode(), 0)
        except OSError as error:
            self.release()
            raise unwritable(self.directory, error) from None

    def clear(self, begins: bool = False) -> None:
        """Look again, and clear old results.

        Raises:
            InputError: as of :meth:`take`, if somebody has come between.
            OutputError: the directory cannot be written.
        """
        prepare(self.directory, self._check(), begins)

    def release(self) -> None:
        """Unlock the directory; it goes if it was made for this claim and nothing was written."""
        if self._descriptor is None:
            return
        with contextlib.suppress(OSError):
            if _same(self._descriptor, self._path):
                self._path.unlink()
        os.close(self._descriptor)
        self._descriptor = None
        with contextlib.suppress(OSError):
            for path in self._made:
                path.rmdir()

    def _check(self) -> tuple[str, ...]:
        """Labels of the sweep whose results may be cleared."""
        check_not_in_use(self.directory, self._descriptor is not None)
        labels = sweep_labels(self.directory)
        check_free(self.directory, self._force, labels)
        for label in labels:
            check_not_in_use(self.directory / label)
        return labels

    def _lock(self) -> bool:
        """Open and lock the file; whether that is done, and the file still the one there."""
        descriptor = open_own(self._path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Who held it may have removed it meanwhile: a lock on a file without a name is none.
            mine = _same(descriptor, self._path)
        except OSError as error:
            mine = error.errno not in _HELD and not _lives(_told(self._path))
        if mine:
            self._descriptor = descriptor
        else:
            os.close(descriptor)
        return mine


def check_not_in_use(directory: Path, by_this: bool = False) -> None:
    """See that no process, but perhaps this one, is writing into a directory; else InputError."""
    owner = None if by_this else owner_of(directory)
    if owner is not None:
        raise InputError(in_use(directory, owner))


@contextmanager
def claimed(directory: Path, force: bool, goes_on: bool = False) -> Iterator[Claim]:
    """Context of a :class:`Claim` that has been taken."""
    claim = Claim(directory, force)
    claim.take(goes_on)
    try:
        yield claim
    finally:
        claim.release()


# -- How far the run in a results directory has come, from its summary alone  ---------------------

SUMMARY = "summary.json"
UNFINISHED = ("running", "interrupted", "failed")


def status_of(directory: Path) -> str | None:
    """What ``summary.json`` says: running, done, interrupted or failed; None without one."""
    status = _told(directory / SUMMARY).get("status")
    return status if isinstance(status, str) else None


def given_keys_of(directory: Path) -> set[str]:
    """Dotted keys that the case file of the run gave; all others were filled in."""
    given = _told(directory / SUMMARY).get("given")
    return set(map(str, given)) if isinstance(given, list) else set()


def sums_of(directory: Path) -> dict[str, Any]:
    """SHA-256 of the files that the run read, by the names that ``case.toml`` gives them."""
    sums = _told(directory / SUMMARY).get("inputs")
    return sums if isinstance(sums, dict) else {}


def end_of(directory: Path) -> float:
    """Time, s, of the last row of the last load step that has ended; infinite if there is none."""
    try:
        return float(_told(directory / SUMMARY)["load_steps"][-1]["time"])
    except (LookupError, TypeError, ValueError):
        return math.inf


def is_done(directory: Path) -> bool:
    """Whether the run has come to its end."""
    return status_of(directory) == "done"


def is_beginning(directory: Path) -> bool:
    """Whether a run has not begun there yet: it was ended while the directory was made ready."""
    return _told(directory / SUMMARY) == BEGINNING


def check_may_begin_anew(directory: Path) -> None:
    """InputError if a directory holds something else than a run that has not come to its end."""
    try:
        present = directory.iterdir() if directory.exists() else ()
        empty = all(path.name in (LOCK, "summary.json.part") for path in present)
    except OSError as error:
        raise InputError(f"{directory}: cannot be read ({error.strerror or error})") from None
    if not empty and status_of(directory) not in UNFINISHED:
        raise InputError(
            f"{directory}: holds no checkpoint and no unfinished run to go on with; begin anew "
            "with --force, or name another directory with --out"
        )
