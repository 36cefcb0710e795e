"""Return mapping of J2 plasticity in principal logarithmic strains.

How much plastic strain brings the stress to yield: with the trial stress q̂ = √(3/2)|s| (von Mises)
and the rate Δα/Δt

    g(Δα) = q̂ − 3G Δα − σ_Y(α + Δα) R(Δα/Δt) = 0.

g falls (σ_Y and R do not), so its root lies in [0, (q̂ − σ_Y(α))/3G] and is the only one. Newton's
method from the left is monotone where σ_Y and R are concave; a step that leaves the bracket of
the root is replaced by one to its middle, so that tables and kinks converge as well. Where the
law is steep and Δα small beside α, g jumps with the round-off of α + Δα, and nothing less is asked
of it there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.elastoplastic import ElastoPlastic

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

NEUTRAL = 1e-9  # of σ_Y: so little below yield a point counts as one that flows, see `Flow`
STILL = 1e-11  # of σ_Y: an overstress that is round-off, so that a strain held changes nothing
ITERATIONS = 200  # far beyond need: 4 are usual, 35 the most seen for laws and rates at random
SMALL_STEP = 1e-9  # relative step after which Newton's next one would be below round-off
ROUNDOFF = 1e-15  # of g relative to q̂


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


def flow(material: ElastoPlastic, logs: Floats, alpha: Floats, dt: float) -> Flow:
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

    def __init__(self, material: ElastoPlastic, alpha: Floats, dt: float) -> None:
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
    low, high = np.zeros_like(over), over / (3.0 * shear)
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
