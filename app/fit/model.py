"""What a fit varies: coordinates of the search, and the friction they give.

Rows with a slip are one step of the law from rest: for a path in one direction at constant speed
backward Euler is exact, whatever its length. Rows without are steady sliding, where the
coefficient of friction of the friction map has come down to mu_d (where B > 0).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as t_distribution

from tribox.app.errors import InputError
from tribox.app.fit.data import Floats, TribometerData
from tribox.forms.closed_forms import presliding_length
from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters
from tribox.forms.friction.film import at_rest
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import FrictionLaw
from tribox.forms.friction.parameters import FrictionMapParameters
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters

INSENSITIVE = 1e-4
"""Change of what is computed, relative, per change of the parameter's logarithm, below which there
is none."""
ALIKE = 3e-3  # share of a parameter's effect that no other can have, below which they are one
CONFIDENCE = 0.95
BROAD = math.log(10.0)
"""Half-width of an interval, in logarithms, from which on the parameter is not determined."""
AT_BOUND = "the search ended at its bound"
NOISE = 1e-3  # scatter that is assumed at least when asking whether data determine a parameter


class Searched:
    """A parameter that is searched by its logarithm, or if bounded by that of a/(1 - a)."""

    __slots__ = ()
    name: str

    @property
    def bounded(self) -> bool:
        """Whether it is a share between 0 and 1."""
        return False

    @property
    def unit(self) -> str:
        """SI, "" of a plain number."""
        return ""

    def to_search(self, value: float) -> float:
        """Logarithm, or that of a/(1 - a)."""
        return math.log(value / (1.0 - value)) if self.bounded else math.log(value)

    def to_value(self, x: float) -> float:
        """Reverts ``to_search``."""
        return 1.0 / (1.0 + math.exp(-x)) if self.bounded else math.exp(x)


class Slopes:
    """Slopes of what was computed at a minimum, and what follows from them, by ``names``.

    ``slopes``: (n, c), of the weighted residual for the logarithm of a parameter, or of a/(1 - a);
    ``own``: (c,), length of the part that others cannot make up.
    """

    def __init__(
        self,
        coordinates: Sequence[Searched],
        slopes: Floats,
        squares: float,
        cure: Callable[[str], str],
        of: str,
    ) -> None:
        """Take the slopes (n, c) at a minimum, by coordinates, with the sum of ``squares`` there.

        ``cure``: what to do about a parameter that is not determined; ``of``: what was computed.
        """
        self.names = tuple(c.name for c in coordinates)
        self.slopes, self._squares = slopes, squares
        self._cure, self._of = cure, of
        self._bounded = {c.name for c in coordinates if c.bounded}
        self._partners = [self._others(i) for i in range(len(self.names))]
        self.own = np.array([own for own, _ in self._partners])

    def _others(self, i: int) -> tuple[float, int | None]:
        """Length of column i beyond what the others make up, and the column most like it."""
        column = self.slopes[:, i]
        others = np.delete(self.slopes, i, axis=1)
        lengths = np.linalg.norm(others, axis=0)
        if not lengths.any():
            return float(np.linalg.norm(column)), None
        unit = others / np.where(lengths > 0.0, lengths, 1.0)
        # What is orthogonal to all others is its own: `half_width` is the scatter over that.
        share, *_ = np.linalg.lstsq(unit, column, rcond=1e-10)
        most = int(np.argmax(np.abs(share)))
        return float(np.linalg.norm(column - unit @ share)), most + (most >= i)

    def half_width(self, name: str, scatter: float, degrees: int) -> float:
        """Half of the confidence interval in logarithms; infinite without any slope."""
        own = float(self.own[self.names.index(name)])
        quantile = float(t_distribution.ppf(0.5 + 0.5 * CONFIDENCE, degrees))
        return quantile * scatter / own if own > 0.0 else math.inf

    def warning(self, name: str, scatter: float, degrees: int) -> str | None:
        """Why the data do not determine a parameter; None if they do."""
        i, cure = self.names.index(name), self._cure(name)
        rows = math.sqrt(len(self.slopes))
        length, own = float(np.linalg.norm(self.slopes[:, i])), float(self.own[i])
        if length < INSENSITIVE * rows:
            return undetermined(name, f"{self._of} hardly depends on it", cure)
        partner = self._partners[i][1]
        if own < ALIKE * length and partner is not None:
            reason = f"a change of {self.names[partner]} has the same effect"
            return undetermined(name, reason, cure)
        return self.broad(name, scatter, degrees)

    def broad(self, name: str, scatter: float, degrees: int) -> str | None:
        """That the interval of a parameter is too wide; None if it is not."""
        half = self.half_width(name, max(scatter, NOISE), degrees)
        if half > BROAD:
            key = name.partition(" ")[0]
            of = f" of {key}/(1 - {key})" if name in self._bounded else ""
            reason = f"the interval{of} spans a factor of {factor_of(half)} either way"
            return undetermined(name, reason, self._cure(name))
        return None

    def open_names(self, degrees: int) -> set[str]:
        """Coordinates that the data do not determine at this minimum."""
        scatter = math.sqrt(self._squares / degrees)
        return {name for name in self.names if self.warning(name, scatter, degrees)}

    def singular_values(self) -> tuple[float, ...]:
        """Of the slopes with columns of unit length, relative to the largest."""
        if not self.names:
            return ()
        lengths = np.linalg.norm(self.slopes, axis=0)
        values = np.linalg.svd(self.slopes / np.where(lengths > 0.0, lengths, 1.0))[1]
        return tuple(float(v) for v in values / values[0]) if values[0] > 0.0 else ()

    def correlation(self) -> Floats:
        """(c, c), of the estimates; of the pseudo-inverse where it does not exist."""
        # Covariance of the estimates, but for the scatter, of the linearised problem: (JᵀJ)⁻¹.
        covariance = np.linalg.pinv(self.slopes.T @ self.slopes, hermitian=True)
        scale = np.sqrt(np.diag(covariance))
        scale = np.where(scale > 0.0, scale, 1.0)
        return np.asarray(covariance / np.outer(scale, scale))


def undetermined(name: str, reason: str, cure: str) -> str:
    """Why the data do not determine a parameter, and what to do about it."""
    return f"{name}: the data cannot determine it: {reason}; {cure}"


def factor_of(half: float) -> str:
    """Half-width of an interval in logarithms as a factor, in words."""
    return f"{math.exp(half):.2g}" if half < 50.0 else "more than 1e20"


def interval(coordinate: Searched, value: float, half: float) -> tuple[float | None, float | None]:
    """Ends of a confidence interval of half-width ``half`` in logarithms; None: open."""
    if half > 50.0:
        return None, None
    at = coordinate.to_search(value)
    return coordinate.to_value(at - half), coordinate.to_value(at + half)


# -- The search for the parameters of a material, whatever its law ---------------------------------

EXACT = 1e-4
"""Relative scatter below which data count as exact when numbers of branches are compared."""


@dataclass(frozen=True, slots=True)
class MaterialParameter(Searched):
    """A parameter of a material."""

    name: str  # such as "G" or "tau 2"
    unit: str = ""  # SI, "" of a plain number
    bounded: bool = False  # whether it is a share between 0 and 1


class _Problem(Protocol):
    """What any material is fitted to."""

    @property
    def measured(self) -> Floats: ...

    def residual(self, x: Floats) -> Floats: ...

    def jacobian(self, x: Floats) -> Floats: ...


Problem = TypeVar("Problem", bound=_Problem)


@dataclass(frozen=True, slots=True)
class MaterialFit(Generic[Problem]):
    """A material that was found."""

    problem: Problem  # what it was fitted to
    x: Floats  # (c,), search coordinates
    at_bound: NDArray[np.bool_]  # (c,), whether the search ended at a bound

    @property
    def squares(self) -> float:
        """Sum of the squares of the residual."""
        residual = self.problem.residual(self.x)
        return float(residual @ residual)

    @property
    def degrees(self) -> int:
        """Values less parameters."""
        return len(self.problem.measured) - len(self.x)

    @property
    def criterion(self) -> float:
        """Bayesian information criterion; that of the best material is least."""
        return information(self.squares, len(self.problem.measured), len(self.x))


def information(squares: float, values: int, parameters: int) -> float:
    """Bayesian information criterion, n ln(squares/n) + c ln n; data may count as exact."""
    variance = max(squares / values, EXACT**2)
    return values * math.log(variance) + parameters * math.log(values)


def best_minimum(
    problem: _Problem, begun: Iterable[Floats], bounds: tuple[Floats, Floats], tol: float, most: int
) -> tuple[Floats, NDArray[np.bool_]]:
    """Search coordinates of the least squares from some starts, and which end at a bound."""
    low, high = bounds
    found = [
        least_squares(
            problem.residual, np.clip(x, low + 1e-6, high - 1e-6), jac=problem.jacobian,
            bounds=bounds, x_scale="jac", xtol=1e-10, ftol=tol, gtol=tol, max_nfev=most,
        )
        for x in begun
    ]  # fmt: skip
    x = min(found, key=lambda one: one.cost).x.copy()
    return x, np.minimum(x - low, high - x) < 1e-6


# -- Coordinates of the search, and the friction that a law gives for the data ---------------------

Parameters = FrictionMapParameters | StribeckParameters | CoulombParameters

RIGID = 1e18
"""Pa/m, K_T of Stribeck and Coulomb friction where it is neither fitted nor fixed: the case then
takes one of its mesh, and rows with a slip count as sliding."""


@dataclass(frozen=True, slots=True)
class Range:
    """Where a parameter is searched, SI: lowest, highest and usual value; its unit."""

    unit: str
    lowest: float
    highest: float
    start: float


RANGES: dict[str, Range] = {
    "mu_s": Range("", 1e-6, 10.0, 0.15),
    "mu_d": Range("", 1e-6, 10.0, 0.1),
    "A_d": Range("m", 1e-10, 1.0, 1e-6),
    "B": Range("1/m", 1e-1, 1e12, 1e6),
    "K_T": Range("Pa/m", 1e6, 1e18, 1e12),
    "eta_b": Range("Pa*s", 1e-7, 1e5, 0.1),
    "alpha": Range("", 1e-8, 1.0 - 1e-8, 0.5),
    "beta": Range("", 1e-8, 1e3, 1.0),
    "V_star": Range("m/s", 1e-15, 1e3, 1e-3),
    "gamma": Range("N/s", 1e-45, 1e20, 1e-10),
    "mu": Range("", 1e-6, 10.0, 0.15),
    "V_s": Range("m/s", 1e-15, 1e3, 1e-3),
    "delta": Range("", 0.05, 20.0, 1.0),
    "viscous": Range("Pa*s/m", 1e-6, 1e15, 1e3),
}
LAWS: dict[str, tuple[str, ...]] = {
    "friction-map": (
        *("mu_s", "mu_d", "A_d", "B", "K_T", "eta_b", "alpha", "beta", "V_star", "gamma"),
    ),
    "stribeck": ("mu_s", "mu_d", "V_s", "delta", "viscous", "K_T"),
    "coulomb": ("mu", "K_T"),
}
"""What can be fitted of each law."""


@dataclass(frozen=True, slots=True)
class Coordinate(Searched):
    """One direction of the search."""

    name: str  # of the parameter, such as "mu_s" or "alpha at 10 nm"
    key: str  # of the parameters
    film: float | None = None  # m, for alpha: the film thickness that it belongs to; None: all

    @property
    def bounded(self) -> bool:
        """Whether it is a share between 0 and 1."""
        return self.key == "alpha"

    @property
    def unit(self) -> str:
        """Of the parameter, SI."""
        return RANGES[self.key].unit

    @property
    def limits(self) -> tuple[float, float]:
        """Bounds of the search."""
        limits = RANGES[self.key]
        return self.to_search(limits.lowest), self.to_search(limits.highest)


def coordinates(names: Sequence[str], data: TribometerData, base: Parameters) -> tuple[
    Coordinate, ...
]:  # fmt: skip
    """Coordinates of the parameters, alpha's one for each film; InputError if there is none."""
    found: list[Coordinate] = []
    for name in names:
        if name != "alpha":
            found.append(Coordinate(name, name))
            continue
        assert isinstance(base, FrictionMapParameters)
        inside = (data.thickness > base.D_min) & (data.thickness < base.D_max)
        films = sorted({float(D) for D in data.thickness[inside]})
        if not films:
            raise InputError("alpha: no row has a film between D_min and D_max to fit it to")
        if len(films) > 10:
            raise InputError(
                f"alpha: the data have {len(films)} film thicknesses, and alpha is fitted to each; "
                "fit beta instead"
            )
        several = len(films) > 1
        found += [
            Coordinate(f"alpha at {D * 1e9:g} nm" if several else "alpha", "alpha", D)
            for D in films
        ]
    return tuple(found)


