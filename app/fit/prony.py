r"""Prony branches of a rubber from relaxation, vibration or cycles.

.. math:: G(t) = G_\infty + \sum_k G_k e^{-t/\tau_k}

At finite strain each branch is that of :math:`W_k = G_k/2 (tr(\bar C C_k^{-1}) - 3)` with
:math:`\dot C_k = (\bar C C_k^{-1})^D C_k/\tau_k`, on a neo-Hookean rubber without change of volume:
the stress is linear in the moduli, and what a branch of unit modulus gives depends on its
relaxation time alone. The logarithms of all moduli and times are searched by least squares, of
relative differences for relaxation and vibration, and of stresses over their root mean square for
cycles.
Starts come from non-negative least squares on a grid of times; the number of branches, unless it is
given, is that of the least Bayesian information criterion (Schwarz, Ann. Statist. 6 (1978) 461).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from tribox.app.errors import InputError
from tribox.app.fit.data import Floats
from tribox.app.fit.material_data import MaterialData
from tribox.app.fit.model import MaterialFit, MaterialParameter, Slopes, best_minimum

Branch = Callable[[Floats], tuple[Floats, Floats]]
"""(k,) relaxation times, s, to what a branch of unit modulus gives, (k, m), and its derivative for
the logarithm of the time."""

MOST_BRANCHES = 12
PER_DECADE = 4  # times of the grid for starts
BEYOND = 30.0
"""Factor beyond the shortest and longest time of the data within which relaxation times lie."""
MOST_LOG = 150.0  # logarithm of a shift factor up to which the search may go astray
SMALL_STRAIN = 0.02  # largest step of logarithmic strain in following a branch through cycles
C1_LIMITS, C2_MOST = (0.1, 200.0), 1e4
C1_START, C2_START = 8.86, 101.6
"""Of most polymers 50 K above the glass transition (Williams, Landel & Ferry, J. Am. Chem. Soc. 77
(1955) 3701)."""


@dataclass(frozen=True, slots=True)
class Shift:
    """Times at a temperature T are a_T those at the reference.

    log10 a_T = -C1 (T - reference)/(C2 + T - reference) (Williams, Landel & Ferry, 1955).
    """

    reference: float  # K
    temperature: Floats  # (n,), K, of the data

    @property
    def above(self) -> Floats:
        """(n,), K, above the reference."""
        return self.temperature - self.reference

    @property
    def usual_C2(self) -> float:
        """K, to start from: that of most polymers, or well above what the coldest row needs."""
        return max(C2_START, -1.5 * float(self.above.min()))

    def logarithm(self, C1: float, C2: float) -> Floats:
        """Logarithm of a_T, (n,); far beyond all decades of a test it is cut."""
        found = -math.log(10.0) * C1 * self.above / (C2 + self.above)
        return np.asarray(np.clip(found, -MOST_LOG, MOST_LOG))


LONG_TERM = MaterialParameter("long-term G", "Pa")


@dataclass(frozen=True, slots=True)
class Prony:
    """A series."""

    G: float  # Pa, instantaneous shear modulus
    shares: Floats  # (k,), of it
    times: Floats  # (k,), s, rising; at the reference temperature if there is a shift
    C1: float | None = None  # of the shift; None without
    C2: float | None = None  # K

    @property
    def long_term(self) -> float:
        """G after all branches have relaxed, Pa."""
        return self.G * (1.0 - float(self.shares.sum()))


class PronyProblem:
    """What is fitted to one test; ``shift``: of its temperatures, None at one.

    ``measured``: (m,), Pa, modulus, storage then loss modulus, or stress; ``span``, ``limits``: s,
    that the data tell of, and within which times are searched.
    """

    def __init__(self, data: MaterialData, shift: Shift | None = None) -> None:
        self.data, self.shift = data, shift
        self.relative = data.kind != "cycles"
        parts = (data.stress,) if data.stress is not None else (data.modulus, data.loss)
        held = [part for part in parts if part is not None]
        self.measured = np.concatenate(held)
        self._root = np.sqrt(np.tile(data.weight, len(held)))
        self.scale = float(np.sqrt(np.mean(self.measured**2)))
        self.span = low, high = self._times()
        self.limits = (low / BEYOND, high * BEYOND)
        self.branch, self.equilibrium = self._response()
        self._last: tuple[Floats, tuple[Floats, Floats]] | None = None

    def _times(self) -> tuple[float, float]:
        """Shortest and longest time that the data tell of, s."""
        data = self.data
        if data.frequency is not None:
            reduced = -np.log(data.frequency)
            if self.shift is not None:  # The master curve is as wide as a usual polymer's.
                reduced = reduced - self.shift.logarithm(C1_START, self.shift.usual_C2)
            return math.exp(reduced.min()), math.exp(reduced.max())
        assert data.time is not None
        since = data.time[data.time > 0.0] if data.kind == "relaxation" else np.diff(data.time)
        if not since.size:
            raise InputError("time: there must be rows at several times")
        first = float(data.time[0]) if data.kind == "cycles" else 0.0
        return float(since.min()), float(data.time[-1]) - first

    def _response(self) -> tuple[Branch, Floats]:
        """What one branch gives, and what the long-term modulus does, (m,), each per modulus."""
        data = self.data
        if data.frequency is not None:
            ones = np.ones(len(data))
            return functools.partial(_vibration, data.frequency), np.append(ones, 0.0 * ones)
        assert data.time is not None
        if data.kind == "relaxation":
            decay = relaxation_curve(data)
            return functools.partial(_relaxation, data.time, decay), np.ones(len(data))
        assert data.strain is not None
        stretch = np.exp(data.strain)
        area = 1.0 / stretch if data.engineering else np.ones(len(data))
        follow = functools.partial(_cycles, data.time, data.strain, area)
        return follow, (stretch**2 - 1.0 / stretch) * area

    # -- search coordinates: ln G_inf, ln G_k, ln tau_k, and with a shift ln C1, ln C2 -------------

    def branches(self, x: Floats) -> int:
        """Their number, of search coordinates."""
        return (len(x) - 1 - 2 * (self.shift is not None)) // 2

    def computed(self, x: Floats) -> tuple[Floats, Floats]:
        """What was measured, (m,), Pa, and its derivative for x, (m, c)."""
        # The search asks for residual and Jacobian in turn, at the same place.
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = (x.copy(), self._computed(x))
        return self._last[1]

    def _computed(self, x: Floats) -> tuple[Floats, Floats]:
        n = self.branches(x)
        moduli, times = np.exp(x[: n + 1]), np.exp(x[n + 1 : 2 * n + 1])
        if self.shift is None:
            one, slope = self.branch(times)
        else:
            C1, C2 = np.exp(x[-2:])
            ln_a = self.shift.logarithm(C1, C2)
            one, slope = self.branch(times[:, None] * np.exp(ln_a))
        long_term = moduli[0] * self.equilibrium
        by_modulus, by_time = moduli[1:, None] * one, moduli[1:, None] * slope
        columns = [long_term, *by_modulus, *by_time]
        if self.shift is not None:
            # τ_k a_T: d ln(τ a_T)/d ln C1 = ln a_T, and that for ln C2 is −ln a_T C2/(C2 + T −
            # T_r); every branch has the same.
            by_shift = by_time.sum(0) * np.tile(ln_a, 2)
            columns += [by_shift, -by_shift * np.tile(C2 / (C2 + self.shift.above), 2)]
        return long_term + by_modulus.sum(0), np.array(columns).T

    def residual(self, x: Floats) -> Floats:
        """Weighted differences, (m,): of logarithms, or over the root mean square stress."""
        value, _ = self.computed(x)
        if self.relative:
            ratio = np.log(value / self.measured)
            return np.asarray(self._root * ratio)
        return np.asarray(self._root * (value - self.measured) / self.scale)

    def jacobian(self, x: Floats) -> Floats:
        """(m, c), of the residual."""
        value, slope = self.computed(x)
        over = value if self.relative else np.full(len(value), self.scale)
        factor: Floats = self._root / over
        return slope * factor[:, None]

    def bounds(self, n: int) -> tuple[Floats, Floats]:
        """Of the search with n branches."""
        top = math.log(float(np.abs(self.measured).max()))
        # From 1e-8 of what was measured, which no test sees, to 1e5 times as much: of a branch that
        # had all but relaxed before the first row.
        modulus = (top - 18.0, top + 12.0)
        rows = [modulus] * (n + 1) + [(math.log(self.limits[0]), math.log(self.limits[1]))] * n
        if self.shift is not None:
            least = max(1.0, 1.0 - float(self.shift.above.min()))
            rows += [(math.log(C1_LIMITS[0]), math.log(C1_LIMITS[1]))]
            rows += [(math.log(least), math.log(C2_MOST))]
        low, high = np.array(rows).T
        return low, high

    # -- starts ------------------------------------------------------------------------------------

    def starts(self, n: int, fewer: Floats | None) -> Iterator[Floats]:
        """Search coordinates to start from; one branch more than ``fewer``, if that is given."""
        low, high = (math.log(end) for end in self.span)
        tail: Floats = np.zeros(0)
        if self.shift is not None:
            tail = np.asarray(np.log([C1_START, self.shift.usual_C2]))
        count = max(2, 1 + math.ceil(PER_DECADE * (high - low) / math.log(10.0)))
        grid = np.asarray(np.linspace(low, high, count), dtype=np.float64)
        # Times spread evenly over what the data see; those that a fine grid puts its moduli at; and
        # what was found with a branch less, with one more wherever it helps most.
        yield self._with_moduli(low + (high - low) * (np.arange(n) + 0.5) / n, tail)[1]
        yield self._gathered(grid, n, tail)
        if fewer is not None:
            tail = fewer[len(fewer) - len(tail) :]
            known = fewer[n : 2 * n - 1]
            more = [self._with_moduli(np.append(known, one), tail) for one in grid]
            yield from (x for _, x in sorted(more, key=lambda one: one[0])[:2])

    def _moduli(self, times: Floats, tail: Floats) -> tuple[float, Floats]:
        """Root of the squares, and moduli of given times that are not negative, (1 + k,)."""
        tau = np.exp(times)
        if self.shift is not None:
            C1, C2 = np.exp(tail)
            tau = tau[:, None] * np.exp(self.shift.logarithm(C1, C2))
        columns = np.vstack([self.equilibrium, self.branch(tau)[0]]).T
        over = self.measured if self.relative else np.full(len(self.measured), self.scale)
        factor = self._root / over
        # The default number of iterations does not always do for columns that are much alike.
        most = 100 * columns.shape[1]
        moduli, left = nnls(columns * factor[:, None], self.measured * factor, maxiter=most)
        return float(left), moduli

    def _with_moduli(self, times: Floats, tail: Floats) -> tuple[float, Floats]:
        left, moduli = self._moduli(times, tail)
        # A modulus of 0, of which there are many, has no logarithm to begin with.
        least = 1e-3 * float(moduli.max() or np.abs(self.measured).max())
        return left, np.concatenate([np.log(np.maximum(moduli, least)), times, tail])

    def _gathered(self, grid: Floats, n: int, tail: Floats) -> Floats:
        """The series on the whole grid, gathered into n branches of like moduli."""
        _, moduli = self._moduli(grid, tail)
        share = np.cumsum(moduli[1:])
        if share[-1] <= 0.0:
            return self._with_moduli(np.linspace(grid[0], grid[-1], n + 2)[1:-1], tail)[1]
        at = (np.arange(n) + 0.5) / n * share[-1]
        # Several that fall on one place of the grid must not begin as one branch.
        times = np.interp(at, share, grid) + 1e-3 * np.arange(n)
        return self._with_moduli(times, tail)[1]

    # -- search ------------------------------------------------------------------------------------

    def fitted(self, n: int, fewer: Floats | None = None) -> PronyFit:
        """The best series of n branches; ``fewer``: search coordinates of the best of n - 1."""
        x, at_bound = best_minimum(self, self.starts(n, fewer), self.bounds(n), 1e-12, 200)
        # Branches are all alike: numbered by their times, those of two fits can be compared.
        order = np.argsort(x[n + 1 : 2 * n + 1])
        for part in (slice(1, n + 1), slice(n + 1, 2 * n + 1)):
            x[part], at_bound[part] = x[part][order], at_bound[part][order]
        return PronyFit(self, x, at_bound)


@dataclass(frozen=True, slots=True)
class PronyFit(MaterialFit[PronyProblem]):
    """A series that was found."""

    @property
    def branches(self) -> int:
        """Their number."""
        return self.problem.branches(self.x)

    @property
    def series(self) -> Prony:
        """What was found, in SI."""
        n = self.branches
        moduli = np.exp(self.x[: n + 1])
        G = float(moduli.sum())
        C1, C2 = np.exp(self.x[-2:]) if self.problem.shift is not None else (None, None)
        return Prony(G, moduli[1:] / G, np.exp(self.x[n + 1 : 2 * n + 1]), C1, C2)

    @property
    def parameters(self) -> list[MaterialParameter]:
        """What is stated: G, shares, times, and C1 and C2 of a shift."""
        k = range(1, self.branches + 1)
        of_shift = [MaterialParameter("C1"), MaterialParameter("C2", "K")]
        return [
            MaterialParameter("G", "Pa"),
            *(MaterialParameter(f"share {i}", bounded=True) for i in k),
            *(MaterialParameter(f"tau {i}", "s") for i in k),
            *(of_shift if self.problem.shift is not None else []),
        ]

    @property
    def values(self) -> dict[str, float]:
        """Of all parameters, SI, by name."""
        found = self.series
        of_shift = [] if found.C1 is None or found.C2 is None else [found.C1, found.C2]
        numbers = [found.G, *found.shares, *found.times, *of_shift]
        return {p.name: float(v) for p, v in zip(self.parameters, numbers, strict=True)}

    def computed(self) -> Floats:
        """What was measured, (m,), Pa."""
        return self.problem.computed(self.x)[0]

    def slopes(self) -> Slopes:
        """Of the residual, for what is stated: its share's a/(1 - a) and not each modulus.

        d ln G/d ln G_k = g_k, and d ln(g_i/(1 - g_i))/d ln G_k = (d_ik - g_k)/(1 - g_i).
        """
        n = self.branches
        moduli = np.exp(self.x[: n + 1])
        g = moduli / moduli.sum()
        change = np.eye(len(self.x))
        change[0, : n + 1] = g
        change[1 : n + 1, : n + 1] = (np.eye(n + 1)[1:] - g) / (1.0 - g[1:])[:, None]
        slopes = self.problem.jacobian(self.x) @ np.linalg.pinv(change)
        return Slopes(self.parameters, slopes, self.squares, self.cure, self._what)

    def search_slopes(self) -> Slopes:
        """Of the residual for the moduli themselves, which tell what the data determine.

        Shares would not: where little is left in the long term, they are one by their sum, and
        where a branch too fast for the data makes G uncertain, none of them is known, though the
        other moduli are. A modulus bears the name of its share.
        """
        stated = self.parameters
        columns = self.problem.jacobian(self.x)
        return Slopes([LONG_TERM, *stated[1:]], columns, self.squares, self.cure, self._what)

    @property
    def _what(self) -> str:
        return "the stress" if self.problem.data.kind == "cycles" else "the modulus"

    def cure(self, name: str) -> str:
        """What to do about a parameter that the data do not determine."""
        if name == LONG_TERM.name:
            slow = "slower frequencies" if self.problem.data.kind == "vibration" else "later times"
            return f"add rows at {slow}, where the modulus has stopped falling"
        if name in ("C1", "C2"):
            return "add temperatures, three at least, over which the curves shift by decades"
        if self.problem.data.kind == "vibration":
            rows = "frequencies" if self.problem.shift is None else "frequencies or temperatures"
        else:
            rows = "times"
        fewer = "" if self.branches == 1 else f", or take --branches {self.branches - 1}"
        return f"add rows at {rows} around it, or beyond those there are{fewer}"


def fit_prony(
    data: MaterialData, branches: int | None, shift: Shift | None = None
) -> tuple[PronyFit, dict[int, float]]:
    """The series of a test, and the criterion by number of branches of all that were tried.

    ``branches``: None: those of the least criterion; InputError if there are too few rows.
    """
    problem = PronyProblem(data, shift)
    most = (len(problem.measured) - 2 - 2 * (shift is not None)) // 2
    least = branches or 1
    if most < least:
        rows = 2 * least + 2 + 2 * (shift is not None)
        there = len(problem.measured)
        raise InputError(
            f"too few data: to fit {least} branch{'es' * (least > 1)}, at least {rows} values are "
            f"needed, found {there}"
        )
    if branches is not None:
        fewer = problem.fitted(branches - 1) if branches > 1 else None
        one = problem.fitted(branches, None if fewer is None else fewer.x)
        return one, {branches: one.criterion}
    found: list[PronyFit] = []
    for n in range(1, min(most, MOST_BRANCHES) + 1):
        found.append(problem.fitted(n, found[-1].x if found else None))
        ranks = [one.criterion for one in found]
        # Two more in a row that are worse than the best before: further ones will be, too.
        if len(ranks) - int(np.argmin(ranks)) > 2:
            break
    best = min(found, key=lambda one: one.criterion)
    return best, {one.branches: one.criterion for one in found}


# -- what a branch of unit modulus gives -----------------------------------------------------------


def _vibration(omega: Floats, tau: Floats) -> tuple[Floats, Floats]:
    """G' = w² t²/(1 + w² t²), G'' = w t/(1 + w² t²); ``tau`` (k,) or (k, n)."""
    x = omega * (tau[:, None] if tau.ndim == 1 else tau)
    below = 1.0 / (1.0 + x**2)
    loss: Floats = x * below
    storage: Floats = x**2 * below
    by_storage: Floats = 2.0 * loss**2
    by_loss: Floats = loss * (1.0 - x**2) * below
    value = np.concatenate([storage, loss], axis=1)
    slope = np.concatenate([by_storage, by_loss], axis=1)
    return value, slope


