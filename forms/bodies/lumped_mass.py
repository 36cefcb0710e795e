"""Lumped masses of the bodies, for explicit dynamics."""

from __future__ import annotations

from collections.abc import Sequence

import dolfinx
import numpy as np
import ufl
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.forms.bodies.kinematics import circumference
from tribox.forms.bodies.solid import Solid

Floats = NDArray[np.float64]


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
    dx = ufl.Measure(
        "dx",
        domain=mesh,
        subdomain_data=[(1, solid.cells)],
        metadata={"quadrature_degree": 2},
    )(1)
    around = circumference(mesh, solid.section)
    return dolfinx.fem.form(
        density * scale * around * ufl.inner(ones, ufl.TestFunction(space)) * dx
    )


def cell_field(mesh: dolfinx.mesh.Mesh, value: float) -> dolfinx.fem.Function:
    """A number per cell, ``value`` everywhere."""
    field = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("DG", 0)))
    field.x.array[:] = value
    return field
