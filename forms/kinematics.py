"""Finite-strain kinematics in plane strain, as UFL expressions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import ufl

Expr = Any  # UFL is untyped


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Invariants of a plane-strain deformation, the out-of-plane stretch being one.

    Attributes:
        F: in-plane deformation gradient (i, j); J: det F.
        I1, I2: tr C and ½((tr C)² − tr C²) of the three-dimensional C = FᵀF.
    """

    F: Expr
    J: Expr
    I1: Expr
    I2: Expr


def plane_strain(u: Expr) -> Kinematics:
    """Kinematics of the in-plane displacement ``u`` (m)."""
    F = ufl.variable(ufl.Identity(2) + ufl.grad(u))
    J = ufl.det(F)
    in_plane = ufl.inner(F, F)
    # Eigenvalues of C: those of the in-plane part, with product J², and one.
    return Kinematics(F=F, J=J, I1=in_plane + 1.0, I2=in_plane + J**2)
