"""Where named surfaces end on the boundary of their body: at its corners, or amid it."""

import dolfinx
import numpy as np
import pytest

from tests.grid import grid
from tribox.geometry.surfaces.body_facets import OuterFacets, displacement_facet, outward_facets

CELLS = {2: ("triangle", "quadrilateral"), 3: ("tetrahedron", "hexahedron")}


def space_on(dim: int, cell: str, degree: int) -> dolfinx.fem.FunctionSpace:
    """A unit box of four cells to a side."""
    return dolfinx.fem.functionspace(grid(cell, [4] * dim), ("Lagrange", degree, (dim,)))


def top(space: dolfinx.fem.FunctionSpace, low: float, high: float) -> np.ndarray:
    """Nodes (f, a) of the facets on top of the box, from one x to another."""
    dim = space.mesh.topology.dim

    def inside(x: np.ndarray) -> np.ndarray:
        return np.isclose(x[dim - 1], 1.0) & (low <= x[0]) & (x[0] <= high)

    found = dolfinx.mesh.locate_entities_boundary(space.mesh, dim - 1, inside)
    return outward_facets(space, displacement_facet(space), found)[0].astype(np.int64)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("dim", "cell"), [(d, c) for d, cells in CELLS.items() for c in cells])
def test_a_surface_ends_smoothly_only_where_its_face_goes_on(dim, cell, degree):
    """Half of the top of a box; all of it; half of it, and the other half beside it."""
    space = space_on(dim, cell, degree)
    half, rest, whole = (top(space, *ends) for ends in ((-0.1, 0.6), (0.4, 1.1), (-0.1, 1.1)))
    outer = OuterFacets(space)
    assert len(outer.smooth_ends(whole, whole[:0])) == 0
    assert len(outer.smooth_ends(half, rest)) == 0
    ends = outer.smooth_ends(half, whole[:0])
    assert len(ends) == (1 if dim == 2 else 4)
    places = space.tabulate_dof_coordinates()[ends.reshape(-1)]
    assert np.allclose(places[:, 0], 0.5) and np.allclose(places[:, dim - 1], 1.0)
