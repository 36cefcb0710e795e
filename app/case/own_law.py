"""The user's own friction law: a Python class named in the case file."""

from __future__ import annotations

import importlib.util
import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from forms.friction.law import FrictionLaw

# The methods of forms.friction.law.FrictionLaw.
METHODS = ("initial_state", "update", "stored_energy", "coefficient")

# Shapes of an answer at 2 points in 2D.
_SHAPES: dict[str, tuple[int, ...]] = {
    "traction": (2, 2),
    "d_traction_d_slip": (2, 2, 2),
    "d_traction_d_elastic": (2, 2, 2),
    "d_traction_d_pressure": (2, 2),
    "d_traction_d_film": (2, 2),
    "regime": (2,),
}


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
        OwnLawError: there is no such file or class, it cannot be made, or it is no friction law:
            a method is missing, fails in a step, or answers with arrays of another shape.
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
    _try_out(law, kind.__name__)
    return law


def _try_out(law: FrictionLaw, name: str) -> None:
    """One step of a closed and an open point, so that a law that cannot run is told beforehand."""
    import numpy as np

    slip, pressure, film = np.full((2, 2), 1e-9), np.array([1e5, 0.0]), np.full(2, 1e-8)
    try:
        state = law.initial_state(2, 2)
        response = law.update(slip, 1.0, pressure, film, state, area_ratio=np.ones(2))
        shapes = {part: np.shape(getattr(response, part)) for part in _SHAPES}
        shapes["stored_energy"] = np.shape(law.stored_energy(response.state))
        shapes["coefficient"] = np.shape(law.coefficient(response.state))
    except Exception as error:  # Whatever the class does.
        raise OwnLawError(f"{name} fails in a step: {_one_line(error)}") from error
    for part, expected in {**_SHAPES, "stored_energy": (2,), "coefficient": (2,)}.items():
        if shapes[part] != expected:
            raise OwnLawError(
                f"{name}: {part} has shape {shapes[part]} for 2 points in 2D, expected {expected}"
            )


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
