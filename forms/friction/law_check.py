r"""A friction law put to the test: its derivatives against differences, its dissipation against 0.

Points are chosen by the law's own scale: the slip s in which its traction stops to grow in
proportion, so that some stick, some slip, and many lie between, whatever the units. Each point has
a history of random steps, a direction of its own, and a pressure and film thickness of its own;
some are open. Differences are central ones of fourth order. Where those of two steps do not agree,
a kink is near (the onset of slip, the end of a transition): such a point says nothing and is left
out, which depends on the tractions alone and not on the derivatives that are tested.

Per point and step the work less what is stored must not be negative, and is what the law says it
dissipates:

.. math:: T \cdot \Delta g_T - (\psi_{n+1} - \psi_n) = \text{sum of the parts} \ge 0
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.law import FrictionLaw, FrictionResponse, FrictionState

Floats = NDArray[np.float64]
Traction = Callable[[Floats], Floats]

POINTS = 200
HISTORY, LONG_HISTORY = 4, 30  # steps before derivatives are compared, and of the dissipation
STEP = 1e-4  # of differences, relative to what is varied or the slip scale, whichever is less
TOLERANCE = 1e-6  # of derivatives, relative
AGREEMENT = 0.1 * TOLERANCE  # of the differences of two steps
FEWEST = 0.25  # share of the points that must be left to compare
ROUNDING = 1e-9  # of energies and equal answers, relative
OPEN = 0.1  # share of the points that are open
SIZES = np.geomspace(1e-16, 1.0, 97)  # m, slips at which the scale is looked for


@dataclass(frozen=True, slots=True)
class Conditions:
    """What a law is asked at."""

    pressure: float  # Pa, of which points have from a hundredth to three times
    film: float = 0.0  # m, thickness, of which points have from half to twice; 0 without a film
    steps: Sequence[float] = (1e-3, 1.0, 1e3)  # s, lengths of steps


@dataclass(slots=True)
class Finding:
    """What came of one comparison."""

    quantity: str  # that was compared
    allowed: float  # the largest error that passes
    asked: int = 0  # points
    compared: int = 0  # of these; not those near kinks
    worst: float = 0.0  # largest error, relative
    where: str = ""  # the largest error is, in words

    @property
    def good(self) -> bool:
        """Whether enough was compared, and nothing was wrong."""
        return self.worst <= self.allowed and self.compared >= FEWEST * self.asked

    def add(
        self, error: Floats, where: Callable[[int], str], used: NDArray[np.bool_] | None = None
    ) -> None:
        """Enter relative errors (q,), at the points that are used (default all)."""
        used = np.ones(len(error), dtype=np.bool_) if used is None else used
        self.asked += len(used)
        self.compared += int(used.sum())
        # An answer that is no number is as wrong as can be, and not one to be passed over.
        errors = np.where(used, np.nan_to_num(error, nan=np.inf), 0.0)
        q = int(np.argmax(errors))
        if errors[q] > self.worst:
            self.worst, self.where = float(errors[q]), where(q)


@dataclass(slots=True)
class _Sample:
    """Points at which a law is asked, and how."""

    slip: Floats
    dt: float
    pressure: Floats
    film: Floats
    state: FrictionState
    scale: Floats  # m, of the slip
    options: dict[str, Any]

    def ask(self, law: FrictionLaw, **other: Any) -> FrictionResponse:
        """The law's answer, with other values for some of what it is asked."""
        now = replace(self, **other)
        return law.update(now.slip, now.dt, now.pressure, now.film, now.state, **now.options)

    def where(self, q: int) -> str:
        """A point in words."""
        rates = "" if self.options["rate_dependent"] else " without rates"
        return (
            f"{self.slip.shape[1]}D, dt {self.dt:.3g} s{rates}, slip "
            f"{np.linalg.norm(self.slip[q]):.3g} m, pressure {self.pressure[q]:.3g} Pa, film "
            f"{self.film[q]:.3g} m"
        )


class _Findings(dict[str, Finding]):
    """The findings by quantity, in the order in which they come up."""

    def of(self, quantity: str, allowed: float) -> Finding:
        return self.setdefault(quantity, Finding(quantity, allowed))


