"""Element frequencies against the spectrum of the assembled stiffness: in plane, rings, space."""

from functools import cache

import dolfinx
import numpy as np
import pytest
import scipy.linalg

from tests.forms.bodies.in_forms import forms_of
from tests.grid import grid
from tribox.forms.bodies.materials import MooneyRivlin
from tribox.forms.bodies.solid import Solid
from tribox.forms.bodies.weights import element_frequencies, element_masses, lumped_mass

RUBBER = MooneyRivlin(0.4, 0.1, 30.0)
KINDS = [
    ("quadrilateral", "plane-strain", "q1-sri"), ("quadrilateral", "axisymmetric", "q1-sri"),
    ("quadrilateral", "axisymmetric", "q1"), ("triangle", "axisymmetric", "q1"),
    ("hexahedron", "3D", "q1-sri"), ("tetrahedron", "3D", "q1"),
]  # fmt: skip


@cache
def straight(cell, section, formulation, counts):
    """A block in as many cells from x = 0, and its coordinates; its forms take most of the time."""
    dim = len(counts)
    mesh = grid(cell, counts, [1.0, 0.8, 0.6][:dim])
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,)))
    u = dolfinx.fem.Function(space)
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    solid = Solid("body", u, cells, RUBBER, formulation, 1.3, section)
    return space, solid, mesh.geometry.x.copy()


def body(cell, section, formulation, counts, inner, bend=0.0):
    """A block, or a ring from this inner radius, in as many cells; shared: the last call holds."""
    space, solid, x = straight(cell, section, formulation, counts)
    x = x + np.array([inner, 0.0, 0.0])
    x[:, 1] += bend * np.sin(3.0 * x[:, 0]) * x[:, 1]
    space.mesh.geometry.x[:] = x
    return space, solid


def highest(space, solid):
    """Largest eigenvalue of the assembled stiffness over the lumped masses."""
    matrices = [dolfinx.fem.assemble_matrix(part.tangent) for part in forms_of(solid)]
    stiffness = sum(matrix.to_scipy().toarray() for matrix in matrices)
    return scipy.linalg.eigh(stiffness, np.diag(lumped_mass(space, [solid])), eigvals_only=True)[-1]


@pytest.mark.parametrize(("cell", "section", "formulation"), KINDS)
@pytest.mark.parametrize("inner", [0.0, 0.3])
def test_bounds_the_spectrum(cell, section, formulation, inner):
    counts = (4, 3, 2)[: 3 if section == "3D" else 2]
    space, solid = body(cell, section, formulation, counts, inner, bend=0.05)
    found, exact = element_frequencies(space, solid).max(), highest(space, solid)
    assert exact < found < 3.0 * exact


@pytest.mark.parametrize(("cell", "section", "formulation"), [k for k in KINDS if k[0][0] in "qh"])
@pytest.mark.parametrize("inner", [0.0, 0.3])
def test_is_exact_for_a_single_cell(cell, section, formulation, inner):
    counts = (1, 1, 1)[: 3 if section == "3D" else 2]
    space, solid = body(cell, section, formulation, counts, inner)
    [found] = element_frequencies(space, solid)
    assert found == pytest.approx(highest(space, solid), rel=1e-10)


@pytest.mark.parametrize(("cell", "section", "formulation"), KINDS)
def test_masses_add_up_to_those_of_the_nodes(cell, section, formulation):
    counts = (4, 3, 2)[: 3 if section == "3D" else 2]
    space, solid = body(cell, section, formulation, counts, 0.2, bend=0.05)
    nodes = np.zeros(space.dofmap.index_map.size_local)
    np.add.at(nodes, space.dofmap.list, element_masses(space, solid))
    expected = lumped_mass(space, [solid])[:: len(counts)]
    np.testing.assert_allclose(nodes, expected, rtol=1e-12)
