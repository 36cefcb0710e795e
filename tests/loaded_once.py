"""What processes of the tests load again and again is looked up once: forms and meshes."""

import functools
import hashlib
import importlib.metadata
from collections.abc import Callable
from pathlib import Path
from typing import Any

import basix.ufl
import ffcx.codegeneration.jit
import ufl

from tribox.geometry.meshes import mesh

_FORMS: dict[tuple[Any, ...], Any] = {}


def _loaded_once(load: Callable[..., Any]) -> Callable[..., Any]:
    """Compiled forms are looked for in FFCx's cache, whose directory is read anew for each."""

    def look(name: str, objects: list[str], directory: Path, timeout: int) -> Any:
        key = (name, *objects, str(directory))
        found = _FORMS.get(key) or load(name, objects, directory, timeout)
        if found[0] is not None:  # otherwise it is to be compiled
            _FORMS[key] = found
        return found

    return look


def _read_once(ask: Callable[..., bytes]) -> Callable[..., bytes]:
    """Mesh files of the same bytes have the same arrays: gmsh takes longer to start than to read.

    One that is refused is read anew.
    """
    answers: dict[tuple[bytes, str], bytes] = {}

    def read(task: str, source: Path, last: str, *limits: float) -> bytes:
        key = hashlib.sha256(source.read_bytes()).digest(), last
        if key not in answers:
            answers[key] = ask(task, source, last, *limits)
        return answers[key]

    return read


ffcx.codegeneration.jit.get_cached_module = _loaded_once(ffcx.codegeneration.jit.get_cached_module)
mesh.ask = _read_once(mesh.ask)
# An element makes its cell anew, with all its parts, whenever it is asked of what shape it is.
cell_of = functools.cache(ufl.Cell)
basix.ufl._ElementBase.cell = property(lambda element: cell_of(element._cellname))
# Setuptools, which calls the compiler, reads those of all that is installed three times for a form.
importlib.metadata.entry_points = functools.cache(importlib.metadata.entry_points)
