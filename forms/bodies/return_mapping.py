"""Return mapping of J2 plasticity: in principal logarithmic strains, and with backstress.

How much plastic strain brings the stress to yield: with the trial stress q̂ = √(3/2)|s| (von Mises)
and the rate Δα/Δt

    g(Δα) = q̂ − 3G Δα − σ_Y(α + Δα) R(Δα/Δt) = 0.

g falls (σ_Y and R do not), so its root lies in [0, (q̂ − σ_Y(α))/3G] and is the only one; where a
backstress fades, which may leave more stress than there was, q̂ there is the most that can be left.
Newton's method from the left is monotone where σ_Y and R are concave; a step that leaves the
bracket of the root is replaced by one to its middle, so that tables and kinks converge as well.
Where the law is steep and Δα small beside α, g jumps with the round-off of α + Δα, and nothing less
is asked of it there.

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
and as c is small beside 3G four turns are usual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.hardening import Backstress, Metal
from tribox.forms.bodies.principal_axes import SERIES, PrincipalAxes, log_ratio

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

NEUTRAL = 1e-9  # of σ_Y: so little below yield a point counts as one that flows, see `Flow`
STILL = 1e-11  # of σ_Y: an overstress that is round-off, so that a strain held changes nothing
ITERATIONS = 200  # far beyond need: 4 are usual, 35 the most seen for laws and rates at random
SMALL_STEP = 1e-9  # relative step after which Newton's next one would be below round-off
ROUNDOFF = 1e-15  # of g relative to q̂
TURNS = 50  # far beyond need: 4 are usual, see "backstress"
SETTLED = 4e-15  # of Σ c and 25 times the trial stress: a change of the rest that is round-off


@dataclass(frozen=True, slots=True)
class Flow:
    """The end of a step at n points, in principal axes a.

    With n = dev e/|dev e| of the trial strain, ∂τ_dev/∂e = 2Gθ (I − ⅓ 1⊗1) − 2Gθ̄ n⊗n; θ = 1 and
    θ̄ = 0 are elastic. A point on the yield surface whose strain does not change (the first
    iteration of a step) has the tangent of plastic loading, not the elastic one, which would send
    Newton's method far beyond yield; as round-off decides on which side of the surface it lies,
    so has a point that is less than `NEUTRAL` below it.

    Attributes:
        deviator: (n, a), Pa, of the Kirchhoff stress.
        direction: (n, a), n.
        theta, theta_bar: (n,), θ and θ̄.
        step: (n,), Δα.
        stress: (n,), Pa, the flow stress σ_Y R at the end.
        numerical: (n,), J/m³, the part of the dissipation due to the step's size.
    """

    deviator: Floats
    direction: Floats
    theta: Floats
    theta_bar: Floats
    step: Floats
    stress: Floats
    numerical: Floats


def flow(material: Metal, logs: Floats, alpha: Floats, dt: float) -> Flow:
    """Return the trial state to yield.

    Args:
        material: moduli, hardening and rate factor.
        logs: (n, a) principal logarithmic strains of the trial state.
        alpha: (n,) equivalent plastic strain at the step's begin.
        dt: s, of the step; infinite: no rate factor.
    """
    G = material.shear_modulus
    strain = logs - logs.mean(axis=1)[:, None]
    size = np.sqrt((strain * strain).sum(axis=1))
    trial = np.sqrt(6.0) * G * size
    begin = material.hardening.stress(alpha)
    flows = trial >= (1.0 - NEUTRAL) * begin
    law = _FlowStress(material, alpha, dt)
    step = np.where(flows, plastic_step(trial, G, law), 0.0)
    stress, slope, _ = law(step)
    drop = 3.0 * G * step / np.where(flows, trial, 1.0)  # 1 − θ
    theta_bar = np.where(flows, 1.0 / (1.0 + slope / (3.0 * G)) - drop, 0.0)
    end = material.hardening.stress(alpha + step)
    return Flow(
        deviator=2.0 * G * (1.0 - drop)[:, None] * strain,
        direction=strain / np.where(flows, size, 1.0)[:, None],
        theta=1.0 - drop,
        theta_bar=theta_bar,
        step=step,
        stress=stress,
        numerical=0.5 * (stress / end) * (end - begin) * step,
    )


class _FlowStress:
    """σ(Δα) = σ_Y(α + Δα) R(Δα/Δt) of given points."""

    def __init__(self, material: Metal, alpha: Floats, dt: float) -> None:
        self.hardening, self.alpha, self.dt = material.hardening, alpha, dt
        self.rate = material.rate if np.isfinite(dt) else None

    def __call__(self, step: Floats) -> tuple[Floats, Floats, Floats]:
        """σ, dσ/dΔα and the round-off of σ that α + Δα makes (n,), Pa."""
        alpha = self.alpha + step
        stress, slope = self.hardening.stress(alpha), self.hardening.slope(alpha)
        roundoff = slope * np.spacing(alpha)
        if self.rate is None:
            return stress, slope, roundoff
        speed = np.asarray(step / self.dt, dtype=np.float64)
        R, by_rate = self.rate.factor(speed), self.rate.slope(speed)
        return stress * R, slope * R + stress * by_rate / self.dt, roundoff * R

    def most(self, trial: Floats) -> Floats:
        """What is left of the stress ``trial`` (n,), Pa, at any Δα, but for 3G Δα, at most."""
        return trial

    def start(self, over: Floats, shear: float) -> Floats:
        """A Δα left of the root for concave laws, from the overstress ``over`` (n,), Pa.

        Newton's step from 0; with a rate factor no more than what takes half of the overstress.
        """
        begin = self.hardening.stress(self.alpha)
        x = over / (3.0 * shear + self.hardening.slope(self.alpha))
        if self.rate is None:
            return x
        by_rate = self.dt * self.rate.rate(1.0 + 0.5 * over / begin)
        return np.where(over > 0.0, np.minimum(0.5 * x, by_rate), 0.0)


def plastic_step(trial: Floats, shear: float, law: _FlowStress) -> Floats:
    """Δα ≥ 0 (n,), the root of g; 0 where the trial stress does not exceed yield.

    Args:
        trial: (n,) von Mises stress q̂, Pa, of the trial state.
        shear: G, Pa.
        law: σ(Δα).
    """
    begin = law.hardening.stress(law.alpha)
    over = np.where(trial > (1.0 + STILL) * begin, trial - begin, 0.0)
    low, high = np.zeros_like(over), (law.most(trial) - begin) / (3.0 * shear)
    x = law.start(over, shear)
    done = ~(x > 0.0)
    for _ in range(ITERATIONS):
        if done.all():
            break
        stress, slope, roundoff = law(x)
        g = trial - 3.0 * shear * x - stress
        low, high = np.where(g >= 0.0, x, low), np.where(g >= 0.0, high, x)
        newton = x + g / (3.0 * shear + slope)
        settled = np.abs(newton - x) <= SMALL_STEP * x
        settled |= np.abs(g) <= ROUNDOFF * trial + roundoff
        inside = (newton > low) & (newton < high)
        x = np.where(done, x, np.where(inside | settled, newton, 0.5 * (low + high)))
        done |= settled
    return x


# -- backstress -------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Turned:
    """The end of a step at n points with backstress.

    Tensors (n, a, b) stand in the principal axes of the trial deformation, which the end need not
    share.

    Attributes:
        strain: (n, a, b), e.
        step, stress, slope: (n,), Δα; the flow stress σ_Y R at the end and its slope, Pa.
        direction: (n, a, b), ν.
        flows: (n,), whether the point flows, or is on the brink of it.
        branches: the backstresses at the end.
        numerical: (n,), J/m³, part of the dissipation that is due to the step's size.
    """

    strain: Floats
    step: Floats
    stress: Floats
    slope: Floats
    direction: Floats
    flows: Bools
    branches: list[Branch]
    numerical: Floats

    @property
    def stored(self) -> Floats:
        """Energy (n,), J/m³, of the branches."""
        return np.sum([branch.energy for branch in self.branches], axis=0)

    @property
    def dissipation(self) -> Floats:
        """Plastic work (n,), J/m³, that the branches do not store, with the stress at the end."""
        return np.asarray((self.stress + lost(self.branches)) * self.step)


class Branch:
    """One branch of the backstress at n points.

    Attributes:
        X: (n, a, b), Pa.
        K: (n, a, b), F⁻ᵀ C_pi F⁻¹ at the end, but for its size.
    """

    def __init__(self, law: Backstress, metric: Floats, axes: PrincipalAxes) -> None:
        """Begin a step.

        Args:
            law: c and b.
            metric: (n, a, b), G_a·C_pi·G_b with the C_pi of the step's begin.
            axes: principal axes of the trial deformation, which give C_p likewise: 1/w_a.
        """
        self.law, self.shear = law, law.modulus / 3.0
        self._metric, self._begin = metric, _diagonal(1.0 / axes.w)
        self.move(_diagonal(1.0 / np.sqrt(axes.w)), np.zeros(len(metric)))
        self.start = self.X

    def move(self, E: Floats, step: Floats) -> None:
        """Take the end of the step to be at E = exp(−e) (n, a, b) and Δα (n,)."""
        y = self.law.recovery * step
        self._E, self._decay, (self.phi, self._ratio) = E, np.exp(-y), mean_decay(y)
        old, mid = self._decay, y * self._ratio
        self._end = 1.0 - self.phi
        H = _times(old, self._metric) + _times(mid, self._begin)
        self.K = H + _times(self._end, E @ E)
        self._Z = np.linalg.solve(self.K, E)
        B = _symmetric(E @ self._Z)
        self._size = np.cbrt(np.linalg.det(self.K) / np.linalg.det(E) ** 2)
        self._bare = B
        self.B = _times(self._size, B)
        self.X = self.shear * _deviator(self.B)

    @property
    def energy(self) -> Floats:
        """μ/2 (tr B − 3) (n,), J/m³."""
        return np.asarray(0.5 * self.shear * (np.trace(self.B, axis1=1, axis2=2) - 3.0))

    @property
    def recovery(self) -> Floats:
        """What is lost by α̇ (n,), Pa: b |X|²/(2 μ)."""
        return np.asarray(0.5 * self.law.recovery / self.shear * (self.X**2).sum(axis=(1, 2)))

    def straight(self, D: Floats) -> Floats:
        """X (n, a, b), Pa, but for the rest, with the plastic strain D (n, a, b) of the step."""
        return _times(self._decay, self.start) + 2.0 * self.shear * _times(self.phi, D)

    def change(self, dE: Floats, push: Floats, by_step: Floats | float = 0.0) -> Floats:
        """Changes of X (n, m, a, b), Pa, for m changes of the end.

        With K = H + (1 − φ) E², B ∝ E Z, Z = K⁻¹ E: what moves B is Y = (dE + E d) Z, d the change
        of the deformation, which takes H along as F⁻ᵀ (·) F⁻¹ does.

        Args:
            dE: (n, m, a, b), changes of E.
            push: (n, m, a, b), symmetric d of δF = d F.
            by_step: (n, 1) or 0, dΔα.
        """
        E, Z, B = (x[:, None] for x in (self._E, self._Z, self._bare))
        Y = (dE + E @ push) @ Z
        dB = Y - self._end[:, None, None, None] * B @ Y
        dB = dB + np.swapaxes(dB, 2, 3)
        size = 2.0 * self._end[:, None] * np.trace(Y, axis1=2, axis2=3)
        b, K = self.law.recovery, self.K
        rise = _times(b * self._ratio, self._E @ self._E) - _times(b * self._decay, self._metric)
        rise += _times(b * (self._decay - self._ratio), self._begin)
        by = np.asarray(by_step)
        dB = dB - by[..., None, None] * (np.swapaxes(self._Z, 1, 2) @ rise @ self._Z)[:, None]
        size = size + by * np.trace(np.linalg.solve(K, rise), axis1=1, axis2=2)[:, None]
        dB = _times(self._size, dB) + (size / 3.0)[..., None, None] * self.B[:, None]
        return self.shear * _deviator(dB)


class _WithBackstress(_FlowStress):
    """σ(Δα), and what the branches add to it or turn the trial stress by, at given points.

    g(Δα) = q̂ − 3G Δα − σ(Δα) with q̂ = √(3/2)|s − ΣX| of the trial state, where σ has in it how much
    less √(3/2)|s − Σ e^(−bΔα) X − rest| is than q̂, and Σ c φ Δα.
    """

    def __init__(self, material: Metal, alpha: Floats, dt: float, branches: list[Branch]) -> None:
        super().__init__(material, alpha, dt)
        self.branches = branches

    def aim(self, stress: Floats) -> None:
        """Set s less the rest (n, a, b), Pa."""
        self._aim = stress

    def most(self, trial: Floats) -> Floats:
        """See ``_FlowStress``: that with all of the branches against the aim."""
        parts = [self._aim, *(branch.start for branch in self.branches)]
        size = np.sum([np.sqrt((part**2).sum(axis=(1, 2))) for part in parts], axis=0)
        return np.asarray(np.sqrt(1.5) * size)

    def over(self, step: Floats) -> tuple[Floats, Floats, Floats]:
        """Aim less Σ e^(−bΔα) X (n, a, b), Pa; √(3/2) of its size, and the slope of that (n,)."""
        over, slope = self._aim, np.zeros_like(self._aim)
        for branch in self.branches:
            b = branch.law.recovery
            part = _times(np.exp(-b * step), branch.start)
            over, slope = over - part, slope + b * part
        size = np.sqrt(1.5 * (over**2).sum(axis=(1, 2)))
        return over, size, 1.5 * (over * slope).sum(axis=(1, 2)) / np.where(size > 0.0, size, 1.0)

    def __call__(self, step: Floats) -> tuple[Floats, Floats, Floats]:
        """See ``_FlowStress``."""
        stress, slope, roundoff = super().__call__(step)
        _, at_once, _ = self.over(np.zeros_like(step))
        _, later, less = self.over(step)
        stress, slope = stress + (at_once - later), slope - less
        for branch in self.branches:
            c, y = branch.law.modulus, branch.law.recovery * step
            stress, slope = stress + c * step * mean_decay(y)[0], slope + c * np.exp(-y)
        return stress, slope, roundoff


def flow_with_backstress(
    material: Metal, axes: PrincipalAxes, inner: Floats, alpha: Floats, dt: float
) -> Turned:
    """Return the trial state to yield around the backstress.

    Args:
        material: moduli, hardening, rate factor and branches.
        axes: principal axes of the trial deformation.
        inner: (n, k, i, j), C_pi of the branches at the step's begin.
        alpha: (n,) equivalent plastic strain there.
        dt: s, of the step; infinite: no rate factor.
    """
    metrics = np.einsum("nai,nkij,nbj->knab", axes.G, inner, axes.G)
    branches = [
        Branch(law, metric, axes) for law, metric in zip(material.kinematic, metrics, strict=True)
    ]
    trial = _diagonal(axes.logs)
    s = 2.0 * material.shear_modulus * _deviator(trial)
    law = _WithBackstress(material, alpha, dt, branches)
    law.aim(s)
    begin = material.hardening.stress(alpha)
    q = law.over(np.zeros_like(alpha))[1]
    flows = q >= (1.0 - NEUTRAL) * begin
    before = lost(branches)
    step, direction, strain = _turn(law, material.shear_modulus, s, axes, flows)
    stress, slope, _ = _FlowStress.__call__(law, step)
    end = material.hardening.stress(alpha + step)
    numerical = 0.5 * (stress / end * (end - begin) + lost(branches) - before) * step
    return Turned(strain, step, stress, slope, direction, flows, branches, numerical)


def lost(branches: Sequence[Branch]) -> Floats:
    """What branches lose by recovery and α̇ (n,), Pa."""
    return np.sum([branch.recovery for branch in branches], axis=0)


def _turn(
    law: _WithBackstress, shear: float, s: Floats, axes: PrincipalAxes, flows: Bools
) -> tuple[Floats, Floats, Floats]:
    """Δα (n,), ν and e (n, a, b) where points flow; the branches are moved there.

    Args:
        law: σ(Δα) of the points with their branches.
        shear: G, Pa.
        s: (n, a, b), Pa, deviatoric trial stress.
        axes: principal axes of the trial deformation.
        flows: (n,) whether points flow at all; the others get NaN, as those that do not settle.
    """
    rest, done, still = np.zeros_like(s), ~flows, np.zeros(len(s))
    moduli = sum(branch.law.modulus for branch in law.branches)
    for _ in range(TURNS):
        law.aim(s - rest)
        q = law.over(still)[1]
        step = plastic_step(q, shear, law)
        over, size, _ = law.over(step)
        direction = _times(np.sqrt(1.5) / np.where(size > 0.0, size, 1.0), over)
        D = np.sqrt(1.5) * _times(step, direction)
        strain = _diagonal(axes.logs) - D
        E = exponential(-strain)
        for branch in law.branches:
            branch.move(E, step)
        new = np.sum([branch.X - branch.straight(D) for branch in law.branches], axis=0)
        change = np.sqrt(((new - rest) ** 2).sum(axis=(1, 2)))
        done |= change <= SETTLED * (25.0 * q + moduli)
        if done.all():
            break
        rest = np.where(done[:, None, None], rest, new)
    return np.where(done, step, np.nan), direction, strain


def turned_moduli(
    material: Metal, axes: PrincipalAxes, end: Turned, bulk: float, space: bool
) -> Floats:
    """∂τ/∂d (n, m, m), Pa, of symmetric changes δF = d F, in the basis of ``symmetric_basis``.

    With L d the change of the trial strain, de = L d − dD. The implicit function of the return is
    solved for y, dD = N y, N = η (I − ν⊗ν) + ϑ ν⊗ν, η = 2G|D|/(2G|D| + √⅔ σ), ϑ = 3G/(3G + σ'):

        (2G I − (∂X/∂e − √⅔ ∂X/∂Δα ⊗ ν) N) y = 2G dev L d − ∂X/∂e L d − ∂X/∂d d,

    which is regular also where flow is about to begin, |D| = 0. It is not symmetric with b > 0.
    """
    G, basis = material.shear_modulus, symmetric_basis(space)
    count, m, flat = len(end.step), len(basis), basis.reshape(len(basis), 9)
    L = np.ones((count, 3, 3))
    for a, b in ((0, 1), (0, 2), (1, 2)):
        difference = axes.logs[:, a] - axes.logs[:, b]
        L[:, a, b] = L[:, b, a] = log_ratio(axes.w[:, a], axes.w[:, b], difference)
    trial = np.einsum("pi,ni,qi->npq", flat, L.reshape(-1, 9), flat)
    dE = np.swapaxes(exponential_slopes(-end.strain, -basis), 0, 1)
    still, each = np.zeros_like(dE), np.broadcast_to(basis, (count, m, 3, 3))
    X_e, X_d, X_step = np.zeros((count, m, m)), np.zeros((count, m, m)), np.zeros((count, m, 1))
    for branch in end.branches:
        X_e += _components(branch.change(dE, still), flat)
        X_d += _components(branch.change(still, each), flat)
        X_step += _components(branch.change(still[:, :1], still[:, :1], np.ones((count, 1))), flat)
    nu = end.direction.reshape(-1, 9) @ flat.T
    along = nu[:, :, None] * nu[:, None, :]
    size = np.sqrt(6.0) * G * end.step
    across = size / (size + np.sqrt(2.0 / 3.0) * end.stress)
    onward = 1.0 / (1.0 + end.slope / (3.0 * G))
    eye = np.eye(m)
    N: Floats = _times(across, eye - along) + _times(onward, along)
    left = 2.0 * G * eye - (X_e - np.sqrt(2.0 / 3.0) * X_step * nu[:, None, :]) @ N
    deviator = eye - flat[:, ::4].sum(axis=1)[:, None] * flat[:, ::4].sum(axis=1) / 3.0
    y = np.linalg.solve(left, 2.0 * G * deviator @ trial - X_e @ trial - X_d)
    elastic = trial - np.where(end.flows[:, None, None], N @ y, 0.0)
    trace = flat[:, ::4].sum(axis=1)
    return 2.0 * G * deviator @ elastic + bulk * trace[:, None] * trace


def symmetric_basis(space: bool) -> Floats:
    """Orthonormal symmetric tensors (m, 3, 3): 11, 22, 33, 12, in space also 23, 13."""
    basis = np.zeros((6, 3, 3))
    for k, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))):
        basis[k, a, b] = basis[k, b, a] = 1.0 if a == b else np.sqrt(0.5)
    return basis if space else basis[:4]


def mean_decay(y: Floats) -> tuple[Floats, Floats]:
    """φ = (1 − e^(−y))/y and (φ − e^(−y))/y for y ≥ 0, to all digits."""
    near = y < SERIES
    z = np.where(near, 1.0, y)
    mean = -np.expm1(-z) / z
    falling = (mean - np.exp(-z)) / z
    x = np.where(near, y, 0.0)
    first = np.polyval([-1 / 720, 1 / 120, -1 / 24, 1 / 6, -1 / 2, 1.0], x)
    second = np.polyval([-1 / 840, 1 / 144, -1 / 30, 1 / 8, -1 / 3, 1 / 2], x)
    return np.where(near, first, mean), np.where(near, second, falling)


def exponential(tensors: Floats) -> Floats:
    """Exponentials (n, a, b) of symmetric tensors."""
    values, axes = np.linalg.eigh(tensors)
    return np.asarray(np.einsum("nai,ni,nbi->nab", axes, np.exp(values), axes))


def exponential_slopes(tensors: Floats, changes: Floats) -> Floats:
    """Changes (m, n, a, b) of exp of symmetric tensors (n, a, b) for theirs (m, a, b)."""
    values, axes = np.linalg.eigh(tensors)
    half = 0.5 * (values[:, :, None] - values[:, None, :])
    w, v = np.broadcast_arrays(np.exp(values)[:, :, None], np.exp(values)[:, None, :])
    slope = 0.5 * (w + v) / log_ratio(w, v, half)
    inside = np.swapaxes(axes, 1, 2) @ changes[:, None] @ axes
    return np.asarray(axes @ (slope * inside) @ np.swapaxes(axes, 1, 2))


def _components(tensors: Floats, flat: Floats) -> Floats:
    """Components (n, p, m) of tensors (n, m, a, b) in a basis (p, 9)."""
    return np.asarray(np.einsum("nmi,pi->npm", tensors.reshape(*tensors.shape[:2], 9), flat))


def _times(factor: NDArray[Any], tensors: Floats) -> Floats:
    """Tensors (n, ..) times a number (n,) each."""
    return factor.reshape(-1, *[1] * (tensors.ndim - 1 or 2)) * tensors


def _deviator(tensors: Floats) -> Floats:
    """Deviators of tensors (.., 3, 3)."""
    trace = np.trace(tensors, axis1=-2, axis2=-1)
    return np.asarray(tensors - trace[..., None, None] / 3.0 * np.eye(3))


def _diagonal(values: NDArray[Any]) -> Floats:
    """Diagonal tensors (n, 3, 3) of values (n, 3)."""
    return np.asarray(values[:, :, None] * np.eye(3))


def _symmetric(tensors: Floats) -> Floats:
    """Symmetric parts of tensors (.., 3, 3)."""
    return np.asarray(0.5 * (tensors + np.swapaxes(tensors, -2, -1)))
