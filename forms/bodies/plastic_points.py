"""Material points of metals: stress, memory and consistent tangent of finite J2 plasticity.

F = Fᵉ Fᵖ; elastic energy W = G |dev e|² + K/2 (tr e)² of the logarithmic strain e = ½ ln bᵉ; yield
stress σ_Y(α); the flow rule integrated by the exponential map, so that plastic flow keeps the
volume (Simo, Comput. Methods Appl. Mech. Engng 99 (1992) 61; de Souza Neto, Perić & Owen,
Computational Methods for Plasticity (2008), ch. 14). In the principal axes n_a of the trial
bᵉ = F C_p⁻¹ Fᵀ = Σ w_a n_a⊗n_a everything is scalar, and with G_a = F⁻¹ n_a

    P = Σ τ_a n_a⊗G_a,   C_p⁻¹ ← Σ exp(2 e_a) G_a⊗G_a,
    A = ∂P/∂F = Σ B_(ab)(cd) M_ab⊗M_cd,   M_ab = n_a⊗G_b,

where B couples M_11, M_22, M_33 by D_ab − τ_a δ_ab with D = ∂τ/∂e, and M_ab with M_ba by
[[g + τ_b, g], [g, g + τ_a]], g = (τ_a w_b − τ_b w_a)/(w_a − w_b).

With backstress the flow has axes of its own, so that τ has all components in those of the trial
state: :mod:`tribox.forms.bodies.return_mapping`. Then A is not symmetric, where b > 0.

Components: in the plane 5 of F, P, A (11, 12, 21, 22, 33) and 5 of the state, C_p⁻¹ (11, 22, 33,
12) and α; in space 9, row by row, and 7, C_p⁻¹ (11, 22, 33, 12, 23, 13) and α. C_pi of each branch
of the backstress stands before α like C_p⁻¹. Axis letters: n points, p components, a, b principal
axes, i, J components in space.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.hardening import (
    Hardening,
    JohnsonCook,
    Linear,
    Metal,
    Perzyna,
    RateFactor,
    Swift,
    Table,
    Voce,
)
from tribox.forms.bodies.point_state import Kernel
from tribox.forms.bodies.principal_axes import (
    PrincipalAxes,
    axes_in_plane,
    axes_in_space,
    log_ratio,
)
from tribox.forms.bodies.return_mapping import (
    Flow,
    exponential,
    flow,
    flow_with_backstress,
    symmetric_basis,
    turned_moduli,
)
from tribox.forms.native.libraries import library

# -- The compiled update, ``plastic_points.c`` -----------------------------------------------------
#
# The same numbers to round-off as this module computes in numpy.

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
SOURCE = "plastic_points.c"
MOST_BRANCHES = 8  # of the backstress, MOST of the C source


class _Material(ctypes.Structure):
    """``Material`` of the C source, field by field in the same order."""

    tables: tuple[Floats, Floats]  # what the others point to
    _fields_ = (
        ("shear", ctypes.c_double),
        ("bulk", ctypes.c_double),
        ("dt", ctypes.c_double),
        ("rate_parameters", ctypes.c_double * 2),
        ("law", ctypes.c_int64),
        ("rate", ctypes.c_int64),
        ("count", ctypes.c_int64),
        ("parameters", ctypes.c_void_p),
        ("branches", ctypes.c_int64),
        ("backstress", ctypes.c_void_p),
    )


def _laid_out(material: Metal, dt: float, bulk: float) -> _Material | None:
    """A material as the C source has it; None: a law that it does not know.

    Args:
        material: the metal.
        dt: s, length of the step.
        bulk: K, Pa, or 0.

    Raises:
        RuntimeError: the library's layout of a material is another one.
    """
    known = isinstance(material.hardening, Linear | Voce | Swift | Table)
    known &= isinstance(material.rate, JohnsonCook | Perzyna | None)
    if not known or len(material.kinematic) > MOST_BRANCHES:
        return None
    size = library(SOURCE).tribox_plastic_material_size
    size.restype = ctypes.c_int64
    if size() != ctypes.sizeof(_Material):
        raise RuntimeError(f"{SOURCE}: its structure Material is not the one of {__name__}")
    law, parameters = _law(material.hardening)
    rate, rate_parameters = _rate(material.rate)
    branches = [(branch.modulus, branch.recovery) for branch in material.kinematic]
    tables = parameters, np.array(branches, dtype=np.float64)
    out = _Material(
        shear=material.shear_modulus,
        bulk=bulk,
        dt=dt,
        rate_parameters=rate_parameters,
        law=law,
        rate=rate if np.isfinite(dt) else 0,
        count=len(parameters) // 2,
        parameters=tables[0].ctypes.data,
        branches=len(branches),
        backstress=tables[1].ctypes.data,
    )
    out.tables = tables
    return out


def _law(law: Hardening) -> tuple[int, Floats]:
    """Number and parameters of a law as the C source has them."""
    if isinstance(law, Linear):
        return 0, np.array([law.yield_stress, law.modulus])
    if isinstance(law, Voce):
        return 1, np.array([law.yield_stress, law.saturation_stress, law.exponent, law.modulus])
    if isinstance(law, Swift):
        return 2, np.array([law.K, law.strain0, law.n])
    assert isinstance(law, Table)
    return 3, np.ascontiguousarray(np.array(law.points).T).reshape(-1)


def _rate(rate: RateFactor | None) -> tuple[int, tuple[float, float]]:
    """Number and parameters of a rate factor as the C source has them."""
    if isinstance(rate, JohnsonCook):
        return 1, (rate.C, rate.reference_rate)
    if isinstance(rate, Perzyna):
        return 2, (rate.reference_rate, rate.exponent)
    return 0, (0.0, 0.0)


PLANE = (0, 1, 3, 4, 8)  # places of the plane's components among the nine
PLASTIC_STRAIN = "equivalent_plastic_strain"  # its name among the variables


@dataclass(frozen=True, slots=True)
class PlasticUpdate:
    """What an update of n points gives; energies per reference volume.

    Attributes:
        P: (n, p), Pa, first Piola stress.
        state: (n, s) at the end of the step.
        A: (n, p, p), Pa, ∂P/∂F; None if not asked for.
        elastic: (n,), J/m³, stored energy (its distortional part if that alone was asked for), that
            of the backstress included.
        dissipation: (n,), J/m³, plastic work of the step that is not stored, σ(end) Δα ≥ 0; with
            backstress also b |X|²/(2μ) Δα of each branch.
        numerical: (n,), J/m³, the part of it that is due to the step's size: ½ (σ_Y(end) −
            σ_Y(begin)) Δα above the work along the hardening curve, likewise of the branches.
        valid: False if det F is not positive, or a number not finite, at any point; at such points
            all floats but the state are NaN, and the state is that of the step's begin.
    """

    P: Floats
    state: Floats
    A: Floats | None
    elastic: Floats
    dissipation: Floats
    numerical: Floats
    valid: bool


class PlasticPoints:
    """The update of a material's points, see :class:`MaterialPoints`."""

    flows, added = True, False

    def __init__(self, material: Metal, space: bool, compiled: bool = True) -> None:
        """Take the material.

        Args:
            material: moduli, hardening and rate factor.
            space: 9 components of F instead of the plane's 5.
            compiled: whether to use the compiled update where there is one.
        """
        self.material = material
        self.space = space
        self.components, metric = (9, 6) if space else (5, 4)
        self.variables = metric * (1 + len(material.kinematic)) + 1
        self._metric = metric
        self._compiled = compiled

    @property
    def columns(self) -> dict[str, slice]:
        """Where the variables lie in a state."""
        metric = self.variables - 1
        return {"plastic_metric": slice(0, metric), PLASTIC_STRAIN: slice(metric, metric + 1)}

    @property
    def rated(self) -> bool:
        """Whether the yield stress depends on the rate."""
        return self.material.rate is not None

    def frozen(self) -> PlasticPoints:
        """Points that do not flow on."""
        return PlasticPoints(self.material.unyielding(), self.space, self._compiled)

    @property
    def compiled(self) -> bool:
        """Whether the update is compiled: it knows the laws."""
        return self._compiled and _laid_out(self.material, 1.0, 0.0) is not None

    def kernel(self, section: str, dt: float, volumetric: bool = True) -> Kernel | None:
        """See ``CompiledPoints.kernel``.

        Raises:
            ValueError: dt ≤ 0 for a material with a rate factor.
        """
        if self.material.rate is not None and not dt > 0.0:
            raise ValueError(f"dt is {dt}: a material with a rate factor needs dt > 0")
        bulk = self.material.bulk_modulus if volumetric else 0.0
        made = _laid_out(self.material, dt, bulk) if self._compiled else None
        if made is None:
            return None
        turning = bool(self.material.kinematic)
        name = f"{'turning' if turning else 'plastic'}_{'space' if self.space else 'plane'}"
        return Kernel.of(SOURCE, name, made, symmetric=not turning)

    def start(self, points: int) -> Floats:
        """State (points, s) of a body that has not flowed: C_p⁻¹ = C_pi = I, α = 0."""
        state = np.zeros((points, self.variables))
        for first in range(0, self.variables - 1, self._metric):
            state[:, first : first + 3] = 1.0
        return state

    def update(
        self, F: Floats, state: Floats, dt: float, tangent: bool, volumetric: bool = True
    ) -> PlasticUpdate:
        """Stress, new state and energies at the deformation gradients ``F``.

        Args:
            F: (n, p) deformation gradients at the end of the step.
            state: (n, s) at its begin.
            dt: s, its length; read if the material has a rate factor, which ``inf`` makes 1.
            tangent: whether to compute A.
            volumetric: False leaves the terms in K out (selective reduced integration).

        Raises:
            ValueError: arrays of other shapes, or dt ≤ 0 for a material with a rate factor.
        """
        wanted = (len(F), self.components), (len(F), self.variables)
        if (F.shape, state.shape) != wanted:
            raise ValueError(f"F and state have shapes {F.shape}, {state.shape}, not {wanted}")
        if kernel := self.kernel("space" if self.space else "ring", dt, volumetric):
            P, new, A, energies, valid = kernel.update(F, state, tangent)
            elastic, dissipation, rated = energies
            return PlasticUpdate(P, new, A, elastic, dissipation, rated, valid)
        bulk = self.material.bulk_modulus if volumetric else 0.0
        with np.errstate(all="ignore"):
            return self._update(F, state, dt, tangent, bulk)

    def _update(
        self, F: Floats, state: Floats, dt: float, tangent: bool, bulk: float
    ) -> PlasticUpdate:
        """The update in numpy."""
        if self.material.kinematic:
            return self._update_with_backstress(F, state, dt, tangent, bulk)
        axes = (axes_in_space if self.space else axes_in_plane)(F, state)
        flowed = flow(self.material, axes.logs, state[:, -1], dt)
        volume = axes.logs.sum(axis=1)
        tau = flowed.deviator + (bulk * volume)[:, None]
        bases = axes.bases()
        bases = bases if self.space else bases[:, :, PLANE]
        P = np.einsum("na,nap->np", tau, bases[:, ::4])
        good = axes.valid & np.isfinite(P).all(axis=1) & np.isfinite(flowed.step)
        A = None
        if tangent:
            B = principal_tangent(axes, flowed, tau, self.material.shear_modulus, bulk)
            A = np.swapaxes(bases, 1, 2) @ B @ bases
            good &= np.isfinite(A).all(axis=(1, 2))
            A[~good] = np.nan
        elastic = (flowed.deviator**2).sum(axis=1) / (4.0 * self.material.shear_modulus)
        elastic += 0.5 * bulk * volume**2
        dissipation, numerical = flowed.stress * flowed.step, flowed.numerical
        for values in (P, elastic, dissipation, numerical):
            values[~good] = np.nan
        new = self._state(axes, flowed, state, good)
        return PlasticUpdate(P, new, A, elastic, dissipation, numerical, bool(good.all()))

    def _state(self, axes: PrincipalAxes, flowed: Flow, state: Floats, good: Bools) -> Floats:
        """The state at the end; where nothing flowed, the one at the begin to the last bit."""
        e = axes.logs - axes.logs.mean(axis=1)[:, None]
        stretch = axes.w * np.exp(-2.0 * (1.0 - flowed.theta)[:, None] * e)
        C = np.einsum("na,nai,naj->nij", stretch, axes.G, axes.G).reshape(-1, 9)
        places = (0, 4, 8, 1, 5, 2) if self.space else (0, 4, 8, 1)
        new = np.column_stack([C[:, places], state[:, -1] + flowed.step])
        return np.where((good & (flowed.step > 0.0))[:, None], new, state)

    def _update_with_backstress(
        self, F: Floats, state: Floats, dt: float, tangent: bool, bulk: float
    ) -> PlasticUpdate:
        """The update in numpy where the material hardens kinematically."""
        axes = (axes_in_space if self.space else axes_in_plane)(F, state)
        inner = np.where(axes.valid[:, None, None, None], self._inner(state), np.eye(3))
        alpha = state[:, -1]
        end = flow_with_backstress(self.material, axes, inner, alpha, dt)
        volume, G = axes.logs.sum(axis=1), self.material.shear_modulus
        deviator = end.strain - (volume / 3.0)[:, None, None] * np.eye(3)
        tau = 2.0 * G * deviator + (bulk * volume)[:, None, None] * np.eye(3)
        bases = axes.bases()
        bases = bases if self.space else bases[:, :, PLANE]
        P = np.einsum("na,nap->np", tau.reshape(-1, 9), bases)
        good = axes.valid & np.isfinite(P).all(axis=1) & np.isfinite(end.step)
        A = None
        if tangent:
            moduli = turned_moduli(self.material, axes, end, bulk, self.space)
            A = np.swapaxes(bases, 1, 2) @ _pushed(moduli, tau, self.space) @ bases
            good &= np.isfinite(A).all(axis=(1, 2))
            A[~good] = np.nan
        elastic = G * (deviator**2).sum(axis=(1, 2)) + 0.5 * bulk * volume**2 + end.stored
        dissipation, numerical = end.dissipation, end.numerical
        for values in (P, elastic, dissipation, numerical):
            values[~good] = np.nan
        metrics = [np.einsum("naI,nab,nbJ->nIJ", axes.G, exponential(2.0 * end.strain), axes.G)]
        H = np.einsum("nai,niJ->naJ", axes.n, _whole(F, self.space))  # Fᵀ n_a
        for branch in end.branches:
            C = np.einsum("naI,nab,nbJ->nIJ", H, branch.K, H)
            metrics.append(C / np.cbrt(np.linalg.det(C))[:, None, None])
        places = (0, 4, 8, 1, 5, 2) if self.space else (0, 4, 8, 1)
        parts = [C.reshape(-1, 9)[:, places] for C in metrics]
        new = np.column_stack([*parts, alpha + end.step])
        new = np.where((good & (end.step > 0.0))[:, None], new, state)
        return PlasticUpdate(P, new, A, elastic, dissipation, numerical, bool(good.all()))

    def _inner(self, state: Floats) -> Floats:
        """C_pi (n, k, 3, 3) of the branches."""
        rows = state[:, self._metric : -1].reshape(len(state), -1, self._metric)
        full = np.zeros((*rows.shape[:2], 9))
        full[..., (0, 4, 8, 1, 5, 2) if self.space else (0, 4, 8, 1)] = rows
        upper = full.reshape(*rows.shape[:2], 3, 3)
        return upper + np.swapaxes(np.triu(upper, 1), 2, 3)


