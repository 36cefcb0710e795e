"""The user's own friction law: a Python class named in the case file.

Naming it runs nothing. :func:`load_own_law` runs the file; the command line calls it only for a
case that the user trusts (:mod:`tribox.app.case.trust`).
"""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tribox.forms.friction.guarded_law import GuardedLaw


class OwnLawError(ValueError):
    """No friction law comes of what the case names; one line.

    Attributes:
        key: the key that is to blame, "class" or "parameters".
    """

    def __init__(self, message: str, key: str = "class") -> None:
        super().__init__(message)
        self.key = key


def split_reference(reference: str) -> tuple[Path, str]:
    """File and class of a reference; the file is there, and is not looked into.

    Args:
        reference: "file.py:Class".

    Raises:
        OwnLawError: it is no such reference, or there is no such file.
    """
    file, colon, name = reference.rpartition(":")
    if not (colon and file.endswith(".py") and name.isidentifier()):
        raise OwnLawError('must be "file.py:Class"')
    path = Path(file)
    try:
        found = path.is_file()
    except (OSError, ValueError) as error:  # a name that no file can have
        raise OwnLawError(f"not a usable file name ({error})") from None
    if not found:
        raise OwnLawError(f"no such file: {path}")
    return path, name


def load_own_law(reference: str, parameters: Mapping[str, Any], dim: int = 2) -> GuardedLaw:
    """An instance of the class, called with the parameters; this runs the user's code.

    Args:
        reference: "file.py:Class".
        parameters: arguments of the class by name.
        dim: space dimensions that the law is tried in.

    Raises:
        OwnLawError: there is no such file or class, it cannot be made, or it is no friction law:
            a method is missing, fails in a step, or answers with arrays of another shape. The
            message names the line of the file.
    """
    from tribox.forms.friction.guarded_law import METHODS, GuardedLaw, user_line

    path, name = split_reference(reference)
    directory = os.getcwd()
    try:
        kind = _class(path, name)
        missing = [method for method in METHODS if not callable(getattr(kind, method, None))]
        if missing:
            names = ", ".join(missing)
            raise OwnLawError(f"{kind.__name__} is no friction law: it has no method {names}")
        try:
            law = kind(**parameters)
        # Whatever the class does with its parameters.
        except (Exception, SystemExit) as error:
            said = f"{kind.__name__}: {user_line(error, str(path))}"
            raise OwnLawError(said, "parameters") from error
    finally:
        os.chdir(directory)  # results are written where the run was started
    guarded = GuardedLaw(law, f"{path.name}:{name}", str(path))
    _try_out(guarded, dim)
    return guarded


def _try_out(law: GuardedLaw, dim: int) -> None:
    """One step of a closed and an open point, so that a law that cannot run is told beforehand.

    And one of no points, which is what a rank has that the contact does not reach.
    """
    import numpy as np

    for n in (2, 0):
        slip, pressure = np.full((n, dim), 1e-9), np.array([1e5, 0.0])[:n]
        state = law.initial_state(n, dim)
        film, more = np.full(n, 1e-8), dict[str, Any](area_ratio=np.ones(n))
        if law.takes_film_cover:
            more["film_cover"] = np.ones(n)
        if law.looks_inside:
            more["look_inside"] = False
        response = law.update(slip, 1.0, pressure, film, state, **more)
        law.try_state(response.state, pressure)
        if law.fault or law.not_finite:
            raise OwnLawError(str(law.fault or law.not_finite))


def _class(path: Path, name: str) -> type[Any]:
    """The class, from the file that is run for it."""
    from tribox.forms.friction.guarded_law import user_line

    # Compiled from the source as it stands: compiled code that lies beside it is not looked at, and
    # none is written there.
    module = ModuleType(f"tribox_own_law_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # where dataclasses look for it
    try:
        exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:  # Whatever the user's file does.
        raise OwnLawError(f"cannot be loaded: {user_line(error, str(path))}") from error
    found = getattr(module, name, None)
    if not inspect.isclass(found):
        classes = [n for n, c in inspect.getmembers(module, inspect.isclass)
                   if c.__module__ == module.__name__]  # fmt: skip
        there = f"there is {', '.join(classes)}" if classes else "there is none"
        raise OwnLawError(f"{path} has no class {name}; {there}")
    return found
