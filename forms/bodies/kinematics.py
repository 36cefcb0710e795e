"""Finite-strain kinematics in plane strain, of bodies of revolution and in space, in UFL."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import ufl
from ufl.corealg.multifunction import MultiFunction

Expr = Any  # UFL is untyped

Section = Literal["plane-strain", "axisymmetric", "3D"]
"""What a mesh stands for: a slab's section, the half section of a body of revolution about the
axis x = 0 (x the radius, y along the axis), or the whole body."""


@dataclass(frozen=True, slots=True)
class PlanePart:
    """The in-plane part of a deformation that does not tilt the normal of the plane."""

    # λ₃ across the plane: one in plane strain, the hoop stretch of a body of revolution
    stretch: Expr
    J: Expr  # det F of the in-plane part
    I1: Expr  # tr FᵀF of the in-plane part


@dataclass(frozen=True, slots=True)
class Kinematics:
    """A deformation and its invariants."""

    F: Expr  # deformation gradient (i, j), a UFL variable; of a plane the in-plane part
    J: Expr  # det of the whole, three-dimensional deformation gradient
    # tr C and ½((tr C)² − tr C²) of the three-dimensional C = FᵀF. In space these and J are UFL
    # variables, and all that a material may depend on
    I1: Expr
    I2: Expr  # likewise
    plane: PlanePart | None  # the in-plane part; None in space


def section_of(dim: int, section: Section | None) -> Section:
    """The section of a mesh in ``dim`` dimensions, plane strain by default in two.

    Raises:
        ValueError: a section in the plane of a mesh in space, or a spatial one of a plane mesh.
    """
    if section is None:
        return "plane-strain" if dim == 2 else "3D"
    if (dim == 3) != (section == "3D"):
        raise ValueError(f"a mesh in {dim}D cannot be taken for {section}")
    return section


def kinematics(u: Expr, section: Section) -> Kinematics:
    """Kinematics of the displacement ``u`` (m)."""
    return _spatial(u) if section == "3D" else _plane(u, stretch_across(u, section))


def stretch_across(u: Expr, section: Section) -> Expr:
    """λ₃ across the plane: 1 in plane strain, 1 + u_x/x of a body of revolution."""
    return 1.0 if section == "plane-strain" else 1.0 + u[0] / radius(u)


def radius(u: Expr) -> Expr:
    """Distance from the axis, m, reference."""
    return ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(u))[0]


def circumference(mesh: Any, section: Section, u: Expr = None) -> Expr:
    """Extent across the plane that a point of the section stands for; 1 without axial symmetry.

    Returns:
        2πx, or 2π(x + u_x), m.
    """
    if section != "axisymmetric":
        return 1.0
    x = ufl.SpatialCoordinate(mesh)[0]
    return 2.0 * ufl.pi * (x if u is None else x + u[0])


def body_measure(mesh: Any, cells: Any, degree: int) -> Any:
    """Measure over local cells, of a quadrature degree."""
    metadata = {"quadrature_degree": degree}
    return ufl.Measure("dx", domain=mesh, subdomain_data=[(1, cells)], metadata=metadata)(1)


def centre_kinematics(u: Expr, section: Section) -> Kinematics:
    """Kinematics from which the volume of a cell is taken at its centre.

    The volume of a ring's cell of width h at the radius R has its centroid at R + h²/(12 R). The
    work of an axial stress in a rectangular cell is that at the centroid, the work of a hoop stress
    that at R; next to the axis the two are h/6 apart. The in-plane gradient is therefore
    extrapolated to the centroid by its own derivative.
    """
    if section != "axisymmetric":
        return kinematics(u, section)
    edges = ufl.Jacobian(ufl.domain.extract_unique_domain(u))
    # J Jᵀ e_R/(12 R), see `tribox.forms.bodies.deformation.centre_rows`, which is the same in
    # numpy.
    away = ufl.dot(edges, edges[0, :]) / (12.0 * radius(u))
    gradient = ufl.Identity(2) + ufl.grad(u) + ufl.dot(ufl.grad(ufl.grad(u)), away)
    return _plane(u, stretch_across(u, section), gradient)


def _plane(u: Expr, stretch: Expr, gradient: Expr = None) -> Kinematics:
    F = ufl.variable(ufl.Identity(2) + ufl.grad(u) if gradient is None else gradient)
    return plane_kinematics(F, PlanePart(stretch, ufl.det(F), ufl.inner(F, F)))


def plane_kinematics(F: Expr, plane: PlanePart) -> Kinematics:
    """Kinematics of an in-plane deformation gradient with the invariants of ``plane``."""
    # Eigenvalues of C: those of the in-plane part, with product J₂², and λ₃².
    return Kinematics(
        F=F,
        J=plane.J * plane.stretch,
        I1=plane.I1 + plane.stretch**2,
        I2=plane.I1 * plane.stretch**2 + plane.J**2,
        plane=plane,
    )


def _spatial(u: Expr) -> Kinematics:
    F = ufl.variable(ufl.Identity(3) + ufl.grad(u))
    # I2 is the sum of squares of all cofactors: no cancellation as in (tr C)² − tr C².
    cofactors = ufl.cofac(F)
    invariants = (ufl.det(F), ufl.inner(F, F), ufl.inner(cofactors, cofactors))
    J, I1, I2 = (ufl.variable(invariant) for invariant in invariants)
    return Kinematics(F=F, J=J, I1=I1, I2=I2, plane=None)


class WithoutVariables(MultiFunction):
    """Replaces variables by their expressions; UFL's own visits shared parts many times.

    Variables are numbered over the whole process and the number enters FFCx's cache key: with
    them, the same expression would be compiled again in almost every run.
    """

    expr = MultiFunction.reuse_if_untouched

    def variable(self, o: Any, operand: Any, label: Any) -> Any:
        """The expression itself."""
        return operand
