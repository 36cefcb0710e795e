"""What a mesh stands for: plane strain, a body of revolution or space; measures in UFL."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import ufl

Expr = Any  # UFL is untyped

Section = Literal["plane-strain", "axisymmetric", "3D"]
"""What a mesh stands for: a slab's section, the half section of a body of revolution about the
axis x = 0 (x the radius, y along the axis), or the whole body."""


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Invariants of a deformation gradient F, of which a user's own energy is a function."""

    J: Expr  # det F
    I1: Expr  # tr C, C = FᵀF
    I2: Expr  # ½((tr C)² − tr C²)


def section_of(dim: int, section: Section | None) -> Section:
    """The section of a mesh, by default plane strain or 3D; ValueError of another dimension."""
    if section is None:
        return "plane-strain" if dim == 2 else "3D"
    if (dim == 3) != (section == "3D"):
        raise ValueError(f"a mesh in {dim}D cannot be taken for {section}")
    return section


def circumference(mesh: Any, section: Section, u: Expr = None) -> Expr:
    """2πx, or 2π(x + u_x), m, that a point of the section stands for; 1 without axial symmetry."""
    if section != "axisymmetric":
        return 1.0
    x = ufl.SpatialCoordinate(mesh)[0]
    return 2.0 * ufl.pi * (x if u is None else x + u[0])


def body_measure(mesh: Any, cells: Any, degree: int) -> Any:
    """Measure over local cells, of a quadrature degree."""
    metadata = {"quadrature_degree": degree}
    return ufl.Measure("dx", domain=mesh, subdomain_data=[(1, cells)], metadata=metadata)(1)
