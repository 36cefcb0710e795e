"""Reading a case file: TOML with overrides; mistakes in it become lines of text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from tribox.app.case.case import Case
from tribox.app.case.toml_files import TomlError, apply_override, parse_toml, read_text
from tribox.app.case.validation import format_problem, problems_of
from tribox.app.errors import InputError, as_line
from tribox.geometry.meshes.drawing import DRAWINGS

GONE = (("solver", "viscous"), ("output", "formats"))
"""Tables and keys that the kept cases of earlier versions have, which wrote all defaults out."""


def load_case(path: Path, overrides: Sequence[str] = ()) -> Case:
    """Read a case file.

    Args:
        overrides: "dotted.key=value" texts that replace or add values; list entries by number
            ("contact.0.film.thickness=10 nm"). The value is TOML if it can be, else text.

    Raises:
        InputError: the file cannot be read or the case is wrong. The message is the first
            problem; `check_case` lists all.
    """
    return _read(Path(path), overrides)


def load_past_case(path: Path) -> Case:
    """Read the case file of a run that is over, to look at its results.

    Files that the run was made from may have gone since: a mesh need not be there, and a friction
    law in Python is not loaded, so that nothing of the file is run.

    Raises:
        InputError: as :func:`load_case`.
    """
    return _read(Path(path), (), past=True)


def check_case(path: Path, overrides: Sequence[str] = ()) -> list[str]:
    """All mistakes in a case file, one line each; empty if it can be run."""
    try:
        _read(Path(path), overrides)
    except InputError as error:
        return list(error.lines)
    return []


def _read(path: Path, overrides: Sequence[str], past: bool = False) -> Case:
    """The case; ``past`` if it has been run already. InputError with a line on each mistake."""
    data = _read_toml(path)
    for override in overrides:
        apply_override(data, override)
    for table, key in GONE if past else ():
        if isinstance(data.get(table), dict):
            data[table].pop(key, None)
    try:
        return Case.model_validate(data, context={"source": path, "past": past})
    except ValidationError as error:
        found = problems_of(error, Case, data)
    first, *more = (as_line(f"{path}: {format_problem(problem)}") for problem in found)
    raise InputError(first, more)


def _read_toml(path: Path) -> dict[str, Any]:
    if path.suffix.lower() in (*DRAWINGS, ".msh") and path.exists():
        raise InputError(
            f"{path}: is no case (.toml), which names drawings and meshes by its key geometry.mesh"
        )
    text = read_text(path)
    try:
        return parse_toml(text)
    except TomlError as error:
        line = "" if error.line is None else f":{error.line}"
        cure = "" if path.suffix == ".toml" else "; a case file, ending in .toml, is asked for"
        raise InputError(f"{path}{line}: {error}{cure}") from None
