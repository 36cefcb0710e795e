"""The user's own friction law: a Python class named in the case file."""

from __future__ import annotations

import importlib.util
import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from forms.friction import FrictionLaw

# The methods of forms.friction.FrictionLaw.
METHODS = ("initial_state", "update", "stored_energy", "coefficient")


class OwnLawError(ValueError):
    """No friction law comes of what the case names; one line.

    Attributes:
        key: the key that is to blame, "class" or "parameters".
    """

    def __init__(self, message: str, key: str = "class") -> None:
        super().__init__(message)
        self.key = key


def load_own_law(reference: str, parameters: Mapping[str, Any]) -> FrictionLaw:
    """An instance of the class, called with the parameters.

    Args:
        reference: "file.py:Class".
        parameters: arguments of the class by name.

    Raises:
        OwnLawError: there is no such file or class, it cannot be made, or it is no friction law.
    """
    kind = _class(reference)
    missing = [name for name in METHODS if not callable(getattr(kind, name, None))]
    if missing:
        names = ", ".join(missing)
        raise OwnLawError(f"{kind.__name__} is no friction law: it has no method {names}")
    try:
        law: FrictionLaw = kind(**parameters)
    except Exception as error:  # Whatever the class does with its parameters.
        raise OwnLawError(f"{kind.__name__}: {_one_line(error)}", "parameters") from error
    return law


def _class(reference: str) -> type[Any]:
    file, colon, name = reference.rpartition(":")
    if not (colon and file.endswith(".py") and name.isidentifier()):
        raise OwnLawError('must be "file.py:Class"')
    path = Path(file)
    if not path.is_file():
        raise OwnLawError(f"no such file: {path}")
    spec = importlib.util.spec_from_file_location(f"tribox_own_law_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # Whatever the user's file does.
        raise OwnLawError(f"{path} cannot be loaded: {_one_line(error)}") from error
    found = getattr(module, name, None)
    if not inspect.isclass(found):
        classes = [n for n, c in inspect.getmembers(module, inspect.isclass)
                   if c.__module__ == module.__name__]  # fmt: skip
        there = f"there is {', '.join(classes)}" if classes else "there is none"
        raise OwnLawError(f"{path} has no class {name}; {there}")
    return found


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    place = f" (line {error.lineno})" if isinstance(error, SyntaxError) else ""
    return f"{type(error).__name__}: {text}{place}" if text else type(error).__name__
