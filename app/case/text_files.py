"""Text files of anyone's making: read if they are files, of bounded size, in UTF-8."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic_core import PydanticCustomError

from tribox.app.errors import InputError

MEGABYTE = 1_000_000
LARGEST = 4 * MEGABYTE
"""Bytes of a case file or of data."""


def read_text(path: Path, largest: int = LARGEST) -> str:
    """Text of a file, without the mark that some editors put before it.

    Args:
        path: the file.
        largest: bytes that it may have.

    Raises:
        InputError: there is none, or it is no such file.
    """
    try:
        found = os.stat(path)
        _see_file(path, found, largest)
        with path.open("rb") as stream:
            content = stream.read(largest + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL.
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason})") from None
    if len(content) > largest:
        raise _too_large(path, largest)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8") from None


def _see_file(path: Path, found: os.stat_result, largest: int) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: is no file but a device, pipe or socket")
    if found.st_size > largest:
        raise _too_large(path, largest)


def _too_large(path: Path, largest: int) -> InputError:
    return InputError(f"{path}: is larger than {largest // MEGABYTE} MB, so it is none of ours")


# -- Files that a case names, found from where the case file is ------------------------------------


def found_file(value: object, context: Mapping[str, Any], what: str) -> Path:
    """An absolute path, seen from the case file, of a file that is there.

    Args:
        value: what the case says.
        context: of the validation: ``source`` is the case file; of a run that is over (``past``)
            the file need not be there any more.
        what: the file is, such as "a mesh file".

    Raises:
        PydanticCustomError: it is no name, or there is no such file.
    """
    if not isinstance(value, str | Path) or not str(value):
        raise PydanticCustomError("path", "must be the name of {what}, in quotes", {"what": what})
    try:
        path = (Path(context.get("source") or "").parent / value).resolve()
        found = path.is_file()
    except (OSError, ValueError):  # a name that no file can have
        raise PydanticCustomError("path", "is no name that a file can have") from None
    if not found and not context.get("past"):
        raise PydanticCustomError("path", "no such file ({path})", {"path": str(path)})
    return path