def _relaxation(
    time: Floats, decay: Callable[[Floats], tuple[Floats, Floats]], tau: Floats
) -> tuple[Floats, Floats]:
    value, slope = decay(np.asarray(time / tau[:, None]))
    return value, -slope


def relaxation_curve(data: MaterialData) -> Callable[[Floats], tuple[Floats, Floats]]:
    """What is left of a branch's stress after the time s = t/τ since a step, and d/d ln s.

    At small strain exp(-s). At finite strain C_k goes from the unit tensor to C, and the stress
    from 1 to 0 somewhat faster: dC_k/ds = C - tr(C C_k⁻¹)/3 C_k.
    """
    if data.strain is None:
        return lambda s: (np.exp(-s), -s * np.exp(-s))
    strain = float(np.mean(data.strain))
    F = np.eye(3)
    if data.in_shear:
        F[0, 1] = strain
    else:
        F = np.diag(np.exp(strain * np.array([1.0, -0.5, -0.5])))
    C = F.T @ F
    step = np.linspace(math.log(1e-4), math.log(40.0), 400)

    def rate(_: float, flat: Floats) -> Floats:
        Ck = flat.reshape(3, 3)
        return np.asarray(C - np.trace(C @ np.linalg.inv(Ck)) / 3.0 * Ck).ravel()

    found = solve_ivp(
        rate, (0.0, math.exp(step[-1])), np.eye(3).ravel(), "LSODA", np.exp(step), rtol=1e-10,
        atol=1e-13,
    )  # fmt: skip
    b = F @ np.linalg.inv(found.y.T.reshape(-1, 3, 3)) @ F.T
    stress = b[:, 0, 1] if data.in_shear else b[:, 0, 0] - b[:, 1, 1]
    first = C[0, 1] if data.in_shear else C[0, 0] - C[1, 1]
    # Round-off is all that is left of it in the end; there its logarithm falls as -s does.
    known = stress / first > 1e-6
    u = step[known]
    curve = CubicSpline(u, np.log(stress[known] / first) / np.exp(u))

    def decay(s: Floats) -> tuple[Floats, Floats]:
        at = np.clip(np.log(np.maximum(s, 1e-300)), u[0], u[-1])
        per, slope = curve(at), curve(at, 1)
        within = (np.log(np.maximum(s, 1e-300)) < u[-1]) & (s > math.exp(u[0]))
        value = np.asarray(np.exp(per * s))
        return value, np.asarray(value * s * (per + np.where(within, slope, 0.0)))

    return decay


