"""How far the run in a results directory has come, from its summary alone."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from tribox.app.errors import InputError
from tribox.app.results.directory import BEGINNING, LOCK

UNFINISHED = ("running", "interrupted", "failed")


def status_of(directory: Path) -> str | None:
    """What ``summary.json`` says: running, done, interrupted or failed; None without one."""
    status = _summary(directory).get("status")
    return status if isinstance(status, str) else None


def given_keys_of(directory: Path) -> set[str]:
    """Dotted keys that the case file of the run gave; all others were filled in."""
    given = _summary(directory).get("given")
    return set(map(str, given)) if isinstance(given, list) else set()


def end_of(directory: Path) -> float:
    """Time, s, of the last row of the last load step that has ended; infinite if there is none."""
    try:
        return float(_summary(directory)["load_steps"][-1]["time"])
    except (LookupError, TypeError, ValueError):
        return math.inf


def _summary(directory: Path) -> dict[str, Any]:
    try:
        summary = json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return summary if isinstance(summary, dict) else {}


def is_done(directory: Path) -> bool:
    """Whether the run has come to its end."""
    return status_of(directory) == "done"


def is_beginning(directory: Path) -> bool:
    """Whether a run has not begun there yet: it was ended while the directory was made ready."""
    return _summary(directory) == BEGINNING


def check_may_begin_anew(directory: Path) -> None:
    """See that a run that cannot be gone on with may be begun again in its directory.

    Raises:
        InputError: the directory holds something else than a run that has not come to its end.
    """
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
