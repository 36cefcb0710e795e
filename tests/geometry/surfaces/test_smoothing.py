"""Smooth surfaces: what they reproduce, how smooth they are, and where they stay sharp."""

from itertools import pairwise

import numpy as np
import pytest

from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.smoothing import corner_spacing, smooth_patches, towards_axis

KINDS = ["interval", "quadrilateral"]
SMOOTHING_ANGLE = np.pi / 6


def grid_of(cell, count, height, sheet):
    return sheet(cell, 1, (count,) if cell == "interval" else (count, count - 1), height)


def sphere(*x):
    """A cap of radius 2 (of a circle in the plane)."""
    return np.sqrt(4.0 - sum((t - 0.5) ** 2 for t in x)) - 1.9


def centre(dim):
    return np.array([0.5] * (dim - 1) + [-1.9])


def places(patches, nodes, xi):
    """Points (f, p, i) of all patches at reference coordinates (p, α)."""
    control = patches.extraction @ nodes[patches.stencil]
    return np.einsum("pc,fci->fpi", patches.shape.values(xi), control)


@pytest.mark.parametrize("cell", KINDS)
def test_patches_pass_through_the_nodes_and_move_with_the_body(sheet, cell):
    shape, facets, nodes = grid_of(cell, 5, sphere, sheet)
    patches = smooth_patches(shape, facets, nodes, SMOOTHING_ANGLE)
    np.testing.assert_allclose(patches.extraction.sum(axis=2), 1.0, rtol=1e-13)
    np.testing.assert_allclose(
        places(patches, nodes, shape.points), nodes[facets], rtol=0, atol=1e-13
    )
    rng = np.random.default_rng(0)
    A, shift = rng.normal(size=(nodes.shape[1],) * 2), rng.normal(size=nodes.shape[1])
    xi = rng.random((6, shape.directions))
    np.testing.assert_allclose(
        places(patches, nodes @ A.T + shift, xi),
        places(patches, nodes, xi) @ A.T + shift,
        atol=1e-12,
    )


@pytest.mark.parametrize("cell", KINDS)
def test_planes_stay_plane(sheet, cell):
    """Whatever the sizes of the facets."""
    shape, facets, nodes = grid_of(cell, 6, lambda *x: 0.0 * x[0], sheet)
    nodes[:, 0] = nodes[:, 0] ** 2
    patches = smooth_patches(shape, facets, nodes, SMOOTHING_ANGLE)
    xi = np.random.default_rng(1).random((9, shape.directions))
    np.testing.assert_allclose(places(patches, nodes, xi)[..., -1], 0.0, atol=1e-14)


@pytest.mark.parametrize("cell", KINDS)
def test_parabolas_are_reproduced_on_even_grids(sheet, cell):
    """Central differences and the one-sided parabolas at the ends are exact for these."""

    def parabola(*x):
        return 0.3 * x[0] ** 2 - 0.2 * x[-1] ** 2 + 0.5 * x[0] * x[-1]

    shape, facets, nodes = grid_of(cell, 4, lambda *x: 0.0 * x[0], sheet)
    patches = smooth_patches(shape, facets, nodes, SMOOTHING_ANGLE)
    nodes[:, -1] = parabola(*nodes[:, :-1].T)
    xi = np.random.default_rng(2).random((9, shape.directions))
    found = places(patches, nodes, xi).reshape(-1, nodes.shape[1])
    np.testing.assert_allclose(found[:, -1], parabola(*found[:, :-1].T), rtol=0, atol=1e-13)


def test_parabola_on_uneven_segments():
    x = np.array([0.0, 0.3, 0.4, 0.9, 1.0, 1.5])
    nodes = np.column_stack([x, x])
    facets = np.stack([np.arange(5), np.arange(1, 6)], axis=1).astype(np.int32)
    patches = smooth_patches(facet_shape("interval", 1), facets, nodes, SMOOTHING_ANGLE)
    # In the arc length the tangents are those of the parabola through three nodes.
    nodes = np.column_stack([x, x**2])
    found = places(patches, nodes, np.linspace(0.0, 1.0, 7)[:, None])
    np.testing.assert_allclose(found[..., 1], found[..., 0] ** 2, atol=1e-14)


