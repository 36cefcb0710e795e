r"""Softening of rubber by its largest load (Mullins): points that remember their largest energy.

R. W. Ogden, D. G. Roxburgh, Proc. R. Soc. Lond. A 455 (1999) 2861, with the third constant that
commercial codes have. Below the largest distortional energy W_m that a point has had, its stress
is that of the distortional energy W times

    η = 1 − erf x/r,   x = (W_m − W)/s,   s = m + β W_m,

and η = 1 where W = W_m. The work of loading to W_m and back is what was lost,

    D(W_m) = (s/r) (g(W_m/s) − g(0)),   g(x) = x erf x + exp(−x²)/√π,

which only grows with W_m; stored is W − (s/r) (g(W_m/s) − g(x)). Both are exact: there is no step
in them. Beside the forms of the energy the points add what softening takes away,

    −(1 − η) P,   −(1 − η) A + η' P ⊗ P,   η' = 2 exp(−x²)/(√π r s) where W < W_m.

State: W_m, J/m³. Axis letters: n points, p components of F and P.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.point_state import Floats, MaterialPoints, PointUpdate
from tribox.forms.bodies.point_stress import DISTORTION, energy_at_points

LARGEST = "largest_energy"


@dataclass(frozen=True, slots=True)
class Mullins:
    """Constants of the softening."""

    r: float  # the largest loss of stress is 1/r of it; above 1
    m: float  # Pa (J/m³), above 0: energies far below it soften little
    beta: float = 0.0  # makes the softening of large energies more gradual; 0 or above

    def width(self, largest: Floats) -> Floats:
        """The s, J/m³, of the largest energies (n,)."""
        return self.m + self.beta * largest

    def lost(self, largest: Floats) -> Floats:
        """D (n,), J/m³, of the largest energies (n,)."""
        s = self.width(largest)
        return np.asarray(s / self.r * (_area(largest / s) - _area(np.zeros_like(s))))


def _area(x: Floats) -> Floats:
    """An antiderivative of erf, even in x."""
    return np.asarray(x * erf(x) + np.exp(-x * x) / math.sqrt(math.pi))


class SofteningPoints(MaterialPoints):
    """What softening takes."""

    added = True

    def __init__(
        self, elastic: Material, softening: Mullins, space: bool, held: bool = False
    ) -> None:
        """Take the energy; ``space``: 9 components of F, else 5.

        ``held``: the largest energy is, as in first unloading: beyond it η goes on as it came.
        """
        super().__init__(space, {LARGEST: slice(0, 1)}, np.zeros(1))
        self.elastic, self.softening, self._held = elastic, softening, held
        self._distortion = energy_at_points(elastic, DISTORTION, space)

    def frozen(self) -> SofteningPoints:
        """The same with the largest energy held."""
        return SofteningPoints(self.elastic, self.softening, self.space, held=True)

    def update(
        self, F: Floats, state: Floats, dt: float, tangent: bool, volumetric: bool = True
    ) -> PointUpdate:
        """See :meth:`MaterialPoints.update`; there is no volumetric part and no rate."""
        with np.errstate(all="ignore"):
            W, P, A = self._distortion(F, tangent)
            before = state[:, 0]
            largest = before if self._held else np.maximum(before, W)
            s, r = self.softening.width(largest), self.softening.r
            x = (largest - W) / s
            below = (x > 0.0) | self._held
            less = erf(x) / r
            if A is not None:
                # ∂η/∂F = η' P, as ∂W/∂F = P; on the virgin curve η stays 1, and there is none.
                slope = np.where(below, 2.0 / math.sqrt(math.pi) * np.exp(-x * x) / (r * s), 0.0)
                A = slope[:, None, None] * (P[:, :, None] * P[:, None, :]) - less[:, None, None] * A
            P = -less[:, None] * P
            elastic = s / r * (_area(x) - _area(largest / s))
            gone = self.softening.lost(largest) - self.softening.lost(before)
            dissipation = np.where(largest > before, gone, 0.0)
        good = np.isfinite(P).all(axis=1) & np.isfinite(W)
        for values in (P, A, elastic, dissipation):
            if values is not None:
                values[~good] = np.nan
        end = np.where(good, largest, before)[:, None]
        lost = np.maximum(dissipation, 0.0)
        return PointUpdate(P, end, A, elastic, lost, np.zeros_like(lost), bool(good.all()))
