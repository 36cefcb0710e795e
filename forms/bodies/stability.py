"""Up to which stretches an elastomer's energy is stable, before it is used.

Drucker's condition of an incompressible, isotropic body: the second derivatives of its energy by
the logarithmic stretches, ∂²W/∂ε_a∂ε_b, a, b = 1, 2 with ε₃ = −ε₁ − ε₂, are positive definite, so
that more strain needs more stress.
Polynomials and sums of powers fitted to a test can lose it within the range of another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from numpy.typing import NDArray
from ufl.algorithms import expand_derivatives

from tribox.forms.bodies.kinematics import Kinematics, PlanePart, plane_kinematics
from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.point_stress import free_variables, values_of

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
    stiffness, found = _Stiffness(material), {}
    for test in TESTS:
        first = np.linspace(0.0, np.log(test.end), STEPS + 1)
        unstable = stiffness.least(first, test.ratio * first) <= 0.0
        if unstable.any():
            found[test.words] = float(np.exp(first[np.argmax(unstable)]))
    return found


def at_rest(material: Material) -> tuple[float, float, float]:
    """Stress, shear modulus and bulk modulus, Pa, of the undeformed material, from its energy.

    With logarithmic stretches ε_a the stress is ∂W/∂ε_a, and the second derivatives are K + 4G/3
    for one stretch and K - 2G/3 for two.

    Raises:
        NotImplementedError: the energy has a function whose values are not known.
    """
    strains, e = free_variables(3)
    a, b, c = (ufl.exp(2.0 * strain) for strain in e)
    J, I1, I2 = ufl.exp(e[0] + e[1] + e[2]), a + b + c, a * b + b * c + c * a
    k = Kinematics(F=None, J=J, I1=I1, I2=I2, plane=None)
    constants: dict[str, Any] = dict(material.parameters())
    energy = sum(material.energy(k, constants))
    wanted = [ufl.diff(energy, e[0]), ufl.diff(ufl.diff(energy, e[0]), e[0])]
    wanted.append(ufl.diff(ufl.diff(energy, e[0]), e[1]))
    none = dict.fromkeys(strains, np.zeros(1))
    found = values_of([expand_derivatives(one) for one in wanted], none)
    stress, same, other = (float(np.broadcast_to(value, 1)[0]) for value in found)
    return stress, 0.5 * (same - other), (same + 2.0 * other) / 3.0


class _Stiffness:
    """∂²W/∂ε_a∂ε_b of an incompressible body over the logarithmic stretches."""

    def __init__(self, material: Material) -> None:
        """Differentiate the energy in a plane that its normal stays across."""
        self._strains, e = free_variables(2)
        squares = [ufl.exp(2.0 * strain) for strain in e]
        # The first two axes lie in the plane.
        J = ufl.exp(e[0] + e[1])
        plane = PlanePart(stretch=1.0 / J, J=J, I1=squares[0] + squares[1])
        constants: dict[str, Any] = dict(material.parameters())
        distortional, _ = material.energy(plane_kinematics(None, plane), constants)
        self._second = [
            expand_derivatives(ufl.diff(ufl.diff(distortional, e[a]), e[b]))
            for a, b in ((0, 0), (0, 1), (1, 1))
        ]

    def least(self, first: Floats, second: Floats) -> Floats:
        """The smallest eigenvalue (p,), Pa, at logarithmic stretches ε₁, ε₂ (p,)."""
        found = values_of(self._second, dict(zip(self._strains, (first, second), strict=True)))
        xx, xy, yy = (np.broadcast_to(value, len(first)) for value in found)
        # Mohr's circle of the symmetric 2 × 2 matrix: the smaller of its two eigenvalues.
        mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
        return mean - np.hypot(half, xy)
