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

State: W_m, J/m³. Axis letters: n points, p components of F and P, a, b invariants: J, I1, I2 in
space, of the plane J and I1 in it and the stretch across it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from scipy.special import erf
from ufl.algorithms import expand_derivatives

from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.point_state import Floats, MaterialPoints, PointUpdate
from tribox.forms.bodies.point_stress import free_variables, of_invariants, values_of

LARGEST = "largest_energy"
TURNED = np.array([[0.0, 0, 0, 1], [0, 0, -1, 0], [0, -1, 0, 0], [1, 0, 0, 0]])  # ∂²det/∂F²


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
        """Differentiate the energy.

        Args:
            space: 9 components of F instead of the plane's 5.
            held: whether the largest energy is held, as in the first moment of unloading: beyond
                it η goes on as it came.
        """
        super().__init__(space, {LARGEST: slice(0, 1)}, np.zeros(1))
        self.elastic, self.softening, self._held = elastic, softening, held
        self._constants, variables = free_variables(3)
        k = of_invariants(variables, space)
        energy = elastic.energy(k, dict(elastic.parameters()))[0]
        slopes = [ufl.diff(energy, v) for v in variables]
        self._first = [expand_derivatives(e) for e in (energy, *slopes)]
        curved = [ufl.diff(slopes[a], variables[b]) for a in range(3) for b in range(a, 3)]
        self._second = [expand_derivatives(e) for e in curved]

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

    def _distortion(self, F: Floats, tangent: bool) -> tuple[Floats, Floats, Floats | None]:
        """Distortional energy (n,), J/m³, P (n, p) and A (n, p, p), Pa, as if nothing had softened.

        By the chain rule over the invariants: P = W_a g_a, A = W_ab g_a ⊗ g_b + W_a ∂g_a/∂F.
        """
        values, g = self._invariants(F)
        given = dict(zip(self._constants, values, strict=True))
        size = len(F)
        W, *slopes = (np.broadcast_to(v, size) for v in values_of(self._first, given))
        P = np.einsum("an,anp->np", slopes, g)
        if not tangent:
            return W, P, None
        second = [np.broadcast_to(v, size) for v in values_of(self._second, given)]
        A = sum(w[:, None, None] * H for w, H in zip(slopes, self._curvatures(F, g), strict=True))
        pairs = [(a, b) for a in range(3) for b in range(a, 3)]
        for (a, b), w in zip(pairs, second, strict=True):
            outer = g[a][:, :, None] * g[b][:, None, :]
            both = outer if a == b else outer + outer.transpose(0, 2, 1)
            A = A + w[:, None, None] * both
        return W, P, np.asarray(A)

    def _invariants(self, F: Floats) -> tuple[Sequence[Floats], Floats]:
        """The three invariants (n,), and their derivatives (a, n, p); NaN where J ≤ 0."""
        if self.space:
            f = F.reshape(-1, 3, 3)
            # ∂J/∂F is the cofactor matrix, its rows the cross products of the two other rows of F.
            cofactors = np.stack([np.cross(f[:, i - 2], f[:, i - 1]) for i in range(3)], axis=1)
            J, first = np.einsum("ni,ni->n", f[:, 0], cofactors[:, 0]), (f**2).sum(axis=(1, 2))
            slope = 2.0 * (first[:, None, None] * f - f @ f.transpose(0, 2, 1) @ f)
            g = np.stack([cofactors, 2.0 * f, slope]).reshape(3, -1, 9)
            return [np.where(J > 0.0, J, np.nan), first, (cofactors**2).sum(axis=(1, 2))], g
        flat, across = F[:, :4], F[:, 4]
        # det of the plane part is the quadratic form ½ F·T·F, T of zeros and ±1: its slope is T F,
        # its curvature T.
        turned = flat @ TURNED
        g = np.zeros((3, len(F), 5))
        g[0, :, :4], g[1, :, :4], g[2, :, 4] = turned, 2.0 * flat, 1.0
        J = 0.5 * (flat * turned).sum(axis=1)
        good = (J > 0.0) & (across > 0.0)
        return [np.where(good, J, np.nan), (flat**2).sum(axis=1), across], g

    def _curvatures(self, F: Floats, g: Floats) -> Sequence[Floats]:
        """Second derivatives (n, p, p) or (p, p) of the invariants by F."""
        if not self.space:
            flat = np.zeros((2, 5, 5))
            flat[0, :4, :4], flat[1, :4, :4] = TURNED, 2.0 * np.eye(4)
            return [flat[0], flat[1], np.zeros((5, 5))]
        f, one = F.reshape(-1, 3, 3), np.eye(3)
        # ∂²J/∂F_iJ ∂F_kL = ε_ikm ε_JLM F_mM.
        alternating = np.zeros((3, 3, 3))
        for i in range(3):
            alternating[i, i - 2, i - 1], alternating[i, i - 1, i - 2] = 1.0, -1.0
        volume = np.einsum("ikm,JLM,nmM->niJkL", alternating, alternating, f)
        C, b = f.transpose(0, 2, 1) @ f, f @ f.transpose(0, 2, 1)
        first = (f**2).sum(axis=(1, 2))
        # I2 = ½ ((tr C)² − tr C²): ∂²I2/∂F_iJ ∂F_kL = 4 F_iJ F_kL + 2 I1 δ_ik δ_JL − 2 (F_iL F_kJ +
        # δ_ik C_LJ + b_ik δ_JL).
        second = 4.0 * np.einsum("niJ,nkL->niJkL", f, f) - 2.0 * np.einsum("niL,nkJ->niJkL", f, f)
        second += 2.0 * np.einsum("n,ik,JL->niJkL", first, one, one)
        second -= 2.0 * np.einsum("ik,nLJ->niJkL", one, C)
        second -= 2.0 * np.einsum("nik,JL->niJkL", b, one)
        return [volume.reshape(-1, 9, 9), 2.0 * np.eye(9), second.reshape(-1, 9, 9)]