def with_values(
    base: Parameters, coordinates: Sequence[Coordinate], values: Sequence[float]
) -> Parameters:
    """The parameters with the values of some coordinates, SI."""
    changes: dict[str, Any] = {}
    table: list[tuple[float, float]] = []
    for coordinate, value in zip(coordinates, values, strict=True):
        if coordinate.key == "alpha":
            assert coordinate.film is not None
            table.append((coordinate.film, value))
        else:
            changes[coordinate.key] = value
    if table:
        changes["alpha"] = tuple(table) if len(table) > 1 else table[0][1]
    return dataclasses.replace(base, **changes)


def friction(parameters: Parameters, data: TribometerData) -> Floats:
    """Traction of every row, (n,), Pa."""
    if isinstance(parameters, StribeckParameters | CoulombParameters):
        # Traction of every row under a law that asks for no film, (n,), Pa
        law: FrictionLaw
        if isinstance(parameters, CoulombParameters):
            law, most = CoulombLaw(parameters), parameters.mu
        else:
            law, most = StribeckLaw(parameters), parameters.mu_s
        sliding = 10.0 * most * data.pressure / parameters.K_T
        return _one_step(law, data, np.where(data.steady, sliding, data.slip))
    # Neither a memory of alpha nor a lag in it has a part in sliding at one speed.
    parameters = dataclasses.replace(parameters, switch="implicit", reentry="literal")
    out = np.empty(len(data))
    steady = data.steady
    if steady.any():
        mu = parameters.mu_s if parameters.B == 0.0 else parameters.mu_dynamic
        steady_law = dataclasses.replace(parameters, mu_s=mu, mu_d=mu, B=0.0)
        rows = _rows(data, steady)
        lengths = presliding_length(
            rows.pressure,
            steady_law.mu_s,
            1.0 - at_rest(steady_law, rows.thickness).solid,
            steady_law,
        )
        # Far beyond the elastic slip: steady, whatever it began with.
        slip = np.where(np.isfinite(lengths), 10.0 * lengths, 1.0)
        out[steady] = _one_step(FrictionMap(steady_law), rows, slip)
    if not steady.all():
        rows = _rows(data, ~steady)
        out[~steady] = _one_step(FrictionMap(parameters), rows, rows.slip)
    return out


