"""Reading a case file: TOML with overrides; mistakes in it become lines of text."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from app.case.case import Case
from app.case.overrides import apply_override
from app.case.validation import format_problem, problems_of
from app.errors import InputError


def load_case(path: Path, overrides: Sequence[str] = ()) -> Case:
    """Read a case file.

    Args:
        path: the file.
        overrides: "dotted.key=value" texts that replace or add values; list entries by number
            ("contact.0.film.thickness=10 nm"). The value is TOML if it can be, else text.

    Raises:
        InputError: the file cannot be read or the case is wrong. The message is the first
            problem; `check_case` lists all.
    """
    return _case_of(_read(Path(path), overrides))


def load_past_case(path: Path) -> Case:
    """Read the case file of a run that is over, to look at its results.

    Files that the run was made from may have gone since: a mesh need not be there, and a friction
    law in Python is not loaded, so that nothing of the file is run.

    Raises:
        InputError: as :func:`load_case`.
    """
    return _case_of(_read(Path(path), (), past=True))


def _case_of(case: Case | list[str]) -> Case:
    if isinstance(case, Case):
        return case
    more = f" (and {len(case) - 1} more; tribox check lists them)" if len(case) > 1 else ""
    raise InputError(case[0] + more)


def check_case(path: Path, overrides: Sequence[str] = ()) -> list[str]:
    """All mistakes in a case file, one line each; empty if it can be run.

    Args:
        path: the file.
        overrides: as for `load_case`.
    """
    case = _read(Path(path), overrides)
    return [] if isinstance(case, Case) else case


def _read(path: Path, overrides: Sequence[str], past: bool = False) -> Case | list[str]:
    """The case, or a line on each mistake in it; ``past`` if it has been run already."""
    try:
        data = _read_toml(path)
        for override in overrides:
            apply_override(data, override)
    except InputError as error:
        return [str(error)]
    try:
        return Case.model_validate(data, context={"source": path, "past": past})
    except ValidationError as error:
        return [f"{path}: {format_problem(p)}" for p in problems_of(error, Case, data)]


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except tomllib.TOMLDecodeError as error:
        match = re.fullmatch(r"(.*) \(at line (\d+), column (\d+)\)", str(error))
        line, reason = (f":{match[2]}", f"{match[1]} (column {match[3]})") if match else ("", error)
        raise InputError(f"{path}{line}: not valid TOML: {reason}") from None
