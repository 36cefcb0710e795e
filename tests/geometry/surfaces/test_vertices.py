"""Vertices of slave facets: areas, lengths and averages, on graded meshes of all facets."""

from dataclasses import dataclass
from functools import lru_cache

import dolfinx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.contact_boxes import SHAPES
from tests.grid import grid
from tribox.geometry.surfaces.surface import ContactSurface

COUNT = 4  # cells along x
BODY = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


@lru_cache
def graded(shape: str, axisymmetric: bool = False) -> ContactSurface:
    """The lower side of a body of width 1 (and depth 1) with cells that widen along x, from 0.5 on.

    Its upper side serves as the master.
    """
    cell, order = SHAPES[shape]
    dim = BODY[cell]
    mesh = grid(cell, [COUNT, 2, 2][:dim] if dim == 3 else [COUNT, 1])
    x = mesh.geometry.x
    x[:, 0] = 0.5 + x[:, 0] * (0.2 + 0.8 * x[:, 0])
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", order, (dim,)))
    sides = [
        dolfinx.mesh.locate_entities_boundary(
            mesh, dim - 1, lambda X, h=h: np.isclose(X[dim - 1], h)
        )
        for h in (0.0, 1.0)
    ]
    return ContactSurface(space, *sides, 5, axisymmetric)


@dataclass
class Facets:
    """Slave facets by their vertices, (f, k), and their areas (f,), from the vertices' places."""

    vertices: np.ndarray
    area: np.ndarray

    @classmethod
    def of(cls, surface: ContactSurface) -> "Facets":
        vertices = surface.vertices
        _, first = np.unique(surface.slave.facet, return_index=True)
        corners = vertices.of_point[first]
        low, high = (side(vertices.position[corners], axis=1) for side in (np.min, np.max))
        area = np.prod((high - low)[:, :-1], axis=1)
        return cls(corners, area / 2.0 if corners.shape[1] == 3 else area)

    def shared_out(self, values: np.ndarray) -> np.ndarray:
        """Values of facets (f,) in equal parts to their vertices (v,)."""
        parts = np.repeat(values / self.vertices.shape[1], self.vertices.shape[1])
        return np.bincount(self.vertices.reshape(-1), parts)


@pytest.mark.parametrize("shape", SHAPES)
def test_shape_functions_are_linear(shape):
    """They add up to one, are nowhere negative, and reproduce places; of every degree's facets."""
    surface = graded(shape)
    vertices = surface.vertices
    np.testing.assert_allclose(vertices.shape.sum(axis=1), 1.0, rtol=1e-14)
    assert vertices.shape.min() > 0.0
    place = np.stack([vertices.at_points(part) for part in vertices.position.T], axis=1)
    np.testing.assert_allclose(place, surface.slave.position, atol=1e-14)
    assert vertices.count == (COUNT + 1) * (1 if surface.dim == 2 else 3)


@pytest.mark.parametrize("shape", SHAPES)
def test_area_is_that_of_the_facets_around(shape):
    surface, facets = graded(shape), Facets.of(graded(shape))
    assert surface.vertices.area.sum() == pytest.approx(1.0, rel=1e-13)
    expected = facets.shared_out(facets.area)
    np.testing.assert_allclose(surface.vertices.area, expected, rtol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_length_is_that_of_the_facets_around(shape):
    """The mean by area of their lengths: of a segment, a square's side, or a half square's."""
    surface, facets = graded(shape), Facets.of(graded(shape))
    length = facets.area
    if surface.dim == 3:
        length = np.sqrt(2.0 * length if facets.vertices.shape[1] == 3 else length)
    expected = facets.shared_out(facets.area * length) / facets.shared_out(facets.area)
    np.testing.assert_allclose(surface.vertices.length, expected, rtol=1e-12)
    assert surface.vertices.length.max() > 1.5 * surface.vertices.length.min()
    np.testing.assert_allclose(surface.slave.facet_length, length[surface.slave.facet], rtol=1e-12)


@given(st.floats(0.02, 50.0), st.sampled_from(["tetrahedron", "hexahedron"]))
@settings(max_examples=20, deadline=None)
def test_length_of_long_facets_is_that_of_their_areas(ratio, cell):
    """A penalty over it goes with the force per area: not with the longer side, however long."""
    mesh = grid(cell, [3, 2, 1])
    mesh.geometry.x[:, 0] *= ratio
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (3,)))
    sides = [
        dolfinx.mesh.locate_entities_boundary(mesh, 2, lambda X, h=h: np.isclose(X[2], h))
        for h in (0.0, 1.0)
    ]
    expected = np.sqrt(ratio / 3.0 / 2.0)  # of 3 by 2 rectangles, or twice as many triangles
    assert ContactSurface(space, *sides, 2).facet_length == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("shape", ["T3", "Q9"])
def test_area_of_rings(shape):
    """∫ N_A 2πx dx over [a, b] is 2π (b − a)(2a + b)/6 at a; lengths are those of the facets."""
    surface, flat = graded(shape, axisymmetric=True), graded(shape)
    x = surface.vertices.position[:, 0]
    a, b = x[:-1], x[1:]
    expected = np.zeros(len(x))
    expected[:-1] += 2.0 * np.pi * (b - a) * (2.0 * a + b) / 6.0
    expected[1:] += 2.0 * np.pi * (b - a) * (a + 2.0 * b) / 6.0
    np.testing.assert_allclose(surface.vertices.area, expected, rtol=1e-12)
    assert surface.vertices.area.sum() == pytest.approx(np.pi * (1.5**2 - 0.5**2), rel=1e-13)
    np.testing.assert_allclose(surface.slave.facet_length, flat.slave.facet_length, rtol=1e-12)
    inner = surface.vertices.length[1:-1]
    assert np.all((inner > (b - a)[:-1]) & (inner < (b - a)[1:]))
