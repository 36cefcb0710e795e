r"""Radial return of an elastic trial slip to the friction threshold, with its derivatives.

The equation solved at each point, with trial slip :math:`p`, :math:`s = |p|`, :math:`m = p/s`:

- stick if :math:`\kappa s \le \mu(d) t_N`: :math:`\hat T = \kappa p`;
- slip otherwise: :math:`\hat T = \mu(d + \lambda) t_N m` with
  :math:`\kappa (s - \lambda) = \mu(d + \lambda) t_N`.

Arrays of vectors here have the component first, (i, q): numpy is then several times faster than
with two or three components in the innermost place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
TINY = float(np.finfo(np.float64).tiny)

# A point that slid before and now rests is at its threshold but for round-off; it sticks, on every
# machine, in every rotated frame and in every system of units. Its slip is a difference of
# coordinates: what rounding them leaves (2e-16 of a body's size) is much more, relative to the
# elastic slip, than the rounding of the two lengths compared here.
ROUND_OFF = 1.0 + 1e-10


@dataclass(frozen=True, slots=True)
class Returned:
    r"""Result of the return mapping at q points.

    :math:`\hat T` = ``secant`` * p. For the isotropic law its derivative for p is
    ``tangent`` m m + ``secant`` (I - m m).
    """

    elastic_slip: Floats  # (i, q), m, after the step
    direction: Floats  # (i, q), m = p/s (zero where p = 0)
    length: Floats  # (q,), m, s = |p|
    slip: Floats  # (q,), m, permanent slip lambda >= 0 of the step
    slipping: NDArray[np.bool_]  # (q,), whether there is any
    secant: Floats  # (q,), Pa/m, |T̂|/s
    tangent: Floats  # (q,), Pa/m, ∂|T̂|/∂s
    d_pressure: Floats  # (q,), ∂|T̂|/∂t_N
    d_stiffness: Floats  # (q,), m, ∂|T̂|/∂κ

    def derivative(self, dim: int) -> Floats:
        r""":math:`\partial\hat T/\partial p`, (i, j, q), Pa/m."""
        m = self.direction
        excess = self.tangent - self.secant
        block = np.empty((dim, dim, self.slip.size))
        for i in range(dim):
            scaled = excess * m[i]
            for j in range(i):
                block[i, j] = block[j, i] = scaled * m[j]
            block[i, i] = scaled * m[i] + self.secant
        return block

    def derivative_along(self, vector: Floats) -> Floats:
        r""":math:`(\partial\hat T/\partial p) x` for a vector x, (i, q)."""
        along = (self.tangent - self.secant) * dot(self.direction, vector)
        return self.secant * vector + along * self.direction


def dot(a: Floats, b: Floats) -> Floats:
    """Inner product of vectors with the component first, (i, q) and (i, q) to (q,)."""
    total = a[0] * b[0]
    for i in range(1, len(a)):
        total += a[i] * b[i]
    return total


def components_first(vectors: Floats) -> Floats:
    """A contiguous (i, q) copy of vectors given as (q, i)."""
    return np.array(np.asarray(vectors, dtype=np.float64).T, order="C")


def return_mapping(
    trial: Floats,
    stiffness: Floats | float,
    pressure: Floats,
    slip_path: Floats,
    friction: SlipWeakening | Floats | float,
) -> Returned:
    r"""Return of a trial slip to the threshold :math:`\mu t_N`.

    Args:
        trial: (i, q), m, trial elastic slip p; must be zero where the contact is open.
        stiffness: (q,) or a number, Pa/m, kappa >= 0. Where it is zero the point sticks without
            traction.
        pressure: (q,), Pa, t_N >= 0; where it is zero the contact is open: all results are zero.
        slip_path: (q,), m, path d of the permanent slip before the step.
        friction: Coefficient of friction: one that falls with the slip path, a number, or (q,).
    """
    if isinstance(friction, SlipWeakening) and friction.constant:
        friction = friction.mu_s
    mu = friction.coefficient(slip_path) if isinstance(friction, SlipWeakening) else friction
    s = np.sqrt(dot(trial, trial))
    # Open points take part without stiffness: to pick rows out and put them back would cost more
    # than to compute what they do not need.
    if not (closed := pressure > 0.0).all():
        stiffness = np.where(closed, stiffness, 0.0)
    threshold, elastic = mu * pressure, stiffness * s
    slipping = elastic > ROUND_OFF * threshold
    tangent, d_stiffness = np.where(slipping, 0.0, stiffness), np.where(slipping, 0.0, s)
    d_pressure = np.where(slipping, mu, 0.0)
    if isinstance(friction, SlipWeakening) and slipping.any():
        q = np.flatnonzero(slipping)
        kappa = np.broadcast_to(stiffness, s.shape)[q]
        threshold[q], tangent[q], d_pressure[q], d_stiffness[q] = _weakened(
            friction, s[q], kappa, pressure[q], slip_path[q]
        )
    # The return is radial: one factor shortens trial slip and traction, and none turns. Clipped, as
    # the new threshold may exceed the trial by a rounding error at the very onset.
    ratio = np.divide(threshold, elastic, out=np.ones_like(elastic), where=slipping)
    np.minimum(ratio, 1.0, out=ratio)
    return Returned(
        elastic_slip=ratio * trial,
        direction=trial / np.maximum(s, TINY),
        length=s,
        slip=s - ratio * s,
        slipping=slipping,
        secant=ratio * stiffness,
        tangent=tangent,
        d_pressure=d_pressure,
        d_stiffness=d_stiffness,
    )


def _weakened(
    friction: SlipWeakening, s: Floats, kappa: Floats, pressure: Floats, slip_path: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Threshold at the end of the step, which depends on the slip itself, and slopes of |T|, (q,).

    From the implicit function κ (s − λ) = μ(d + λ) t_N: ∂λ/∂κ = (s − λ)/(κ + μ' t_N), and |T|
    changes by μ' t_N ∂λ/∂κ; likewise ∂|T|/∂s = μ' t_N κ/(κ + μ' t_N).
    """
    path = friction.slipped_path(s, kappa, pressure, slip_path)
    mu, softening = friction.coefficient(path), friction.slope(path) * pressure
    threshold, share = mu * pressure, kappa / (kappa + softening)
    return threshold, softening * share, mu * share, softening * share * threshold / kappa**2


