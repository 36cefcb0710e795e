"""The highest frequency of each undeformed element on its own.

The largest eigenvalue of an assembled pencil (K, M) is at most the largest of its elements', also
when stiffness at a node is divided among its elements in proportion to their masses.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import CENTRE_DEGREE, Solid

Floats = NDArray[np.float64]


MASS_DEGREE = 2  # of the quadrature that lumps the masses


def element_masses(space: dolfinx.fem.FunctionSpace, solid: Solid) -> Floats:
    """Lumped masses (c, a) of the nodes of each cell, kg per unit thickness."""
    at = _points(space, solid, MASS_DEGREE)
    return solid.density * np.einsum("cg,ga->ca", at.weight, at.shape)


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
    G, K = solid.material.shear_modulus, solid.material.bulk_modulus
    lame = K - 2.0 / 3.0 * G
    full = _points(space, solid, solid.full_degree)
    if not solid.reduced:
        return _integral(full, G, lame)
    centre = lame if isinstance(solid.material.elastic, NeoHookean) else K
    middle = _points(space, solid, CENTRE_DEGREE, centroid=True)
    return _integral(full, G, lame - centre) + _integral(middle, 0.0, centre)


@dataclass(frozen=True, slots=True)
class _Points:
    """Quadrature points of a body's cells.

    Attributes:
        grad: (c, g, a, i), 1/m, gradients; shape: (g, a) shape functions; weight: (c, g), of rings
            2πx as large; radius: (c, g), m, from the axis; None without one.
    """

    grad: Floats
    shape: Floats
    weight: Floats
    radius: Floats | None


def _integral(at: _Points, G: float, lame: float) -> Floats:
    """∫ Λ div u div v + 2 G ε(u):ε(v), with the hoop strain u_x/x of rings."""
    grad, weight = at.grad, at.weight
    count, _, nodes, dim = grad.shape
    div = grad
    if at.radius is not None:
        hoop = at.shape / at.radius[:, :, None]
        div = grad.copy()
        div[..., 0] += hoop
    out = lame * np.einsum("cg,cgai,cgbj->caibj", weight, div, div, optimize=True)
    out += G * np.einsum("cg,cgaj,cgbi->caibj", weight, grad, grad, optimize=True)
    dots = G * np.einsum("cg,cgak,cgbk->cab", weight, grad, grad, optimize=True)
    for i in range(dim):
        out[:, :, i, :, i] += dots
    if at.radius is not None:
        out[:, :, 0, :, 0] += 2.0 * G * np.einsum("cg,cga,cgb->cab", weight, hoop, hoop)
    return out.reshape(count, nodes * dim, nodes * dim)


def _points(
    space: dolfinx.fem.FunctionSpace, solid: Solid, degree: int, centroid: bool = False
) -> _Points:
    """Quadrature points of a degree.

    Args:
        space: of the displacement.
        solid: the body.
        degree: exact for.
        centroid: whether the gradients of rings are those at the centroids of their volumes.
    """
    element = space.element.basix_element
    points, weights = basix.make_quadrature(element.cell_type, degree)
    shape, first = element.tabulate(0, points)[0, ..., 0], _first(element, points)
    dim = space.mesh.geometry.dim
    nodes = np.asarray(space.dofmap.list)[solid.cells]
    x = space.tabulate_dof_coordinates()[:, :dim][nodes]
    jacobian = np.einsum("kga,cai->cgik", first, x)
    weight = weights * np.abs(np.linalg.det(jacobian))
    slope, radius = np.broadcast_to(first, (len(x), *first.shape)), None
    if solid.section == "axisymmetric":
        radius = np.einsum("ga,ca->cg", shape, x[..., 0])
        weight *= 2.0 * np.pi * radius
        if centroid:
            # h²/(12 x) off in space is J[0, :]/(12 x) off in the cell's own coordinates.
            away = jacobian[:, 0, 0] / (12.0 * radius)
            slope = _first(element, points[0] + away).transpose(1, 0, 2)[:, :, None]
            jacobian = np.einsum("ckga,cai->cgik", slope, x)
    grad = np.einsum("ckga,cgki->cgai", slope, np.linalg.inv(jacobian))
    return _Points(grad, shape, weight, radius)


def _first(element: basix.finite_element.FiniteElement, points: Floats) -> Floats:
    """Derivatives (k, g, a) of the shape functions at reference points (g, k)."""
    first: Floats = element.tabulate(1, points)[1:, ..., 0]
    return first
