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

from tribox.forms.friction.film import film_point, film_resistance
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
    SlipWeakening,
    components_first,
    dot,
    return_mapping,
)
from tribox.forms.friction.slowing import Motion, Slowing, slowing

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FrictionMap:
    """The friction-map law (a ``FrictionLaw``).

    ``takes_film_cover``: the share that is wet; ``looks_inside``: into a step that is not short.
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
        step = _Step(self, slip_increment, dt, pressure, film, state, area, rate_dependent)
        if rate_dependent and look_inside:
            step.hold_back(pressure, film, area)
        return step.response()


class _Step:
    """One step of the law at q points, solved as it is made; vectors are (i, q).

    Attributes:
        at: film fraction; closed: (q,) whether points are in contact; length: (q,), m, of the slip.
        kept: r, the part of the elastic slip that is kept; d_kept: its derivative for alpha, None
            where it is zero at all points.
        weight: omega of the flow rule; trial: trial elastic slip p, m; returned: of its return.
        flow: f, film traction per slip of the step for alpha = 1, with its derivatives; resistance:
            (q,), Pa/m, alpha f.
        slowed: points that slowed down through V*, and whose asperities are held back; held_back:
            (q,), Pa, by how much.
    """

    def __init__(
        self,
        law: FrictionMap,
        slip_increment: Floats,
        dt: Floats | float,
        pressure: Floats,
        film: Floats,
        state: FrictionState,
        area: tuple[Floats | float, Floats | float],
        rates: bool,
    ) -> None:
        """Film fraction, re-entry and return mapping; ``area``: area ratio and cover."""
        p = self.parameters = law.parameters
        self.dt, self.state, self.rates, film = dt, state, rates, _shortened(film)
        self.closed = pressure > 0.0
        self.slip = _where_closed(slip_increment, self.closed)
        self.before = _where_closed(state.elastic_slip, self.closed)
        self.length = np.sqrt(dot(self.slip, self.slip))
        speed = np.zeros_like(self.length)
        if rates:
            speed = state.speed if p.switch == "lagged" else self.length / dt
        self.at = film_point(p, film, speed)
        self.kept, self.d_kept = self._kept()
        literal = p.flow_rule == "literal"
        self.weight: Floats | float = 1.0 if literal else self.at.solid
        self.trial = self.kept * self.before + self.slip
        stiffness = p.K_T * self.at.solid if literal else p.K_T
        self.returned = return_mapping(
            self.trial, stiffness, pressure, state.slip_path, law._friction
        )
        # In an infinite step the film is not sheared at any rate: it carries no stress.
        felt = dt if rates else math.inf
        self.flow = film_resistance(p, film, self.length, felt, pressure, *area)
        self.resistance = self.at.alpha * self.flow.value
        self.slowed: Slowing | None = None
        self.held_back: Floats | None = None

    def _kept(self) -> tuple[Floats | float, Floats | None]:
        """The kept part r of the elastic slip, and its derivative for alpha."""
        solid_before = 1.0 - self.state.alpha
        falls = self.at.solid > solid_before
        if self.parameters.reentry == "literal" or not falls.any():
            return 1.0, None
        # Where alpha falls its solid share is above that of before, so never 0.
        solid = np.where(falls, self.at.solid, 1.0)
        kept = np.where(falls, solid_before / solid, 1.0)
        return kept, np.where(falls, kept / solid, 0.0)

    def hold_back(
        self, pressure: Floats, film: Floats, area: tuple[Floats | float, Floats | float]
    ) -> None:
        """Let asperities take over no more than the film gives up, where points slow through V*."""
        if self.parameters.switch == "lagged" or self.parameters.reentry == "literal":
            return
        motion = Motion(
            length=self.length,
            dt=self.dt,
            speed_before=self.state.speed,
            solid_before=1.0 - self.state.alpha,
            bend=np.sqrt(dot(self.before, self.before)),
            pressure=pressure,
            film=_shortened(film),
            area_ratio=area[0],
            cover=area[1],
        )
        slowed = slowing(self.parameters, self.at, motion)
        if slowed is None:
            return
        returned = self.returned
        traction = self.weight * returned.secant * returned.length
        slowed = slowed.take(slowed.elastic < traction[slowed.points])
        share = np.ones_like(traction)
        share[slowed.points] = slowed.elastic / traction[slowed.points]
        # What a held point carries is decided by the film that slows, not by its trial: its slopes
        # come from there (`_add_held_back`), and those of the return are none.
        held = share < 1.0
        if not held.any():
            return
        self.slowed, self.held_back = slowed, (1.0 - share) * traction
        self.returned = replace(
            returned,
            elastic_slip=share * returned.elastic_slip,
            slip=returned.length - share * (returned.length - returned.slip),
            slipping=returned.slipping | held,
            secant=share * returned.secant,
            **{
                name: np.where(held, 0.0, getattr(returned, name))
                for name in ("tangent", "d_pressure", "d_stiffness")
            },
        )

    def response(self) -> FrictionResponse:
        """What the law answers."""
        returned, state = self.returned, self.state
        path = state.slip_path + returned.slip
        if self.parameters.reset_slip_on_opening:
            path = np.where(self.closed, path, 0.0)
        new = FrictionState(
            elastic_slip=np.ascontiguousarray(returned.elastic_slip.T),
            slip_path=path,
            alpha=self.at.alpha,
            speed=self.length / self.dt if self.rates else np.zeros_like(self.length),
            closed=self.closed,
        )
        traction = self.weight * returned.secant * self.trial
        traction += self.resistance * self.slip
        d_slip, d_elastic, d_film = self._derivatives()
        d_pressure = self.weight * returned.d_pressure * returned.direction
        if self.slowed is not None:
            self._add_held_back(self.slowed, d_slip, d_elastic, d_pressure, d_film)
        if self.flow.d_pressure is not None:
            d_pressure += (self.at.alpha * self.flow.d_pressure) * self.slip
        # Inside components come first, so that numpy's loops run along the points; outside last.
        return FrictionResponse(
            traction=traction.T,
            d_traction_d_slip=d_slip.transpose(2, 0, 1),
            d_traction_d_elastic=d_elastic.transpose(2, 0, 1),
            d_traction_d_pressure=d_pressure.T,
            d_traction_d_film=d_film.T,
            state=new,
            regime=self._regime(),
            dissipation=self._dissipation(),
            held_back=self.held_back,
        )

    def _derivatives(self) -> tuple[Floats, Floats, Floats]:
        """Of T for slip (i, j, q), elastic slip (i, j, q) and film thickness (i, q)."""
        at, dim = self.at, len(self.slip)
        elastic = self.weight * self.returned.derivative(dim)
        d_elastic = self.kept * elastic if isinstance(self.kept, np.ndarray) else elastic
        d_slip = elastic.copy()
        for i in range(dim):
            d_slip[i, i] += self.resistance
        d_film = (at.alpha * self.flow.d_film) * self.slip
        # d|slip|/d slip; where it does not exist (no slip) nothing depends on it.
        ahead = self.slip / np.where(self.length > 0.0, self.length, 1.0)
        if self.flow.d_length is not None:
            along = (at.alpha * self.flow.d_length) * self.slip
            d_slip += along[:, None] * ahead[None, :]
        d_speed = None if self.parameters.switch == "lagged" else at.d_alpha_d_speed
        if d_speed is not None or at.d_alpha_d_film.any():
            d_alpha = self._d_traction_d_alpha()
            d_film += at.d_alpha_d_film * d_alpha
            if d_speed is not None:
                d_slip += d_alpha[:, None] * ((d_speed / self.dt) * ahead)[None, :]
        return d_slip, d_elastic, d_film

    def _add_held_back(
        self, slowed: Slowing, d_slip: Floats, d_elastic: Floats, d_pressure: Floats, d_film: Floats
    ) -> None:
        """Add the derivatives of what asperities took over where the film gave it up."""
        q, at, returned = slowed.points, self.at, self.returned
        slopes, ahead = slowed.slopes.copy(), returned.direction[:, q]
        if self.parameters.flow_rule == "weighted":
            # There (1 - alpha) of the traction is varied with the rest of the law.
            whole = (returned.secant * returned.length)[q]
            if at.d_alpha_d_speed is not None:
                slopes[0] += whole * (at.d_alpha_d_speed / self.dt)[q]
            slopes[2] += whole * np.broadcast_to(at.d_alpha_d_film, self.closed.shape)[q]
        along, bent = (
            vectors[:, q] / np.maximum(np.sqrt(dot(vectors[:, q], vectors[:, q])), TINY)
            for vectors in (self.slip, self.before)
        )
        d_slip[:, :, q] += ahead[:, None] * (slopes[0] * along)[None, :]
        d_elastic[:, :, q] += ahead[:, None] * (slowed.d_bend * bent)[None, :]
        d_pressure[:, q] += slopes[1] * ahead
        d_film[:, q] += slopes[2] * ahead

    def _d_traction_d_alpha(self) -> Floats:
        """dT/dalpha with slip, film thickness and pressure fixed, (i, q), Pa."""
        returned = self.returned
        if self.parameters.flow_rule == "weighted":
            # T^e is 1 - alpha times a traction that depends on alpha through r only.
            d_alpha = -returned.secant * self.trial
        else:
            d_alpha = (-self.parameters.K_T * returned.d_stiffness) * returned.direction
        # Through r: p = r g_e + Δg_T, ∂T/∂p · g_e ∂r/∂α.
        if self.d_kept is not None:
            d_alpha += self.weight * self.d_kept * returned.derivative_along(self.before)
        d_alpha += self.flow.value * self.slip
        return d_alpha

    def _regime(self) -> NDArray[np.int8]:
        """Codes of ``Regime``, (q,)."""
        slipping, alpha = self.returned.slipping, self.at.alpha
        regime = np.full(slipping.shape, int(Regime.STICK), dtype=np.int8)
        regime[slipping] = Regime.SLIP
        regime[slipping & (alpha > 0.0)] = Regime.MIXED
        regime[alpha == 1.0] = Regime.VISCOUS
        regime[~self.closed] = Regime.OPEN
        return regime

    def _dissipation(self) -> Dissipation:
        """The work of the step, split; exact by construction of the step."""
        returned, K_T, solid = self.returned, self.parameters.K_T, self.at.solid
        solid_before = 1.0 - self.state.alpha
        length2 = dot(self.before, self.before)
        if isinstance(self.kept, np.ndarray):
            # (1 - alpha) r^2 = (1 - alpha_old) r where alpha falls: no difference of near numbers.
            rising = np.maximum(solid_before - solid, 0.0)
            freed = np.where(self.kept < 1.0, solid_before * (1.0 - self.kept), rising)
        else:
            freed = solid_before - solid
        # Backward Euler's part, as in plain friction, from the elastic slip that re-entry leaves.
        change = returned.elastic_slip - self.kept * self.before
        opening, gone = np.zeros_like(length2), ~self.closed
        if gone.any():
            lost = self.state.elastic_slip[gone].T
            opening[gone] = 0.5 * K_T * solid_before[gone] * dot(lost, lost)
        return Dissipation(
            coulomb=returned.slip * self.weight * returned.secant * returned.length,
            viscous=self.resistance * dot(self.slip, self.slip),
            switching=0.5 * K_T * freed * length2,
            numerical=0.5 * K_T * solid * dot(change, change),
            opening=opening,
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
