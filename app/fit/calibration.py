r"""Calibration: least squares of the logarithms of measured and computed friction.

.. math:: r_i = \sqrt{w_i}\, (\ln T(x; D_i, V_i, p_i, s_i) - \ln T_i)

over the logarithms x of the parameters (for alpha of :math:`\alpha/(1 - \alpha)`), so that errors
and intervals are relative. The threshold speed is not searched that way: where alpha switches over
a narrow width, only the order of V* among the measured speeds matters and the residual is flat in
between. Each gap between two speeds is tried, and the interval of V* is made of gaps. Where one or
two rows lie within the transition, V* would follow from them and the width that is assumed; the
interval then goes from the row below them to the row above.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import f as f_distribution

from tribox.app.errors import InputError
from tribox.app.fit.data import Floats, TribometerData
from tribox.app.fit.model import (
    AT_BOUND,
    BROAD,
    CONFIDENCE,
    NOISE,
    RANGES,
    Coordinate,
    Estimate,
    FitResult,
    Found,
    Parameters,
    Slopes,
    factor_of,
    friction,
    interval,
    undetermined,
    with_values,
)
from tribox.forms.friction.coulomb import CoulombParameters
from tribox.forms.friction.parameters import FrictionMapParameters

Ends = tuple[float | None, float | None]

MOST_GAPS = 40  # gaps of V* that are tried at first; then those beside the best
ROWS_FOR_SLOPE = 3  # rows within the transition from which on V* has an interval from the Jacobian
OFF_BRANCH = 0.999
"""Confidence with which a row must lie off both branches to count as within the transition."""
ROUNDED = 1e-8  # logarithms of speeds that are no further apart are the same


class Calibration:
    """The search for the parameters of one data set.

    ``star``: which coordinate, if any, is the threshold speed; ``base``: all that is not fitted.
    """

    def __init__(
        self,
        data: TribometerData,
        base: Parameters,
        coordinates: Sequence[Coordinate],
        starts: Mapping[str, float] | None = None,
    ) -> None:
        """Begin at ``starts`` (by key, SI); InputError if rows are not more than parameters."""
        self.data, self.base, self.coordinates = data, base, tuple(coordinates)
        self._starts = dict(starts or {})
        self._slip_start: Floats | None = None
        keys = [c.key for c in self.coordinates]
        self.star = next((i for i, key in enumerate(keys) if key in ("V_star", "gamma")), None)
        self._mu_s = keys.index("mu_s") if {"mu_s", "mu_d"} <= set(keys) else None
        self._mu_d = keys.index("mu_d") if self._mu_s is not None else None
        if len(data) <= len(self.coordinates):
            names, least = ", ".join(c.name for c in self.coordinates), len(self.coordinates) + 1
            raise InputError(
                f"too few data: to fit {names}, at least {least} rows are needed, "
                f"found {len(data)}; add rows, or give values with --fix"
            )

    # -- search coordinates ------------------------------------------------------------------------

    def _values(self, x: Floats) -> list[float]:
        """Parameters of search coordinates: V* in place of gamma, mu_d/mu_s in place of mu_d."""
        values = [c.to_value(float(u)) for c, u in zip(self.coordinates, x, strict=True)]
        if self._mu_s is not None and self._mu_d is not None:
            values[self._mu_d] = values[self._mu_s] * math.exp(min(float(x[self._mu_d]), 0.0))
        if self.star is not None and self.coordinates[self.star].key == "gamma":
            eta = next(
                (v for c, v in zip(self.coordinates, values, strict=True) if c.key == "eta_b"),
                self._map.eta_b,
            )
            # V* at D_max, so that gamma is eta_b V*^2 whatever the films of the data are.
            values[self.star] = eta * math.exp(2.0 * float(x[self.star]))
        return values

    @property
    def _map(self) -> FrictionMapParameters:
        """The law, where its film is asked for."""
        assert isinstance(self.base, FrictionMapParameters)
        return self.base

    def parameters(self, x: Floats) -> Parameters:
        """The law at search coordinates."""
        return with_values(self.base, self.coordinates, self._values(x))

    def _bounds(self) -> tuple[Floats, Floats]:
        limits = [list(c.limits) for c in self.coordinates]
        for i, c in enumerate(self.coordinates):
            if c.key == "gamma":
                limits[i] = [math.log(RANGES["V_star"].lowest), math.log(RANGES["V_star"].highest)]
            elif c.key == "mu_d":
                if self._mu_s is not None:
                    limits[i] = [math.log(1e-4), 0.0]
                elif not isinstance(self.base, CoulombParameters):
                    limits[i][1] = math.log(self.base.mu_s)
            elif c.key == "mu_s" and self._mu_d is None:
                least = getattr(self.base, "mu_d", None) or 0.0
                limits[i][0] = math.log(max(least, RANGES["mu_s"].lowest))
        low, high = np.array(limits).T
        return low, high

    def _residual(self, x: Floats) -> Floats:
        computed = friction(self.parameters(x), self.data)
        # A law may give no friction at all, and its logarithm would end the search.
        ratio = np.maximum(computed, 1e-300) / self.data.traction
        return np.asarray(np.sqrt(self.data.weight) * np.log(ratio))

    # -- starts ------------------------------------------------------------------------------------

    def _first(self) -> Iterator[Floats]:
        """Starting points: guesses from the data, and several for where the weakening lies."""
        low, high = self._bounds()
        x = np.array([self._guess(c) for c in self.coordinates])
        keys = [c.key for c in self.coordinates]
        if self._slip_start is not None:
            for key in ("A_d", "B", "K_T"):
                if key in keys:
                    x[keys.index(key)] = self._slip_start[keys.index(key)]
            yield np.clip(x, low + 1e-9, high - 1e-9)
            return
        slips = self.data.slip[~self.data.steady]
        variants = [x]
        if "V_s" in keys and "V_s" not in self._starts:
            # From a V_s below or above all rows the fall would not be seen, and V_s not moved.
            variants = [x.copy() for _ in range(4)]
            shares = np.quantile(np.log(self.data.velocity), [0.1, 0.35, 0.6, 0.9])
            for at, share in zip(variants, shares, strict=True):
                at[keys.index("V_s")] = float(share)
        if "A_d" in keys and "A_d" not in self._starts and slips.size:
            variants = []  # likewise: weakening far from the slips of the rows has no slope
            for share in (0.02, 0.1, 0.3):
                A_d = share * float(slips.max())
                at = x.copy()
                at[keys.index("A_d")] = math.log(A_d)
                if "B" in keys and "B" not in self._starts:
                    at[keys.index("B")] = math.log(1.0 / A_d)
                variants.append(at)
        for at in variants:
            yield np.clip(at, low + 1e-9, high - 1e-9)

    def _guess(self, c: Coordinate) -> float:
        """Search coordinate to start from."""
        if c.key in self._starts and c.key not in ("gamma", "mu_d"):
            return c.to_search(self._starts[c.key])
        data = self.data
        ratio = data.traction / data.pressure
        if not isinstance(self.base, FrictionMapParameters):
            return self._guess_without_film(c, ratio)
        if c.key == "mu_d":
            mu_s = self._starts.get("mu_s", float(ratio.max()))
            mu_d = self._starts.get("mu_d", 0.8 * mu_s)
            return math.log(min(mu_d / mu_s, 1.0)) if self._mu_s is not None else math.log(mu_d)
        if c.key == "mu_s":
            dry = data.thickness <= self._map.D_min
            return math.log(float((ratio[dry] if dry.any() else ratio).max()))
        if c.key == "eta_b":
            # Asperities only add to what the film drags: the least is the nearest to it.
            wet = data.thickness > self._map.D_min
            viscosity = (data.traction * data.thickness / data.velocity)[wet]
            return math.log(float(viscosity.min())) if viscosity.size else math.log(0.1)
        if c.key == "alpha":
            # Slow rows have (1 − alpha) of the friction of dry asperities.
            rows = data.thickness == c.film
            slow = float(ratio[rows][np.argmin(data.velocity[rows])])
            mu = max(self._starts.get("mu_s", float(ratio.max())), self._map.mu_dynamic)
            return c.to_search(min(max(1.0 - slow / mu, 0.02), 1.0 - 1e-6))
        if c.key == "gamma":
            return math.log(RANGES["V_star"].start)
        return c.to_search(RANGES[c.key].start)

    def _guess_without_film(self, c: Coordinate, ratio: Floats) -> float:
        """Search coordinate to start from, of a law that asks for no film."""
        V, slow = self.data.velocity, float(ratio[np.argmin(self.data.velocity)])
        if c.key == "mu":
            return math.log(float(np.median(ratio)))
        if c.key == "mu_s":
            return math.log(max(slow, float(getattr(self.base, "mu_d", 0.0))))
        if c.key == "mu_d":
            mu_s = self._starts.get("mu_s", slow)
            share = 0.8 * self._starts.get("mu_d", float(ratio.min())) / mu_s
            return min(math.log(share), -0.01) + (0.0 if self._mu_s is not None else math.log(mu_s))
        if c.key == "viscous":
            T = self.data.traction
            fastest = int(np.argmax(V))
            rise = max(float(T[fastest] - T.min()), 0.01 * float(T[fastest]))
            return math.log(rise / float(V[fastest]))
        if c.key == "K_T" and not self.data.steady.all():
            # Before it slips T = K_T g: the steepest of all chords from rest.
            moved = ~self.data.steady
            return math.log(float(np.max(self.data.traction[moved] / self.data.slip[moved])))
        return c.to_search(RANGES[c.key].start)

    # -- search ------------------------------------------------------------------------------------

    def _minimum(
        self, start: Floats, held: float | None, within: tuple[float, float] | None = None
    ) -> Found:
        """Least squares from a start; V* stays at ``held`` if given, or ``within`` (logarithms)."""
        low, high = self._bounds()
        x = start.copy()
        if within is not None and self.star is not None:
            low[self.star], high[self.star] = within
        vary = np.ones(len(x), dtype=np.bool_)
        if held is not None and self.star is not None:
            x[self.star], vary[self.star] = held, False

        def residual(y: Floats) -> Floats:
            at = x.copy()
            at[vary] = y
            return self._residual(at)

        # See that the law says something of every row at these search coordinates.
        with np.errstate(over="ignore", invalid="ignore"):
            wrong = ~np.isfinite(self._residual(x))
        if wrong.any():
            row = int(np.argmax(wrong)) + 1
            raise InputError(
                f"the law has no finite friction for row {row} of the data; check their units and "
                "the values that are fixed"
            )
        if not vary.any():
            at_bound = np.zeros(len(x), dtype=np.bool_)
            return Found(x, self._residual(x), np.zeros((len(self.data), 0)), at_bound, False)
        found = least_squares(
            residual, x[vary], jac="2-point", bounds=(low[vary], high[vary]), max_nfev=100,
            xtol=1e-9, ftol=1e-10, gtol=1e-10,
        )  # fmt: skip
        x[vary] = found.x
        at_bound = np.zeros(len(x), dtype=np.bool_)
        at_bound[vary] = np.minimum(found.x - low[vary], high[vary] - found.x) < 1e-6
        if self.star is not None:
            at_bound[self.star] = False  # Its ends are judged by the gaps.
        return Found(x, found.fun, found.jac, at_bound, held is None)

    def _best(self, held: float | None) -> Found:
        return min((self._minimum(x, held) for x in self._first()), key=lambda one: one.squares)

    def _reduced_speeds(self) -> Floats:
        """Logarithms of the V* at which each row would be right at it, sorted, without repeats."""
        D, V = self.data.thickness, self.data.velocity
        rows = (D > self._map.D_min) & (D < self._map.D_max)
        reduced = np.log(V[rows] * np.sqrt(D[rows] / self._reference))
        return np.asarray(np.unique(np.round(reduced, 9)))

    @property
    def _reference(self) -> float:
        """m, film thickness at which the search coordinate of V* holds."""
        return self._map.D_max if self._map.V_star_at is None else self._map.V_star_at

    def _in_transition(self, star: float) -> int:
        """Number of rows whose speed lies within the transition."""
        ratio = np.exp(self._reduced_speeds() - star)
        return int(np.sum(np.abs(ratio - 1.0) < self._map.transition_width))

    def _search_star(self, speeds: Floats) -> tuple[Found, Ends, list[Found]]:
        """Best minimum over the gaps between reduced speeds, interval of ln V*, others as good."""
        edges, clear = self._gaps(speeds)
        tried: dict[int, Found] = {}
        # What slip does is all but independent of V*: its start is found once.
        self._slip_start = self._best(0.5 * float(speeds[0] + speeds[-1])).x
        wanted = [clear[i] for i in np.unique(np.linspace(0, len(clear) - 1, MOST_GAPS, dtype=int))]
        while wanted:
            tried |= {gap: self._in_gap(edges, gap, gap in clear) for gap in wanted}
            inside = self._as_good(tried)
            beside = {gap + step for gap in inside for step in (-1, 1)}
            wanted = sorted(beside & set(range(len(edges) - 1)) - tried.keys())
        # A row inside the transition can be fitted by V* alone: that is no reason to prefer it, nor
        # is a row that lies off by what one in twenty does.
        plain = [gap for gap in inside if not tried[gap].free]
        if not plain:
            plain = [gap for gap in self._as_good(tried, OFF_BRANCH) if not tried[gap].free]
            inside += plain
        low, high = min(inside), max(inside) + 1
        best = min(plain or inside, key=lambda gap: tried[gap].squares)
        ends = (
            float(edges[low]) if low > 0 else None,
            float(edges[high]) if high < len(edges) - 1 else None,
        )
        if self._rests_on_few(tried[best]):
            ends = self._neighbours(speeds, *ends)
        return tried[best], ends, [tried[gap] for gap in plain if gap != best]

    def _rests_on_few(self, found: Found) -> bool:
        """Whether V* was chosen by one or two rows in the transition, whose width is not known."""
        return found.free and self._in_transition(float(found.x[self.star or 0])) < ROWS_FOR_SLOPE

    def _neighbours(self, speeds: Floats, low: float | None, high: float | None) -> Ends:
        """The next rows below and above the transition of every V* between two ends.

        A wider transition than the one assumed has V* elsewhere: anywhere between those rows.
        """
        width = self._map.transition_width
        below = speeds[speeds <= (-math.inf if low is None else low + math.log1p(-width) + ROUNDED)]
        above = speeds[speeds >= (math.inf if high is None else high + math.log1p(width) - ROUNDED)]
        return (float(below[-1]) if below.size else None, float(above[0]) if above.size else None)

    def _gaps(self, speeds: Floats) -> tuple[Floats, list[int]]:
        """Edges of intervals of ln V* with the same rows beside; numbers of the empty ones."""
        width = self._map.transition_width
        both = np.concatenate([speeds - math.log1p(width), speeds - math.log1p(-width)])
        ends = np.unique(np.round(both, 9))
        edges = np.concatenate([[ends[0] - 2.0], ends, [ends[-1] + 2.0]])
        middles = 0.5 * (edges[1:] + edges[:-1])
        clear = [gap for gap, at in enumerate(middles) if not self._in_transition(float(at))]
        return edges, clear

    def _in_gap(self, edges: Floats, gap: int, clear: bool) -> Found:
        """The minimum with V* in one interval: in its middle, or anywhere in it if not clear."""
        low, high = float(edges[gap]), float(edges[gap + 1])
        one = self._best(0.5 * (low + high))
        return one if clear else self._minimum(one.x, None, (low, high))

    def _as_good(self, tried: Mapping[int, Found], confidence: float = CONFIDENCE) -> list[int]:
        """The intervals that the data do not rule out beside the best (F test)."""
        degrees = len(self.data) - len(self.coordinates)
        least = min(one.squares for one in tried.values())
        # Of data without scatter, round-off would choose: some scatter is assumed at least.
        variance = max(least / degrees, NOISE**2)
        limit = least + float(f_distribution.ppf(confidence, 1, degrees)) * variance
        return [gap for gap, one in tried.items() if one.squares <= limit]

    def run(self) -> FitResult:
        """Search, and judge what was found."""
        if self.star is None:
            return self._judged(self._best(None), None)
        speeds = self._reduced_speeds()
        if not speeds.size:
            name = self.coordinates[self.star].name
            raise InputError(f"{name}: no row has a film between D_min and D_max to fit it to")
        found, ends, as_good = self._search_star(speeds)
        if found.free and not self._rests_on_few(found):
            return self._judged(found, None)
        return self._judged(found, ends, as_good)

    def _left_open(self, found: Found, as_good: Sequence[Found]) -> dict[str, str]:
        """Lines on parameters that other threshold speeds, which fit as well, do not determine."""
        if self.star is None or not as_good:
            return {}
        at = [
            [c.to_search(v) for c, v in zip(self.coordinates, self._values(one.x), strict=True)]
            for one in (found, *as_good)
        ]
        far = np.ptp(at, axis=0) > BROAD
        degrees = len(self.data) - len(self.coordinates)
        open_there = {
            name
            for one in as_good
            for name in Judgement(self.coordinates, self.star, one, True).open_names(degrees)
        }
        star = self.coordinates[self.star].name
        reason = "another {} fits as well, with which they leave {} open"
        return {
            c.name: undetermined(c.name, reason.format(star, c.name), _cure(c.name))
            for c, is_far in zip(self.coordinates, far, strict=True)
            if c.name != star and (is_far or c.name in open_there)
        }

    def _judged(self, found: Found, star: Ends | None, as_good: Sequence[Found] = ()) -> FitResult:
        """The result, with V* between the ends ``star`` (logarithms) unless it has a slope."""
        film = isinstance(self.base, FrictionMapParameters)
        cures = CURES if film else CURES_WITHOUT_FILM
        judgement = Judgement(self.coordinates, self.star, found, star is not None, cures)
        degrees = len(self.data) - len(self.coordinates)
        scatter = math.sqrt(found.squares / degrees)
        known = self._left_open(found, as_good) | {
            c.name: undetermined(c.name, AT_BOUND, _cure(c.name, cures=cures))
            for c, hit in zip(self.coordinates, found.at_bound, strict=True)
            if hit
        }
        estimates = []
        for c, value in zip(self.coordinates, self._values(found.x), strict=True):
            if c.name in judgement.names:
                half = judgement.half_width(c.name, scatter, degrees)
                low, high = interval(c, value, half)
                warning = judgement.warning(c.name, scatter, degrees) or known.get(c.name)
            else:
                assert star is not None and self.star is not None
                scale = value / math.exp(float(found.x[self.star]))
                if c.key == "gamma":
                    scale /= math.exp(float(found.x[self.star]))
                power = 2.0 if c.key == "gamma" else 1.0
                low, high = (None if end is None else scale * math.exp(power * end) for end in star)
                few = self._rests_on_few(found)
                warning = star_warning(c.name, *star, self._map.transition_width if few else None)
            estimates.append(Estimate(c, value, low, high, warning))
        parameters = self.parameters(found.x)
        return FitResult(
            parameters=parameters,
            estimates=tuple(estimates),
            traction=friction(parameters, self.data),
            scatter=scatter,
            degrees=degrees,
            slopes=judgement,
        )


# -- What a fit of friction is worth: slopes for its parameters, and what V* rests on --------------

CURES = {
    "mu_s": "dry rows (thickness up to D_min)",
    "mu_d": "rows that have slid far beyond A_d",
    "A_d": "rows with slips around A_d",
    "B": "rows with slips beyond A_d",
    "K_T": "rows with slips below mu p/K_T, before all slides",
    "eta_b": "rows in which the film drags: fast ones, or thickness from D_max on",
    "alpha": "dry rows, and slow ones with this film",
    "beta": "dry rows, and slow ones with films between D_min and D_max",
    "V_star": "rows close below and above the threshold speed",
    "gamma": "rows close below and above the threshold speed",
    "mu": "rows that slide",
    "V_s": "rows at velocities over which the friction falls",
    "delta": "rows at velocities over which the friction falls",
    "viscous": "faster rows, in which the friction rises",
}
"""Rows that would determine a parameter."""
CURES_WITHOUT_FILM = CURES | {"mu_s": "rows slower than V_s", "mu_d": "rows faster than V_s"}
"""The same for Stribeck and Coulomb friction."""


class Judgement(Slopes):
    """Slopes of the friction for the parameters of its law."""

    def __init__(
        self,
        coordinates: Sequence[Coordinate],
        star: int | None,
        found: Found,
        bracketed: bool,
        cures: Mapping[str, str] = CURES,
    ) -> None:
        """Take the Jacobian of the search to the parameters themselves.

        ``bracketed``: the interval of the threshold speed is known otherwise; ``cures``: rows that
        would determine a parameter, by key.
        """
        varied = [i for i in range(len(coordinates)) if found.free or i != star]
        columns = {coordinates[i].key: found.jacobian[:, n] for n, i in enumerate(varied)}
        full = {coordinates[i].name: found.jacobian[:, n].copy() for n, i in enumerate(varied)}
        # With mu_d held, a higher mu_s is a lower mu_d/mu_s.
        if {"mu_s", "mu_d"} <= full.keys():  # Searched as mu_d/mu_s.
            full["mu_s"] -= full["mu_d"]
        # ln V* = (ln gamma − ln eta_b)/2, at the film that it is searched for.
        if "gamma" in full:  # Searched as V*, with gamma = eta_b V*^2.
            full["gamma"] *= 0.5
            if "eta_b" in full:
                full["eta_b"] -= 0.5 * columns["gamma"]
        if bracketed and star is not None:
            full.pop(coordinates[star].name, None)
        slopes = np.array(list(full.values())).T if full else np.zeros((len(found.residual), 0))
        kept = [c for c in coordinates if c.name in full]
        super().__init__(
            kept, slopes, found.squares, lambda name: _cure(name, cures=cures), "the friction"
        )


def _cure(name: str, rows: str | None = None, cures: Mapping[str, str] = CURES) -> str:
    """What to do about a parameter that is not determined, such as "alpha at 10 nm"."""
    key = name.partition(" ")[0]
    return f"add {rows or cures[key]}"


def star_warning(
    name: str, low: float | None, high: float | None, width: float | None
) -> str | None:
    """Why the data do not determine the threshold speed; None if they do.

    ``low``, ``high``: logarithms of the ends of V*'s interval, None: open; ``width``: of the
    transition that is assumed, where V* rests on one or two rows in it.
    """
    if low is None and high is None:
        reason, rows = "they fit with every threshold speed", CURES["V_star"]
    elif low is None:
        reason, rows = "it may lie below all their velocities", "slower rows"
    elif high is None:
        reason, rows = "it may lie above all their velocities", "faster rows"
    elif high - low > 2.0 * BROAD:
        factor = factor_of(0.5 * (high - low))
        reason, rows = f"the interval spans a factor of {factor} either way", CURES["V_star"]
    elif width is not None:
        reason = (
            "it rests on one or two rows between both branches, and with them on "
            f"transition_width = {width:g}, which is assumed"
        )
        rows = CURES["V_star"]
    else:
        return None
    return undetermined(name, reason, _cure(name, rows))
