"""The line-contact generators: shapes, sizes, names, orientation, and what they refuse."""

import math

import gmsh
import numpy as np
import pytest

from tests.geometry.generators.conftest import group_points
from tribox.geometry.generators.cylinders import FlatBlock, HalfCylinder, LineContact, counts
from tribox.geometry.meshes.gmsh_model import named_groups

R, W, H = 10e-3, 0.6e-3, 40e-6
CYLINDER = HalfCylinder(R, W, H)
SMALL = HalfCylinder(0.4 * R, W, 30e-6)
BLOCK = FlatBlock(20e-3, 8e-3, 0.8e-3, 50e-6)
ON_BLOCK = LineContact(CYLINDER, BLOCK, growth=1.4)
TWO = LineContact(CYLINDER, SMALL, growth=1.4)


@pytest.mark.parametrize("shape", [ON_BLOCK, TWO])
def test_bodies_touch_in_one_line_only(model, shape):
    shape.build()
    upper, lower = group_points("elastomer_contact", 1), group_points("aluminium_contact", 1)
    for points in (upper, lower):
        (at,) = np.flatnonzero(np.abs(points[:, 0]) < 1e-12)  # a node on the apex of both
        np.testing.assert_allclose(points[at], 0.0, atol=1e-15)
        np.testing.assert_allclose(points[:, 0], -points[::-1, 0], atol=1e-15)
    assert np.all(upper[:, 1] >= -1e-15) and np.all(lower[:, 1] <= 1e-15)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-6])
def test_the_round_side_is_an_arc_of_the_radius(model, scale):
    LineContact(
        HalfCylinder(R * scale, W * scale, H * scale), HalfCylinder(R * scale, W * scale, H * scale)
    ).build()
    for body, up in (("elastomer", 1.0), ("aluminium", -1.0)):
        for side in ("contact", "left", "right"):
            x = group_points(f"{body}_{side}", 1)[:, :2] - [0.0, up * R * scale]
            np.testing.assert_allclose(np.linalg.norm(x, axis=1), R * scale, rtol=1e-9)
    far = group_points("top", 1)
    np.testing.assert_allclose(far[:, 1], R * scale, rtol=1e-12)
    np.testing.assert_allclose(far[[0, -1], 0], [-R * scale, R * scale], rtol=1e-12)


def test_contact_zone_has_its_width_and_size_in_each_body(model):
    ON_BLOCK.build()
    for name, width, size in (("elastomer", W, H), ("aluminium", 0.8e-3, 50e-6)):
        x = group_points(f"{name}_contact", 1)
        assert np.ptp(x[:, 0]) == pytest.approx(width, rel=1e-9)
        lengths = np.linalg.norm(np.diff(x, axis=0), axis=1)
        np.testing.assert_allclose(lengths, lengths[0], rtol=1e-6)
        assert 0.8 * size < lengths[0] <= size * (1.0 + 1e-3)


def test_cells_grow_from_the_contact_by_the_growth_asked_for(model):
    ON_BLOCK.build()
    lengths = np.linalg.norm(np.diff(group_points("elastomer_right", 1), axis=0), axis=1)
    assert lengths[0] <= H and lengths[0] > 0.5 * H
    np.testing.assert_allclose(lengths[1:] / lengths[:-1], 1.4, rtol=2e-2)  # chords of arcs


@pytest.mark.parametrize(
    "shape",
    [
        ON_BLOCK,
        TWO,
        LineContact(HalfCylinder(1.0, 0.999, 0.03), FlatBlock(1.1, 0.3, 0.8, 0.03)),
        LineContact(HalfCylinder(1.0, 0.01, 1e-3), FlatBlock(1.0, 9.0, 0.01, 1e-3), growth=2.0),
        LineContact(HalfCylinder(1.0, 0.2, 0.1), HalfCylinder(2.0, 0.2, 0.1), growth=1.0001),
    ],
)
def test_all_cells_are_quadrilaterals_of_a_usable_shape(model, shape):
    shape.build()
    groups = named_groups(gmsh, "test")  # refuses folded cells
    assert set(groups.bodies) == {"elastomer", "aluminium"}
    assert list(model.mesh.getElementTypes(2)) == [3]
    assert len(model.mesh.getElementsByType(3)[0]) == sum(
        n * d + (n + 2 * d) * o
        for n, d, o in (counts(body, shape.growth) for body in (shape.upper, shape.lower))
    )
    qualities = model.mesh.getElementQualities(model.mesh.getElementsByType(3)[0], "minSJ")
    # Sines of the smallest angles: no cell is nearly a triangle.
    assert np.abs(qualities).min() > 0.15


BAD = [
    (lambda: HalfCylinder(0.0, W, H), "radius = 0.0"),
    (lambda: HalfCylinder(-1.0, W, H), "radius = -1.0"),
    (lambda: HalfCylinder(math.nan, W, H), "radius = nan"),
    (lambda: HalfCylinder(R, R, H), "must be < radius"),
    (lambda: HalfCylinder(R, 0.0, H), "contact_width = 0.0"),
    (lambda: HalfCylinder(R, W, 0.0), "contact_size = 0.0"),
    (lambda: HalfCylinder(R, W, 0.51 * W), "at most half of contact_width"),
    (lambda: HalfCylinder(R, W, 1e-12), "contact_size = 1e-12 m is not allowed; at least"),
    (lambda: FlatBlock(W, 1.0, W, H), "must be < width"),
    (lambda: FlatBlock(1.0, math.inf, W, H), "height = inf"),
    (lambda: FlatBlock(-1.0, 1.0, W, H), "width = -1.0"),
    (lambda: LineContact(CYLINDER, BLOCK, growth=0.9), "growth = 0.9"),
    (lambda: LineContact(CYLINDER, BLOCK, growth=2.1), "growth = 2.1"),
    (lambda: LineContact(CYLINDER, BLOCK, cell="hexagon"), "cell = 'hexagon'"),
    (lambda: LineContact(CYLINDER, BLOCK, upper_name="a", lower_name="a"), "two different names"),
    (lambda: LineContact(CYLINDER, HalfCylinder(1.0, W, 1e-7), growth=1.0), "make a body of"),
]


@pytest.mark.parametrize(("make", "message"), BAD)
def test_what_cannot_be_meshed_is_refused(make, message):
    with pytest.raises(ValueError) as error:
        make()
    assert message in str(error.value)
