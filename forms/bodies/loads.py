"""Loads on surfaces: forms that are compiled once, and the values they are set to."""

from __future__ import annotations

from typing import Any

import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc

from forms.bodies.kinematics import Section, circumference, section_of
from geometry.compat import integration_facets
from geometry.surfaces.facets import Floats


class Load:
    """What an equilibrium needs of a load: forms, and a value that they are proportional to.

    Attributes:
        value: the present value, a number or a vector; set it before assembling.
        residual, tangent: compiled forms, to be added to those of the solids. A dead load, which
            the displacement does not change, has no tangent.
    """

    def __init__(
        self,
        value: dolfinx.fem.Constant,
        residual: dolfinx.fem.Form,
        tangent: dolfinx.fem.Form | None = None,
    ) -> None:
        """Keep the parts."""
        self.value, self.residual, self.tangent = value, residual, tangent

    @property
    def amount(self) -> Floats:
        """The present value (k,), a copy."""
        return np.array(self.value.value, dtype=np.float64).reshape(-1)

    @amount.setter
    def amount(self, amount: Floats) -> None:
        self.value.value = np.reshape(amount, self.value.value.shape)

    @property
    def acts(self) -> bool:
        """Whether the value is anything but zero."""
        return bool(np.any(self.value.value))


class FollowerPressure(Load):
    """A pressure normal to the deformed surface: δW = −∫ p cof(F) N · δu dΓ₀.

    Attributes:
        value: the present pressure, Pa.
    """

    def __init__(
        self, u: dolfinx.fem.Function, facets: NDArray[np.int32], section: Section | None = None
    ) -> None:
        """Compile the load's forms for local facets.

        Args:
            u: displacement, m.
            facets: local facets, owned and ghosts.
            section: what the mesh stands for; by default plane strain, or a body in space.
        """
        space = u.function_space
        mesh, dim = space.mesh, space.mesh.geometry.dim
        section = section_of(dim, section)
        value = dolfinx.fem.Constant(mesh, PETSc.ScalarType(0.0))
        # Tangents of the deformed surface, their product and δu: exact on straight facets.
        degree = 2 if space.ufl_element().degree == 1 else 5
        ds = surface_measure(mesh, facets, degree)
        test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
        gradient = ufl.Identity(dim) + ufl.grad(u)
        if dim == 3:
            area = ufl.dot(ufl.cofac(gradient), ufl.FacetNormal(mesh))
        else:
            # Deformed, without a division that fails on the axis.
            across = circumference(mesh, section, u)
            area = across * ufl.det(gradient) * ufl.inv(gradient).T * ufl.FacetNormal(mesh)
        power = value * ufl.inner(area, test) * ds
        tangent = dolfinx.fem.form(ufl.derivative(power, u, trial))
        super().__init__(value, dolfinx.fem.form(power), tangent)

    def set(self, pressure: float) -> None:
        """Set the pressure, Pa, positive when it pushes on the body."""
        self.value.value = pressure


def reference_area(
    mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32], section: Section | None = None
) -> float:
    """Area of a surface in the reference configuration; collective.

    Args:
        mesh: the mesh.
        facets: local facets, owned and ghosts.
        section: what the mesh stands for; by default plane strain, or a body in space.

    Returns:
        m², of the whole surface of revolution if it is one; in plane strain m, per unit thickness.
    """
    section = section_of(mesh.geometry.dim, section)
    one = dolfinx.fem.Constant(mesh, PETSc.ScalarType(1.0))
    form = dolfinx.fem.form(one * circumference(mesh, section) * surface_measure(mesh, facets))
    return float(mesh.comm.allreduce(dolfinx.fem.assemble_scalar(form)))


def mean_normal(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32], component: int) -> float:
    """Mean of one component of the outward normal over a surface's facets; collective."""
    ds = surface_measure(mesh, facets)
    unit = dolfinx.fem.Constant(mesh, np.zeros(mesh.geometry.dim, dtype=PETSc.ScalarType))
    unit.value[component] = 1.0
    form = dolfinx.fem.form(ufl.inner(ufl.FacetNormal(mesh), unit) * ds)
    total = float(mesh.comm.allreduce(dolfinx.fem.assemble_scalar(form)))
    size = reference_area(mesh, facets)
    return total / size if size > 0.0 else 0.0


def surface_measure(
    mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32], degree: int | None = None
) -> Any:
    """Surface measure over local facets, of a quadrature degree."""
    return ufl.Measure(
        "ds",
        domain=mesh,
        subdomain_data=[(1, integration_facets(mesh, facets))],
        metadata={} if degree is None else {"quadrature_degree": degree},
    )(1)
