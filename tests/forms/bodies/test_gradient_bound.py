"""The bound of a body's displacement gradients is one, and not far off; what counts as thin."""

import dolfinx
import numpy as np
import pytest

from tests.conftest import SOFT
from tests.grid import grid
from tribox.forms.bodies.deformation import BodyPoints
from tribox.forms.bodies.gradient_bound import GradientBound
from tribox.forms.bodies.solid import Solid


def body(cell, size, count, degree=1, section=None, low=None):
    """A box of the given size with its displacement."""
    mesh = grid(cell, count, size, low or [0.0] * len(size))
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", degree, (len(size),))))
    cells = np.arange(mesh.topology.index_map(len(size)).size_local, dtype=np.int32)
    return u, Solid("box", u, cells, SOFT, "q2" if degree == 2 else "q1", section=section)


def largest_gradient(u, solid, values):
    """Largest |∇u| at the quadrature points."""
    F = BodyPoints(u.function_space, solid).deformation(values[u.function_space.dofmap.list])
    return np.sqrt(((F - np.eye(3)) ** 2).sum(axis=(2, 3))).max()


@pytest.mark.parametrize(
    ("cell", "size", "degree", "section"),
    [
        ("quadrilateral", [2.0, 1.0], 1, "plane-strain"),
        ("triangle", [2.0, 1.0], 2, "plane-strain"),
        ("quadrilateral", [2.0, 1.0], 2, "axisymmetric"),
        ("hexahedron", [2.0, 1.0, 1.0], 1, None),
        ("tetrahedron", [2.0, 1.0, 1.0], 1, None),
        ("hexahedron", [2.0, 1.0, 1.0], 2, None),
    ],
)
def test_it_bounds_the_gradients_of_any_displacement(cell, size, degree, section):
    u, solid = body(cell, size, [3, 2, 2][: len(size)], degree, section)
    x = u.function_space.tabulate_dof_coordinates()[:, : len(size)]
    bound = GradientBound(u.function_space, solid)
    generator = np.random.default_rng(3)
    G = generator.normal(size=(len(size), len(size)))
    uniform, noise = 1e-4 * x @ G.T, 1e-4 * generator.normal(size=x.shape)
    noise[x[:, 0] < 1e-9, 0] = 0.0  # on the axis, if it is one
    uniform[:, 0] = 1e-4 * x[:, 0] * G[0, 0] if section == "axisymmetric" else uniform[:, 0]
    excess = 7.0 if degree == 1 else {2: 12.0, 3: 40.0}[len(size)]
    for values in (uniform, noise):
        found, exact = bound.largest(values), largest_gradient(u, solid, values)
        assert exact <= found <= excess * exact
    assert bound.largest(uniform + 5.0 * (section != "axisymmetric")) == pytest.approx(
        bound.largest(uniform), rel=1e-9
    )
    assert bound.content == pytest.approx(np.prod(size))
