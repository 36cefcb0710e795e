"""Weights of nodes in means over a surface or body, lumped masses, and elements' frequencies."""

from __future__ import annotations

from collections.abc import Sequence

import dolfinx
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from tribox.forms.bodies import point_cells
from tribox.forms.bodies.deformation import quadrature_rows
from tribox.forms.bodies.kinematics import Section, circumference, section_of
from tribox.forms.bodies.loads import owned_values, surface_measure
from tribox.forms.bodies.materials import Hencky, Material, NeoHookean
from tribox.forms.bodies.point_stress import DISTORTION, VOLUME, WHOLE, energy_kernel
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Floats, Ints


def surface_weights(
    space: dolfinx.fem.FunctionSpace, facets: Ints, section: Section | None = None
) -> Floats:
    r"""Weights :math:`\int N_a \, d\Gamma_0` (n,) of owned nodes, m² or m, 0 beside; collective.

    Of local facets with ghosts in a blocked vector Lagrange space and section.
    """
    mesh, dim = space.mesh, space.dofmap.index_map_bs
    around = circumference(mesh, section_of(mesh.geometry.dim, section))
    # Shape functions of a blocked space: one component of it gives their integrals once.
    one = dolfinx.fem.Constant(mesh, PETSc.ScalarType(1.0))
    first = ufl.inner(ufl.as_vector([one] + [0.0] * (dim - 1)), ufl.TestFunction(space))
    form = dolfinx.fem.form(around * first * surface_measure(mesh, facets, _degree(space)))
    return owned_values(space, form)[::dim].copy()


def body_weights(
    space: dolfinx.fem.FunctionSpace, cells: Ints, section: Section | None = None
) -> Floats:
    """The same over a body's owned ``cells``: m³ (m² in plane strain); 0 off the body."""
    section = section_of(space.mesh.geometry.dim, section)
    rows, weight = quadrature_rows(space, section, cells, _degree(space))
    shares = np.einsum("gc,gca->ca", weight, np.stack([one.values for one in rows]))
    return _nodal_sums(space, cells, shares)[: space.dofmap.index_map.size_local].copy()


def _degree(space: dolfinx.fem.FunctionSpace) -> int:
    """Exact for a shape function times the radius on straight cells."""
    return int(space.element.basix_element.degree) + 1


def _nodal_sums(space: dolfinx.fem.FunctionSpace, cells: Ints, shares: Floats) -> Floats:
    """Sums (n,) at local nodes, ghosts too, of ``shares`` (c, a) of owned cells; collective."""
    total = dolfinx.la.vector(space.dofmap.index_map, 1)
    nodes = np.asarray(space.dofmap.list)[cells].reshape(-1)
    total.array[:] = np.bincount(nodes, shares.reshape(-1), len(total.array))
    total.scatter_reverse(dolfinx.la.InsertMode.add)
    total.scatter_forward()
    return np.array(total.array)


def lumped_mass(
    space: dolfinx.fem.FunctionSpace, solids: Sequence[Solid], scale: Floats | None = None
) -> Floats:
    r"""Row sums of the mass matrix, :math:`m_a = \int s \rho N_a \, d\Omega_0`; collective.

    Of each local unknown, ghosts included, kg per unit thickness, 0 at nodes of no body. ``scale``:
    s of the owned cells (c,), or 1. ValueError, on every rank, without a density, or of the second
    order, whose row sums are not positive.
    """
    missing = [solid.name for solid in solids if not solid.density > 0.0]
    if missing:
        raise ValueError(f"bodies.{missing[0]}.density: missing; explicit dynamics needs it")
    mass: Floats = np.zeros(1)
    for solid in solids:
        shares = element_masses(space, solid)
        if scale is not None:
            shares *= scale[solid.cells, None]
        mass = mass + _nodal_sums(space, solid.cells, shares)
    cells = np.concatenate([solid.cells for solid in solids])
    nodes = np.unique(space.dofmap.list[cells])
    lightest = float(mass[nodes].min(initial=np.inf))
    if space.mesh.comm.allreduce(not lightest > 0.0, op=MPI.LOR):
        raise ValueError("the element's lumped masses are not positive: use first-order elements")
    return mass.repeat(space.dofmap.index_map_bs)


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

    At rest all energies of the same moduli are alike but for what is taken at the centre: of
    neo-Hooke's, whose −G ln J is in the other part, Λ, of all others K.
    """
    moduli = solid.material.shear_modulus, solid.material.bulk_modulus
    neo = isinstance(solid.material.elastic, NeoHookean)
    material: Material = NeoHookean(*moduli) if neo else Hencky(*moduli)
    section, cells = solid.section, solid.cells
    full = point_cells.cells_of(space, section, cells, solid.full_degree)
    parts = [(full, DISTORTION if solid.reduced else WHOLE)]
    if solid.reduced:
        parts.append((point_cells.centres_of(space, section, cells), VOLUME))
    kernels = [energy_kernel(point_cells.NAMES[section], material, part) for _, part in parts]
    loops = [
        point_cells.PointCells(section, at, point_cells.Moduli(kernel))
        for (at, _), kernel in zip(parts, kernels, strict=True)
    ]
    (count, nodes), dim = full.nodes.shape, space.dofmap.index_map_bs
    shape = (count, nodes, dim, nodes)
    values = np.zeros((*shape, dim))
    starts = dim * np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    point_cells.add_tangent(loops, np.zeros_like(solid.displacement.x.array), values, starts)
    return values.reshape(count, nodes * dim, nodes * dim)