def _rows(data: TribometerData, rows: NDArray[np.bool_]) -> TribometerData:
    picked: Mapping[str, Any] = {
        field.name: getattr(data, field.name)[rows]
        for field in dataclasses.fields(data)
        if isinstance(getattr(data, field.name), np.ndarray)
    }
    return dataclasses.replace(data, **picked)


def _one_step(law: FrictionLaw, data: TribometerData, slip: Floats) -> Floats:
    """Traction after a slip from rest, at the speed of each row, (n,), Pa."""
    state = law.initial_state(len(data), 1)
    # One time step for all rows, short against the time that each has slid; the slip before it
    # is put into the state as elastic slip, which the step then releases as it would have been.
    dt = 1e-3 * float(np.min(slip / data.velocity))
    step = data.velocity * dt
    state.elastic_slip = (slip - step)[:, None]
    state.closed = np.ones(len(data), dtype=np.bool_)
    response = law.update(step[:, None], dt, data.pressure, data.thickness, state)
    return np.asarray(response.traction[:, 0], dtype=np.float64)


# -- What a search for the parameters of the law finds, and what a fit gives -----------------------

Which = TypeVar("Which", bound=Searched)


@dataclass(frozen=True, slots=True)
class Estimate(Generic[Which]):
    """One parameter of the fit."""

    coordinate: Which
    value: float  # SI
    low: float | None  # lower end of the confidence interval, SI; None: open
    high: float | None  # upper end
    warning: str | None  # why the data do not determine it, if they do not


