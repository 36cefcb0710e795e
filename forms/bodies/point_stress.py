"""Stress and strain measures at material points, from their deformation gradients, in numpy.

The energies are those of the materials, differentiated by UFL and evaluated at all points at once:
nothing is compiled, and every material serves. Axis letters: p points, i, j space; tensors are
always (3, 3), the direction across a plane being the third.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import basix.ufl
import numpy as np
import ufl
from numpy.typing import NDArray
from ufl.algorithms import expand_derivatives

from tribox.forms.bodies.kinematics import Kinematics, PlanePart, Section, plane_kinematics
from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.ufl_values import values_of

Floats = NDArray[np.float64]


class StressAt(Protocol):
    """What gives the stress of a body at fixed places of it."""

    def cauchy(self, F: Floats, volumetric: Floats | None = None) -> Floats:
        """Cauchy stress (p, 3, 3), Pa, at the present displacement.

        Args:
            F: (p, 3, 3) deformation gradients there.
            volumetric: (p, 3, 3), those that the volumetric energy is taken at, where they are
                others (selective reduced integration: those at the cells' centres).
        """
        ...

    def plastic_strain(self) -> Floats | None:
        """Equivalent plastic strain (p,); None of a material that does not flow."""
        ...


class PointStress:
    """Cauchy stress of a material from deformation gradients.

    In space W(J, I1, I2) gives J σ = J W_J I + 2 (W_1 + I1 W_2) b − 2 W_2 b². In a plane section,
    with the determinant j and the trace i of C of the in-plane part and the stretch λ across it,
    W(j, i, λ) gives J σ = j W_j I + 2 W_i b in the plane and J σ₃₃ = λ W_λ.
    """

    def __init__(self, material: Material, section: Section) -> None:
        """Differentiate the energy.

        Args:
            material: strain energy.
            section: what the mesh stands for.
        """
        self._space = section == "3D"
        domain = ufl.Mesh(basix.ufl.element("Lagrange", "interval", 1, shape=(1,)))
        self._constants = [ufl.Constant(domain) for _ in range(3)]
        variables = [ufl.variable(c) for c in self._constants]
        k = _of_invariants(variables, self._space)
        parts = material.energy(k, dict(material.parameters()))
        self._distortional, self._volumetric = (
            [expand_derivatives(ufl.diff(part, v)) for v in variables] for part in parts
        )

    def cauchy(self, F: Floats, volumetric: Floats | None = None) -> Floats:
        """See :meth:`StressAt.cauchy`."""
        first, second = self._distortional, self._volumetric
        return self._part(first, F) + self._part(second, F if volumetric is None else volumetric)

    def plastic_strain(self) -> None:
        """None: the material does not flow."""

    def _part(self, slopes: Sequence[Any], F: Floats) -> Floats:
        """Cauchy stress (p, 3, 3) of one part of the energy, from its slopes."""
        invariants = _space_invariants(F) if self._space else _plane_invariants(F)
        found = values_of(slopes, dict(zip(self._constants, invariants, strict=True)))
        w = [np.broadcast_to(value, len(F))[:, None, None] for value in found]
        b = F @ F.transpose(0, 2, 1)
        volume = np.linalg.det(F)[:, None, None]
        if self._space:
            first = invariants[1][:, None, None]
            parts = 2.0 * (w[1] + first * w[2]) * b - 2.0 * w[2] * (b @ b)
            return np.asarray(w[0] * np.eye(3) + parts / volume)
        in_plane, across = np.diag([1.0, 1.0, 0.0]), np.diag([0.0, 0.0, 1.0])
        plane = invariants[0][:, None, None] * w[0] * in_plane + 2.0 * w[1] * (in_plane @ b)
        return np.asarray((plane + invariants[2][:, None, None] * w[2] * across) / volume)


def _of_invariants(variables: Sequence[Any], space: bool) -> Kinematics:
    """Kinematics in which the invariants stand for themselves."""
    first, second, third = variables
    if space:
        return Kinematics(F=None, J=first, I1=second, I2=third, plane=None)
    return plane_kinematics(None, PlanePart(stretch=third, J=first, I1=second))


def _space_invariants(F: Floats) -> tuple[Floats, Floats, Floats]:
    """J, I1 and I2 (p,): I2 is the sum of squares of all cofactors."""
    x, y, z = F[:, 0], F[:, 1], F[:, 2]
    cofactors = np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)])
    return np.linalg.det(F), _square(F), _square(cofactors.transpose(1, 0, 2))


def _square(A: Floats) -> Floats:
    """A:A (p,) of tensors (p, i, j)."""
    return np.asarray(np.einsum("pij,pij->p", A, A))


def _plane_invariants(F: Floats) -> tuple[Floats, Floats, Floats]:
    """Determinant and trace of C (p,) of the in-plane part, and the stretch across the plane."""
    plane = F[:, :2, :2]
    return np.linalg.det(plane), _square(plane), F[:, 2, 2]


def log_strain(F: Floats) -> Floats:
    """Logarithmic (Hencky) strain ln V = ½ ln b (p, 3, 3), in the deformed axes."""
    values, axes = np.linalg.eigh(F @ F.transpose(0, 2, 1))
    logs = 0.5 * np.log(values)
    found: Floats = np.einsum("pia,pa,pja->pij", axes, logs, axes)
    return found


def mean_pressure(stress: Floats) -> Floats:
    """−tr σ/3 (p,), Pa, of stresses (p, 3, 3)."""
    return np.asarray(-np.einsum("pii->p", stress) / 3.0)


def von_mises(stress: Floats) -> Floats:
    """√(3/2 s:s) (p,), Pa, of stresses (p, 3, 3) with the deviator s."""
    s = stress + mean_pressure(stress)[:, None, None] * np.eye(3)
    return np.asarray(np.sqrt(1.5 * _square(s)))


def triaxiality(stress: Floats) -> Floats:
    """Mean stress over von Mises stress (p,) of stresses (p, 3, 3); 0 where there is none."""
    mises, mean = von_mises(stress), -mean_pressure(stress)
    some = mises > 1e-12 * np.abs(stress).max(axis=(1, 2), initial=0.0)
    return np.asarray(np.where(some, mean / np.where(some, mises, 1.0), 0.0))
