"""The bound of a body's displacement gradients is one, and not far off; what counts as thin."""

from __future__ import annotations

import dolfinx
import numpy as np
import pytest

from tests.conftest import SOFT
from tests.grid import grid
from tribox.forms.bodies.deformation import BodyPoints, GradientBound, thickness_ratio
from tribox.forms.bodies.solid import Solid

TURN = 0.3  # rad, by which boxes lie askew


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


def test_a_rotation_counts():
    u, solid = body("quadrilateral", [1.0, 1.0], [2, 2])
    x = u.function_space.tabulate_dof_coordinates()[:, :2]
    bound = GradientBound(u.function_space, solid)
    assert bound.largest(np.zeros_like(x)) == 0.0
    assert 1e-3 < bound.largest(1e-3 * np.stack([-x[:, 1], x[:, 0]], axis=1)) < 7e-3
    assert np.isnan(bound.largest(np.full_like(x, np.nan)))


@pytest.mark.parametrize(
    ("size", "ratio"), [([2.0, 0.1], 0.05), ([2.0, 2.0, 0.1], 0.05), ([2.0, 0.1, 0.1], 0.05)]
)
def test_plates_and_beams_are_thin_however_they_lie(size, ratio):
    cell = "quadrilateral" if len(size) == 2 else "hexahedron"
    u, solid = body(cell, size, [4] * len(size))
    space = u.function_space
    content = GradientBound(space, solid).content
    assert thickness_ratio(space, solid, content) == pytest.approx(ratio)
    x = space.mesh.geometry.x
    x[:, :2] = x[:, :2] @ np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]])
    again = Solid("askew", dolfinx.fem.Function(space), solid.cells, SOFT, "q1")
    content = GradientBound(space, again).content
    assert thickness_ratio(space, again, content) < 1.6 * ratio


def test_a_cube_is_compact():
    u, solid = body("hexahedron", [1.0, 1.0, 1.0], [1, 1, 1])
    bound = GradientBound(u.function_space, solid)
    assert thickness_ratio(u.function_space, solid, bound.content) == pytest.approx(1.0)