def walk(cell, count, sheet, smoothing_angle):
    """Projections of a dense row of points on a sphere, and the exact normals."""
    shape, facets, nodes = grid_of(cell, count, sphere, sheet)
    surface = FacetSurface(shape, facets, nodes, smoothing_angle)
    t = np.linspace(0.0, 1.0, 2001)
    x = [0.2 + 0.55 * t, 0.3 + 0.4 * t**1.3][: nodes.shape[1] - 1]
    points = np.column_stack([*x, sphere(*x)])
    return surface.project(points, nodes), (points - centre(len(x) + 1)) / 2.0


@pytest.mark.parametrize("cell", KINDS)
def test_normals_do_not_jump(sheet, cell):
    """Over the seams of a sphere; the facets themselves jump by the angle between them."""
    for smoothing_angle, most in ((None, None), (SMOOTHING_ANGLE, 1.05)):
        at, exact = walk(cell, 8, sheet, smoothing_angle)
        step = np.abs(np.diff(exact, axis=0)).max()
        jump = np.abs(np.diff(at.normal, axis=0)).max()
        assert jump > 50.0 * step if most is None else jump < most * step
        assert not at.clamped.any() or smoothing_angle is None


@pytest.mark.parametrize("cell", KINDS)
def test_fourth_order(sheet, cell):
    """Place and normal of a sphere converge with h⁴ and h³."""
    gaps, normals = [], []
    for count in (8, 16):
        at, exact = walk(cell, count, sheet, SMOOTHING_ANGLE)
        gaps.append(np.abs(at.gap).max())
        normals.append(np.abs(at.normal - exact).max())
    assert gaps[0] / gaps[1] > 13.0
    assert normals[0] / normals[1] > 6.5


def test_distorted_grid_has_small_jumps_only(sheet):
    """Normals agree at the nodes and nearly so on the seams between."""
    shape, facets, nodes = grid_of("quadrilateral", 8, sphere, sheet)
    rng = np.random.default_rng(3)
    inner = (np.abs(nodes[:, :2] - 0.5) < 0.45).all(axis=1)
    nodes[inner, :2] += 0.02 * rng.uniform(-1.0, 1.0, (np.count_nonzero(inner), 2))
    nodes[:, 2] = sphere(*nodes[:, :2].T)
    t = np.linspace(0.0, 1.0, 2001)
    points = np.column_stack([0.2 + 0.55 * t, 0.3 + 0.4 * t**1.3, np.zeros(2001)])
    points[:, 2] = sphere(*points[:, :2].T)
    jumps = [
        np.abs(np.diff(FacetSurface(shape, facets, nodes, c).project(points, nodes).normal, axis=0))
        for c in (None, SMOOTHING_ANGLE)
    ]
    assert jumps[1].max() < 0.03 * jumps[0].max()


def fan(count, height):
    """Quadrilaterals round one node, each a kite; nodes (n, 3) on a surface over the plane."""
    angle = 2.0 * np.pi * np.arange(count) / count
    spokes = 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    between = angle + np.pi / count
    tips = 0.7 * np.column_stack([np.cos(between), np.sin(between)])
    flat = np.vstack([[0.0, 0.0], spokes, tips])
    k = np.arange(count)
    facets = np.stack([0 * k, 1 + k, 1 + (k + 1) % count, 1 + count + k], axis=1)
    return facets.astype(np.int32), np.column_stack([flat, height(*flat.T)])