# -- Coefficient of friction that falls with the permanent slip, and its implicit slip equation ----


@dataclass(frozen=True, slots=True)
class SlipWeakening:
    r"""Slip weakening of Luege & Luccioni.

    .. math:: \mu(d) = \mu_d + \frac{\mu_s - \mu_d}{1 + B \langle d - A_d \rangle_+}
    """

    mu_s: float  # static coefficient of friction
    mu_d: float  # dynamic coefficient of friction, reached after infinite slip
    A_d: float = 0.0  # m, slip at which the weakening starts
    B: float = 0.0  # 1/m, rate of the weakening

    @property
    def constant(self) -> bool:
        """Whether the coefficient does not depend on the slip."""
        return self.mu_s == self.mu_d or self.B == 0.0

    def coefficient(self, slip_path: Floats) -> Floats:
        """mu(d), (q,), for the slip path d, (q,), m."""
        past = np.maximum(slip_path - self.A_d, 0.0)
        return self.mu_d + (self.mu_s - self.mu_d) / (1.0 + self.B * past)

    def above_end(self, slip_path: Floats) -> Floats:
        """mu(d) less the coefficient that it tends to with the slip, (q,), -."""
        if self.constant:
            return np.zeros_like(slip_path)
        return self.coefficient(slip_path) - self.mu_d

    def settling_slip(self, excess: float) -> float:
        """Slip, m, from which mu is at most ``excess`` (≥ 0) above where it tends; inf for 0."""
        fall = self.mu_s - self.mu_d
        if self.constant or fall <= excess:
            return 0.0
        return self.A_d + (fall / excess - 1.0) / self.B if excess > 0.0 else math.inf

    def slope(self, slip_path: Floats) -> Floats:
        """Derivative of mu, (q,), 1/m; at the start of the weakening the one before it (zero)."""
        past = np.maximum(slip_path - self.A_d, 0.0)
        slope = -self.B * (self.mu_s - self.mu_d) / (1.0 + self.B * past) ** 2
        return np.where(past > 0.0, slope, 0.0)

    def slipped_path(
        self, trial: Floats, stiffness: Floats | float, pressure: Floats, slip_path: Floats
    ) -> Floats:
        r"""Slip path after the step, from the implicit slip equation.

        Solves :math:`\kappa (s - \lambda) = \mu(d + \lambda) t_N` for :math:`\lambda > 0` at points
        beyond the threshold, :math:`\kappa s > \mu(d) t_N`. Up to :math:`A_d` the equation is
        linear; beyond it is

        .. math:: B x^2 + (1 - e B) x + \delta - e = 0, \qquad x = d + \lambda - A_d, \quad
           e = s + d - A_d - \mu_d t_N/\kappa, \quad \delta = (\mu_s - \mu_d) t_N/\kappa

        and its larger root is the solution: the residual is concave there and positive at the
        start, so it has exactly one zero ahead.

        Args:
            trial: (q,), m, length s of the trial elastic slip.
            stiffness: (q,) or a number, Pa/m, kappa > 0.
            pressure: (q,), Pa, t_N.
            slip_path: (q,), m, path d before the step.

        Returns:
            (q,), m, :math:`d + \lambda`.
        """
        per_mu = pressure / stiffness
        linear = slip_path + trial - self.mu_s * per_mu
        e = trial + slip_path - self.A_d - self.mu_d * per_mu
        delta = (self.mu_s - self.mu_d) * per_mu
        b = 1.0 - e * self.B
        square: Floats = (1.0 + e * self.B) ** 2 - 4.0 * self.B * delta
        root: Floats = np.sqrt(np.maximum(square, 0.0))
        # Each form of the root where it adds numbers of one sign (root >= 0).
        forward = b > 0.0
        past = np.where(
            forward,
            2.0 * (e - delta) / np.where(forward, b + root, 1.0),
            (root - b) / (2.0 * self.B),
        )
        stays = (slip_path <= self.A_d) & (linear <= self.A_d)
        return np.where(stays, linear, self.A_d + past)
