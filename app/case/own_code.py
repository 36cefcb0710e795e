"""The user's own friction law or strain energy: a Python class named in the case file.

Naming it runs nothing. :func:`load_own_law` and :func:`load_own_material` run the file; the command
line calls them only for a case that the user trusts (:mod:`tribox.app.case.trust`).
"""

from __future__ import annotations

import inspect
import math
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from pydantic import Field, ValidationInfo, create_model, field_validator

from tribox.app.case.table import Model, Place, Problem, Text

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Kinematics
    from tribox.forms.friction.guarded_law import GuardedLaw

    _NamesAClass = Model
else:
    # A field called "class" cannot be written as an attribute.
    _NamesAClass = create_model(
        "_NamesAClass",
        __base__=Model,
        **{
            "class": (
                Text,
                Field(description='file and class, "my_law.py:MyLaw", relative to the case file'),
            )
        },
    )

CLOSE = 0.01  # relative difference of the moduli that a case gives from those of the energy


class NamesAClass(_NamesAClass):
    """A table of the case that names a class of the user's own, and what it is called with."""

    parameters: dict[str, Any] = Field(default={})
    """what the class is called with, by name, as it stands here"""

    @field_validator("class")
    @classmethod
    def _found_from_anywhere(cls, value: str, info: ValidationInfo) -> str:
        """The file from the root on, so that a copy of the case elsewhere finds it too."""
        source = (info.context or {}).get("source")
        file, colon, name = value.rpartition(":")
        return f"{(Path(source or '').parent / file).resolve()}:{name}" if colon else value

    @property
    def reference(self) -> str:
        """File and class, "/path/my_law.py:MyLaw"."""
        return getattr(self, "class")

    @property
    def file(self) -> Path:
        """The file with the class."""
        return Path(self.reference.rpartition(":")[0])

    def file_problems(self, place: Place) -> list[Problem]:
        """Whether the file is there, at `place`; what is in it shows only when it is run."""
        try:
            split_reference(self.reference)
        except OwnCodeError as error:
            return [Problem((*place, error.key), str(error), self.reference)]
        return []


class OwnCodeError(ValueError):
    """Nothing that can be used comes of what the case names; one line.

    Attributes:
        key: the key that is to blame, such as "class" or "parameters".
    """

    def __init__(self, message: str, key: str = "class") -> None:
        super().__init__(message)
        self.key = key


def split_reference(reference: str) -> tuple[Path, str]:
    """File and class of "file.py:Class", which is not looked into; OwnCodeError if none there."""
    file, colon, name = reference.rpartition(":")
    if not (colon and file.endswith(".py") and name.isidentifier()):
        raise OwnCodeError('must be "file.py:Class"')
    path = Path(file)
    try:
        found = path.is_file()
    except (OSError, ValueError) as error:  # a name that no file can have
        raise OwnCodeError(f"not a usable file name ({error})") from None
    if not found:
        raise OwnCodeError(f"no such file: {path}")
    return path, name


def load_own_law(reference: str, parameters: Mapping[str, Any], dim: int = 2) -> GuardedLaw:
    """An instance of the class "file.py:Class", called with the parameters; this runs its code.

    OwnCodeError, naming the line of the file, if it cannot be made, or is no friction law: a method
    is missing, fails in a step, or answers with arrays of another shape.
    """
    from tribox.forms.friction.guarded_law import METHODS, GuardedLaw

    law = _made(reference, parameters, METHODS, "friction law")
    path, name = split_reference(reference)
    guarded = GuardedLaw(law, f"{path.name}:{name}", str(path))
    _try_out(guarded, dim)
    return guarded


def _made(
    reference: str, parameters: Mapping[str, Any], methods: tuple[str, ...], what: str
) -> Any:
    """An instance of a class that has some methods."""
    from tribox.forms.friction.guarded_law import user_line

    path, name = split_reference(reference)
    directory = os.getcwd()
    try:
        kind = _class(path, name)
        missing = [method for method in methods if not callable(getattr(kind, method, None))]
        if missing:
            names = ", ".join(missing)
            raise OwnCodeError(f"{kind.__name__} is no {what}: it has no method {names}")
        try:
            return kind(**parameters)
        # Whatever the class does with its parameters.
        except (Exception, SystemExit) as error:
            said = f"{kind.__name__}: {user_line(error, str(path))}"
            raise OwnCodeError(said, "parameters") from error
    finally:
        os.chdir(directory)  # results are written where the run was started


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
            raise OwnCodeError(str(law.fault or law.not_finite))


