"""Copies of the files that a run reads beside its case file, so that its results can be run again.

They lie in ``inputs`` of the results directory, where ``case.toml`` names them relative to itself.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tribox.app.case.bodies import OwnBody
from tribox.app.case.case import Case, resolved_toml
from tribox.app.case.friction import OwnLaw
from tribox.app.case.geometry import MeshGeometry
from tribox.app.errors import InputError
from tribox.app.results.directory import SUMS, unwritable, write_text

INPUTS = "inputs"


@dataclass(frozen=True, slots=True)
class KeptInputs:
    """What was copied.

    Attributes:
        names: of the copies, by the files that they were made from.
        sums: SHA-256 of each copy, by its name.
    """

    names: Mapping[Path, str] = field(default_factory=dict)
    sums: Mapping[str, str] = field(default_factory=dict)


NOTHING = KeptInputs()


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's contents, in hexadecimal digits.

    Raises:
        InputError: it cannot be read.
    """
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None


def input_files(case: Case) -> list[Path]:
    """The files that a case, or a value of its sweep, names: meshes, Python of its own."""
    found: dict[Path, None] = {}
    for one in (case, *(part for _, part in case.sweep_cases())):
        if isinstance(one.geometry, MeshGeometry):
            found[one.geometry.mesh] = None
            if one.geometry.meshed is not None:
                found[one.geometry.meshed] = None
        found |= dict.fromkeys(file for tool in one.tools.values() for file in tool.files)
        laws = [c.friction.file for c in one.contact if isinstance(c.friction, OwnLaw)]
        found |= dict.fromkeys(laws)
        found |= dict.fromkeys(b.file for b in one.bodies.values() if isinstance(b, OwnBody))
    return list(found)


def keep_inputs(case: Case, directory: Path, like: Path | None = None) -> KeptInputs:
    """Copy all that a case reads beside its file into ``inputs`` of a results directory.

    Args:
        case: what is run.
        directory: of its results, ready to be written.
        like: directory whose ``inputs`` hold copies of the same files, that of the sweep: what is
            the same there is linked, so that it takes no room again.

    Raises:
        InputError: a file cannot be read.
        OutputError: it cannot be copied.
    """
    kept = kept_inputs(case)
    names, sums, folder = kept.names, kept.sums, directory / INPUTS
    if not names:
        return NOTHING
    try:
        folder.mkdir(exist_ok=True)
        # First, so that what is copied is known to be a copy whatever happens.
        write_text(folder / SUMS, "".join(f"{sums[name]}  {name}\n" for name in sums))
        for source, name in names.items():
            if like is None or not _linked(like / INPUTS / name, folder / name, sums[name]):
                shutil.copyfile(source, folder / name)
    except OSError as error:
        raise unwritable(directory, error) from None
    return kept


def kept_inputs(case: Case) -> KeptInputs:
    """What :func:`keep_inputs` makes of a case; nothing is copied.

    Raises:
        InputError: a file cannot be read.
    """
    names = _names(input_files(case))
    return KeptInputs(names, {name: sha256_of(source) for source, name in names.items()})


def write_case(case: Case, directory: Path, kept: KeptInputs = NOTHING) -> None:
    """Write ``case.toml``: the resolved case, which reads the copies of its files."""
    text = resolved_toml(case, {path: f"{INPUTS}/{name}" for path, name in kept.names.items()})
    write_text(directory / "case.toml", text)


def _names(files: list[Path]) -> dict[Path, str]:
    """A name of its own for each file: its own, numbered where others are called the same."""
    names: dict[Path, str] = {}
    for path in files:
        name, count = path.name, 1
        while name in (SUMS, *names.values()):
            count += 1
            name = f"{path.stem}-{count}{path.suffix}"
        names[path] = name
    return names


def _linked(there: Path, target: Path, digest: str) -> bool:
    """Whether a file that is there already, with the same contents, could be linked."""
    try:
        if sha256_of(there) != digest:
            return False
        os.link(there, target)
    except (InputError, OSError):  # not there, or a file system without links
        return False
    return True
