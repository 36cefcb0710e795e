"""Up to which stretches an elastomer's energy is stable, before it is used.

Drucker's condition of an incompressible, isotropic body: the second derivatives of its energy by
the logarithmic stretches, ∂²W/∂ε_a∂ε_b, a, b = 1, 2 with ε₃ = −ε₁ − ε₂, are positive definite, so
that more strain needs more stress.
Polynomials and sums of powers fitted to a test can lose it within the range of another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.point_stress import DISTORTION, energy_at_points

Floats = NDArray[np.float64]

LARGEST = 2.0  # stretch, or its inverse, up to which is looked at
STEPS = 400  # on the way there


@dataclass(frozen=True, slots=True)
class _Test:
    """A homogeneous test."""

    words: str  # what it is called
    ratio: float  # ε₂/ε₁
    end: float  # stretch λ₁ at which it ends


# Uniaxial compression is equibiaxial tension, planar tension is planar compression as well.
TESTS = (
    _Test("uniaxial tension", -0.5, LARGEST),
    _Test("uniaxial compression", -0.5, 1.0 / LARGEST),
    _Test("planar tension", 0.0, LARGEST),
)


def stability_limits(material: Material) -> dict[str, float]:
    """Where a material is not stable within the stretches looked at.

    Returns:
        The stretch beyond which it is not, by test, such as {"uniaxial compression": 0.62}.
    """
    found = {}
    for test in TESTS:
        first = np.linspace(0.0, np.log(test.end), STEPS + 1)
        unstable = _least_stiffness(material, first, test.ratio * first) <= 0.0
        if unstable.any():
            found[test.words] = float(np.exp(first[np.argmax(unstable)]))
    return found


def _least_stiffness(material: Material, first: Floats, second: Floats) -> Floats:
    """The smallest eigenvalue (p,), Pa, of ∂²W/∂ε_a∂ε_b at logarithmic stretches ε₁, ε₂ (p,)."""
    stretches = np.exp(np.stack([first, second, -first - second], axis=1))
    F = np.zeros((len(first), 5))
    F[:, [0, 3, 4]] = stretches
    _, P, A = energy_at_points(material, DISTORTION, space=False)(F, True)
    assert A is not None
    # By three logarithms λ_a λ_b A_ab + δ_ab λ_a P_a, and then with ε₃ = −ε₁ − ε₂.
    H: Floats = A[:, [0, 3, 4]][:, :, [0, 3, 4]]
    H *= stretches[:, :, None] * stretches[:, None, :]
    pull: Floats = stretches * P[:, [0, 3, 4]]
    H += pull[:, :, None] * np.eye(3)
    K = H[:, :2, :2] - H[:, :2, 2:] - H[:, 2:, :2] + H[:, 2:, 2:]
    return np.asarray(np.linalg.eigvalsh(K)[:, 0])