@pytest.mark.parametrize("count", [3, 4, 5, 6])
def test_all_patches_round_a_node_have_one_normal_there(count):
    facets, nodes = fan(count, lambda x, y: 0.3 * x - 0.2 * y - 0.25 * (x**2 + y**2) + 0.1 * x * y)
    surface = FacetSurface(facet_shape("quadrilateral", 1), facets, nodes, 1.0)
    at = np.arange(count, dtype=np.int32)
    _, tangents = surface.places(at, np.zeros((count, 2)), nodes)
    normal = np.cross(tangents[:, 0], tangents[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    np.testing.assert_allclose(normal, np.broadcast_to(normal[0], normal.shape), atol=1e-13)
    exact = np.array([-0.3, 0.2, 1.0]) / np.linalg.norm([-0.3, 0.2, 1.0])
    np.testing.assert_allclose(normal[0], exact, atol=2e-2)


@pytest.mark.parametrize("cell", KINDS)
def test_sharp_edges_stay_sharp(sheet, cell):
    """A roof: its sides remain plane, and its ridge where it was."""
    shape, facets, nodes = grid_of(cell, 6, lambda *x: -np.abs(x[0] - 0.5), sheet)
    patches = smooth_patches(shape, facets, nodes, SMOOTHING_ANGLE)
    xi = np.random.default_rng(4).random((9, shape.directions))
    found = places(patches, nodes, xi)
    np.testing.assert_allclose(found[..., -1], -np.abs(found[..., 0] - 0.5), atol=1e-14)
    # With a larger limit the same ridge is rounded.
    found = places(smooth_patches(shape, facets, nodes, 2.0), nodes, xi)
    assert np.abs(found[..., -1] + np.abs(found[..., 0] - 0.5)).max() > 0.01


def test_closed_chain():
    angle = -2.0 * np.pi * np.arange(16) / 16
    nodes = np.column_stack([np.cos(angle), np.sin(angle)])
    facets = np.stack([np.arange(16), (np.arange(16) + 1) % 16], axis=1).astype(np.int32)
    surface = FacetSurface(facet_shape("interval", 1), facets, nodes, SMOOTHING_ANGLE)
    at = surface.project(1.1 * np.column_stack([np.cos(angle + 0.1), np.sin(angle + 0.1)]), nodes)
    np.testing.assert_allclose(at.gap, 0.1, atol=4e-4)
    assert at.on_surface.all() and not at.clamped.any()


@pytest.mark.parametrize("kind", [("triangle", 1), ("quadrilateral", 2)])
def test_other_facets_are_refused(sheet, kind):
    with pytest.raises(ValueError, match="a smooth master needs first-order"):
        FacetSurface(*sheet(*kind, (2, 2), sphere), SMOOTHING_ANGLE)


FLAT, EDGE = 1e-3, 0.35  # rad


def polygon(angles, divided, flat=0.0):
    """Nodes on an arc of radius 1 at some angles, chords divided evenly, then a flat; facets."""
    corners = np.stack([np.sin(angles), np.cos(angles)], axis=1)
    parts = np.linspace(0.0, 1.0, divided, endpoint=False)[:, None]
    pieces = [a + parts * (b - a) for a, b in pairwise(corners)]
    nodes = np.concatenate([*pieces, corners[-1:]])
    if flat:
        nodes = np.concatenate([nodes[:1] - [[flat, 0.0]], nodes])
    count = np.arange(len(nodes) - 1, dtype=np.int32)
    return nodes, np.stack([count, count + 1], axis=1)


@pytest.mark.parametrize("divided", [1, 2, 5])
def test_corners_are_where_chords_meet_however_these_are_divided(divided):
    """The end of an arc may be the end of a flat: that counts as the chord beside it."""
    nodes, facets = polygon(np.linspace(0.0, 0.6, 4), divided, flat=3.0)
    spacing, angle = corner_spacing(facet_shape("interval", 1), facets, nodes, FLAT, EDGE)
    chord = 2.0 * np.sin(0.1)
    at_corner = spacing > 0.0
    assert spacing[at_corner] == pytest.approx(np.full(np.count_nonzero(at_corner), chord))
    assert at_corner[:2].all() and angle.max() == pytest.approx(0.2)
    assert np.count_nonzero(at_corner) == 1 + min(2 * 3 - 1, 3 * divided)


@pytest.mark.parametrize(("bulge", "apart"), [(1.0, 0.0), (np.cos(0.1), 2.0 * np.sin(0.1))])
def test_second_order_facets_have_corners_where_they_are_straight_only(bulge, apart):
    """Nodes in the middle on the arc, or on the chord."""
    angle = np.linspace(0.0, 0.6, 7)
    radius = np.where(np.arange(7) % 2 == 1, bulge, 1.0)
    nodes = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    facets = np.array([[0, 2, 1], [2, 4, 3], [4, 6, 5]], dtype=np.int32)
    spacing, _ = corner_spacing(facet_shape("interval", 2), facets, nodes, FLAT, EDGE)
    assert spacing == pytest.approx(np.full(3, apart))


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
@pytest.mark.parametrize("along", [1, 4])
def test_corners_in_space_are_apart_across_their_edges(cell, along):
    """A cylinder of chords, each divided into two by a line along it and ``along`` across."""
    flat, _ = polygon(np.linspace(0.0, 0.6, 4), 2)
    rows = [
        np.column_stack([flat, np.full(len(flat), z)]) for z in np.linspace(0.0, 2.0, along + 1)
    ]
    count = len(flat)
    quads = [
        [r * count + i, r * count + i + 1, (r + 1) * count + i, (r + 1) * count + i + 1]
        for r in range(along)
        for i in range(count - 1)
    ]
    facets = np.array(quads, dtype=np.int32)
    if cell == "triangle":
        facets = np.concatenate([facets[:, [0, 1, 2]], facets[:, [1, 3, 2]]])
    spacing, _ = corner_spacing(facet_shape(cell, 1), facets, np.concatenate(rows), FLAT, EDGE)
    assert spacing.max() == pytest.approx(2.0 * np.sin(0.1))


def test_a_ball_of_squares_has_corners_a_square_apart():
    x = np.linspace(-0.3, 0.3, 7)
    nodes = np.stack([*np.meshgrid(x, x, indexing="ij")], axis=2).reshape(-1, 2)
    nodes = np.column_stack([nodes, -0.5 * np.sum(nodes**2, axis=1)])
    number = np.arange(49).reshape(7, 7)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]], axis=2)
    facets = quads.reshape(-1, 4).astype(np.int32)
    spacing, _ = corner_spacing(facet_shape("quadrilateral", 1), facets, nodes, FLAT, EDGE)
    assert spacing == pytest.approx(np.full(36, 0.1), rel=0.1)


