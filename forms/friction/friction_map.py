r"""The friction-map law: Coulomb friction of asperities beside a lubricating film.

After Luege & Luccioni, *Finite strain model for elastomer-aluminium contact interface in forming
processes*. Per point and step, with slip :math:`\Delta g_T`, elastic slip :math:`g_e`, film
fraction :math:`\alpha(D, V)`, :math:`V = |\Delta g_T|/\Delta t`, pressure :math:`t_N`:

.. math::
   r = \min\{1, (1 - \alpha_{old})/(1 - \alpha)\}, \quad p = r g_e + \Delta g_T, \quad
   k = (1 - \alpha) K_T

   T = T^e + \alpha \frac{\eta_b}{D} \frac{da}{dA} \frac{\Delta g_T}{\Delta t}, \qquad
   T^e = k\, g_{e,new}, \quad |T^e| \le \omega\, \mu(d)\, t_N

with :math:`\omega = 1 - \alpha` (weighted flow rule) or 1 (literal). The factor r keeps the
elastic traction where alpha falls, so that the energy it releases is never negative; the literal
re-entry rule has r = 1. Options of the film's flow: :mod:`tribox.forms.friction.film_rheology`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.film import (
    FilmPoint,
    FilmResistance,
    film_point,
    film_resistance,
)
from tribox.forms.friction.law import (
    SETTLED,
    Dissipation,
    FrictionResponse,
    FrictionState,
    Regime,
    require_time_step,
)
from tribox.forms.friction.parameters import FrictionMapParameters
from tribox.forms.friction.return_mapping import (
    TINY,
    Returned,
    SlipWeakening,
    components_first,
    dot,
    return_mapping,
)
from tribox.forms.friction.slowing import Motion, Slowing, slowing

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Step:
    """Intermediate quantities of one step of the law; vectors are (i, q)."""

    slip: Floats
    elastic_before: Floats
    closed: NDArray[np.bool_]
    at: FilmPoint
    kept: Floats | float
    """r, the part of the elastic slip that is kept."""
    d_kept: Floats | None
    """Derivative of r for alpha, None where it is zero at all points."""
    weight: Floats | float
    """Omega of the flow rule."""
    trial: Floats
    """Trial elastic slip p."""
    returned: Returned
    resistance: Floats
    """(q,), Pa/m, film traction per slip of the step: alpha f."""
    flow: FilmResistance
    """f: the same for alpha = 1, with its derivatives."""
    slowed: Slowing | None = None
    """Points that slowed down through V*, and whose asperities are held back."""
    held_back: Floats | None = None
    """(q,), Pa, by how much."""


@dataclass(frozen=True, slots=True)
class FrictionMap:
    """The friction-map law (a ``FrictionLaw``).

    Attributes:
        parameters: Its parameters.
        takes_film_cover: That ``update`` takes the share of the area that is wet.
        looks_inside: That it looks into the step, and takes ``look_inside=False`` for a short one.
    """

    takes_film_cover: ClassVar[bool] = True
    looks_inside: ClassVar[bool] = True
    parameters: FrictionMapParameters
    _friction: SlipWeakening = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_friction", self.parameters.friction)

    def initial_state(self, n: int, dim: int) -> FrictionState:
        """State of n points that have never been in contact, in dim space dimensions."""
        return FrictionState.zeros(n, dim)

    def stored_energy(self, state: FrictionState) -> Floats:
        """Elastic energy of the slip, psi = (1 - alpha)/2 K_T |g_e|^2, (q,), J/m^2."""
        g = state.elastic_slip.T
        return 0.5 * self.parameters.K_T * (1.0 - state.alpha) * dot(g, g)

    def coefficient(self, state: FrictionState) -> Floats:
        """mu(d) at the slip path reached, (q,)."""
        return self._friction.coefficient(state.slip_path)

    @property
    def settling_slip(self) -> float:
        """Slip from which on mu(d) is within ``SETTLED`` of where it tends, m."""
        return self._friction.settling_slip(SETTLED * self._friction.mu_d)

    def unsettled(self, state: FrictionState, pressure: Floats) -> Floats:
        r"""What asperities have still to lose, :math:`\omega (\mu(d) - \mu_d) t_N`, (q,), Pa."""
        solid = 1.0 - state.alpha
        # The literal rule has ω = 1 as long as there are asperities at all.
        weight = np.sign(solid) if self.parameters.flow_rule == "literal" else solid
        return weight * self._friction.above_end(state.slip_path) * pressure

    def presliding_length(self, state: FrictionState, pressure: Floats) -> Floats:
        r"""Elastic slip of sliding asperities, :math:`\mu t_N/K_T`, (q,), m.

        Under the literal flow rule it is :math:`\mu t_N/((1 - \alpha) K_T)`.
        """
        length = self.coefficient(state) * pressure / self.parameters.K_T
        solid = 1.0 - state.alpha
        if self.parameters.flow_rule == "literal":
            return np.divide(length, solid, out=np.zeros_like(length), where=solid > 0.0)
        return np.where(solid > 0.0, length, 0.0)

    def update(
        self,
        slip_increment: Floats,
        dt: Floats | float,
        pressure: Floats,
        film: Floats,
        state: FrictionState,
        *,
        area_ratio: Floats | float = 1.0,
        film_cover: Floats | float = 1.0,
        rate_dependent: bool = True,
        look_inside: bool = True,
    ) -> FrictionResponse:
        """Traction, derivatives and trial state of one step; see ``FrictionLaw.update``.

        The step may have another length ``dt`` (q,) at each point.

        With ``rate_dependent=False`` the film carries no stress and alpha is that of V = 0.
        """
        require_time_step(dt, rate_dependent)
        area = area_ratio, film_cover
        step = self._solve(slip_increment, dt, pressure, film, state, area, rate_dependent)
        if rate_dependent and look_inside:
            step = _held_back(step, self._slowing(step, state, dt, pressure, film, area))
        new = self._new_state(step, state, dt, rate_dependent)
        traction = step.weight * step.returned.secant * step.trial
        traction += step.resistance * step.slip
        d_slip, d_elastic, d_film = self._derivatives(step, dt)
        d_pressure = step.weight * step.returned.d_pressure * step.returned.direction
        if step.slowed is not None:
            self._add_held_back(step, step.slowed, dt, (d_slip, d_elastic, d_pressure, d_film))
        if step.flow.d_pressure is not None:
            d_pressure += (step.at.alpha * step.flow.d_pressure) * step.slip
        # Inside components come first, so that numpy's loops run along the points; outside last.
        return FrictionResponse(
            traction=traction.T,
            d_traction_d_slip=d_slip.transpose(2, 0, 1),
            d_traction_d_elastic=d_elastic.transpose(2, 0, 1),
            d_traction_d_pressure=d_pressure.T,
            d_traction_d_film=d_film.T,
            state=new,
            regime=_regime(step),
            dissipation=self._dissipation(step, state),
            held_back=step.held_back,
        )

    def _solve(
        self,
        slip_increment: Floats,
        dt: Floats | float,
        pressure: Floats,
        film: Floats,
        state: FrictionState,
        area: tuple[Floats | float, Floats | float],
        rate_dependent: bool,
    ) -> _Step:
        """Film fraction, re-entry and return mapping; ``area``: area ratio and cover."""
        parameters = self.parameters
        closed = pressure > 0.0
        slip = _where_closed(slip_increment, closed)
        before = _where_closed(state.elastic_slip, closed)
        film = _shortened(film)
        at = film_point(parameters, film, self._speed(slip, dt, state, rate_dependent))
        kept, d_kept = self._kept(at, state)
        literal = parameters.flow_rule == "literal"
        trial = kept * before + slip
        returned = return_mapping(
            trial,
            parameters.K_T * at.solid if literal else parameters.K_T,
            pressure,
            state.slip_path,
            self._friction,
        )
        # In an infinite step the film is not sheared at any rate: it carries no stress.
        length, felt = np.sqrt(dot(slip, slip)), dt if rate_dependent else math.inf
        flow = film_resistance(parameters, film, length, felt, pressure, *area)
        return _Step(
            slip=slip,
            elastic_before=before,
            closed=closed,
            at=at,
            kept=kept,
            d_kept=d_kept,
            weight=1.0 if literal else at.solid,
            trial=trial,
            returned=returned,
            resistance=at.alpha * flow.value,
            flow=flow,
        )

    def _slowing(
        self,
        step: _Step,
        state: FrictionState,
        dt: Floats | float,
        pressure: Floats,
        film: Floats,
        area: tuple[Floats | float, Floats | float],
    ) -> Slowing | None:
        """The points that slow down through V*, where the law looks into the step."""
        if self.parameters.switch == "lagged" or self.parameters.reentry == "literal":
            return None
        motion = Motion(
            length=np.sqrt(dot(step.slip, step.slip)),
            dt=dt,
            speed_before=state.speed,
            solid_before=1.0 - state.alpha,
            bend=np.sqrt(dot(step.elastic_before, step.elastic_before)),
            pressure=pressure,
            film=_shortened(film),
            area_ratio=area[0],
            cover=area[1],
        )
        return slowing(self.parameters, step.at, motion)

    def _speed(
        self, slip: Floats, dt: Floats | float, state: FrictionState, rate_dependent: bool
    ) -> Floats:
        """The speed that alpha is taken at, (q,), m/s."""
        if not rate_dependent:
            return np.zeros(slip.shape[1])
        if self.parameters.switch == "lagged":
            return state.speed
        return np.sqrt(dot(slip, slip)) / dt

    def _kept(self, at: FilmPoint, state: FrictionState) -> tuple[Floats | float, Floats | None]:
        """The kept part r of the elastic slip, and its derivative for alpha."""
        if self.parameters.reentry == "literal":
            return 1.0, None
        solid_before = 1.0 - state.alpha
        falls = at.solid > solid_before
        if not falls.any():
            return 1.0, None
        # Where alpha falls its solid share is above that of before, so never 0.
        solid = np.where(falls, at.solid, 1.0)
        kept = np.where(falls, solid_before / solid, 1.0)
        return kept, np.where(falls, kept / solid, 0.0)

    def _new_state(
        self, step: _Step, state: FrictionState, dt: Floats | float, rate_dependent: bool
    ) -> FrictionState:
        path = state.slip_path + step.returned.slip
        if self.parameters.reset_slip_on_opening:
            path = np.where(step.closed, path, 0.0)
        speed = np.sqrt(dot(step.slip, step.slip))
        return FrictionState(
            elastic_slip=np.ascontiguousarray(step.returned.elastic_slip.T),
            slip_path=path,
            alpha=step.at.alpha,
            speed=speed / dt if rate_dependent else np.zeros_like(speed),
            closed=step.closed,
        )

    def _derivatives(self, step: _Step, dt: Floats | float) -> tuple[Floats, Floats, Floats]:
        """Of T for slip (i, j, q), elastic slip (i, j, q) and film thickness (i, q)."""
        dim = len(step.slip)
        elastic = step.weight * step.returned.derivative(dim)
        d_elastic = step.kept * elastic if isinstance(step.kept, np.ndarray) else elastic
        d_slip = elastic.copy()
        for i in range(dim):
            d_slip[i, i] += step.resistance
        d_film = (step.at.alpha * step.flow.d_film) * step.slip
        # d|slip|/d slip; where it does not exist (no slip) nothing depends on it.
        length = np.sqrt(dot(step.slip, step.slip))
        ahead = step.slip / np.where(length > 0.0, length, 1.0)
        if step.flow.d_length is not None:
            along = (step.at.alpha * step.flow.d_length) * step.slip
            d_slip += along[:, None] * ahead[None, :]
        d_speed = step.at.d_alpha_d_speed
        if self.parameters.switch == "lagged":
            d_speed = None
        if d_speed is not None or step.at.d_alpha_d_film.any():
            d_alpha = self._d_traction_d_alpha(step)
            d_film += step.at.d_alpha_d_film * d_alpha
            if d_speed is not None:
                d_slip += d_alpha[:, None] * ((d_speed / dt) * ahead)[None, :]
        return d_slip, d_elastic, d_film

    def _add_held_back(
        self,
        step: _Step,
        slowed: Slowing,
        dt: Floats | float,
        into: tuple[Floats, Floats, Floats, Floats],
    ) -> None:
        """Add the derivatives of what asperities took over where the film gave it up."""
        q = slowed.points
        d_slip, d_elastic, d_pressure, d_film = into
        slopes, ahead = slowed.slopes.copy(), step.returned.direction[:, q]
        if self.parameters.flow_rule == "weighted":
            # There (1 - alpha) of the traction is varied with the rest of the law.
            whole = (step.returned.secant * step.returned.length)[q]
            if step.at.d_alpha_d_speed is not None:
                slopes[0] += whole * (step.at.d_alpha_d_speed / dt)[q]
            slopes[2] += whole * np.broadcast_to(step.at.d_alpha_d_film, step.closed.shape)[q]
        slip, bend = step.slip[:, q], step.elastic_before[:, q]
        along = slip / np.maximum(np.sqrt(dot(slip, slip)), TINY)
        bent = bend / np.maximum(np.sqrt(dot(bend, bend)), TINY)
        d_slip[:, :, q] += ahead[:, None] * (slopes[0] * along)[None, :]
        d_elastic[:, :, q] += ahead[:, None] * (slowed.d_bend * bent)[None, :]
        d_pressure[:, q] += slopes[1] * ahead
        d_film[:, q] += slopes[2] * ahead

    def _d_traction_d_alpha(self, step: _Step) -> Floats:
        """dT/dalpha with slip, film thickness and pressure fixed, (i, q), Pa."""
        returned = step.returned
        if self.parameters.flow_rule == "weighted":
            # T^e is 1 - alpha times a traction that depends on alpha through r only.
            d_alpha = -returned.secant * step.trial
        else:
            d_alpha = (-self.parameters.K_T * returned.d_stiffness) * returned.direction
        # Through r: p = r g_e + Δg_T, ∂T/∂p · g_e ∂r/∂α.
        if step.d_kept is not None:
            d_alpha += step.weight * step.d_kept * returned.derivative_along(step.elastic_before)
        d_alpha += step.flow.value * step.slip
        return d_alpha

    def _dissipation(self, step: _Step, state: FrictionState) -> Dissipation:
        """The work of the step, split; exact by construction of the step."""
        returned, K_T = step.returned, self.parameters.K_T
        new, before = returned.elastic_slip, step.elastic_before
        solid_before = 1.0 - state.alpha
        length2 = dot(before, before)
        if isinstance(step.kept, np.ndarray) and self.parameters.reentry == "consistent":
            # (1 - alpha) r^2 = (1 - alpha_old) r where alpha falls: no difference of near numbers.
            rising = np.maximum(solid_before - step.at.solid, 0.0)
            freed = np.where(step.kept < 1.0, solid_before * (1.0 - step.kept), rising)
        else:
            freed = solid_before - step.at.solid
        # Backward Euler's part, as in plain friction, from the elastic slip that re-entry leaves.
        change = new - step.kept * before
        opening = np.zeros_like(length2)
        if not step.closed.all():
            gone = ~step.closed
            lost = state.elastic_slip[gone].T
            opening[gone] = 0.5 * K_T * solid_before[gone] * dot(lost, lost)
        return Dissipation(
            coulomb=returned.slip * step.weight * returned.secant * returned.length,
            viscous=step.resistance * dot(step.slip, step.slip),
            switching=0.5 * K_T * freed * length2,
            numerical=0.5 * K_T * step.at.solid * dot(change, change),
            opening=opening,
        )


def _held_back(step: _Step, slowed: Slowing | None) -> _Step:
    """The step with asperities that took over no more than the film gave up."""
    if slowed is None:
        return step
    returned = step.returned
    traction = step.weight * returned.secant * returned.length
    slowed = slowed.take(slowed.elastic < traction[slowed.points])
    points, share = slowed.points, np.ones_like(traction)
    share[points] = slowed.elastic / traction[points]
    # What a held point carries is decided by the film that slows, not by its trial: its slopes come
    # from there (`_add_held_back`), and those of the return are none.
    held = share < 1.0
    if not held.any():
        return step
    return replace(
        step,
        slowed=slowed,
        held_back=(1.0 - share) * traction,
        returned=replace(
            returned,
            elastic_slip=share * returned.elastic_slip,
            slip=returned.length - share * (returned.length - returned.slip),
            slipping=returned.slipping | held,
            secant=share * returned.secant,
            tangent=np.where(held, 0.0, returned.tangent),
            d_pressure=np.where(held, 0.0, returned.d_pressure),
            d_stiffness=np.where(held, 0.0, returned.d_stiffness),
        ),
    )


def _where_closed(vectors: Floats, closed: NDArray[np.bool_]) -> Floats:
    """Vectors (q, i) as (i, q), zero where the contact is open."""
    out = components_first(vectors)
    if not closed.all():
        out[:, ~closed] = 0.0
    return out


def _shortened(film: Floats) -> Floats:
    """One entry for all where the film is the same everywhere, which saves powers and roots."""
    if film.size > 1 and bool((film == film[0]).all()):
        return film[:1]
    return film


def _regime(step: _Step) -> NDArray[np.int8]:
    """Codes of ``Regime``, (q,)."""
    slipping = step.returned.slipping
    regime = np.full(slipping.shape, int(Regime.STICK), dtype=np.int8)
    regime[slipping] = Regime.SLIP
    regime[slipping & (step.at.alpha > 0.0)] = Regime.MIXED
    regime[step.at.alpha == 1.0] = Regime.VISCOUS
    regime[~step.closed] = Regime.OPEN
    return regime
