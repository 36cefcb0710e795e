"""A friction law written by the user, whose failures all ranks hear of together.

A law may fail on one rank alone, within a callback of PETSc or between two exchanges of values: an
exception there leaves the other ranks waiting for ever. So what the law does wrong is noted, and
the answer is one that is not a number; whoever runs the steps asks for the note, on all ranks, and
ends the run with the user's own line.
"""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.law import Dissipation, FrictionLaw, FrictionResponse, FrictionState

Floats = NDArray[np.float64]

METHODS = ("initial_state", "update", "stored_energy", "coefficient")  # what every friction law has

# What the answer of a step consists of, with the axes of each part behind the points.
ARRAYS = {
    "traction": 1,
    "d_traction_d_slip": 2,
    "d_traction_d_elastic": 2,
    "d_traction_d_pressure": 1,
    "d_traction_d_film": 1,
}


class LawError(Exception):
    """A friction law of the user's has failed; one line that names its place in the user's file."""


class GuardedLaw:
    """A user's law that never raises, and whose answers have the shapes they should have.

    The working directory is put back if the law changes it. What a law says of where its friction
    tends (:mod:`tribox.forms.friction.law`) is passed on as far as it says something.

    Attributes:
        law: the user's; name: of it in messages; file: that it is written in.
        fault: what it did wrong first; None as long as nothing. From then on it is asked no more.
        not_finite: what of the last answer to finite questions was no finite number; None if
            all was. A step may be tried again shorter then.
    """

    def __init__(self, law: FrictionLaw, name: str, file: str = "") -> None:
        self.law, self.name, self.file = law, name, file
        self.fault: str | None = None
        self.not_finite: str | None = None
        self.takes_film_cover = bool(getattr(law, "takes_film_cover", False))
        self.looks_inside = bool(getattr(law, "looks_inside", False))
        self._directory = os.getcwd()
        # Only what the law has: whoever asks looks whether it is there.
        if hasattr(law, "settling_slip"):
            self.settling_slip = float(self._call(lambda: float(law.settling_slip)) or 0.0)
        for member in ("unsettled", "presliding_length"):
            if hasattr(law, member):
                setattr(self, member, partial(self._values, member))

    def initial_state(self, n: int, dim: int) -> FrictionState:
        """As the law's; a state without history where it fails."""
        state = self._call(
            lambda: self.law.initial_state(n, dim), lambda answer: state_problem(answer, n, dim)
        )
        return FrictionState.zeros(n, dim) if state is None else state

    def update(
        self,
        slip_increment: Floats,
        dt: float,
        pressure: Floats,
        film: Floats,
        state: FrictionState,
        **options: Any,
    ) -> FrictionResponse:
        """As the law's; no numbers where it fails."""
        n, dim = slip_increment.shape
        self.not_finite = None
        response: FrictionResponse | None = self._call(
            lambda: self.law.update(slip_increment, dt, pressure, film, state, **options),
            lambda answer: response_problem(answer, n, dim),
        )
        if response is None:
            return _no_response(state, n, dim)
        # Newton may ask at places that are no numbers, and then the law is not to blame.
        if all(np.isfinite(asked).all() for asked in (slip_increment, pressure, film)):
            self.not_finite = self._not_finite(response, slip_increment, dt, pressure, film)
        return response

    def stored_energy(self, state: FrictionState) -> Floats:
        """As the law's; zeros where it fails."""
        return self._values("stored_energy", state)

    def coefficient(self, state: FrictionState) -> Floats:
        """As the law's; zeros where it fails."""
        return self._values("coefficient", state)

    def try_state(self, state: FrictionState, pressure: Floats) -> None:
        """Ask for all that depends on a state, before the step that led to it is accepted."""
        self.stored_energy(state)
        self.coefficient(state)
        for member in ("unsettled", "presliding_length"):
            if hasattr(self, member):
                getattr(self, member)(state, pressure)

    # -- what goes wrong ----------------------------------------------------------------------

    def _call(
        self, action: Callable[[], Any], problem_of: Callable[[Any], str | None] = lambda _: None
    ) -> Any:
        """What the law answers; None, with a note, where it fails or has failed before."""
        if self.fault is not None:
            return None
        try:
            answer = action()
            wrong = "answers with None" if answer is None else problem_of(answer)
        # Whatever the law does. sys.exit would end this rank alone.
        except (Exception, SystemExit) as error:
            wrong = user_line(error, self.file)
        with suppress(OSError):  # where it has been deleted there is nothing to go back to
            if os.getcwd() != self._directory:
                os.chdir(self._directory)
        if wrong is None:
            return answer
        self.fault = f"the friction law {self.name} fails: {wrong}"
        return None

    def _values(self, member: str, state: FrictionState, *more: Floats) -> Floats:
        """What a method answers for each point, (q,)."""
        n = len(state.slip_path)

        def problem_of(answer: Any) -> str | None:
            if np.shape(answer) != (n,):
                return f"{member} has shape {np.shape(answer)} for {n} points, expected ({n},)"
            bad = ~np.isfinite(answer)
            return f"{member} is not finite at {bad.sum()} of {n} points" if bad.any() else None

        found = self._call(lambda: getattr(self.law, member)(state, *more), problem_of)
        return np.zeros(n) if found is None else np.asarray(found, dtype=np.float64)

    def _not_finite(
        self, response: FrictionResponse, slip: Floats, dt: float, pressure: Floats, film: Floats
    ) -> str | None:
        """The first part of an answer that is not finite, and what was asked there."""
        for part in ARRAYS:
            values = np.asarray(getattr(response, part))
            bad = ~np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
            if bad.any():
                q = int(np.argmax(bad))
                asked = ", ".join(f"{c:.3g}" for c in slip[q])
                return (
                    f"the friction law {self.name} answers with numbers that are not finite: "
                    f"{part} at {int(bad.sum())} of {len(bad)} points, the first at slip_increment "
                    f"({asked}) m, dt {dt:.3g} s, pressure {pressure[q]:.3g} Pa, film "
                    f"{film[q]:.3g} m"
                )
        return None


