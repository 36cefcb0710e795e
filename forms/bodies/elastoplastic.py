"""Metals: elastic in the logarithmic strain, plastic by von Mises, hardening both ways.

F = Fᵉ Fᵖ; elastic energy W = G |dev e|² + K/2 (tr e)² of the logarithmic strain e = ½ ln bᵉ
(Hencky's); yield stress σ_Y(α); the flow rule integrated by the exponential map, so that plastic
flow keeps the volume (Simo, Comput. Methods Appl. Mech. Engng 99 (1992) 61; de Souza Neto, Perić &
Owen, Computational Methods for Plasticity (2008), ch. 14). Material points are updated by the
source ``plastic_points.c``. In the principal axes n_a of the trial
bᵉ = F C_p⁻¹ Fᵀ = Σ w_a n_a⊗n_a everything is scalar, and with G_a = F⁻¹ n_a

    P = Σ τ_a n_a⊗G_a,   C_p⁻¹ ← Σ exp(2 e_a) G_a⊗G_a,
    c = Σ (D_ab − 2 τ_a δ_ab) m_aa⊗m_bb + Σ_(a<b) g_ab s_ab⊗s_ab,   m_ab = n_a⊗n_b,

of ``MODULI`` in ``point_lanes.h``, with D = ∂τ/∂e, s_ab = m_ab + m_ba and
g = (τ_a w_b − τ_b w_a)/(w_a − w_b), which is written as
Gθ artanh(z)/z − ½ (τ_a + τ_b), z = (w_a − w_b)/(w_a + w_b), and so holds where w_a = w_b. With
n = dev e/|dev e| of the trial strain, ∂τ_dev/∂e = 2Gθ (I − ⅓ 1⊗1) − 2Gθ̄ n⊗n; θ = 1 and θ̄ = 0 are
elastic. A point on the yield surface whose strain does not change (the first iteration of a step)
has the tangent of plastic loading, not the elastic one, which would send Newton's method far beyond
yield; as round-off decides on which side of the surface it lies, so has one just below it.

**Return mapping.** How much plastic strain brings the stress to yield: with the trial stress
q̂ = √(3/2)|s| (von Mises) and the rate Δα/Δt

    g(Δα) = q̂ − 3G Δα − σ_Y(α + Δα) R(Δα/Δt) = 0.

g falls (σ_Y and R do not), so its root lies in [0, (q̂ − σ_Y(α))/3G] and is the only one; where a
backstress fades, which may leave more stress than there was, q̂ there is the most that can be left.
Newton's method from the left is monotone where σ_Y and R are concave; a step that leaves the
bracket of the root is replaced by one to its middle, so that tables and kinks converge as well.
Where the law is steep and Δα small beside α, g jumps with the round-off of α + Δα, and nothing less
is asked of it there. Dissipated is σ(end) Δα ≥ 0, with backstress also b |X|²/(2μ) Δα of each
branch; ½ (σ_Y(end) − σ_Y(begin)) Δα of it, likewise of the branches, is due to the step's size.

**Backstress** has axes of its own, and the flow turns with it. Fᵖ = Fᵖᵉ Fᵖⁱ (Lion, Int. J.
Plasticity 16 (2000) 469; Dettmer & Reese, Comput. Methods Appl. Mech. Engng 193 (2004) 87;
Vladimirov, Pietryga & Reese, Int. J. Numer. Meth. Engng 75 (2008) 1): each branch stores
μ/2 (tr B − 3), μ = c/3, with B = Fᵖᵉ Fᵖᵉᵀ = E (F⁻ᵀ C_pi F⁻¹)⁻¹ E, E = exp(−e), e the elastic
logarithmic strain. Fᵉ is taken free of rotation, so that all stands in the present configuration:

    X = μ dev B,   e = e_trial − D,   D = √(3/2) Δα ν,   ν = (s − ΣX)/|s − ΣX|,
    √(3/2) |s − ΣX| = σ_Y(α + Δα) R(Δα/Δt),   s = 2G dev e,

the flow rule in logarithmic strains of Eterovic & Bathe, Int. J. Numer. Meth. Engng 30 (1990)
1099. The inner metric, Ċ_pi = b α̇ (C_p − ⅓ tr(C_p C_pi⁻¹) C_pi) (Armstrong & Frederick), follows in
closed form a C_p that goes straight from the step's begin to its end: with y = b Δα,

    C_pi ← unimodular(e^(−y) C_pi + (φ − e^(−y)) C_p,begin + (1 − φ) C_p,end), φ = (1 − e^(−y))/y,

which keeps det C_pi = 1, and X of a straight pull right whatever the step (implicit Euler errs by
½ b Δα of its change). X is e^(−y) X_begin + ⅔ c φ D but for a rest of the size of the strain in
Fᵖᵉ, some 1/b of it. With the rest held, everything hangs on Δα alone; the rest is then taken anew,
and as c is small beside 3G four turns are usual. Then
A is not symmetric, where b > 0. With L d the change of the trial strain for a symmetric δF = d F,
de = L d − dD. The implicit function of the return is solved for y, dD = N y,
N = η (I − ν⊗ν) + ϑ ν⊗ν, η = 2G|D|/(2G|D| + √⅔ σ), ϑ = 3G/(3G + σ'):

    (2G I − (∂X/∂e − √⅔ ∂X/∂Δα ⊗ ν) N) y = 2G dev L d − ∂X/∂e L d − ∂X/∂d d,

which is regular also where flow is about to begin, |D| = 0. By the principal axes of e, that of
deviators alone, the changes of E are its components times those of de and of d. The axes of e_trial
are not needed: e_trial = e + D, and with ad d = [e_trial, d] L is ad coth ad, even in ad, in space
1 + rᵀ g(r rᵀ) r of the three components r d of the commutator, g(x²) = (x coth x − 1)/x².

Components: in the plane 5 of F, P, A (11, 12, 21, 22, 33) and 5 of the state, C_p⁻¹ (11, 22, 33,
12) and α; in space 9, row by row, and 7, C_p⁻¹ (11, 22, 33, 12, 23, 13) and α. C_pi of each branch
of the backstress stands before α like C_p⁻¹.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, replace

import numpy as np

from tribox.forms.bodies.hardening import Backstress, Hardening, Linear, RateFactor
from tribox.forms.bodies.materials import Hencky
from tribox.forms.bodies.point_state import Floats, Kernel, MaterialPoints
from tribox.forms.native import library

NEVER = 1e300  # Pa, yield stress of a material that stays elastic
PLASTIC_STRAIN = "equivalent_plastic_strain"  # its name among the variables
SOURCE = "plastic_points.c"
MOST_BRANCHES = 8  # of the backstress, MOST of the C source
# Pressure that a body which flows can bear under a tool, over its yield stress: D. Tabor, The
# Hardness of Metals, Oxford 1951. The yield stress is taken at a plastic strain of forming.
HARDNESS = 3.0
FORMED = 0.2


@dataclass(frozen=True, slots=True)
class ElastoPlastic:
    """Finite J2 plasticity with F = Fᵉ Fᵖ and Hencky's energy of Fᵉ."""

    shear_modulus: float  # G, Pa
    bulk_modulus: float  # K, Pa
    hardening: Hardening  # yield stress over the equivalent plastic strain
    # factor of the yield stress for the rate of that strain; None: independent of rate
    rate: RateFactor | None = None
    # branches of the backstress, around whose sum the metal yields; none: around 0
    kinematic: tuple[Backstress, ...] = ()

    def __post_init__(self) -> None:
        """ValueError if branches are more than ``MOST_BRANCHES``."""
        if len(self.kinematic) > MOST_BRANCHES:
            raise ValueError(f"kinematic: {len(self.kinematic)} branches; at most {MOST_BRANCHES}")

    def points(self, space: bool) -> PlasticPoints:
        """What flows, and remembers how far it has."""
        return PlasticPoints(self, space)

    @property
    def hardness(self) -> float:
        """The pressure, Pa, that it bears under a tool at most."""
        yield_stress = float(self.hardening.stress(np.array(FORMED)))
        return HARDNESS * (yield_stress + sum(branch.pulled(FORMED) for branch in self.kinematic))

    @property
    def elastic(self) -> Hencky:
        """The same body without plastic flow."""
        return Hencky(self.shear_modulus, self.bulk_modulus)

    def parameters(self) -> dict[str, float]:
        """G and K, Pa."""
        return self.elastic.parameters()


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


