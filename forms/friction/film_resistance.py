r"""Resistance of the film to a slip increment: its stress per length of slip.

With :math:`\hat\eta` the viscosity at the shear rate :math:`|\Delta g_T|/(D \Delta t)`:

.. math:: f = \min\{t_N/p_{on}, 1\}\, \frac{\hat\eta}{D \Delta t} \frac{da}{dA}, \qquad
   T_{film} = \alpha f \Delta g_T

The film's pressure is per current area, :math:`t_N/(da/dA)`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.film_rheology import FilmRheology
from tribox.forms.friction.parameters import FrictionMapParameters

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FilmResistance:
    """Resistance f at q points, with its derivatives; all zero where the contact is open.

    Attributes:
        value: (q,), Pa/m.
        d_length: (q,), Pa/m^2, for the length of the slip; None where the film is Newtonian.
        d_pressure: (q,), 1/m, for the pressure t_N; None where it is zero at all points.
        d_film: (q,), Pa/m^2, for the film thickness.
    """

    value: Floats
    d_length: Floats | None
    d_pressure: Floats | None
    d_film: Floats


def film_resistance(
    parameters: FrictionMapParameters,
    rheology: FilmRheology,
    film: Floats,
    length: Floats,
    dt: Floats | float,
    pressure: Floats,
    area_ratio: Floats | float,
    cover: Floats | float = 1.0,
) -> FilmResistance:
    """Resistance of the film, for alpha = 1.

    Args:
        parameters: Of the law.
        rheology: ``parameters.rheology``.
        film: (q,) or (1,), m, film thickness D; one entry stands for all points.
        length: (q,), m, length of the slip increment.
        dt: (q,) or a number, s, > 0; infinity takes the film away.
        pressure: (q,), Pa, t_N.
        area_ratio: (q,) or a number, da/dA.
        cover: (q,) or a number, share of the area that the film covers.
    """
    area = np.asarray(area_ratio, dtype=np.float64)
    closed = pressure > 0.0
    wet = film > parameters.D_min
    thickness = np.where(wet, film, 1.0)
    onset = parameters.film_onset_pressure
    scale = np.where(wet, 1.0 / (thickness * dt), 0.0) * area * cover
    scale = np.where(closed, scale, 0.0)
    if onset > 0.0:
        scale *= np.minimum(pressure / onset, 1.0)
    d_length: Floats | None = None
    d_pressure: Floats | None = None
    if rheology.newtonian:
        value = rheology.eta_b * scale
        d_film = -value / thickness
    else:
        rate = length / (thickness * dt)
        eta = rheology.viscosity(rate, np.asarray(pressure / area))
        value = eta.value * scale
        d_length = scale * eta.d_rate / (thickness * dt)
        d_film = -(value + scale * eta.d_rate * rate) / thickness
        d_pressure = scale * eta.d_pressure / area
    forming = closed & (pressure < onset)
    if forming.any():
        growth = np.where(forming, value / np.where(forming, pressure, 1.0), 0.0)
        d_pressure = growth if d_pressure is None else d_pressure + growth
    return FilmResistance(value, d_length, d_pressure, d_film)