def user_line(error: BaseException, file: str) -> str:
    """An exception as one line, with the last line of the user's file that led to it."""
    if isinstance(error, SyntaxError):
        return f"{error.filename}:{error.lineno}: {type(error).__name__}: {error.msg}"
    text = " ".join(str(error).split())
    what = f"{type(error).__name__}: {text}" if text else type(error).__name__
    places = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
    return f"{file}:{places[-1].lineno}: {what}" if places else what


def state_problem(state: object, n: int, dim: int) -> str | None:
    """What is wrong with a state of n points in dim dimensions; None if nothing."""
    for field in fields(FrictionState):
        if not hasattr(state, field.name):
            return f"the state is {type(state).__name__}, which has no {field.name}"
        expected = (n, dim) if field.name == "elastic_slip" else (n,)
        found = np.shape(getattr(state, field.name))
        if found != expected:
            return f"{field.name} of the state has shape {found} {_expected(n, dim, expected)}"
    return None


def response_problem(response: Any, n: int, dim: int) -> str | None:
    """What is wrong with the answer to a step of n points in dim dimensions; None if nothing."""
    shapes = {part: (n, *(dim,) * axes) for part, axes in ARRAYS.items()} | {"regime": (n,)}
    for part in (*shapes, "state", "dissipation"):
        if not hasattr(response, part):
            return f"update answers with {type(response).__name__}, which has no {part}"
    for part, expected in shapes.items():
        found = np.shape(getattr(response, part))
        if found != expected:
            return f"{part} has shape {found} {_expected(n, dim, expected)}"
    dissipation, state = response.dissipation, response.state
    for field in fields(Dissipation):
        found = np.shape(getattr(dissipation, field.name, "none"))
        if found != (n,):
            return f"dissipation.{field.name} has shape {found} {_expected(n, dim, (n,))}"
    return state_problem(state, n, dim)


def _expected(n: int, dim: int, shape: tuple[int, ...]) -> str:
    return f"for {n} points in {dim}D, expected {shape}"


def _no_response(state: FrictionState, n: int, dim: int) -> FrictionResponse:
    """An answer that is no number."""
    parts: dict[str, Any] = {a: np.full((n, *(dim,) * k), np.nan) for a, k in ARRAYS.items()}
    none = Dissipation(**{field.name: np.zeros(n) for field in fields(Dissipation)})
    return FrictionResponse(
        **parts, state=state, regime=np.zeros(n, dtype=np.int8), dissipation=none
    )
