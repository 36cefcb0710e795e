"""Compiled forms are looked for in FFCx's cache, whose directory is read anew for each, once."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import ffcx.codegeneration.jit

_FORMS: dict[tuple[Any, ...], Any] = {}


def _loaded_once(load: Callable[..., Any]) -> Callable[..., Any]:
    def look(name: str, objects: list[str], directory: Path, timeout: int) -> Any:
        key = (name, *objects, str(directory))
        found = _FORMS.get(key) or load(name, objects, directory, timeout)
        if found[0] is not None:  # otherwise it is to be compiled
            _FORMS[key] = found
        return found

    return look


ffcx.codegeneration.jit.get_cached_module = _loaded_once(ffcx.codegeneration.jit.get_cached_module)
