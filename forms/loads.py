"""Surface loads on named surfaces."""

from __future__ import annotations

import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc

from geometry.surface import integration_facets


class FollowerPressure:
    """A pressure normal to the deformed surface: δW = −∫ p cof(F) N · δu dΓ₀.

    Attributes:
        value: the pressure of today, Pa; set it before assembling.
        residual, tangent: compiled forms, to be added to those of the solids.
    """

    def __init__(self, u: dolfinx.fem.Function, facets: NDArray[np.int32]) -> None:
        """Compile the load's forms for the local facets ``facets``."""
        mesh = u.function_space.mesh
        self.value = dolfinx.fem.Constant(mesh, PETSc.ScalarType(0.0))
        ds = ufl.Measure(
            "ds",
            domain=mesh,
            subdomain_data=[(1, integration_facets(mesh, facets))],
            metadata={"quadrature_degree": 2},
        )(1)
        test, trial = ufl.TestFunction(u.function_space), ufl.TrialFunction(u.function_space)
        gradient = ufl.Identity(2) + ufl.grad(u)
        area = ufl.det(gradient) * ufl.inv(gradient).T * ufl.FacetNormal(mesh)
        power = self.value * ufl.inner(area, test) * ds
        self.residual = dolfinx.fem.form(power)
        self.tangent = dolfinx.fem.form(ufl.derivative(power, u, trial))

    def set(self, pressure: float) -> None:
        """Set the pressure of today, Pa, positive when it pushes on the body."""
        self.value.value = pressure


def reference_area(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32]) -> float:
    """Length of a surface in the reference configuration, m (area per unit thickness); collective.

    Args:
        mesh: the mesh.
        facets: local facets, owned and ghosts.
    """
    ds = ufl.Measure("ds", domain=mesh, subdomain_data=[(1, integration_facets(mesh, facets))])(1)
    one = dolfinx.fem.Constant(mesh, PETSc.ScalarType(1.0))
    local = dolfinx.fem.assemble_scalar(dolfinx.fem.form(one * ds))
    return float(mesh.comm.allreduce(local))


def mean_normal(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32], component: int) -> float:
    """Integral of one component of the outward normal over a surface, m; collective."""
    ds = ufl.Measure("ds", domain=mesh, subdomain_data=[(1, integration_facets(mesh, facets))])(1)
    unit = dolfinx.fem.Constant(mesh, np.zeros(mesh.geometry.dim, dtype=PETSc.ScalarType))
    unit.value[component] = 1.0
    form = dolfinx.fem.form(ufl.inner(ufl.FacetNormal(mesh), unit) * ds)
    return float(mesh.comm.allreduce(dolfinx.fem.assemble_scalar(form)))
