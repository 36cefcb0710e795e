"""Plain Coulomb friction with an elastic tangential stiffness, and no friction at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.law import (
    Dissipation,
    FrictionResponse,
    FrictionState,
    Regime,
    require_time_step,
)
from tribox.forms.friction.return_mapping import Returned, components_first, dot, return_mapping
from tribox.forms.parameters import Declared, Scales, parameter

Floats = NDArray[np.float64]

# -- One step of friction without a film, for a coefficient that does not depend on the slip path --


def dry_step(
    slip_increment: Floats,
    dt: float,
    pressure: Floats,
    state: FrictionState,
    stiffness: float,
    mu: Floats | float,
    rate_dependent: bool,
) -> tuple[FrictionResponse, Returned, Floats]:
    """Traction K_T g_e up to mu t_N, with derivatives, trial state and dissipation.

    Returns the response for a constant coefficient, the return mapping, and the slip (i, q), m, 0
    at open points. ``mu``: (q,) or a number, of this step; else as ``FrictionLaw.update``, with its
    ValueError.
    """
    require_time_step(dt, rate_dependent)
    slip, before, closed = in_contact(slip_increment, pressure, state)
    trial = before + slip
    returned = return_mapping(trial, stiffness, pressure, state.slip_path, mu)
    block = returned.derivative(len(slip)).transpose(2, 0, 1)
    regime = np.where(returned.slipping, Regime.SLIP, Regime.STICK).astype(np.int8)
    regime[~closed] = Regime.OPEN
    # T·Δg_e = ψ_{n+1} − ψ_n + ½ K_T |Δg_e|²: backward Euler takes T at the end of the step, and the
    # last term is what that makes.
    change = returned.elastic_slip - before
    stored = 0.5 * stiffness * dot(state.elastic_slip.T, state.elastic_slip.T)
    response = FrictionResponse(
        traction=(returned.secant * trial).T,
        d_traction_d_slip=block,
        d_traction_d_elastic=block.copy(),
        d_traction_d_pressure=(returned.d_pressure * returned.direction).T,
        d_traction_d_film=np.zeros(slip_increment.shape),
        state=next_state(
            returned.elastic_slip, returned.slip, slip, dt, closed, state, rate_dependent
        ),
        regime=regime,
        dissipation=Dissipation(
            coulomb=returned.slip * returned.secant * returned.length,
            viscous=np.zeros_like(stored),
            switching=np.zeros_like(stored),
            numerical=0.5 * stiffness * dot(change, change),
            opening=np.where(closed, 0.0, stored),
        ),
    )
    return response, returned, slip


def in_contact(
    slip_increment: Floats, pressure: Floats, state: FrictionState
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Slip and old elastic slip, (i, q), zero at open points; and which points are closed."""
    slip = components_first(slip_increment)
    before = components_first(state.elastic_slip)
    closed = pressure > 0.0
    if not closed.all():
        slip[:, ~closed] = 0.0
        before[:, ~closed] = 0.0
    return slip, before, closed


def next_state(
    elastic: Floats,
    permanent: Floats,
    slip: Floats,
    dt: float,
    closed: NDArray[np.bool_],
    state: FrictionState,
    rate_dependent: bool,
) -> FrictionState:
    """State after a step without a film."""
    moved = np.sqrt(dot(slip, slip))
    return FrictionState(
        elastic_slip=np.ascontiguousarray(elastic.T),
        slip_path=state.slip_path + permanent,
        alpha=np.zeros_like(moved),
        speed=moved / dt if rate_dependent else np.zeros_like(moved),
        closed=closed,
    )


# -- The laws --------------------------------------------------------------------------------------

# Default stiffness of stick, in units of G/h (shear modulus of the softer body, or hardness if it
# flows, over the length of a slave facet): stiff against the shear of the elements beside it, yet
# soft enough for the onset of slip to spread without a fight.
TANGENTIAL_FACTOR = 10.0


def stick_stiffness(scales: Scales) -> float:
    """Default of K_T, Pa/m."""
    return TANGENTIAL_FACTOR * scales.modulus / scales.length