def check_law(law: FrictionLaw, at: Conditions, seed: int = 0) -> list[Finding]:
    """Compare a law with what every friction law must hold to, in the plane and in space.

    Returns:
        What was compared. Derivatives for the film's thickness only where there is a film.
    """
    rng, findings = np.random.default_rng(seed), _Findings()
    for dim in (2, 3):
        for dt, rates in [*((dt, True) for dt in at.steps), (1.0, False)]:
            sample = _sample(law, at, dim, dt, rates, rng)
            for _ in range(HISTORY):
                sample.state = sample.ask(law).state
                _draw(sample, at, rng)
            _compare_derivatives(law, sample, findings)
            _compare_alone(law, sample, findings)
            _compare_dissipation(law, sample, at, rng, findings)
    return list(findings.values())


# -- points ---------------------------------------------------------------------------------------


def _sample(
    law: FrictionLaw, at: Conditions, dim: int, dt: float, rates: bool, rng: np.random.Generator
) -> _Sample:
    """Points without history, with their scales of slip."""
    options: dict[str, Any] = {"rate_dependent": rates, "area_ratio": rng.uniform(0.9, 1.1, POINTS)}
    if getattr(law, "takes_film_cover", False):
        options["film_cover"] = rng.uniform(0.5, 1.0, POINTS)
    none, state = np.zeros((POINTS, dim)), law.initial_state(POINTS, dim)
    pressure, film = np.full(POINTS, at.pressure), np.full(POINTS, at.film)
    sample = _Sample(none, dt, pressure, film, state, np.ones(POINTS), options)
    # Slip (q,), m, at which the traction is half of what its first slope would give: laws may stick
    # over a fraction of a nanometre or over a millimetre, and only near that do they bend.
    secant = np.empty((len(SIZES), POINTS))
    slip = np.zeros_like(sample.slip)
    for row, size in enumerate(SIZES):
        slip[:, 0] = size
        secant[row] = sample.ask(law, slip=slip).traction[:, 0] / size
    fallen = secant < 0.5 * secant[0]
    first = np.argmax(fallen, axis=0)
    # Where it never falls, as of a film alone, any slip is as good as another.
    sample.scale = np.where(fallen.any(axis=0), SIZES[first], 1e-6)
    _draw(sample, at, rng)
    return sample


def _draw(sample: _Sample, at: Conditions, rng: np.random.Generator) -> None:
    """Slips, pressures and films anew, for the next step."""
    direction = rng.normal(size=sample.slip.shape)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    size = sample.scale * 10.0 ** rng.uniform(-2.0, 2.0, POINTS)
    sample.slip = size[:, None] * direction
    pressure = at.pressure * 10.0 ** rng.uniform(-2.0, 0.5, POINTS)
    sample.pressure = np.where(rng.random(POINTS) < OPEN, 0.0, pressure)
    sample.film = at.film * 2.0 ** rng.uniform(-1.0, 1.0, POINTS)


# -- derivatives ----------------------------------------------------------------------------------


def _compare_derivatives(law: FrictionLaw, sample: _Sample, findings: _Findings) -> None:
    """All derivatives of the traction that a law gives, and what it does to its argument."""
    before = sample.state.copy()
    response = sample.ask(law)
    _compare_state(sample, before, findings)
    # An error counts beside the derivative or, where that vanishes, beside traction over length:
    # a law of constant traction is not wrong by rounding over nothing.
    size = np.linalg.norm(response.traction, axis=1)
    length = np.maximum(np.linalg.norm(sample.slip, axis=1), sample.scale)
    step = STEP * np.minimum(np.linalg.norm(sample.slip, axis=1), sample.scale)
    closed = sample.pressure > 0.0
    every = np.ones(POINTS, dtype=np.bool_)
    for name in ("slip", "elastic"):
        exact = getattr(response, f"d_traction_d_{name}")
        directions: Floats = np.eye(sample.slip.shape[1])
        for j in range(len(directions)):
            traction = _varied(law, sample, name, directions[j])
            finding = findings.of(f"d_traction_d_{name}", TOLERANCE)
            _enter(finding, exact[:, :, j], traction, step, size / length, every, sample)
    for name, value in (("pressure", sample.pressure), ("film", sample.film)):
        used = closed & (value > 0.0)
        if not used.any():
            continue
        safe = np.where(used, value, 1.0)
        exact = getattr(response, f"d_traction_d_{name}")
        traction = _varied(law, sample, name, used.astype(np.float64))
        finding = findings.of(f"d_traction_d_{name}", TOLERANCE)
        _enter(finding, exact, traction, STEP * safe, size / safe, used, sample)