def _class(path: Path, name: str) -> type[Any]:
    """The class, from the file that is run for it."""
    from tribox.forms.friction.guarded_law import user_line

    # Compiled from the source as it stands: compiled code that lies beside it is not looked at, and
    # none is written there.
    module = ModuleType(f"tribox_own_code_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # where dataclasses look for it
    try:
        exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)
    except (Exception, SystemExit) as error:  # Whatever the user's file does.
        raise OwnCodeError(f"cannot be loaded: {user_line(error, str(path))}") from error
    found = getattr(module, name, None)
    if not inspect.isclass(found):
        classes = [n for n, c in inspect.getmembers(module, inspect.isclass)
                   if c.__module__ == module.__name__]  # fmt: skip
        there = f"there is {', '.join(classes)}" if classes else "there is none"
        raise OwnCodeError(f"{path} has no class {name}; {there}")
    return found


SHARE = "share left when all branches are relaxed"  # among the constants: no name of the user's


@dataclass(frozen=True, slots=True)
class OwnMaterial:
    """A strain energy of the user's, with the moduli that the case gives."""

    own: Any  # an instance of the user's class
    file: str  # that it is written in
    shear_modulus: float  # of the undeformed material, Pa
    bulk_modulus: float  # likewise
    share: float = 1.0  # of the first part of its energy that there is

    def softened(self, share: float) -> OwnMaterial:
        """The same with a share of the first part of its energy."""
        return replace(self, shear_modulus=share * self.shear_modulus, share=share)

    def parameters(self) -> dict[str, float]:
        """Values of the constants in the energy, by name; OwnCodeError if they are no numbers."""
        found = self._asked(self.own.parameters)
        if not isinstance(found, Mapping):
            raise OwnCodeError(f"parameters() must return a dict, found {type(found).__name__}")
        for key, value in found.items():
            if not isinstance(value, int | float) or not math.isfinite(value):
                raise OwnCodeError(f"parameters(): {key} must be a number, found {value!r}")
        given = {str(key): float(value) for key, value in found.items()}
        return given if self.share == 1.0 else given | {SHARE: self.share}

    def energy(self, k: Kinematics, c: dict[str, Any]) -> tuple[Any, Any]:
        """Distortional and volumetric part, J/m³; OwnCodeError if they are no scalars of UFL."""
        import ufl

        found = self._asked(lambda: self.own.energy(k, c))
        if not isinstance(found, tuple) or len(found) != 2:
            raise OwnCodeError(
                "energy(k, c) must return two parts, the distortional and the volumetric energy "
                f"(0 where there is none), found {type(found).__name__}"
            )
        first, second = (self._asked(lambda part=part: ufl.as_ufl(part)) for part in found)
        if first.ufl_shape or second.ufl_shape:
            raise OwnCodeError("energy(k, c) must return two scalars")
        return (first if self.share == 1.0 else c[SHARE] * first), second

    def points(self, space: bool) -> None:
        """None: its points remember nothing."""
        return None

    @property
    def elastic(self) -> OwnMaterial:
        """The material itself."""
        return self

    def _asked(self, action: Any) -> Any:
        """What the user's code answers."""
        from tribox.forms.friction.guarded_law import user_line

        try:
            return action()
        except (Exception, SystemExit) as error:  # whatever it does
            raise OwnCodeError(user_line(error, self.file)) from error


def load_own_material(
    reference: str, parameters: Mapping[str, Any], shear_modulus: float, bulk_modulus: float
) -> OwnMaterial:
    """A strain energy in Python; this runs the user's code "file.py:Class".

    OwnCodeError if there is none of J, I1 and I2, stressless at rest and of these moduli, Pa.
    """
    from tribox.forms.bodies.own_energy import at_rest

    own = _made(reference, parameters, ("parameters", "energy"), "strain energy")
    material = OwnMaterial(own, reference.rpartition(":")[0], shear_modulus, bulk_modulus)
    try:
        stress, shear, bulk = at_rest(material)
    except NotImplementedError as error:
        raise OwnCodeError(f"the energy has a function that is not known: {error}") from None
    modulus = bulk_modulus + 4.0 / 3.0 * shear_modulus
    if not abs(stress) <= CLOSE * 1e-3 * modulus:
        raise OwnCodeError(
            f"the energy gives a stress of {stress:.3g} Pa in the undeformed body: must be 0"
        )
    for name, given, found in (("G", shear_modulus, shear), ("K", bulk_modulus, bulk)):
        if not abs(found - given) <= CLOSE * given:
            raise OwnCodeError(
                f"the energy has the modulus {name} = {found:.5g} Pa in the undeformed body, the "
                f"case says {given:.5g} Pa"
            )
    return material