def _pushed(moduli: Floats, tau: Floats, space: bool) -> Floats:
    """B (n, 3a + b, 3c + d), Pa, of the module's docstring, where τ has axes of its own.

    (δP Fᵀ) = δτ − τ δlᵀ for δF = δl F, with δτ = c:d + W τ − τ W of the parts d and W of δl.

    Args:
        moduli: (n, m, m), c of ``turned_moduli``.
        tau: (n, a, b), Pa.
        space: whether the basis is that in space.
    """
    flat, eye = symmetric_basis(space).reshape(-1, 9), np.eye(3)
    B = np.einsum("pi,npq,qj->nij", flat, moduli, flat)
    parts = (
        np.einsum("ac,ndb->nabcd", eye, tau)
        - np.einsum("ad,ncb->nabcd", eye, tau)
        - np.einsum("nac,bd->nabcd", tau, eye)
        - np.einsum("nad,bc->nabcd", tau, eye)
    )
    return np.asarray(B + 0.5 * parts.reshape(-1, 9, 9))


def _whole(F: Floats, space: bool) -> Floats:
    """F (n, 3, 3) of its components."""
    if space:
        return F.reshape(-1, 3, 3)
    full = np.zeros((len(F), 9))
    full[:, PLANE] = F
    return full.reshape(-1, 3, 3)