class PlasticPoints(MaterialPoints):
    """Material points of a metal."""

    flows = True

    def __init__(self, material: ElastoPlastic, space: bool) -> None:
        """Take the material; ``space``: 9 components of F instead of the plane's 5."""
        self.material = material
        metric = np.repeat([1.0, 0.0], [3, 3 if space else 1])  # C_p⁻¹ = C_pi = I
        first = np.append(np.tile(metric, 1 + len(material.kinematic)), 0.0)
        end = len(first) - 1
        columns = {"plastic_metric": slice(0, end), PLASTIC_STRAIN: slice(end, end + 1)}
        super().__init__(space, columns, first)
        self.rated = material.rate is not None

    def frozen(self) -> PlasticPoints:
        """Points that do not flow on."""
        never = replace(self.material, hardening=Linear(NEVER, 0.0), rate=None)
        return PlasticPoints(never, self.space)

    def kernel(self, section: str, dt: float, volumetric: bool = True) -> Kernel:
        """See :meth:`MaterialPoints.kernel`; ValueError for a rate without dt > 0."""
        material = self.material
        if material.rate is not None and not dt > 0.0:
            raise ValueError(f"dt is {dt}: a material with a rate factor needs dt > 0")
        size = library(SOURCE).tribox_plastic_material_size
        size.restype = ctypes.c_int64
        if size() != ctypes.sizeof(_Material):
            raise RuntimeError(f"{SOURCE}: its structure Material is not the one of {__name__}")
        law, turning = material.hardening.numbers(), bool(material.kinematic)
        back = np.array([(one.modulus, one.recovery) for one in material.kinematic], np.float64)
        made = _Material(
            shear=material.shear_modulus,
            bulk=material.bulk_modulus if volumetric else 0.0,
            dt=dt,
            law=material.hardening.number,
            count=len(law) // 2,
            parameters=law.ctypes.data,
            branches=len(back),
            backstress=back.ctypes.data,
        )
        # ctypes stores addresses: without a reference the arrays would be freed below the
        # structure.
        made.tables = law, back
        # An endless step stands for no rate at all: R(0) = 1, no factor.
        if material.rate is not None and np.isfinite(dt):
            made.rate = material.rate.number
            made.rate_parameters = tuple(material.rate.numbers())
        name = f"{'turning' if turning else 'plastic'}_{'space' if self.space else 'plane'}"
        return Kernel.of(SOURCE, name, made, symmetric=not turning)
