"""What a verification case finds: numbers beside closed forms, and curves to draw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Check:
    """One number compared with a closed form (or another code's result)."""

    quantity: str  # what it is, in a few words
    error: float  # relative (or normalised, as ``quantity`` says), >= 0
    bar: float  # largest error allowed
    # the number, in ``unit``; None where only a deviation is measured
    computed: float | None = None
    exact: float | None = None  # what it is compared with; None likewise
    unit: str = ""  # of both

    @property
    def passed(self) -> bool:
        """Whether the error is a number and within the bar."""
        return bool(self.error <= self.bar)


SHOWN = {
    "": 1.0,
    "N": 1.0,
    "N/m": 1.0,
    "Pa s": 1.0,
    "µm": 1e6,
    "mm": 1e3,
    "kPa": 1e-3,
    "MPa": 1e-6,
    "mN": 1e3,
    "nJ": 1e9,
    "N µm": 1e6,
}
"""Units that numbers are shown in, over that of SI."""


def compare(quantity: str, computed: float, exact: float, bar: float, unit: str = "") -> Check:
    """A check of one number by its relative error; both are in SI, and shown in ``unit``."""
    error, scale = abs(computed / exact - 1.0) if exact != 0.0 else math.inf, SHOWN[unit]
    return Check(quantity, error, bar, scale * computed, scale * exact, unit)


def apart(computed: Floats, exact: Floats | float) -> float:
    """Largest difference of values, each over the closed form's."""
    return float(np.abs(computed / exact - 1.0).max())


@dataclass(frozen=True, slots=True)
class Line:
    """One curve of a figure."""

    label: str  # for the legend
    x: NDArray[np.floating[Any]]  # (n,), in the units of the axes
    y: NDArray[np.floating[Any]]  # likewise
    exact: bool = False  # a closed form, drawn as a line; computed values are drawn as points


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes with its curves."""

    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    log: bool = False


@dataclass(frozen=True, slots=True)
class Verification:
    """The outcome of one verification case."""

    name: str  # as on the command line
    title: str  # what is verified, in one line
    setup: str  # mesh, load and norms, a few sentences of Markdown
    checks: tuple[Check, ...]  # the numbers
    panels: tuple[Panel, ...] = ()  # the figure
    failure: str = ""  # why it could not be computed; empty if it could

    @property
    def passed(self) -> bool:
        """Whether it was computed and every check is within its bar."""
        return not self.failure and all(check.passed for check in self.checks)


# -- Runs the case files that verification is based on ---------------------------------------------

CASES = Path(__file__).parents[2] / "cases"


def solve(
    name: str | Path, overrides: Sequence[str] = (), observer: Observer | None = None
) -> tuple[Case, Simulation]:
    """Run a case file in this process, without results.

    ``name``: of a file in ``cases``, without its ending, or a path; ``overrides``: "key=value"
    texts.

    Returns:
        The case (without its sweep) and the finished simulation.

    Raises:
        InputError: the file or an override is wrong.
        SolutionError: a step could not be solved.
    """
    path = name if isinstance(name, Path) else CASES / f"{name}.toml"
    case = load_case(path, overrides)
    simulation = Simulation(build_model(case, MPI.COMM_SELF))
    simulation.run(observer or Observer())
    return case, simulation