def stated(
    estimates: Sequence[Estimate[Any]], slopes: Slopes, scatter: float, degrees: int
) -> dict[str, Any]:
    """What ``fit.json`` holds of any fit."""
    return {
        "parameters": {
            e.coordinate.name: {
                "value": e.value,
                "low": e.low,
                "high": e.high,
                "unit": e.coordinate.unit,
                "determined": e.warning is None,
            }
            for e in estimates
        },
        "confidence": CONFIDENCE,
        "scatter": scatter,
        "degrees_of_freedom": degrees,
        "warnings": [e.warning for e in estimates if e.warning],
        "singular_values": list(slopes.singular_values()),
        "correlation": {"names": list(slopes.names), "matrix": slopes.correlation().tolist()},
    }


@dataclass(frozen=True, slots=True)
class FitResult:
    """What a fit found."""

    parameters: Parameters  # the calibrated law
    estimates: tuple[Estimate[Coordinate], ...]  # one for each coordinate
    traction: Floats  # (n,), Pa, of the law, for the rows of the data
    scatter: float  # standard deviation of the logarithm of the friction
    degrees: int  # rows less parameters
    slopes: Slopes  # of the coordinates that have one

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the data do not determine, a line each."""
        return tuple(e.warning for e in self.estimates if e.warning)

    @property
    def correlated(self) -> tuple[str, ...]:
        """Names of the coordinates that have a slope."""
        return tuple(self.slopes.names)

    @property
    def correlation(self) -> Floats:
        """(c, c), of the coordinates ``correlated``."""
        return self.slopes.correlation()


@dataclass(frozen=True, slots=True)
class Found:
    """A minimum."""

    x: Floats  # (c,), search coordinates
    residual: Floats  # (n,), weighted
    jacobian: Floats  # (n, c), or (n, c - 1) where V* was held
    at_bound: NDArray[np.bool_]  # (c,), whether the search ended at a bound
    free: bool  # whether V* was varied; else it was held

    @property
    def squares(self) -> float:
        """Sum of the squares of the residual."""
        return float(self.residual @ self.residual)
