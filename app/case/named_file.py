"""Files that a case names, found from where the case file is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic_core import PydanticCustomError


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