def _cycles(time: Floats, strain: Floats, area: Floats, tau: Floats) -> tuple[Floats, Floats]:
    """Uniaxial stress, and by differences its derivative for ln τ."""
    h = 1e-5
    three = np.concatenate([tau, tau * math.exp(h), tau * math.exp(-h)])
    stress = branch_stress(time, strain, three) * area
    k = len(tau)
    return stress[:k], np.asarray((stress[k : 2 * k] - stress[2 * k :]) / (2.0 * h))


def branch_stress(time: Floats, strain: Floats, tau: Floats) -> Floats:
    r"""True stress of branches of unit modulus in uniaxial cycles without change of volume.

    .. math:: \sigma = e^{2e} - e^{-e}, \quad \dot e = \dot\varepsilon - (e^{2e} - e^{-e})/(3\tau)

    with the branch's elastic logarithmic strain e: an exponential integrator of second order, exact
    at small strain. Before the first row the specimen was relaxed, without strain.

    Args:
        time: (n,), s, rising.
        strain: (n,), logarithmic; straight between the rows.
        tau: (k,), s.

    Returns:
        (k, n).
    """
    steps = np.maximum(np.ceil(np.abs(np.diff(strain)) / SMALL_STRAIN), 1.0).astype(int)
    dt, turn = np.diff(time) / steps, np.diff(strain) / steps
    e = np.full(len(tau), strain[0])
    out = [e]
    for n, h, d in zip(steps, dt, turn, strict=True):
        for _ in range(n):
            # Predictor, and corrector at the middle: exact were the rate of decay constant.
            a = _steepness(e) * (h / tau)
            guess = e * np.exp(-a) + d * _mean_decay(a)
            a = _steepness(0.5 * (e + guess)) * (h / tau)
            e = e * np.exp(-a) + d * _mean_decay(a)
        out.append(e)
    found = np.array(out).T
    return np.asarray(np.exp(2.0 * found) - np.exp(-found))


def _steepness(e: Floats) -> Floats:
    """(e^(2e) - e^(-e))/(3 e), 1 at e = 0."""
    small = np.abs(e) < 1e-5
    safe = np.where(small, 1.0, e)
    return np.where(small, 1.0 + 0.5 * e, (np.exp(2.0 * safe) - np.exp(-safe)) / (3.0 * safe))


def _mean_decay(a: Floats) -> Floats:
    """(1 - e^(-a))/a."""
    return np.asarray(-np.expm1(-a) / a)
