"""One step of friction without a film, for a coefficient that does not depend on the slip path."""

from __future__ import annotations

from dataclasses import dataclass

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

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DryStep:
    """A step and its intermediate results; vectors are (i, q).

    Attributes:
        response: Its result, with a constant coefficient of friction.
        returned: The return mapping.
        slip: (i, q), m, slip increment, zero at open points.
    """

    response: FrictionResponse
    returned: Returned
    slip: Floats


def dry_step(
    slip_increment: Floats,
    dt: float,
    pressure: Floats,
    state: FrictionState,
    stiffness: float,
    mu: Floats | float,
    rate_dependent: bool,
) -> DryStep:
    """Traction K_T g_e up to mu t_N, with derivatives, trial state and dissipation.

    Args:
        slip_increment: (q, i), m.
        dt: s, > 0 where ``rate_dependent``.
        pressure: (q,), Pa, t_N.
        state: Last converged state.
        stiffness: Pa/m, K_T.
        mu: (q,) or a number, coefficient of friction of this step.
        rate_dependent: Whether the step has a duration.

    Raises:
        ValueError: dt is not positive in a rate-dependent step.
    """
    require_time_step(dt, rate_dependent)
    slip, before, closed = in_contact(slip_increment, pressure, state)
    trial = before + slip
    returned = return_mapping(trial, stiffness, pressure, state.slip_path, mu)
    block = returned.derivative(len(slip)).transpose(2, 0, 1)
    regime = np.where(returned.slipping, Regime.SLIP, Regime.STICK).astype(np.int8)
    regime[~closed] = Regime.OPEN
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
        dissipation=_dissipation(returned, before, closed, state, stiffness),
    )
    return DryStep(response, returned, slip)


def _dissipation(
    returned: Returned,
    before: Floats,
    closed: NDArray[np.bool_],
    state: FrictionState,
    stiffness: float,
) -> Dissipation:
    change = returned.elastic_slip - before
    none = np.zeros_like(returned.slip)
    stored = 0.5 * stiffness * dot(state.elastic_slip.T, state.elastic_slip.T)
    return Dissipation(
        coulomb=returned.slip * returned.secant * returned.length,
        viscous=none,
        switching=none.copy(),
        numerical=0.5 * stiffness * dot(change, change),
        opening=np.where(closed, 0.0, stored),
    )


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
