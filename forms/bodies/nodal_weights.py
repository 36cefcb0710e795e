"""Weights of nodes in means over a surface or a body: integrals of their shape functions."""

from __future__ import annotations

import dolfinx
import ufl
from petsc4py import PETSc

from tribox.forms.bodies.kinematics import Section, circumference, section_of
from tribox.forms.bodies.loads import surface_measure
from tribox.geometry.surfaces.facets import Floats, Ints


def surface_weights(
    space: dolfinx.fem.FunctionSpace, facets: Ints, section: Section | None = None
) -> Floats:
    r"""Weights :math:`\int N_a \, d\Gamma_0` of the owned nodes (n,); collective.

    Args:
        space: blocked vector Lagrange space.
        facets: local facets, owned and ghosts.
        section: what the mesh stands for; by default plane strain, or a body in space.

    Returns:
        m² (m in plane strain, per unit thickness); 0 off the surface.
    """
    return _assembled(space, surface_form(space, facets, section))


def body_weights(
    space: dolfinx.fem.FunctionSpace, cells: Ints, section: Section | None = None
) -> Floats:
    r"""Weights :math:`\int N_a \, d\Omega_0` of the owned nodes (n,); collective.

    Args:
        space: blocked vector Lagrange space.
        cells: local cells of the body that this rank owns.
        section: what the mesh stands for; by default plane strain, or a body in space.

    Returns:
        m³ (m² in plane strain, per unit thickness); 0 off the body.
    """
    return _assembled(space, body_form(space, cells, section))


def surface_form(
    space: dolfinx.fem.FunctionSpace, facets: Ints, section: Section | None = None
) -> dolfinx.fem.Form:
    """The form of :func:`surface_weights`."""
    return _form(space, surface_measure(space.mesh, facets, _degree(space)), section)


def body_form(
    space: dolfinx.fem.FunctionSpace, cells: Ints, section: Section | None = None
) -> dolfinx.fem.Form:
    """The form of :func:`body_weights`."""
    degree = {"quadrature_degree": _degree(space)}
    dx = ufl.Measure("dx", domain=space.mesh, subdomain_data=[(1, cells)], metadata=degree)(1)
    return _form(space, dx, section)


def _degree(space: dolfinx.fem.FunctionSpace) -> int:
    """Exact for a shape function times the radius on straight cells."""
    return int(space.element.basix_element.degree) + 1


def _form(
    space: dolfinx.fem.FunctionSpace, measure: ufl.Measure, section: Section | None
) -> dolfinx.fem.Form:
    mesh, dim = space.mesh, space.dofmap.index_map_bs
    one = dolfinx.fem.Constant(mesh, PETSc.ScalarType(1.0))
    around = circumference(mesh, section_of(mesh.geometry.dim, section))
    first = ufl.as_vector([one] + [0.0] * (dim - 1))
    return dolfinx.fem.form(around * ufl.inner(first, ufl.TestFunction(space)) * measure)


def _assembled(space: dolfinx.fem.FunctionSpace, form: dolfinx.fem.Form) -> Floats:
    index, dim = space.dofmap.index_map, space.dofmap.index_map_bs
    vector = dolfinx.la.vector(index, dim)
    dolfinx.fem.assemble_vector(vector.array, form)
    vector.scatter_reverse(dolfinx.la.InsertMode.add)
    weights: Floats = vector.array[: index.size_local * dim : dim].copy()
    return weights
