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
endless step has t = 1: the branch is relaxed, C_k = C̄, and carries nothing. With U = F N,
V = U Fᵀ, H = F⁻ᵀ, n = tr V, q = tr V², g = G_k m^(1/3) J^(−2/3), y = t J^(−2/3) g

    P = g (U − n/3 H),
    A_iJkL = (g δ_ik − y V_ik) N_JL − y U_iL U_kJ + ⅔ y U_iJ U_kL + (g n/3) H_iL H_kJ
             + H_iJ Z_kL + Z_iJ H_kL + c H_iJ H_kL,
    Z = −(⅔ g + 2/9 y n) U + ⅔ y V U,   c = 2/9 g n + y (2/27 n² − 2/9 q).

With r = Δt/τ_k = t/(1 − t) and the stored energy W_k of a branch it dissipates in a step

    D_k = ½ G_k r tr[((C̄ C_k⁻¹)^D)²] + ⟨√W_k,n − √W_k⟩² ≥ 0,

the rate at the end times Δt, and what a branch that relaxes within the step loses beside it: of
second order while steps are short, and all that was stored where the step is endless.

State: of each branch C_k (11, 22, 33, 12; in space 23, 13 too), then what each has dissipated since
the start, then what each stores, J/m³. Axis letters: n points, p components of F and P, b branches,
i, J space.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.kinematics import Kinematics
from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.point_state import DISSIPATED, Kernel, MaterialPoints
from tribox.forms.bodies.softening import Mullins, PointsBeside, SofteningPoints

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
SOURCE = "viscous_points.c"
ROUNDOFF = 1e-14  # of G/2: less is no stored energy but what rounding leaves of 3 − 3
PLANE = (0, 1, 3, 4, 8)  # places of the plane's components among the nine
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))  # those of C_k, four in the plane


@dataclass(frozen=True, slots=True)
class Branch:
    """A spring and a dashpot in line: modulus G_k, Pa, and relaxation time τ_k, s."""

    modulus: float
    time: float


@dataclass(frozen=True, slots=True)
class Viscoelastic:
    """An elastomer with branches, or that softens, or both.

    Attributes:
        elastic: what is left of it when all branches are relaxed.
        branches: beside it.
        softening: of the relaxed energy, by the largest that a point has had; None: there is none.
    """

    elastic: Material
    branches: tuple[Branch, ...] = ()
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

    def energy(self, k: Kinematics, c: dict[str, Any]) -> tuple[Any, Any]:
        """The relaxed strain energy."""
        return self.elastic.energy(k, c)

    def points(self, space: bool) -> MaterialPoints:
        """Its branches, and what softens."""
        parts: list[MaterialPoints] = []
        if self.branches:
            parts.append(ViscousPoints(self.branches, space))
        if self.softening is not None:
            parts.append(SofteningPoints(self.elastic, self.softening, space))
        return parts[0] if len(parts) == 1 else PointsBeside(parts)


@dataclass(frozen=True, slots=True)
class ViscousUpdate:
    """What an update of n points gives, see :class:`tribox.forms.bodies.point_state.PointUpdate`.

    At points that are not valid all but the state is NaN, and the state is that of the begin.
    """

    P: Floats
    state: Floats
    A: Floats | None
    elastic: Floats
    dissipation: Floats
    valid: bool