@dataclass(frozen=True, slots=True, kw_only=True)
class CoulombParameters(Declared):
    """Coulomb friction with an elastic (penalty) stick phase. SI units.

    Raises:
        Refused: A value is not allowed; the message names field, value and what is allowed.
    """

    mu: float = parameter(
        "coefficient of friction, a number or a program of time", ge=0.0, program=True
    )
    K_T: float = parameter(
        "tangential stiffness before slip; default: 10 G/h, with the shear modulus G of the softer "
        "body and the length h of a slave facet",
        "Pa/m",
        gt=0.0,
        follows=stick_stiffness,
    )


class StickingLaw:
    """What laws have in common that stick with a stiffness K_T, up to a threshold mu t_N."""

    __slots__ = ()
    parameters: Any

    def initial_state(self, n: int, dim: int) -> FrictionState:
        """State of n points that have never been in contact, in dim space dimensions."""
        return FrictionState.zeros(n, dim)

    def stored_energy(self, state: FrictionState) -> Floats:
        """Elastic energy of the slip, psi = K_T/2 |g_e|^2, (q,), J/m^2."""
        g = state.elastic_slip.T
        return np.asarray(0.5 * self.parameters.K_T * dot(g, g))

    def coefficient(self, state: FrictionState) -> Floats:
        """Coefficient of friction mu, (q,)."""
        raise NotImplementedError

    def presliding_length(self, state: FrictionState, pressure: Floats) -> Floats:
        """Elastic slip of a point that slides, mu t_N/K_T, (q,), m."""
        return np.asarray(self.coefficient(state) * pressure / self.parameters.K_T)


@dataclass(frozen=True, slots=True)
class CoulombLaw(StickingLaw):
    r"""Coulomb friction (a ``FrictionLaw``): T = K_T g_e, |T| <= mu t_N.

    The elastic slip :math:`g_e` grows with the slip until :math:`K_T |g_e| = \mu t_N`; the rest of
    the slip is permanent. The film has no effect.
    """

    parameters: CoulombParameters

    def coefficient(self, state: FrictionState) -> Floats:
        """The constant coefficient of friction, (q,)."""
        return np.full_like(state.slip_path, self.parameters.mu)

    def update(
        self,
        slip_increment: Floats,
        dt: float,
        pressure: Floats,
        film: Floats,
        state: FrictionState,
        *,
        area_ratio: Floats | float = 1.0,
        rate_dependent: bool = True,
    ) -> FrictionResponse:
        """Traction, derivatives and trial state of one step; see ``FrictionLaw.update``."""
        mu, K_T = self.parameters.mu, self.parameters.K_T
        return dry_step(slip_increment, dt, pressure, state, K_T, mu, rate_dependent)[0]


@dataclass(frozen=True, slots=True)
class NoParameters(Declared):
    """No tangential traction."""


@dataclass(frozen=True, slots=True)
class FrictionlessLaw:
    """No tangential traction (a ``FrictionLaw``); points in contact slip freely."""

    def initial_state(self, n: int, dim: int) -> FrictionState:
        """State of n points that have never been in contact, in dim space dimensions."""
        return FrictionState.zeros(n, dim)

    def stored_energy(self, state: FrictionState) -> Floats:
        """Zero, (q,), J/m^2."""
        return np.zeros_like(state.slip_path)

    def coefficient(self, state: FrictionState) -> Floats:
        """Zero, (q,)."""
        return np.zeros_like(state.slip_path)

    def update(
        self,
        slip_increment: Floats,
        dt: float,
        pressure: Floats,
        film: Floats,
        state: FrictionState,
        *,
        area_ratio: Floats | float = 1.0,
        rate_dependent: bool = True,
    ) -> FrictionResponse:
        """No traction; the slip is added to the slip path. See ``FrictionLaw.update``."""
        require_time_step(dt, rate_dependent)
        slip, _, closed = in_contact(slip_increment, pressure, state)
        n, dim = slip_increment.shape
        still, moved = np.zeros_like(slip), np.sqrt(dot(slip, slip))
        regime = np.where(closed, Regime.SLIP, Regime.OPEN).astype(np.int8)
        return FrictionResponse(
            traction=np.zeros((n, dim)),
            d_traction_d_slip=np.zeros((n, dim, dim)),
            d_traction_d_elastic=np.zeros((n, dim, dim)),
            d_traction_d_pressure=np.zeros((n, dim)),
            d_traction_d_film=np.zeros((n, dim)),
            state=next_state(still, moved, slip, dt, closed, state, rate_dependent),
            regime=regime,
            dissipation=Dissipation(*(np.zeros(n) for _ in range(5))),
        )
