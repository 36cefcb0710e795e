r"""Elastomers with Maxwell branches (a Prony series): the material, and its points that remember.

The branches are neo-Hookean springs in C̄ = J^(−2/3) C, each in line with a dashpot, beside any
strain energy W_∞ (Simo, Comput. Methods Appl. Mech. Engng 60 (1987) 153, in the form of Reese &
Govindjee, Int. J. Solids Struct. 35 (1998) 3455):

    W = W_∞ + Σ_k ½ G_k (tr C̄ C_k⁻¹ − 3),   Ċ_k = (1/τ_k) (C̄ C_k⁻¹)^D C_k.

The backward Euler step has a closed solution (Shutov, Landgraf & Ihlemann, Comput. Methods Appl.
Mech. Engng 265 (2013) 213), C_k ∝ C_k,n + (Δt/τ_k) C̄ with det C_k = 1. With t = Δt/(τ_k + Δt),
M = (1 − t) C_k,n + t C̄, N = M⁻¹ and m = det M it is

    C_k = m^(−1/3) M,   S_k = J^(−2/3) G_k m^(1/3) (N − ⅓ (C:N) C⁻¹):

the stress of an energy 3 G_k m^(1/3)/(2 t) of the step, so that its tangent is symmetric. An
endless step has t = 1: the branch is relaxed, C_k = C̄, and carries nothing. With H = F⁻ᵀ and
n = C:N, g = G_k m^(1/3) J^(−2/3)

    P = g (F N − n/3 H).

**Tangent**, about the present place (``MODULI`` of ``point_lanes.h``): with S = g F N Fᵀ, p = tr S
and e = t m^(−1/3)/G_k the branch adds to τ and c

    τ = S − p/3 1,
    c_ijkl = ⅔ e S_ij S_kl − e (S_ik S_jl + S_il S_jk) + ⅓ p (δ_ik δ_jl + δ_il δ_jk)
             + δ_ij Z_kl + Z_ij δ_kl + (2/9 p + e (2/27 p² − 2/9 S:S)) δ_ij δ_kl,
    Z = ⅔ e S² − (⅔ + 2/9 e p) S.

With r = Δt/τ_k = t/(1 − t) and the stored energy W_k of a branch it dissipates in a step

    D_k = R + √(½ r R) (√W_k,n − √W_k) ≥ 0,   R = ½ G_k r tr[((C̄ C_k⁻¹)^D)²],

the rate at the end times Δt, and what the mean stress over the step makes of it, to second order.
Steps with r ≥ 1 have R + ⟨√W_k,n − √W_k⟩²: all that was stored where the step is endless.

State: of each branch C_k (11, 22, 33, 12; in space 23, 13 too), then what each has dissipated since
the start, then what each stores, J/m³. Axis letters: n points, p components of F and P, b branches,
i, J space.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tribox.forms.bodies import point_state
from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.softening import Mullins, SofteningPoints

SOURCE = "viscous_points.c"


@dataclass(frozen=True, slots=True)
class Branch:
    """A spring and a dashpot in line: modulus G_k, Pa, and relaxation time τ_k, s."""

    modulus: float
    time: float


@dataclass(frozen=True, slots=True)
class Viscoelastic:
    """An elastomer with branches, or that softens, or both."""

    elastic: Material  # what is left of it when all branches are relaxed
    branches: tuple[Branch, ...] = ()  # beside it
    # of the relaxed energy, by the largest that a point has had; None: there is none
    softening: Mullins | None = None

    @property
    def shear_modulus(self) -> float:
        """G of a sudden deformation, Pa: G_∞ + Σ G_k."""
        return self.elastic.shear_modulus + sum(branch.modulus for branch in self.branches)

    @property
    def bulk_modulus(self) -> float:
        """K, Pa: a volume does not relax."""
        return self.elastic.bulk_modulus

    def parameters(self) -> dict[str, float]:
        """Those of the relaxed energy."""
        return self.elastic.parameters()

    def points(self, space: bool) -> point_state.MaterialPoints:
        """Its branches, and what softens."""
        parts: list[point_state.MaterialPoints] = []
        if self.branches:
            parts.append(ViscousPoints(self.branches, space))
        if self.softening is not None:
            parts.append(SofteningPoints(self.elastic, self.softening, space))
        return parts[0] if len(parts) == 1 else point_state.PointsBeside(parts)


class _Branches(ctypes.Structure):
    """``Branches`` of the C source."""

    tables: point_state.Floats  # what the others point to
    _fields_ = (
        ("branches", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("modulus", "share", "rest", "ratio")),
    )


class ViscousPoints(point_state.MaterialPoints):
    """The branches at material points."""

    added = rated = True

    def __init__(self, branches: Sequence[Branch], space: bool, held: bool = False) -> None:
        """Take the branches.

        Args:
            branches: one at least.
            space: 9 components of F instead of the plane's 5.
            held: whether the dashpots are held, as in a sudden deformation.
        """
        self.branches, self._held = tuple(branches), held
        self._moduli = np.array([branch.modulus for branch in self.branches])
        self._times = np.array([branch.time for branch in self.branches])
        count, metric = len(self.branches), np.repeat([1.0, 0.0], [3, 3 if space else 1])
        size = len(metric)
        columns = {f"viscous_metric_{b + 1}": slice(size * b, size * (b + 1)) for b in range(count)}
        ends = [size * count, (size + 1) * count, (size + 2) * count]
        columns |= {point_state.DISSIPATED: slice(*ends[:2]), "stored": slice(*ends[1:])}
        super().__init__(space, columns, np.append(np.tile(metric, count), np.zeros(2 * count)))

    def frozen(self) -> ViscousPoints:
        """The same with the dashpots held."""
        return ViscousPoints(self.branches, self.space, held=True)

    def kernel(self, section: str, dt: float, volumetric: bool = True) -> point_state.Kernel:
        """See :meth:`MaterialPoints.kernel`; no volumetric part; ValueError if dt ≤ 0."""
        if not dt > 0.0:
            raise ValueError(f"dt is {dt}: branches need dt > 0")
        # t of the backward Euler step and 1 − t: 1 and 0 of an endless step, 0 and 1 of held
        # dashpots.
        share, rest = np.ones_like(self._times), np.zeros_like(self._times)
        if self._held:
            share, rest = rest, share
        elif math.isfinite(dt):
            share, rest = dt / (self._times + dt), self._times / (self._times + dt)
        work = _Branches(len(self.branches))
        ratio = np.minimum(share, rest) / np.maximum(share, rest)
        work.tables = np.stack([self._moduli, share, rest, ratio])
        rows = (row.ctypes.data for row in work.tables)
        work.modulus, work.share, work.rest, work.ratio = rows
        metrics = self.columns[point_state.DISSIPATED].start  # what comes before
        return point_state.Kernel.of(
            SOURCE, f"viscous_{section}", work, symmetric=True, read=metrics
        )