class ViscousPoints:
    """The branches at material points, see :class:`tribox.forms.bodies.point_state.MaterialPoints`.

    Attributes:
        components: p; variables: s of a state; space: whether p = 9.
        compiled: whether the update is.
    """

    flows, added, rated = False, True, True

    def __init__(
        self, branches: Sequence[Branch], space: bool, compiled: bool = True, held: bool = False
    ) -> None:
        """Take the branches.

        Args:
            branches: one at least.
            space: 9 components of F instead of the plane's 5.
            compiled: whether to use the compiled update.
            held: whether the dashpots are held, as in a sudden deformation.
        """
        self.branches, self.space, self._held = tuple(branches), space, held
        self.components, self._metric = (9, 6) if space else (5, 4)
        self.variables = (self._metric + 2) * len(self.branches)
        self._moduli = np.array([branch.modulus for branch in self.branches])
        self._times = np.array([branch.time for branch in self.branches])
        self.compiled = compiled

    def kernel(self, section: str, dt: float, volumetric: bool = True) -> Kernel | None:
        """See ``CompiledPoints.kernel``.

        Raises:
            ValueError: dt ≤ 0.
        """
        if not dt > 0.0:
            raise ValueError(f"dt is {dt}: branches need dt > 0")
        if not self.compiled:
            return None
        work = _Branches(len(self.branches))
        work.tables = np.stack([self._moduli, *self._shares(dt)])
        work.modulus, work.share, work.rest = (row.ctypes.data for row in work.tables)
        return Kernel.of(SOURCE, f"viscous_{section}", work, symmetric=True)

    @property
    def columns(self) -> Mapping[str, slice]:
        """Where the variables lie in a state."""
        count, size = len(self.branches), self._metric
        found = {f"viscous_metric_{b + 1}": slice(size * b, size * (b + 1)) for b in range(count)}
        ends = size * count, (size + 1) * count
        return found | {DISSIPATED: slice(*ends), "stored": slice(ends[1], self.variables)}

    def start(self, points: int) -> Floats:
        """State (points, s) of relaxed, undeformed branches: C_k = I."""
        state = np.zeros((points, self.variables))
        for b in range(len(self.branches)):
            state[:, self._metric * b : self._metric * b + 3] = 1.0
        return state

    def frozen(self) -> ViscousPoints:
        """The same with the dashpots held."""
        return ViscousPoints(self.branches, self.space, self.compiled, held=True)

    def update(
        self, F: Floats, state: Floats, dt: float, tangent: bool, volumetric: bool = True
    ) -> ViscousUpdate:
        """See ``MaterialPoints.update``; there is no volumetric part.

        Raises:
            ValueError: arrays of other shapes, or dt ≤ 0.
        """
        wanted = (len(F), self.components), (len(F), self.variables)
        if (F.shape, state.shape) != wanted:
            raise ValueError(f"F and state have shapes {F.shape}, {state.shape}, not {wanted}")
        if kernel := self.kernel("space" if self.space else "ring", dt):
            P, new, A, energies, valid = kernel.update(F, state, tangent)
            return ViscousUpdate(P, new, A, energies[0], energies[1], valid)
        share, rest = self._shares(dt)
        with np.errstate(all="ignore"):
            return self._update(F, state, share, rest, tangent)

    def _shares(self, dt: float) -> tuple[Floats, Floats]:
        """The t and 1 − t (b,) of a step of ``dt`` (s)."""
        if self._held:
            return np.zeros_like(self._times), np.ones_like(self._times)
        if math.isinf(dt):
            return np.ones_like(self._times), np.zeros_like(self._times)
        whole = self._times + dt
        return np.asarray(dt / whole), np.asarray(self._times / whole)

    def _update(
        self, F: Floats, state: Floats, share: Floats, rest: Floats, tangent: bool
    ) -> ViscousUpdate:
        """The update in numpy."""
        at, new = _Deformation(self._tensors(F)), state.copy()
        P, columns = np.zeros_like(at.F), self.columns
        lost = np.zeros((len(F), len(self.branches)))
        A = np.zeros((len(F), 3, 3, 3, 3)) if tangent else None
        stored = np.zeros_like(lost)
        for b, (G, t, s) in enumerate(zip(self._moduli, share, rest, strict=True)):
            old = self._metrics(state, b)
            M = s * old + t * at.j[:, None, None] * at.C
            cube, N = np.cbrt(np.linalg.det(M)), _inverse(M)
            U = at.F @ N
            g, V = G * cube * at.j, U @ at.F.transpose(0, 2, 1)
            n = np.trace(V, axis1=1, axis2=2)
            P += g[:, None, None] * (U - n[:, None, None] / 3.0 * at.H)
            excess = cube * at.j * n - 3.0
            stored[:, b] = 0.5 * G * np.where(excess < ROUNDOFF, 0.0, excess)
            # (C̄ C_k⁻¹)^D = −(C_k,n C_k⁻¹)^D/r: the one that holds more digits.
            of, factor = (at.j[:, None, None] * at.C, t / s) if t < 0.5 else (old, s / t)
            lost[:, b] = 0.5 * G * factor * cube**2 * _distance(of @ N)
            places = PAIRS[: self._metric]
            rows = slice(self._metric * b, self._metric * (b + 1))
            new[:, rows] = np.stack([M[:, i, j] / cube for i, j in places], axis=1)
            if A is not None:
                A += branch_tangent(at.H, U, V, N, g, t * at.j * g)
        fallen = np.sqrt(state[:, columns["stored"]]) - np.sqrt(stored)
        lost += np.maximum(fallen, 0.0) ** 2
        new[:, columns[DISSIPATED]] += lost
        new[:, columns["stored"]] = stored
        return self._result(P, new, state, A, stored.sum(axis=1), lost.sum(axis=1), at.valid)

    def _result(
        self,
        P: Floats,
        new: Floats,
        old: Floats,
        A: Floats | None,
        stored: Floats,
        lost: Floats,
        valid: Bools,
    ) -> ViscousUpdate:
        places = slice(None) if self.space else list(PLANE)
        rows = P.reshape(-1, 9)[:, places]
        good = valid & np.isfinite(rows).all(axis=1) & np.isfinite(new).all(axis=1)
        new = np.where(good[:, None], new, old)
        if A is not None:
            A = A.reshape(-1, 9, 9)[:, places][:, :, places].copy()
        for values in (rows, A, stored, lost):
            if values is not None:
                values[~good] = np.nan
        return ViscousUpdate(rows, new, A, stored, lost, bool(good.all()))

    def _tensors(self, rows: Floats) -> Floats:
        """Tensors (n, 3, 3) of components (n, p)."""
        out = np.zeros((len(rows), 9))
        out[:, slice(None) if self.space else list(PLANE)] = rows
        return out.reshape(-1, 3, 3)

    def _metrics(self, state: Floats, b: int) -> Floats:
        """C_k (n, 3, 3) of a branch."""
        out = np.zeros((len(state), 3, 3))
        for k, (i, j) in enumerate(PAIRS[: self._metric]):
            out[:, i, j] = out[:, j, i] = state[:, self._metric * b + k]
        return out


