r"""Closed forms of homogeneous sliding under the friction-map law, to verify computations with.

They contain no time steps: the film fraction switches sharply at the threshold speed, so a
computation with a transition of finite width is compared outside that transition. All arguments
broadcast against each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tribox.forms.friction.film import at_rest
from tribox.forms.friction.film import threshold_speed as switching_speed
from tribox.forms.friction.parameters import FrictionMapParameters

Floats = NDArray[np.float64]


def threshold_speed(film: ArrayLike, parameters: FrictionMapParameters) -> Floats:
    r"""Speed from which the film carries all, m/s: :math:`V^* = \sqrt{\gamma D_{max}/(\eta_b D)}`.

    With V* given at a reference, :math:`V^*_{ref} \sqrt{D_{ref}/D}`; inf where D <= D_min; D in m.
    """
    return switching_speed(parameters, np.asarray(film, dtype=np.float64))


def film_fraction(speed: ArrayLike, film: ArrayLike, parameters: FrictionMapParameters) -> Floats:
    r"""Film fraction :math:`\alpha_0(D)` below V*, 1 from V* on; of V ≥ 0, m/s, and D, m."""
    V, D = np.broadcast_arrays(
        np.asarray(speed, dtype=np.float64), np.asarray(film, dtype=np.float64)
    )
    below = 1.0 - at_rest(parameters, D).solid
    return np.where(threshold_speed(D, parameters) <= V, 1.0, below)


def steady_traction(
    speed: ArrayLike,
    film: ArrayLike,
    pressure: ArrayLike,
    mu: ArrayLike,
    parameters: FrictionMapParameters,
) -> Floats:
    r"""Friction traction in steady sliding, Pa: :math:`\omega\mu p + \alpha\hat\eta V/D`.

    With the film's viscosity :math:`\hat\eta` at V/D and p, eta_b without an option of its flow.

    With :math:`\omega = 1 - \alpha` for the weighted flow rule. Under the literal rule
    :math:`\omega = 1`, but where :math:`\alpha = 1` the asperities have lost their stiffness and
    never reach the threshold: there the traction is the film's alone.

    Args:
        speed: m/s, V > 0.
        film: m, film thickness D; the traction is Coulomb's up to D_min.
        pressure: Pa, p.
        mu: Coefficient of friction at the slip reached.
    """
    V, D = np.asarray(speed, dtype=np.float64), np.asarray(film, dtype=np.float64)
    alpha = film_fraction(V, D, parameters)
    weighted = parameters.flow_rule == "weighted"
    omega = 1.0 - alpha if weighted else np.where(alpha == 1.0, 0.0, 1.0)
    wet = parameters.D_min < D
    p = np.asarray(pressure, dtype=np.float64)
    rate = np.where(wet, V / np.where(wet, D, 1.0), 0.0)
    viscosity = parameters.viscosity(rate, np.broadcast_to(p, rate.shape)).value
    dry: Floats = omega * np.asarray(mu) * p
    sheared: Floats = alpha * viscosity * rate
    return np.asarray(dry + sheared)


def effective_viscosity(
    speed: ArrayLike,
    film: ArrayLike,
    pressure: ArrayLike,
    mu: ArrayLike,
    parameters: FrictionMapParameters,
) -> Floats:
    r"""Effective viscosity in steady sliding, Pa s: :math:`\eta_{eff} = T D/V`.

    With the weighted flow rule :math:`(1 - \alpha)\mu p D/V + \alpha\eta_b`. The arguments are
    those of ``steady_traction``.
    """
    V, D = np.asarray(speed, dtype=np.float64), np.asarray(film, dtype=np.float64)
    return steady_traction(V, D, pressure, mu, parameters) * D / V


def crossover_speed(film: ArrayLike, pressure: ArrayLike, mu: ArrayLike, eta_b: float) -> Floats:
    r"""Speed, m/s, at which the film drags as friction alone: :math:`V_c = \mu p D/\eta_b`.

    Where V* < V_c the traction falls at V*. D in m, p in Pa, eta_b in Pa s.
    """
    return np.asarray(np.asarray(mu) * np.asarray(pressure) * np.asarray(film) / eta_b)


def presliding_length(
    pressure: ArrayLike, mu: ArrayLike, alpha: ArrayLike, parameters: FrictionMapParameters
) -> Floats:
    r"""Slip at which the asperities reach the threshold, m: :math:`\omega\mu p/((1 - \alpha) K_T)`.

    That is :math:`\mu p/K_T` for the weighted rule at any film fraction (its limit at alpha = 1),
    and :math:`\mu p/((1 - \alpha) K_T)` for the literal rule, infinite at alpha = 1.

    Args:
        pressure: Pa, p.
        mu: Coefficient of friction at that slip.
    """
    length = np.asarray(mu) * np.asarray(pressure) / parameters.K_T
    solid = 1.0 - np.asarray(alpha, dtype=np.float64)
    if parameters.flow_rule == "weighted":
        return np.asarray(length + 0.0 * solid)
    return np.where(solid > 0.0, length / np.where(solid > 0.0, solid, 1.0), np.inf)
