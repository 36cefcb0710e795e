r"""Friction that weakens with the speed (Stribeck), with an optional viscous part.

.. math:: T = K_T g_e + c \frac{\Delta g_T}{\Delta t}, \qquad K_T |g_e| \le \mu(V)\, t_N, \qquad
   \mu(V) = \mu_d + (\mu_s - \mu_d)\, e^{-(V/V_s)^\delta}

with :math:`V = |\Delta g_T|/\Delta t` the speed of the step (Bo & Pavelescu, Wear 82, 1982). The
traction falls with the speed where :math:`c < -\mu'(V) t_N`: stick-slip then belongs to the law.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.coulomb import StickingLaw, dry_step, stick_stiffness
from tribox.forms.friction.law import FrictionResponse, FrictionState
from tribox.forms.friction.return_mapping import dot
from tribox.forms.parameters import Declared, Refused, parameter

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class StribeckParameters(Declared):
    """Coulomb friction that weakens with the velocity. SI units.

    Raises:
        Refused: A value is not allowed; the message names field, value and what is allowed.
    """

    mu_s: float = parameter("coefficient of friction at rest", ge=0.0)
    mu_d: float = parameter("coefficient of friction at high velocity", ge=0.0)
    V_s: float = parameter("velocity of the fall from mu_s to mu_d", "m/s", gt=0.0)
    delta: float = parameter(
        "exponent of that fall; below 1 its slope is infinite at rest", gt=0.0, default=1.0
    )
    viscous: float = parameter(
        "viscous stress per velocity (and current area)", "Pa*s/m", ge=0.0, default=0.0
    )
    K_T: float = parameter(
        "tangential stiffness before slip; default: as for coulomb",
        "Pa/m",
        gt=0.0,
        follows=stick_stiffness,
    )

    def faults(self) -> Iterator[Refused]:
        """Friction that rises with the velocity."""
        if self.mu_d > self.mu_s:
            yield Refused("mu_d", f"must be <= mu_s = {self.mu_s:g}", self.mu_d)

    def coefficient(self, speed: Floats) -> tuple[Floats, Floats]:
        """mu(V) and its derivative (s/m; 0 at V = 0), both (q,), of V ≥ 0 (q,), m/s."""
        moving = speed > 0.0
        # At rest any ratio will do: the power's slope is infinite there for δ < 1.
        ratio = np.where(moving, speed, self.V_s) / self.V_s
        power = ratio**self.delta
        weakening = np.where(moving, (self.mu_s - self.mu_d) * np.exp(-power), 0.0)
        slope = -weakening * self.delta * power / (ratio * self.V_s)
        return np.where(moving, self.mu_d + weakening, self.mu_s), slope


@dataclass(frozen=True, slots=True)
class StribeckLaw(StickingLaw):
    """Stribeck friction (a ``FrictionLaw``); the film has no effect."""

    # that ``update`` takes the share of the area that is wet
    takes_film_cover: ClassVar[bool] = True
    parameters: StribeckParameters  # its parameters

    def coefficient(self, state: FrictionState) -> Floats:
        """mu(V) at the speed of the last step, (q,)."""
        return self.parameters.coefficient(state.speed)[0]

    def update(
        self,
        slip_increment: Floats,
        dt: float,
        pressure: Floats,
        film: Floats,
        state: FrictionState,
        *,
        area_ratio: Floats | float = 1.0,
        film_cover: Floats | float = 1.0,
        rate_dependent: bool = True,
    ) -> FrictionResponse:
        """Traction, derivatives and trial state of one step; see ``FrictionLaw.update``.

        With ``rate_dependent=False`` the coefficient is mu_s and there is no viscous part.
        """
        p = self.parameters
        if not rate_dependent:
            return dry_step(slip_increment, dt, pressure, state, p.K_T, p.mu_s, False)[0]
        length = np.sqrt(dot(slip_increment.T, slip_increment.T))
        mu, slope = p.coefficient(length / dt if dt > 0.0 else length)
        response, returned, slip = dry_step(slip_increment, dt, pressure, state, p.K_T, mu, True)
        # At open points the pressure is zero, and so is the slip.
        resistance = np.where(pressure > 0.0, p.viscous / dt * area_ratio * film_cover, 0.0)
        # μ'(V) t_N ∂V/∂Δg_T with V = |Δg_T|/Δt, where the threshold is reached.
        softening = np.where(returned.slipping, pressure * slope / dt, 0.0)
        ahead = slip / np.where(length > 0.0, length, 1.0)
        d_slip = response.d_traction_d_slip.copy()
        d_slip += np.einsum("q,iq,jq->qij", softening, returned.direction, ahead)
        for i in range(len(slip)):
            d_slip[:, i, i] += resistance
        viscous = resistance * dot(slip, slip)
        return replace(
            response,
            traction=response.traction + (resistance * slip).T,
            d_traction_d_slip=d_slip,
            dissipation=replace(response.dissipation, viscous=viscous),
        )
