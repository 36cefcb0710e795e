"""Weights of nodes in means over a surface or body, lumped masses, and elements' frequencies."""

from __future__ import annotations

from collections.abc import Sequence

import basix.cell
import dolfinx
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from tribox.forms.bodies.deformation import Rows, centre_rows, quadrature_rows, ring_volume
from tribox.forms.bodies.kinematics import Section, body_measure, circumference, section_of
from tribox.forms.bodies.loads import owned_values, surface_measure
from tribox.forms.bodies.materials import NeoHookean
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
    return _integrals(space, surface_measure(space.mesh, facets, _degree(space)), section)


def body_weights(
    space: dolfinx.fem.FunctionSpace, cells: Ints, section: Section | None = None
) -> Floats:
    """The same over a body's owned ``cells``: m³ (m² in plane strain); 0 off the body."""
    return _integrals(space, body_measure(space.mesh, cells, _degree(space)), section)


def _degree(space: dolfinx.fem.FunctionSpace) -> int:
    """Exact for a shape function times the radius on straight cells."""
    return int(space.element.basix_element.degree) + 1


def _integrals(
    space: dolfinx.fem.FunctionSpace, measure: ufl.Measure, section: Section | None
) -> Floats:
    mesh, dim = space.mesh, space.dofmap.index_map_bs
    one = dolfinx.fem.Constant(mesh, PETSc.ScalarType(1.0))
    around = circumference(mesh, section_of(mesh.geometry.dim, section))
    # Shape functions of a blocked space: one component of it gives their integrals once.
    first = ufl.as_vector([one] + [0.0] * (dim - 1))
    form = dolfinx.fem.form(around * ufl.inner(first, ufl.TestFunction(space)) * measure)
    return owned_values(space, form)[::dim].copy()


def lumped_mass(
    space: dolfinx.fem.FunctionSpace,
    solids: Sequence[Solid],
    scale: dolfinx.fem.Function | None = None,
) -> Floats:
    r"""Row sums of the mass matrix, :math:`m_a = \int s \rho N_a \, d\Omega_0`; collective.

    Args:
        space: blocked vector Lagrange space of first order.
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
    return mass.array.copy()


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


# -- The highest frequency of each undeformed element on its own -----------------------------------
#
# The largest eigenvalue of an assembled pencil (K, M) is at most the largest of its elements', also
# when stiffness at a node is divided among its elements in proportion to their masses.


MASS_DEGREE = 2  # of the quadrature that lumps the masses


def element_masses(space: dolfinx.fem.FunctionSpace, solid: Solid) -> Floats:
    """Lumped masses (c, a) of the nodes of each cell, kg per unit thickness."""
    rows, weight = quadrature_rows(space, solid.section, solid.cells, MASS_DEGREE)
    shape = np.stack([one.values for one in rows])
    return solid.density * np.einsum("gc,gca->ca", weight, shape)


def element_frequencies(space: dolfinx.fem.FunctionSpace, solid: Solid) -> Floats:
    """Largest eigenvalue ω² (c,) of each cell's stiffness over its lumped mass, 1/s²."""
    stiffness = _stiffness(space, solid)
    mass = np.repeat(element_masses(space, solid), space.dofmap.index_map_bs, axis=1)
    root = 1.0 / np.sqrt(mass)
    # M^(−1/2) K M^(−1/2) has the eigenvalues of (K, M) and is symmetric.
    scaled = root[:, :, None] * stiffness * root[:, None, :]
    if not len(scaled):
        return np.empty(0)
    return np.asarray(np.linalg.eigvalsh(scaled)[:, -1], dtype=np.float64)


def _stiffness(space: dolfinx.fem.FunctionSpace, solid: Solid) -> Floats:
    """Stiffness (c, a·i, b·j) of the undeformed cells, Pa per unit thickness.

    The moduli are G and the Λ of each part of the energy: at the centre that of the volumetric part
    where it is integrated there.
    """
    section, cells = solid.section, solid.cells
    G, K = solid.material.shear_modulus, solid.material.bulk_modulus
    lame, centre = K - 2.0 / 3.0 * G, 0.0
    if solid.reduced:
        # Volumetric energies whose second derivative at rest is Λ (neo-Hooke, whose −G ln J is in
        # the other part) or K; what is left of Λ belongs to the full Gauss points.
        centre = lame if isinstance(solid.material.elastic, NeoHookean) else K
    rows, weight = quadrature_rows(space, section, cells, solid.full_degree)
    parts = [_moduli(one, weight[g], G, lame - centre) for g, one in enumerate(rows)]
    if solid.reduced:
        middle = centre_rows(space, section, cells)
        size = basix.cell.volume(basix.CellType[space.mesh.topology.cell_name()])
        parts.append(_moduli(middle, size * ring_volume(middle, section), 0.0, centre))
    return np.asarray(np.sum(parts, axis=0))


def _moduli(at: Rows, weight: Floats, G: float, lame: float) -> Floats:
    """Λ div u div v + 2 G ε(u):ε(v) of points, weighted (c,), rings with their hoop strain."""
    grad, hoop = at.gradients, at.across[:, None] * at.values
    count, nodes, dim = grad.shape
    div = grad.copy()
    div[..., 0] += hoop
    out = lame * np.einsum("c,cai,cbj->caibj", weight, div, div, optimize=True)
    # 2 G ε(u):ε(v) = G (u_i,j v_j,i + u_i,j v_i,j): the first couples the directions, the second
    # (`dots`) stands on the diagonal of each pair of nodes.
    out += G * np.einsum("c,caj,cbi->caibj", weight, grad, grad, optimize=True)
    dots = G * np.einsum("c,cak,cbk->cab", weight, grad, grad, optimize=True)
    for i in range(dim):
        out[:, :, i, :, i] += dots
    out[:, :, 0, :, 0] += 2.0 * G * np.einsum("c,ca,cb->cab", weight, hoop, hoop)
    return out.reshape(count, nodes * dim, nodes * dim)
