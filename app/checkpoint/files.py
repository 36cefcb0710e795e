"""Checkpoints as files: ``checkpoints/NNNNNN/`` in a results directory, whole or not there at all.

Each is written under a temporary name, synced to the disk and renamed; its manifest holds the size
and the SHA-256 sum of its files, and its own. They are numbered from 1; the last few are kept.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tribox.app.equilibrium.snapshot import Array
from tribox.app.errors import InputError
from tribox.app.results.directory import CHECKPOINTS, checkpoint_numbers

FORMAT = 2
INSTEAD = "; the one before it is taken"  # of one that is damaged
# What reading something else than was written may end in.
DAMAGE = (
    *(OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, EOFError),
    *(MemoryError, RecursionError, zipfile.BadZipFile, NotImplementedError),
)
_STATE, _ARRAYS, _MANIFEST = "state.json", "arrays.npz", "manifest.json"


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """One checkpoint.

    Attributes:
        about: its manifest: step, time, status of the run, versions and so on.
        tree: snapshot as plain data; arrays: of it, by name.
    """

    about: dict[str, Any]
    tree: Any
    arrays: dict[str, Array] = field(default_factory=dict)


def write_checkpoint(directory: Path, checkpoint: Checkpoint, keep: int) -> Path:
    """Write a checkpoint of a results directory, and drop all but the last ``keep``.

    Returns:
        Its directory.

    Raises:
        OSError: it cannot be written; those before it are untouched.
    """
    root = directory / CHECKPOINTS
    root.mkdir(exist_ok=True)
    numbers = checkpoint_numbers(directory)
    final = root / f"{(numbers[-1] if numbers else 0) + 1:06d}"
    part = final.with_name(f"{final.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        part.mkdir()
        _fill(part, checkpoint)
        os.replace(part, final)
        _sync(root)
    except OSError:
        shutil.rmtree(part, ignore_errors=True)
        raise
    for number in checkpoint_numbers(directory)[:-keep]:
        shutil.rmtree(root / f"{number:06d}", ignore_errors=True)
    return final


def _fill(part: Path, checkpoint: Checkpoint) -> None:
    with (part / _STATE).open("w", encoding="utf-8") as stream:
        json.dump(checkpoint.tree, stream, default=_plain)
    np.savez(part / _ARRAYS, **{f"a{name}": a for name, a in checkpoint.arrays.items()})  # type: ignore[arg-type]
    files = {name: _fingerprint(part / name) for name in (_STATE, _ARRAYS)}
    about = {"format": FORMAT, **checkpoint.about, "files": files}
    with (part / _MANIFEST).open("w", encoding="utf-8") as stream:
        json.dump(about | {"sha256": _sum(about)}, stream, indent=2, default=_plain)
    for name in (_STATE, _ARRAYS, _MANIFEST, "."):
        _sync(part / name)


def _plain(value: Any) -> Any:
    """Numbers of numpy as Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} in a checkpoint")


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _sum(about: dict[str, Any]) -> str:
    """SHA-256 of what a manifest holds, however it is laid out."""
    text = json.dumps(about, sort_keys=True, default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()


def _fingerprint(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return {"bytes": path.stat().st_size, "sha256": digest}


def latest(directory: Path) -> tuple[Checkpoint | None, list[str]]:
    """The last checkpoint of a results directory that is whole.

    Returns:
        None if there is none; and a line for each later one that is damaged.

    Raises:
        InputError: the last one is of another format.
    """
    damaged: list[str] = []
    for number in reversed(checkpoint_numbers(directory)):
        path = directory / CHECKPOINTS / f"{number:06d}"
        try:
            return _read(path), damaged
        except DAMAGE as error:
            damaged.append(f"{path}: is damaged ({why(error)}){INSTEAD}")
    return None, damaged


def why(error: BaseException) -> str:
    """One of ``DAMAGE`` in words."""
    if isinstance(error, KeyError):
        return f"{error} is missing"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__


def _read(path: Path) -> Checkpoint:
    about = json.loads((path / _MANIFEST).read_text(encoding="utf-8"))
    if not isinstance(about, dict):
        raise ValueError(f"{_MANIFEST} is not what was written")
    if about["format"] != FORMAT:
        raise InputError(
            f"{path}: a checkpoint of format {about['format']}, this version of tribox reads "
            f"{FORMAT}; resume it with the version that wrote it "
            f"({about.get('versions', {}).get('tribox', 'unknown')})"
        )
    if about.pop("sha256") != _sum(about):
        raise ValueError(f"{_MANIFEST} is not what was written")
    for name in (_STATE, _ARRAYS):
        if _fingerprint(path / name) != about["files"][name]:
            raise ValueError(f"{name} is not what was written")
    tree = json.loads((path / _STATE).read_text(encoding="utf-8"))
    return Checkpoint(about, tree, _arrays(path / _ARRAYS))


def _arrays(path: Path) -> dict[str, Array]:
    """The arrays of a file, none of which may take more memory than it has bytes there."""
    with zipfile.ZipFile(path) as archive:
        if any(one.compress_type != zipfile.ZIP_STORED for one in archive.infolist()):
            raise ValueError(f"{path.name} is not what was written")
    with np.load(path, allow_pickle=False) as stored:
        return {name.removeprefix("a"): stored[name] for name in stored.files}
