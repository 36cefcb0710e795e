r"""Coefficient of friction that falls with the permanent slip, and its implicit slip equation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SlipWeakening:
    r"""Slip weakening of Luege & Luccioni.

    .. math:: \mu(d) = \mu_d + \frac{\mu_s - \mu_d}{1 + B \langle d - A_d \rangle_+}

    Attributes:
        mu_s: Static coefficient of friction.
        mu_d: Dynamic coefficient of friction, reached after infinite slip.
        A_d: m, slip at which the weakening starts.
        B: 1/m, rate of the weakening.
    """

    mu_s: float
    mu_d: float
    A_d: float = 0.0
    B: float = 0.0

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
        """Slip from which on mu is at most ``excess`` above where it tends, m; inf for 0.

        Args:
            excess: -, >= 0.
        """
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
        root = np.sqrt(np.maximum((1.0 + e * self.B) ** 2 - 4.0 * self.B * delta, 0.0))
        # Each form of the root where it adds numbers of one sign (root >= 0).
        forward = b > 0.0
        past = np.where(
            forward,
            2.0 * (e - delta) / np.where(forward, b + root, 1.0),
            (root - b) / (2.0 * self.B),
        )
        stays = (slip_path <= self.A_d) & (linear <= self.A_d)
        return np.where(stays, linear, self.A_d + past)
