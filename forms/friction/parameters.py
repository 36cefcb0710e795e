r"""Parameters of the friction-map law, validated, and its named presets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

from tribox.forms.friction.film_rheology import FilmRheology
from tribox.forms.friction.return_mapping import SlipWeakening
from tribox.forms.parameters import Bounds, Refused, Scales, parameter

Table = tuple[tuple[float, float], ...]
FlowRule = Literal["weighted", "literal"]
Reentry = Literal["consistent", "literal"]
Switch = Literal["implicit", "lagged"]

_THICKNESS = Bounds("m", gt=0.0, name="film thickness")
FILM_ONSET = 0.01  # share of G or pressure below which the film's stress grows: only the rim's


def _onset(scales: Scales) -> float:
    """Pa. A pressure that the case prescribes says better than the body what is small."""
    return FILM_ONSET * min(scales.modulus, scales.pressure or float("inf"))


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionMapParameters(FilmRheology):
    """Friction of a lubricated contact between Coulomb and viscous, by film and velocity.

    Exactly one of ``alpha`` and ``beta``, and exactly one of ``gamma`` and ``V_star`` is given;
    the film flows as `FilmRheology` says. SI units.

    Raises:
        tribox.forms.parameters.Refused: A value is not allowed; the message names field, value and
            what is allowed.
    """

    mu_s: float = parameter("static coefficient of friction", ge=0.0)
    mu_d: float | None = parameter(
        "dynamic coefficient of friction; default: mu_s", ge=0.0, default=None, same_as="mu_s"
    )
    A_d: float = parameter(
        "slip at which the fall from mu_s to mu_d starts", "m", ge=0.0, default=0.0
    )
    B: float = parameter("rate of the fall from mu_s to mu_d with slip", "1/m", ge=0.0, default=0.0)
    K_T: float = parameter("tangential stiffness of the asperities", "Pa/m", gt=0.0)
    eta_b: float = parameter(
        "bulk viscosity of the film; needed (> 0) where D > D_min", "Pa*s", ge=0.0, default=0.0
    )
    D_min: float = parameter(
        "thickness up to which friction is purely Coulomb", "m", ge=0.0, default=0.0
    )
    D_max: float = parameter("thickness from which the film is a Newtonian fluid", "m", gt=0.0)
    alpha: float | Table | None = parameter(
        "film fraction below the switching velocity V*, a number or a table "
        "[[thickness, alpha], ...], linear between its rows (this or beta)",
        ge=0.0,
        le=1.0,
        default=None,
        over=_THICKNESS,
    )
    beta: float | Table | None = parameter(
        "exponent of alpha = ((D - D_min)/(D_max - D_min))^beta, a number or a table "
        "[[thickness, beta], ...], linear in the logarithms of both (this or alpha)",
        gt=0.0,
        default=None,
        over=_THICKNESS,
    )
    V_star: float | None = parameter(
        "switching velocity V* at the thickness V_star_at (or gamma)",
        "m/s",
        gt=0.0,
        infinite=True,  # no switch
        default=None,
    )
    V_star_at: float | None = parameter(
        "thickness at which V_star holds", "m", gt=0.0, default=None
    )
    gamma: float | None = parameter(
        "constant of V* = sqrt(gamma D_max/(eta_b D)) (or V_star)", "N/s", gt=0.0, default=None
    )
    transition_width: float = parameter(
        "width of the transition at V*, relative to V*", ge=0.0, lt=1.0, default=0.03
    )
    flow_rule: FlowRule = parameter(
        "friction threshold (1 - alpha) mu p, or mu p as printed", default="weighted"
    )
    reentry: Reentry = parameter(
        "what is kept when alpha falls: the traction, or the elastic slip (which can break the "
        "second law)",
        default="consistent",
    )
    switch: Switch = parameter(
        "alpha from the velocity of this step, or of the last one", default="implicit"
    )
    reset_slip_on_opening: bool = parameter(
        "whether a point that opens forgets the slip it has made", default=False
    )
    film_onset_pressure: float = parameter(
        "contact pressure up to which the film's stress grows with the pressure; 0 lets the "
        "traction jump where a point opens; default: 1 % of the softer body's shear modulus or of "
        "the highest prescribed pressure, whichever is less",
        "Pa",
        ge=0.0,
        default=0.0,
        follows=_onset,
    )

    def faults(self) -> Iterator[Refused]:
        """Values that do not fit together."""
        if self.mu_d is not None and self.mu_d > self.mu_s:
            yield Refused("mu_d", f"must be <= mu_s = {self.mu_s:g}", self.mu_d)
        if self.D_max <= self.D_min:
            yield Refused("D_max", f"must be > D_min = {self.D_min:g} m", self.D_max)
        if (self.alpha is None) == (self.beta is None):
            found = "neither" if self.alpha is None else "both"
            yield Refused("", f"give either alpha or beta, found {found}")
        if (self.V_star is None) == (self.gamma is None):
            found = "neither" if self.gamma is None else "both"
            yield Refused("", f"give either V_star (with V_star_at) or gamma, found {found}")
        if self.V_star is not None and self.V_star_at is None:
            yield Refused("V_star_at", 'missing; the thickness at which V_star holds, "10 nm" say')
        if self.V_star is None and self.V_star_at is not None:
            yield Refused("V_star_at", "belongs to V_star, which is not given", self.V_star_at)
        if self.gamma is not None and self.eta_b == 0.0:
            yield Refused("eta_b", "must be > 0 Pa*s with gamma", self.eta_b)
        yield from FilmRheology.faults(self)

    @property
    def mu_dynamic(self) -> float:
        """mu_d, or mu_s where mu_d is not given."""
        return self.mu_s if self.mu_d is None else self.mu_d

    @property
    def friction(self) -> SlipWeakening:
        """The coefficient of friction as a function of the slip path."""
        return SlipWeakening(mu_s=self.mu_s, mu_d=self.mu_dynamic, A_d=self.A_d, B=self.B)

    @property
    def threshold_constant(self) -> float:
        r"""V*^2 D, m^3/s^2, the same at every film thickness: gamma D_max/eta_b."""
        if self.gamma is not None:
            return self.gamma * self.D_max / self.eta_b
        assert self.V_star is not None and self.V_star_at is not None
        return self.V_star**2 * self.V_star_at


_PAPER: dict[str, Any] = {
    **{"eta_b": 0.8, "D_min": 0.0, "D_max": 250e-9, "gamma": 4.0e-25, "transition_width": 0.0},
    **{"flow_rule": "literal", "reentry": "literal", "switch": "implicit"},
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
                **{"eta_b": 0.8, "D_min": 0.0, "D_max": 250e-9, "transition_width": 0.03},
                "alpha": ((10e-9, 0.039), (30e-9, 0.9967), (180e-9, 0.9999)),
                **{"flow_rule": "weighted", "reentry": "consistent", "switch": "implicit"},
            }
        ),
    }
)
"""Printed values of Luege & Luccioni by name (SI). What is not printed there (mu_s, mu_d, A_d, B,
K_T) is in none of them; "friction-map" also leaves the threshold speed (V_star or gamma) open."""


def with_preset(name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values over a preset's, for ``FrictionMapParameters(**...)``; ValueError if there is none.

    A given alpha replaces the preset's beta, likewise V_star and gamma; None is not given.
    """
    if name not in PRESETS:
        raise Refused("preset", f"must be {' or '.join(map(repr, PRESETS))}", name)
    given = {key: value for key, value in values.items() if value is not None}
    merged = dict(PRESETS[name])
    for group in ({"alpha", "beta"}, {"gamma", "V_star", "V_star_at"}):
        if group & given.keys():
            for key in group:
                merged.pop(key, None)
    return merged | given