def principal_tangent(
    axes: PrincipalAxes, flowed: Flow, tau: Floats, shear: float, bulk: float
) -> Floats:
    """B (n, 3a + b, 3c + d), Pa, of the module's docstring.

    g is written as Gθ artanh(z)/z − ½ (τ_a + τ_b), z = (w_a − w_b)/(w_a + w_b), which holds as it
    stands where w_a = w_b.

    Args:
        axes: principal axes of the trial state.
        flowed: what the return mapping gave.
        tau: (n, a), Pa, principal Kirchhoff stresses.
        shear: G, Pa.
        bulk: K, Pa.
    """
    n, eye = flowed.direction, np.eye(3)
    B = np.zeros((len(tau), 9, 9))
    D = 2.0 * shear * flowed.theta[:, None, None] * (eye - 1.0 / 3.0) + bulk
    D -= 2.0 * shear * flowed.theta_bar[:, None, None] * n[:, :, None] * n[:, None, :]
    B[:, ::4, ::4] = D - tau[:, :, None] * eye
    for a, b in ((0, 1), (0, 2), (1, 2)):
        ratio = log_ratio(axes.w[:, a], axes.w[:, b], axes.logs[:, a] - axes.logs[:, b])
        g = shear * flowed.theta * ratio - 0.5 * (tau[:, a] + tau[:, b])
        ab, ba = 3 * a + b, 3 * b + a
        B[:, ab, ba] = B[:, ba, ab] = g
        B[:, ab, ab], B[:, ba, ba] = g + tau[:, b], g + tau[:, a]
    return B
