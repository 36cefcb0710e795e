"""The highest frequency of each undeformed element on its own.

The largest eigenvalue of an assembled pencil (K, M) is at most the largest of its elements', also
when stiffness at a node is divided among its elements in proportion to their masses.
"""

from __future__ import annotations

import basix.cell
import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.deformation import Rows, centre_rows, quadrature_rows, ring_volume
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid

Floats = NDArray[np.float64]


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
    scaled = root[:, :, None] * stiffness * root[:, None, :]
    if not len(scaled):
        return np.empty(0)
    values: Floats = np.asarray(np.linalg.eigvalsh(scaled)[:, -1], dtype=np.float64)
    return values


def _stiffness(space: dolfinx.fem.FunctionSpace, solid: Solid) -> Floats:
    """Stiffness (c, a·i, b·j) of the undeformed cells, Pa per unit thickness.

    The moduli are G and the Λ of each part of the energy: at the centre that of the volumetric part
    where it is integrated there.
    """
    section, cells = solid.section, solid.cells
    G, K = solid.material.shear_modulus, solid.material.bulk_modulus
    lame, centre = K - 2.0 / 3.0 * G, 0.0
    if solid.reduced:
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
    out += G * np.einsum("c,caj,cbi->caibj", weight, grad, grad, optimize=True)
    dots = G * np.einsum("c,cak,cbk->cab", weight, grad, grad, optimize=True)
    for i in range(dim):
        out[:, :, i, :, i] += dots
    out[:, :, 0, :, 0] += 2.0 * G * np.einsum("c,ca,cb->cab", weight, hoop, hoop)
    return out.reshape(count, nodes * dim, nodes * dim)
