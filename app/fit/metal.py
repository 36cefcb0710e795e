r"""Isotropic and kinematic hardening of a metal from tension and compression, or cycles.

Uniaxial, in logarithmic strain and true stress, from the virgin state: :math:`\sigma = E
(\varepsilon - \varepsilon_p)`, yield at :math:`|\sigma - X| = \sigma_Y(\alpha)` with the laws of
:mod:`tribox.forms.bodies.hardening`, and back stresses :math:`X = \sum X_k` after Armstrong and
Frederick, :math:`\dot X_k = c_k \dot\varepsilon_p - b_k X_k \dot\alpha` (in tensors
:math:`\dot X = 2/3\, c\, \dot\varepsilon_p - b X \dot\alpha`). On a path in one direction s

.. math:: X_k(\alpha) = s c_k/b_k + (X_k^0 - s c_k/b_k) e^{-b_k (\alpha - \alpha_0)}

is exact, so all rows between two turns of the strain are solved at once, each by Newton's method
for its plastic strain: the equation falls and is convex, so that it cannot fail from the elastic
side.
Stresses are compared over their root mean square.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tribox.app.errors import InputError
from tribox.app.fit.data import Floats
from tribox.app.fit.material_data import MaterialData
from tribox.app.fit.model import MaterialFit, MaterialParameter, Slopes, best_minimum
from tribox.forms.bodies.hardening import Hardening, Linear, Swift, Voce

Bools = NDArray[np.bool_]

LAWS: dict[str, dict[str, str]] = {
    "linear": {"yield_stress": "Pa", "modulus": "Pa"},
    "voce": {"yield_stress": "Pa", "saturation_stress": "Pa", "exponent": ""},
    "swift": {"K": "Pa", "strain0": "", "n": ""},
}
"""What is fitted of each law of isotropic hardening, with units."""
LIMITS = {
    "E": (1e6, 1e13),
    "yield_stress": (1e3, 1e12),
    "modulus": (1e2, 1e12),
    "saturation_stress": (1e2, 1e12),
    "exponent": (1e-2, 1e5),
    "K": (1e3, 1e13),
    "strain0": (1e-8, 1.0),
    "n": (1e-4, 1.0),
    "c": (1e4, 1e14),
    "b": (1e-2, 1e6),
}
"""Within which parameters are searched, SI; of saturation_stress what it is above yield_stress."""
MOST_BRANCHES = 3
MOST_GIVEN = 6  # branches that are tried, and that may be asked for
FLOWED = 1e-6  # plastic strain from which on a path counts as one that flows
NEXT = 4  # distances of rows before and after a turn that tell where it lies between two of them
EVEN = 0.2  # share of their mean that these may differ by
AT_ROW = 0.95  # share of the distance of the rows from which on a turn is at one


@dataclass(frozen=True, slots=True)
class Metal:
    """A metal, SI."""

    E: float  # Pa
    hardening: Hardening  # yield stress over the plastic strain
    kinematic: tuple[tuple[float, float], ...] = ()  # rows (c, b) of the back stresses, Pa and 1


def paths(strain: Floats) -> list[slice]:
    """Rows between turns of the strain; it begins at 0."""
    turn = np.sign(np.diff(strain, prepend=0.0))
    # A row at the strain of the one before belongs to the path that it is on; one at 0, with which
    # files begin, to the first.
    turn[: np.argmax(turn != 0.0)] = turn[np.argmax(turn != 0.0)]
    for row in range(1, len(turn)):
        if turn[row] == 0.0:
            turn[row] = turn[row - 1]
    edges = np.flatnonzero(np.diff(turn)) + 1
    ends = [0, *(int(edge) for edge in edges), len(strain)]
    return [slice(first, last) for first, last in itertools.pairwise(ends)]


def with_turns(strain: Floats) -> tuple[Floats, Bools, list[float]]:
    """Strains (r,) with the turns between rows, which of them are rows, and turns not found.

    A machine is read out at equal times, and need not be where the strain turns. If rows keep their
    distances d and d' before and after a turn, it lies as far beyond the row i before it, and the
    row j after it, as they are covered in one such time:

        s (ε - ε_i)/d + s (ε - ε_j)/d' = 1.

    Args:
        strain: (n,) of the rows.
    """
    found: Floats = strain
    rows: Bools = np.ones(len(strain), dtype=bool)
    unknown: list[float] = []
    apart = np.abs(np.diff(strain))
    for path, then in reversed(list(itertools.pairwise(paths(strain)))):
        # The farthest row is that before the turn, or that after it. Rows about a turn are nearer
        # to each other than to the next ones on their side; on the other the rate may differ.
        i = path.stop - 1
        sides = [(i - 1, i - 2)] * (i - 2 >= path.start) + [(i, i + 1)] * (i + 2 < then.stop)
        short = {row: apart[row] / (apart[beside] or np.inf) for row, beside in sides}
        i = min(short, key=lambda row: float(short[row]), default=i)
        before, after = apart[path.start : i][-NEXT:], apart[i + 1 : then.stop - 1][:NEXT]
        dwells = not (before.all() and after.all())
        if dwells or not (before.size and after.size) or short[i] >= AT_ROW:
            continue
        if any(np.ptp(one) > EVEN * one.mean() for one in (before, after)):
            unknown.append(float(strain[path.stop - 1]))
            continue
        s, d, e = np.sign(strain[i] - strain[i - 1]), before.mean(), after.mean()
        at = (s + strain[i] / d + strain[i + 1] / e) / (1.0 / d + 1.0 / e)
        found, rows = np.insert(found, i + 1, at), np.insert(rows, i + 1, False)
    return found, rows, unknown[::-1]


def response(metal: Metal, strain: Floats, along: Sequence[slice]) -> tuple[Floats, Floats]:
    """True stress, Pa, and plastic strain (n,) along log strains (n,) and their :func:`paths`."""
    stress, alphas = np.empty(len(strain)), np.empty(len(strain))
    rows = np.array(metal.kinematic, dtype=np.float64).reshape(-1, 2)
    c, b = rows[:, :1], rows[:, 1:]
    X, alpha, plastic, before = np.zeros_like(c), 0.0, 0.0, 0.0
    for path in along:
        e = strain[path]
        s = float(np.sign(e[-1] - before))
        trial = s * metal.E * (e - plastic)
        limit = s * c / b
        more = _plastic_strain(metal, trial, s * limit, s * (X - limit), b, alpha)
        stress[path] = metal.E * (e - plastic - s * more)
        alphas[path] = alpha + more
        # Along one path dX = (s c − b X) dx, an exponential towards s c/b.
        X = limit + (X - limit) * np.exp(-b * more[-1])
        alpha, plastic, before = (
            alpha + float(more[-1]),
            plastic + s * float(more[-1]),
            float(e[-1]),
        )
    return stress, alphas


def _plastic_strain(
    metal: Metal, trial: Floats, limit: Floats, above: Floats, b: Floats, alpha: float
) -> Floats:
    """How far each row of one path has flowed on it, (r,), from 0 on.

    Root of trial - E x - Σ (limit + above e^(-b x)) - σ_Y(α + x), all along the path.
    """
    x = np.zeros_like(trial)
    most = 1e-13 * metal.E
    for _ in range(200):
        fading = above * np.exp(-b * x)
        over = trial - metal.E * x - (limit + fading).sum(0) - metal.hardening.stress(alpha + x)
        slope = metal.E - (b * fading).sum(0) + metal.hardening.slope(alpha + x)
        step = over / slope
        x = np.maximum(x + step, 0.0)
        # Rows below yield stay at 0.
        if np.all((np.abs(over) <= most) | (x == 0.0)):
            break
    return x


class MetalProblem:
    """What is fitted to one data set: a ``law`` of ``LAWS`` with ``branches`` of back stresses.

    ``fixed``: what is not, SI, by key; ``keys``: what is: E, those of the law, c and b of each
    branch. ``strain``: (r,), logarithmic, with turns between rows; ``rows``: (r,), which are;
    ``along``: its paths between turns; ``unknown``: strains of turns that may lie anywhere between
    rows; ``measured``: (n,), Pa, true stress.
    """

    def __init__(
        self, data: MaterialData, law: str, branches: int, fixed: Mapping[str, float]
    ) -> None:
        assert data.strain is not None and data.stress is not None
        self.law, self.branches, self.fixed = law, branches, dict(fixed)
        self.strain, self.rows, self.unknown = with_turns(data.strain)
        self.measured, self.along = data.stress, paths(self.strain)
        self._root = np.sqrt(data.weight)
        self.scale = float(np.sqrt(np.mean(data.stress**2)))
        isotropic = [key for key in ("E", *LAWS[law]) if key not in fixed]
        ends = [f"{key} {k}" for k in range(1, branches + 1) for key in ("c", "b")]
        self.keys = (*isotropic, *ends)
        if len(data) <= len(self.keys):
            raise InputError(
                f"too few data: to fit {', '.join(self.keys)}, at least {len(self.keys) + 1} rows "
                f"are needed, found {len(data)}"
            )

    # -- search coordinates: logarithms; of saturation_stress that of what is above yield_stress ---

    def values(self, x: Floats) -> dict[str, float]:
        """Parameters at search coordinates, SI, with what is fixed."""
        found = self.fixed | {key: math.exp(u) for key, u in zip(self.keys, x, strict=True)}
        if self.law == "voce" and "saturation_stress" in self.keys:
            found["saturation_stress"] += found["yield_stress"]
        return found

    def metal(self, x: Floats) -> Metal:
        """The metal at search coordinates."""
        found = self.values(x)
        hardening: Hardening
        if self.law == "linear":
            hardening = Linear(found["yield_stress"], found["modulus"])
        elif self.law == "voce":
            highest = max(found["saturation_stress"], found["yield_stress"])
            start, rise = found["yield_stress"], found.get("modulus", 0.0)
            hardening = Voce(start, highest, found["exponent"], rise)
        else:
            hardening = Swift(found["K"], found["strain0"], min(found["n"], 1.0))
        rows = [(found[f"c {k}"], found[f"b {k}"]) for k in range(1, self.branches + 1)]
        return Metal(found["E"], hardening, tuple(rows))

    def residual(self, x: Floats) -> Floats:
        """Weighted differences of the stress, (n,), over its root mean square."""
        stress, _ = response(self.metal(x), self.strain, self.along)
        return np.asarray(self._root * (stress[self.rows] - self.measured) / self.scale)

    def jacobian(self, x: Floats) -> Floats:
        """(n, c), of the residual, by central differences."""
        columns = []
        for i in range(len(x)):
            step = np.zeros(len(x))
            step[i] = 1e-5
            columns.append((self.residual(x + step) - self.residual(x - step)) / 2e-5)
        return np.array(columns).T

    def bounds(self) -> tuple[Floats, Floats]:
        """Of the search."""
        rows = [LIMITS[key.partition(" ")[0]] for key in self.keys]
        low, high = np.log(rows).T
        return low, high

    # -- starts ------------------------------------------------------------------------------------

    def starts(self, fewer: Mapping[str, float] | None) -> Iterator[Floats]:
        """Search coordinates to start from; ``fewer``: what was found with a branch less."""
        # E, the highest stress, and the stress at which the line of E is left, Pa.
        top = float(np.abs(self.measured).max())
        e = np.abs(self.strain[self.along[0]][self.rows[self.along[0]]])
        s = np.abs(self.measured[: len(e)])
        slope = np.where(e > 0.0, s / np.where(e > 0.0, e, 1.0), 0.0)
        E = self.fixed.get("E", float(np.max(slope)))
        # The highest stress that lies on the line of E yet: where it yields, about.
        near = s[s > 0.9 * E * e]
        first = float(near.max()) if near.size else 0.3 * top
        first = min(max(first, 0.05 * top), 0.95 * top)
        wide = self._width
        for share, at in itertools.product((0.3, 0.7), (3.0, 30.0, 300.0)):
            c_over_b = share * top * 0.5
            table = {"E": E, **self._isotropic(top, first if self.branches == 0 else 0.8 * first)}
            for k in range(1, self.branches + 1):
                # A decade apart, so that no two branches begin as one.
                b = at / wide * 10.0 ** (self.branches - k)
                table |= {f"c {k}": c_over_b * b / self.branches, f"b {k}": b}
            if fewer is not None:
                table |= fewer
            yield np.array([math.log(table[key]) for key in self.keys])
            if self.branches == 0:
                return

    @property
    def _width(self) -> float:
        """What the strain covers from 0 on."""
        return float(np.ptp(np.append(self.strain, 0.0)))

    def _isotropic(self, top: float, first: float) -> dict[str, float]:
        """Where the search for the law of isotropic hardening begins."""
        wide = self._width
        found = {"yield_stress": first, "modulus": max(top - first, 0.01 * top) / wide}
        if self.law == "voce":
            found |= {"saturation_stress": max(top - first, 0.05 * top), "exponent": 3.0 / wide}
        if self.law == "swift":
            # Through the first yield without plastic strain, K ε₀ⁿ, and the last, highest stress.
            n = 0.2
            found |= {"K": top / wide**n, "n": n, "strain0": wide * (first / top) ** (1.0 / n)}
            found["strain0"] = min(max(found["strain0"], 1e-6), 0.5)
        return found

    # -- search ------------------------------------------------------------------------------------

    def fitted(self, fewer: MetalFit | None = None) -> MetalFit:
        """The best metal; from ``fewer`` with a branch less, too."""
        low, high = self.bounds()
        known = None
        if fewer is not None and fewer.problem.law == self.law:
            own = dict(zip(fewer.problem.keys, np.exp(fewer.x), strict=True))
            known = {key: value for key, value in own.items() if key in self.keys}
        begun = [*self.starts(None), *(self.starts(known) if known else ())]
        begun = [np.clip(x, low + 1e-6, high - 1e-6) for x in begun]
        begun.sort(key=lambda x: float(np.sum(self.residual(x) ** 2)))
        # Searches take the time, and those from bad starts end where others do, or worse.
        x, at_bound = best_minimum(self, begun[:4], (low, high), 1e-11, 100)
        order = np.arange(len(x))  # the fastest branch first
        pairs = order[len(x) - 2 * self.branches :].reshape(-1, 2)
        pairs[:] = pairs[np.argsort(-x[pairs[:, 1]])]
        return MetalFit(self, x[order], at_bound[order])


@dataclass(frozen=True, slots=True)
class MetalFit(MaterialFit[MetalProblem]):
    """A metal that was found."""

    @property
    def values(self) -> dict[str, float]:
        """Of all parameters, SI, fitted or fixed."""
        return self.problem.values(self.x)

    @property
    def metal(self) -> Metal:
        """What was found."""
        return self.problem.metal(self.x)

    @property
    def parameters(self) -> list[MaterialParameter]:
        """What was fitted."""
        units = {"E": "Pa", "c": "Pa", **LAWS[self.problem.law]}
        return [
            MaterialParameter(key, units.get(key.partition(" ")[0], ""))
            for key in self.problem.keys
        ]

    def slopes(self) -> Slopes:
        """Of the residual, for the logarithm of each parameter."""
        keys = list(self.problem.keys)
        columns = self.problem.jacobian(self.x)
        if "saturation_stress" in keys:  # Searched as what it is above the yield stress.
            # d ln σ∞/d ln(σ∞ − σ₀) = 1 − σ₀/σ∞, and σ₀/σ∞ is that for ln σ₀.
            change, values = np.eye(len(keys)), self.values
            row = keys.index("saturation_stress")
            share = 1.0 - values["yield_stress"] / values["saturation_stress"]
            change[row, row] = share
            if "yield_stress" in keys:
                change[row, keys.index("yield_stress")] = 1.0 - share
            columns = np.asarray(columns @ np.linalg.inv(change))
        return Slopes(self.parameters, columns, self.squares, self.cure, "the stress")

    def flows_back(self) -> bool:
        """Whether the metal flows on a path after a turn: only this shows back stresses."""
        _, alpha = response(self.metal, self.problem.strain, self.problem.along)
        ends = alpha[[rows.stop - 1 for rows in self.problem.along]]
        return bool((np.diff(ends) > FLOWED).any())

    def computed(self) -> Floats:
        """Stress of every row, Pa."""
        return response(self.metal, self.problem.strain, self.problem.along)[0][self.problem.rows]

    def cure(self, name: str) -> str:
        """What to do about a parameter that the data do not determine."""
        key = name.partition(" ")[0]
        if key in ("c", "b"):
            n = self.problem.branches
            return f"add rows soon after each turn of the strain, or take --branches {n - 1}"
        rows = "rows before it yields" if key == "E" else "rows at other plastic strains"
        return f"add {rows}, or give a value with --fix {key}=..."


def fit_metal(
    data: MaterialData, law: str | None, branches: int | None, fixed: Mapping[str, float]
) -> tuple[MetalFit, dict[str, float]]:
    """The hardening of a test, and the criterion of all that were tried, by law and branches.

    Law and branches are those of the least information criterion where they are None, without
    branches if the strain never turns; ``fixed``: SI, by key; InputError if rows are too few.
    """
    assert data.strain is not None
    turns = len(paths(data.strain)) > 1
    found: list[MetalFit] = []
    for one in (law,) if law else LAWS:
        if branches is not None:
            found.append(MetalProblem(data, one, branches, fixed).fitted())
            continue
        best = MetalProblem(data, one, 0, fixed).fitted()
        found.append(best)
        for n in range(1, MOST_BRANCHES + 1) if turns else ():
            if len(data) <= len(best.x) + 2:
                break
            more = MetalProblem(data, one, n, fixed).fitted(best)
            found.append(more)
            if more.criterion > best.criterion:
                break
            best = more
    known = {f"{one.problem.law}, {one.problem.branches}": one.criterion for one in found}
    # A back stress that no flow after a turn has shown is none: it may only fit a pull better.
    shown = [one for one in found if not one.problem.branches or one.flows_back()]
    return min(shown or found, key=lambda one: one.criterion), known
