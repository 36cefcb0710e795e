"""Finite-strain kinematics in plane strain, as UFL expressions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ufl

Expr = Any  # UFL is untyped


@dataclass(frozen=True, slots=True)
class Kinematics:
    """A plane deformation and its invariants, the out-of-plane stretch being λ₃.

    Attributes:
        F: in-plane deformation gradient (i, j), a UFL variable.
        stretch: λ₃, one in plane strain.
        plane_J, plane_I1: det and tr FᵀF of the in-plane part.
        J: det of the whole deformation gradient.
        I1, I2: tr C and ½((tr C)² − tr C²) of the three-dimensional C = FᵀF.
    """

    F: Expr
    stretch: Expr
    plane_J: Expr
    plane_I1: Expr
    J: Expr
    I1: Expr
    I2: Expr


def plane_strain(u: Expr, stretch: Expr = 1.0) -> Kinematics:
    """Kinematics of the in-plane displacement ``u`` (m).

    Args:
        u: displacement.
        stretch: out-of-plane stretch; another value than one, or a UFL variable of value one, is
            for derivatives with respect to it, which give the out-of-plane stress.
    """
    F = ufl.variable(ufl.Identity(2) + ufl.grad(u))
    plane_J = ufl.det(F)
    plane_I1 = ufl.inner(F, F)
    # Eigenvalues of C: those of the in-plane part, with product J₂², and λ₃².
    return Kinematics(
        F=F,
        stretch=stretch,
        plane_J=plane_J,
        plane_I1=plane_I1,
        J=plane_J * stretch,
        I1=plane_I1 + stretch**2,
        I2=plane_I1 * stretch**2 + plane_J**2,
    )