class _Deformation:
    """F, H = F⁻ᵀ and C (n, 3, 3), and j = J^(−2/3) (n,)."""

    def __init__(self, F: Floats) -> None:
        J = np.linalg.det(F)
        self.valid: Bools = np.isfinite(J) & (J > 0.0)
        self.F = np.where(self.valid[:, None, None], F, np.eye(3))
        self.j = np.where(self.valid, J, 1.0) ** (-2.0 / 3.0)
        self.H = _inverse(self.F).transpose(0, 2, 1)
        self.C = self.F.transpose(0, 2, 1) @ self.F


def branch_tangent(H: Floats, U: Floats, V: Floats, N: Floats, g: Floats, y: Floats) -> Floats:
    """A (n, i, J, k, L), Pa, of a branch, see the module's docstring."""
    n, q = (np.asarray(np.trace(T, axis1=1, axis2=2)) for T in (V, V @ V))

    def by(values: Floats, pattern: str, *tensors: Floats) -> Floats:
        return np.asarray(np.einsum(f"n,{pattern}->niJkL", values, *tensors))

    y3 = np.asarray(2.0 * y / 3.0)
    Z = -(2.0 / 3.0 * g + y3 * n / 3.0)[:, None, None] * U + y3[:, None, None] * (V @ U)
    one = np.ones_like(g)
    out = by(g, "ik,nJL", np.eye(3), N) - by(y, "nik,nJL", V, N) - by(y, "niL,nkJ", U, U)
    out += by(y3, "niJ,nkL", U, U) + by(g * n / 3.0, "niL,nkJ", H, H)
    out += by(one, "niJ,nkL", H, Z) + by(one, "niJ,nkL", Z, H)
    last = np.asarray(2.0 / 9.0 * (g * n - y * q) + 2.0 / 27.0 * y * n**2)
    return out + by(last, "niJ,nkL", H, H)


def _distance(A: Floats) -> Floats:
    """The tr (A^D)² (n,) of tensors similar to symmetric ones: not negative."""
    D = A - np.trace(A, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    return np.maximum(np.einsum("nij,nji->n", D, D), 0.0)


def _inverse(A: Floats) -> Floats:
    """Inverses (n, 3, 3) by cofactors, not numbers where there is none."""
    x, y, z = (A[:, i] for i in range(3))
    columns = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=2)
    return np.asarray(columns / np.einsum("ni,ni->n", x, columns[:, :, 0])[:, None, None])


class _Branches(ctypes.Structure):
    """``Branches`` of the C source."""

    tables: Floats  # what the others point to
    _fields_ = (
        ("branches", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("modulus", "share", "rest")),
    )
