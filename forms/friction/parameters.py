r"""Parameters of the friction-map law, validated, and its named presets."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

from tribox.forms.friction.film_rheology import FilmRheology
from tribox.forms.friction.parameter_checks import (
    refusal,
    require_above,
    require_at_least,
    require_choice,
)
from tribox.forms.friction.slip_weakening import SlipWeakening

Table = tuple[tuple[float, float], ...]
FlowRule = Literal["weighted", "literal"]
Reentry = Literal["consistent", "literal"]
Switch = Literal["implicit", "lagged"]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionMapParameters:
    r"""Parameters of the friction-map law, SI units.

    Exactly one of ``alpha`` and ``beta``, and exactly one of ``gamma`` and ``V_star`` is given.

    Attributes:
        mu_s: Static coefficient of friction, >= 0.
        mu_d: Dynamic coefficient of friction, 0 <= mu_d <= mu_s; None: equal to mu_s.
        A_d: m, permanent slip at which the weakening starts, >= 0.
        B: 1/m, rate of the weakening, >= 0.
        K_T: Pa/m, elastic tangential stiffness of the asperities, > 0.
        eta_b: Pa s, viscosity of the lubricant in bulk, >= 0 (> 0 where there is a film).
        D_min: m, film thickness up to which there is dry friction, >= 0.
        D_max: m, film thickness from which the film is a Newtonian fluid, > D_min.
        alpha: Film fraction below the threshold speed, in [0, 1]; or a table of (D in m, alpha),
            linear between its rows and constant outside.
        beta: Exponent > 0 of alpha = ((D - D_min)/(D_max - D_min))^beta; or a table of
            (D in m, beta), linear in the logarithms of both and constant outside.
        gamma: N/s, sets the threshold speed V*(D) = sqrt(gamma D_max/(eta_b D)), > 0.
        V_star: m/s, threshold speed at the film thickness V_star_at, > 0 (inf: no switch).
        V_star_at: m, > 0, required with V_star.
        transition_width: w >= 0, < 1: alpha rises from its value at rest to 1 between V*(1 - w)
            and V*(1 + w).
        flow_rule: "weighted": the threshold is (1 - alpha) mu t_N; "literal": mu t_N.
        reentry: "consistent": where alpha falls the elastic traction is kept; "literal": the
            elastic slip is kept always, which can break the second law.
        switch: "implicit": alpha from the speed of the step; "lagged": from the speed of the last
            converged step.
        reset_slip_on_opening: Whether the slip path of an opening point is set to zero.
        film_onset_pressure: Pa, >= 0, contact pressure up to which the film's stress grows in
            proportion to the pressure; beyond, it is whole. 0: whole as soon as there is contact,
            so that the traction jumps where a point opens.
        tau_0: Pa, >= 0, limiting shear stress of the film at no pressure; None: no limit.
        zeta: Growth of the limiting shear stress with the pressure, >= 0; needs ``tau_0``.
        critical_rate: 1/s, > 0, shear rate from which the film thins (Carreau); None: it does not.
        thinning_exponent: n in [0, 1] of the thinning, required with ``critical_rate``.
        eta_inf: Pa s, viscosity of the film at infinite shear rate, 0 <= eta_inf <= eta_b.
        barus: 1/Pa, >= 0, coefficient a of eta_b exp(a p) (Barus).

    Raises:
        ValueError: A value is not allowed; the message names field, value and what is allowed.
    """

    mu_s: float
    mu_d: float | None = None
    A_d: float = 0.0
    B: float = 0.0
    K_T: float
    eta_b: float = 0.0
    D_min: float = 0.0
    D_max: float
    alpha: float | Table | None = None
    beta: float | Table | None = None
    gamma: float | None = None
    V_star: float | None = None
    V_star_at: float | None = None
    transition_width: float = 0.03
    flow_rule: FlowRule = "weighted"
    reentry: Reentry = "consistent"
    switch: Switch = "implicit"
    reset_slip_on_opening: bool = False
    film_onset_pressure: float = 0.0
    tau_0: float | None = None
    zeta: float = 0.0
    critical_rate: float | None = None
    thinning_exponent: float | None = None
    eta_inf: float = 0.0
    barus: float = 0.0

    def __post_init__(self) -> None:
        require_at_least("mu_s", self.mu_s, 0.0)
        require_at_least("mu_d", self.mu_dynamic, 0.0)
        if self.mu_dynamic > self.mu_s:
            raise refusal("mu_d", self.mu_d, f"a number up to mu_s = {self.mu_s!r}")
        require_at_least("A_d", self.A_d, 0.0)
        require_at_least("film_onset_pressure", self.film_onset_pressure, 0.0)
        require_at_least("B", self.B, 0.0)
        require_above("K_T", self.K_T, 0.0)
        require_at_least("eta_b", self.eta_b, 0.0)
        require_at_least("D_min", self.D_min, 0.0)
        require_above("D_max", self.D_max, self.D_min, "D_min = ")
        require_at_least("transition_width", self.transition_width, 0.0)
        if self.transition_width >= 1.0:
            raise refusal("transition_width", self.transition_width, "a number in [0, 1)")
        require_choice("flow_rule", self.flow_rule, ("weighted", "literal"))
        require_choice("reentry", self.reentry, ("consistent", "literal"))
        require_choice("switch", self.switch, ("implicit", "lagged"))
        self._check_film_fraction()
        self._check_threshold_speed()
        _ = self.rheology  # checks its own parameters

    def _check_film_fraction(self) -> None:
        _require_one_of("alpha", self.alpha, "beta", self.beta)
        if self.alpha is not None:
            object.__setattr__(self, "alpha", _numbers("alpha", self.alpha))
            for value in _values(self.alpha):
                if not 0.0 <= value <= 1.0:
                    raise refusal("alpha", value, "a number in [0, 1]")
        else:
            assert self.beta is not None
            object.__setattr__(self, "beta", _numbers("beta", self.beta))
            for value in _values(self.beta):
                require_above("beta", value, 0.0)

    def _check_threshold_speed(self) -> None:
        _require_one_of("gamma", self.gamma, "V_star", self.V_star)
        if self.gamma is not None:
            require_above("gamma", self.gamma, 0.0)
            if self.V_star_at is not None:
                raise refusal("V_star_at", self.V_star_at, "nothing, as gamma is given")
            if self.eta_b == 0.0:
                raise refusal("eta_b", self.eta_b, "a finite number above 0 with gamma")
        elif self.V_star is not None:
            if not self.V_star > 0.0:
                raise refusal("V_star", self.V_star, "a number above 0")
            if self.V_star_at is None:
                raise refusal("V_star_at", None, "a film thickness above 0 with V_star")
            require_above("V_star_at", self.V_star_at, 0.0)

    @property
    def mu_dynamic(self) -> float:
        """mu_d, or mu_s where mu_d is not given."""
        return self.mu_s if self.mu_d is None else self.mu_d

    @property
    def friction(self) -> SlipWeakening:
        """The coefficient of friction as a function of the slip path."""
        return SlipWeakening(mu_s=self.mu_s, mu_d=self.mu_dynamic, A_d=self.A_d, B=self.B)

    @property
    def rheology(self) -> FilmRheology:
        """How the film flows."""
        return FilmRheology(
            eta_b=self.eta_b,
            tau_0=self.tau_0,
            zeta=self.zeta,
            critical_rate=self.critical_rate,
            thinning_exponent=self.thinning_exponent,
            eta_inf=self.eta_inf,
            barus=self.barus,
        )

    @property
    def threshold_constant(self) -> float:
        r"""V*^2 D, m^3/s^2, the same at every film thickness: gamma D_max/eta_b."""
        if self.gamma is not None:
            return self.gamma * self.D_max / self.eta_b
        assert self.V_star is not None and self.V_star_at is not None
        return self.V_star**2 * self.V_star_at


def _require_one_of(first: str, a: object, second: str, b: object) -> None:
    if (a is None) == (b is None):
        given = "neither" if a is None else "both"
        raise ValueError(f"{first}, {second}: give exactly one of the two, got {given}")


def _numbers(name: str, value: Any) -> float | Table:
    """A number, or a table as tuples, whose film thicknesses must be positive and rise."""
    if not isinstance(value, list | tuple):
        return float(value)
    if not value or any(not isinstance(row, list | tuple) or len(row) != 2 for row in value):
        raise refusal(name, value, "a number or a table of (film thickness, value)")
    table = tuple((float(film), float(entry)) for film, entry in value)
    films = [film for film, _ in table]
    if films[0] <= 0.0 or any(b <= a for a, b in itertools.pairwise(films)):
        raise refusal(name, value, "a table whose film thicknesses are above 0 and rise")
    return table


def _values(number_or_table: float | Table) -> list[float]:
    if isinstance(number_or_table, tuple):
        return [value for _, value in number_or_table]
    return [number_or_table]


_PAPER: dict[str, Any] = {
    "eta_b": 0.8,
    "D_min": 0.0,
    "D_max": 250e-9,
    "gamma": 4.0e-25,
    "transition_width": 0.0,
    "flow_rule": "literal",
    "reentry": "literal",
    "switch": "implicit",
}

PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        # Everything as printed, with the exponents as printed for 10, 30 and 180 nm.
        "paper-printed": MappingProxyType(
            {**_PAPER, "beta": ((10e-9, 1.0), (30e-9, 0.01), (180e-9, 1e-5))}
        ),
        # The last two exponents exchanged: they then give the printed alpha, for the other D.
        "paper-swapped": MappingProxyType(
            {**_PAPER, "beta": ((10e-9, 1.0), (30e-9, 1e-5), (180e-9, 0.01))}
        ),
        # The law as this program interprets it, with the printed alpha. The threshold speed is left
        # to the user: the printed gamma puts it below anything that can be resolved.
        "friction-map": MappingProxyType(
            {
                "eta_b": 0.8,
                "D_min": 0.0,
                "D_max": 250e-9,
                "alpha": ((10e-9, 0.039), (30e-9, 0.9967), (180e-9, 0.9999)),
                "transition_width": 0.03,
                "flow_rule": "weighted",
                "reentry": "consistent",
                "switch": "implicit",
            }
        ),
    }
)
"""Printed values of Luege & Luccioni by name (SI). What is not printed there (mu_s, mu_d, A_d, B,
K_T) is in none of them; "friction-map" also leaves the threshold speed (V_star or gamma) open."""


def with_preset(name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values over a preset's, for ``FrictionMapParameters(**...)``.

    A given alpha replaces the preset's beta and the other way round; likewise V_star and gamma.

    Args:
        name: One of ``PRESETS``.
        values: Fields given by the user; None counts as not given.

    Raises:
        ValueError: There is no such preset.
    """
    if name not in PRESETS:
        raise refusal("preset", name, " or ".join(repr(known) for known in PRESETS))
    given = {key: value for key, value in values.items() if value is not None}
    merged = dict(PRESETS[name])
    for group in ({"alpha", "beta"}, {"gamma", "V_star", "V_star_at"}):
        if group & given.keys():
            for key in group:
                merged.pop(key, None)
    return merged | given