def _varied(law: FrictionLaw, sample: _Sample, name: str, along: Floats) -> Traction:
    """The tractions (q, i) over a change (q,) of what the law is asked with."""

    def traction(h: Floats) -> Floats:
        if name in ("pressure", "film"):  # ``along``: (q,) 1 where it varies, or would leave 0
            return sample.ask(law, **{name: getattr(sample, name) + h * along}).traction
        moved = h[:, None] * along  # (i,) a direction
        if name == "slip":
            return sample.ask(law, slip=sample.slip + moved).traction
        elastic = sample.state.elastic_slip + moved
        return sample.ask(law, state=replace(sample.state, elastic_slip=elastic)).traction

    return traction


def _enter(
    finding: Finding,
    exact: Floats,
    traction: Traction,
    step: Floats,
    floor: Floats,
    asked: NDArray[np.bool_],
    sample: _Sample,
) -> None:
    """Compare derivatives (q, i) for one number with differences of the tractions."""
    coarse, fine = _difference(traction, step), _difference(traction, 0.25 * step)
    size = np.maximum(np.maximum(np.abs(exact).max(axis=1), np.abs(fine).max(axis=1)), floor)
    size = np.where(size > 0.0, size, 1.0)
    smooth = np.abs(coarse - fine).max(axis=1) <= AGREEMENT * size
    smooth |= ~np.isfinite(exact).all(axis=1)  # those are wrong wherever they are
    rows = np.nonzero(asked)[0]
    error = np.abs(exact - fine).max(axis=1) / size
    finding.add(error[rows], lambda q: sample.where(int(rows[q])), smooth[rows])


def _difference(traction: Traction, h: Floats) -> Floats:
    """Central difference of fourth order, (q, i)."""
    near, far = traction(h) - traction(-h), traction(2.0 * h) - traction(-2.0 * h)
    return (8.0 * near - far) / (12.0 * h[:, None])


# -- everything else ------------------------------------------------------------------------------


def _compare_state(sample: _Sample, before: FrictionState, findings: _Findings) -> None:
    """The state that a law is given stays as it was: a step may be rejected."""
    now, then = sample.state.arrays(), before.arrays()
    changed = np.zeros(POINTS)
    for name, values in then.items():
        different = (now[name] != values).reshape(POINTS, -1)
        changed = np.maximum(changed, different.any(axis=1))
    findings.of("state passed in, changed", 0.0).add(changed, sample.where)


def _compare_alone(law: FrictionLaw, sample: _Sample, findings: _Findings) -> None:
    """A point's answer is its own: it does not depend on which points are asked together."""
    # Ranks and chunks of cells ask for other groups of points: a law that averages, or decides by
    # any point for all, would give results that depend on them.
    some = np.arange(0, POINTS, 7)
    options = {k: v[some] if isinstance(v, np.ndarray) else v for k, v in sample.options.items()}
    alone = law.update(
        *(sample.slip[some], sample.dt, sample.pressure[some], sample.film[some]),
        sample.state.take(some),
        **options,
    ).traction
    together = sample.ask(law).traction[some]
    size = np.abs(together).max(axis=1)
    error = np.abs(alone - together).max(axis=1) / np.where(size > 0.0, size, 1.0)
    finding = findings.of("traction among other points", ROUNDING)
    finding.add(error, lambda q: sample.where(int(some[q])))


def _compare_dissipation(
    law: FrictionLaw, sample: _Sample, at: Conditions, rng: np.random.Generator, findings: _Findings
) -> None:
    """What is lost in the steps of a random history, and what the law says is lost."""
    least = findings.of("dissipation, below 0", ROUNDING)
    parts = findings.of("dissipation, its parts", ROUNDING)
    for work, said, size in _losses(law, sample, at, rng):
        size = np.where(size > 0.0, size, 1.0)
        least.add(np.maximum(-work / size, 0.0), sample.where)
        parts.add(np.abs(work - said) / size, sample.where)


def _losses(
    law: FrictionLaw, sample: _Sample, at: Conditions, rng: np.random.Generator
) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Work less storage, the law's sum of parts, and the size of the terms; each (q,), J/m²."""
    for _ in range(LONG_HISTORY):
        _draw(sample, at, rng)
        response = sample.ask(law)
        work = np.einsum("qi,qi->q", response.traction, sample.slip)
        before, after = law.stored_energy(sample.state), law.stored_energy(response.state)
        size = np.abs(work) + np.abs(before) + np.abs(after)
        yield work - (after - before), response.dissipation.total, size
        sample.state = response.state
