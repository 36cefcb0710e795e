"""Integrals of shape functions: weights of nodes in means over a surface or body, lumped masses."""

from __future__ import annotations

from collections.abc import Sequence

import dolfinx
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from tribox.forms.bodies.kinematics import Section, body_measure, circumference, section_of
from tribox.forms.bodies.loads import owned_values, surface_measure
from tribox.forms.bodies.solid import Solid
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
    form = surface_form(space, facets, section)
    return owned_values(space, form)[:: space.dofmap.index_map_bs].copy()


def body_weights(
    space: dolfinx.fem.FunctionSpace, cells: Ints, section: Section | None = None
) -> Floats:
    """The same over a body's owned ``cells``: m³ (m² in plane strain); 0 off the body."""
    return owned_values(space, body_form(space, cells, section))[
        :: space.dofmap.index_map_bs
    ].copy()


def surface_form(
    space: dolfinx.fem.FunctionSpace, facets: Ints, section: Section | None = None
) -> dolfinx.fem.Form:
    """The form of :func:`surface_weights`."""
    return _form(space, surface_measure(space.mesh, facets, _degree(space)), section)


def body_form(
    space: dolfinx.fem.FunctionSpace, cells: Ints, section: Section | None = None
) -> dolfinx.fem.Form:
    """The form of :func:`body_weights`."""
    return _form(space, body_measure(space.mesh, cells, _degree(space)), section)


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


def lumped_mass(
    space: dolfinx.fem.FunctionSpace,
    solids: Sequence[Solid],
    scale: dolfinx.fem.Function | None = None,
) -> Floats:
    r"""Row sums of the mass matrix, :math:`m_a = \int s \rho N_a \, d\Omega_0`; collective.

    Args:
        space: blocked vector Lagrange space of first order.
        solids: the bodies.
        scale: s, one number per cell (DG 0), a factor on the cell's mass; None: 1.

    Returns:
        Mass of each local unknown, ghosts included, kg per unit thickness; 0 at nodes of no body.

    Raises:
        ValueError: on every rank, if a body has no density, or the element's row sums are not
            positive (second order).
    """
    missing = [solid.name for solid in solids if not solid.density > 0.0]
    if missing:
        raise ValueError(f"bodies.{missing[0]}.density: missing; explicit dynamics needs it")
    index, size = space.dofmap.index_map, space.dofmap.index_map_bs
    mass = dolfinx.la.vector(index, size)
    for solid in solids:
        dolfinx.fem.assemble_vector(mass.array, mass_form(space, solid, scale))
    mass.scatter_reverse(dolfinx.la.InsertMode.add)
    mass.scatter_forward()
    nodes = np.unique(space.dofmap.list[np.concatenate([solid.cells for solid in solids])])
    lightest = float(mass.array.reshape(-1, size)[nodes].min(initial=np.inf))
    if space.mesh.comm.allreduce(not lightest > 0.0, op=MPI.LOR):
        raise ValueError("the element's lumped masses are not positive: use first-order elements")
    values: Floats = mass.array.copy()
    return values


def mass_form(
    space: dolfinx.fem.FunctionSpace, solid: Solid, scale: dolfinx.fem.Function | None = None
) -> dolfinx.fem.Form:
    """The form of a body's row sums; see :func:`lumped_mass`."""
    mesh = space.mesh
    density = dolfinx.fem.Constant(mesh, PETSc.ScalarType(solid.density))
    if scale is None:
        scale = cell_field(mesh, 1.0)
    ones = ufl.as_vector([1.0] * space.dofmap.index_map_bs)
    around, dx = circumference(mesh, solid.section), body_measure(mesh, solid.cells, 2)
    return dolfinx.fem.form(
        density * scale * around * ufl.inner(ones, ufl.TestFunction(space)) * dx
    )


def cell_field(mesh: dolfinx.mesh.Mesh, value: float) -> dolfinx.fem.Function:
    """A number per cell, ``value`` everywhere."""
    field = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("DG", 0)))
    field.x.array[:] = value
    return field
