r"""Springback of a wide strip bent by a moment alone, by integration over its fibres.

Sections stay plane, the strip stays in plane strain and thin against its radius: a fibre at a
distance y of the middle has the strain κy along the strip, none across it, and no stress through
the thickness. The stresses of each fibre, along the strip and across it, follow from Prandtl's and
Reuss' equations by backward Euler steps in the plane of these two (Simo & Taylor, Int. J. Numer.
Methods Engng 22 (1986) 649), and the moment is :math:`\int \sigma y\,dy`. What is left out is of
the order (t/R)².
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tribox.forms.closed_forms.thick_tube import Law

Floats = NDArray[np.float64]
HALVINGS = 50  # of an interval: to round-off


@dataclass(frozen=True, slots=True)
class Strip:
    """A strip and how it is integrated.

    Attributes:
        thickness: m.
        young, poisson: E, Pa; ν.
        yield_stress: σ_Y(α), Pa, not falling.
        fibres: of half the thickness; the other half is its mirror image.
        steps: of the curvature.
    """

    thickness: float
    young: float
    poisson: float
    yield_stress: Law
    fibres: int = 200
    steps: int = 100

    def bent(self, curvature: float) -> tuple[float, float]:
        """Moment of a strip that is bent, and the curvature that is left of it.

        Args:
            curvature: 1/m, κ, to which it is bent.

        Returns:
            N m/m, moment per width at κ; 1/m, curvature without moment.
        """
        half = 0.5 * self.thickness
        points, weights = np.polynomial.legendre.leggauss(self.fibres)
        y, weight = 0.5 * half * (1.0 + points), half * weights  # of both halves
        stress: Floats = np.zeros((2, len(y)))
        alpha: Floats = np.zeros(len(y))
        for _ in range(self.steps):
            stress, alpha = self._stepped(stress, alpha, curvature / self.steps * y)
        moment = float(weight @ (stress[0] * y))
        # Back, as far as an elastic strip would; then by secants, lest some of it flows.
        stiffness = self.young * self.thickness**3 / (12.0 * (1.0 - self.poisson**2))
        back = moment / stiffness
        for _ in range(20):
            left = float(weight @ (self._stepped(stress, alpha, -back * y)[0][0] * y))
            back += left / stiffness
        return moment, curvature - back

    def _stepped(self, stress: Floats, alpha: Floats, strain: Floats) -> tuple[Floats, Floats]:
        """Stresses (2, n), Pa, along and across, and α (n,), after strains (n,) along the strip."""
        E, nu = self.young, self.poisson
        along = E / (1.0 - nu**2) * strain
        trial = stress + np.stack([along, nu * along])
        # Sum and difference of both over √2 are independent of each other.
        parts = np.stack([trial[0] + trial[1], trial[1] - trial[0]]) / np.sqrt(2.0)
        rates = np.array([E / (3.0 * (1.0 - nu)), E / (1.0 + nu)])[:, None]

        def returned(gamma: Floats) -> tuple[Floats, Floats, Floats]:
            now = parts / (1.0 + rates * gamma)
            equivalent = np.sqrt(0.5 * now[0] ** 2 + 1.5 * now[1] ** 2)
            return now, equivalent, alpha + 2.0 / 3.0 * gamma * equivalent

        low, high = np.zeros_like(alpha), np.full_like(alpha, 1.0 / float(rates.min()))
        flows = returned(low)[1] > self.yield_stress(alpha)
        for _ in range(60):  # up to where the stress is below the yield stress
            _, equivalent, after = returned(high)
            above = equivalent > self.yield_stress(after)
            if not above.any():
                break
            high = np.where(above, 2.0 * high, high)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            _, equivalent, after = returned(middle)
            above = equivalent > self.yield_stress(after)
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        now, _, after = returned(np.where(flows, low, 0.0))
        out = np.stack([now[0] - now[1], now[0] + now[1]]) / np.sqrt(2.0)
        return out, np.where(flows, after, alpha)