# -- Rings ----------------------------------------------------------------------------------------


def ring_loads(facets, nodes, rings):
    """Loads of a unit pressure on flat rings over those of linear facets."""
    shape = facet_shape("interval", 1)
    patches = smooth_patches(shape, facets, nodes, SMOOTHING_ANGLE, rings)
    place, weight = np.polynomial.legendre.leggauss(4)
    xi, loads = 0.5 * (place[:, None] + 1.0), np.zeros((2, len(nodes)))
    linear, cubic = shape.values(xi), patches.shape.values(xi)
    radius = np.einsum("pa,fa->fp", linear, nodes[facets, 0])
    size = 0.5 * weight * radius * np.abs(np.diff(nodes[facets, 0], axis=1))
    shares = np.einsum("pc,fcm->fpm", cubic, patches.extraction)
    np.add.at(loads[0], facets, np.einsum("fp,pa->fa", size, linear))
    np.add.at(loads[1], patches.stencil, np.einsum("fp,fpm->fm", size, shares))
    return loads[1] / loads[0]


@pytest.mark.parametrize("flipped", [False, True])
def test_rings_hand_on_a_uniform_pressure(flipped):
    """Cubics give the node on the axis 0.4 of its load (0.7 with an image beyond)."""
    nodes = np.stack([2.0 * np.arange(20), np.zeros(20)], axis=1)
    chain = np.stack([np.arange(19), np.arange(1, 20)], axis=1).astype(np.int32)
    facets = chain[:, ::-1] if flipped else chain
    assert ring_loads(facets, nodes, False)[0] == pytest.approx(0.4, abs=1e-12)
    smoothness = towards_axis(facets, nodes)
    load = ring_loads(facets, nodes, True)[:15]
    assert np.abs(load - 1.0).max() == pytest.approx(1.0 / 62.0, abs=1e-12)
    assert np.all(smoothness[6:] == 1.0) and np.all(np.diff(smoothness[:7]) > 0.0)
    assert np.all(towards_axis(facets, np.add(nodes, [1.0, 0.0])) == 1.0)
