"""A rigid surface of facets is a surface of facets whose nodes move as a rigid body does."""

import numpy as np
import pytest

from tests.geometry.surfaces.rigid_shapes import STEP, moved
from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.rigid_mesh import MeshSurface

LINE = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])


def hill(count=4, degree=1):
    """A bumpy square sheet of quadrilaterals (n, 3), (f, a)."""
    side = degree * count + 1
    s = np.linspace(-1.0, 1.0, side)
    x, y = np.meshgrid(s, s, indexing="ij")
    nodes = np.stack([x, y, 0.3 * np.cos(2.0 * x) * np.cos(1.5 * y)], axis=-1).reshape(-1, 3)
    first = (np.arange(count)[:, None] * side + np.arange(count)).reshape(-1)
    return nodes, first[:, None] + np.array([0, side, 1, side + 1])


def triangles():
    nodes, quads = hill()
    return nodes, np.concatenate([quads[:, [0, 1, 3]], quads[:, [0, 3, 2]]])


def parabolas():
    """Segments with a node in their middle, on a wave."""
    x = np.linspace(-1.0, 1.0, 9)
    nodes = np.stack([x, 0.2 * np.cos(4.0 * x)], axis=1)
    return nodes, np.array([[2 * k, 2 * k + 2, 2 * k + 1] for k in range(4)])


CASES = {
    "segments": (lambda: (STEP, LINE), ("interval", 1), None),
    "smooth segments": (lambda: (STEP, LINE), ("interval", 1), 3.0),
    "parabolas": (parabolas, ("interval", 2), None),
    "triangles": (triangles, ("triangle", 1), None),
    "quadrilaterals": (hill, ("quadrilateral", 1), None),
    "smooth quadrilaterals": (hill, ("quadrilateral", 1), 1.0),
}


@pytest.mark.parametrize("name", CASES)
def test_the_same_as_facets_that_are_moved(name):
    make, form, angle = CASES[name]
    nodes, facets = make()
    rigid = MeshSurface(nodes, facets, angle)
    mesh = FacetSurface(facet_shape(*form), facets.astype(np.int32), nodes, angle)
    controls = moved(rigid, 0.8, 0.15)
    now = rigid.moved(nodes, controls)
    rng = np.random.default_rng(3)
    points = rigid.moved(rng.uniform(-1.2, 1.2, (200, rigid.dim)), controls)
    ours, theirs = rigid.project(points, controls), mesh.project(points, now)
    assert (theirs.clamped & theirs.on_surface).any() or angle is not None
    for field in ("facet", "clamped", "on_surface"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))
    names = ["xi", "foot", "normal", "tangents", "gap"]
    names += ["curvature"] if theirs.curvature is not None else []
    names += ["along"] if theirs.along is not None else []
    for field in names:
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), atol=1e-10)
    places = rigid.places(ours.facet, ours.xi, controls)
    shares = rigid.weights(ours.facet, ours.xi) @ controls, rigid.slopes(ours.facet, ours.xi)
    np.testing.assert_allclose(places[0], ours.foot, atol=1e-13)
    np.testing.assert_allclose(shares[0], ours.foot, atol=1e-13)
    np.testing.assert_allclose(shares[1] @ controls, ours.tangents, atol=1e-13)
    np.testing.assert_array_equal(
        rigid.excess(ours.facet, ours.xi), mesh.excess(theirs.facet, ours.xi)
    )
    assert rigid.has_kinks == mesh.has_kinks and rigid.search.searches == 1


def test_nodes_of_no_facet_do_not_matter():
    nodes, facets = hill()
    rigid = MeshSurface(np.concatenate([np.full((3, 3), 9.0), nodes]), facets + 3)
    np.testing.assert_array_equal(rigid.control_points, MeshSurface(nodes, facets).control_points)
    assert rigid.outline(rigid.extent).cells.shape == (32, 3)
    np.testing.assert_allclose(rigid.extent[:, :2], [[-1.0, -1.0], [1.0, 1.0]])


@pytest.mark.parametrize(
    ("nodes", "facets", "wrong"),
    [
        (STEP[:, :1], LINE, r"coordinates \(n, 2\) or \(n, 3\)"),
        (np.where(STEP == 0.9, np.nan, STEP), LINE, "finite"),
        (STEP, LINE.astype(float), "numbers of nodes"),
        (STEP, LINE[:0], "numbers of nodes"),
        (STEP, np.zeros((2, 5), dtype=int), r"in 2 dimensions has \[2, 3\] nodes, not 5"),
        (STEP, LINE + 1, "nodes 1 to 5 of 5"),
        (STEP, np.array([[0, 1], [1, 1]]), "facet 1 .* no extent"),
        (STEP, np.array([[0, 1], [0, 2]]), "branches"),
        (hill()[0], np.array([[0, 5, 10]]), "facet 0 .* no extent"),
    ],
)
def test_what_is_no_surface_is_refused(nodes, facets, wrong):
    if wrong.startswith("facet 0"):
        nodes = nodes * [1.0, 1.0, 0.0]
    with pytest.raises(ValueError, match=wrong):
        MeshSurface(nodes, facets)


@pytest.mark.parametrize("kind", ["quadrilaterals", "triangles", "curved quadrilaterals"])
def test_rounds_are_cut_off_where_they_turn(kind):
    """A part of a cylinder is, around its axis, and not where the cylinder itself ends."""
    degree = 2 if kind == "curved quadrilaterals" else 1
    nodes, facets = hill(4, 1)
    if degree == 2:
        square = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0.5, 0], [0, 0.5], [1, 0.5], [0.5, 1]])
        points = np.concatenate([square, [[0.5, 0.5]]])
        corners = nodes[facets][:, [0, 1, 2, 3], :2]
        shape = facet_shape("quadrilateral", 1).values(points)
        places = np.einsum("pa,fai->fpi", shape, corners).reshape(-1, 2)
        unique, numbers = np.unique(np.round(places, 9), axis=0, return_inverse=True)
        nodes, facets = np.pad(unique, ((0, 0), (0, 1))), numbers.reshape(len(facets), 9)
    angle = 0.3 * nodes[:, 0]
    nodes = np.stack([np.sin(angle), nodes[:, 1], np.cos(angle)], axis=1)
    if kind == "triangles":
        facets = np.concatenate([facets[:, [0, 1, 3]], facets[:, [0, 3, 2]]])
    tool = MeshSurface(nodes, facets)
    points = np.array([[0.35, 0.1, 0.9], [-0.35, 0.1, 0.9], [0.1, 1.2, 0.9], [0.1, 0.1, 0.9]])
    at = tool.project(points, tool.control_points)
    np.testing.assert_array_equal(at.on_surface, [False, False, False, True])
    np.testing.assert_array_equal(tool.cut_off(at.facet, at.xi), [True, True, False, False])


def test_segments_of_a_round_line_are_cut_off_and_a_flat_is_not():
    nodes, facets = parabolas()
    straight = np.stack([np.linspace(-1.0, 1.0, 5), np.zeros(5)], axis=1)
    angle = np.radians(np.linspace(-12.0, 12.0, 5))
    chords = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    for tool, cut in (
        (MeshSurface(nodes, facets), True),
        (MeshSurface(straight, LINE), False),
        (MeshSurface(chords, LINE), True),
        (MeshSurface(chords, LINE, 1.0), True),
    ):
        low, high = tool.extent[:, 0]
        points = np.array([[low - 0.1, 0.0], [high + 0.1, 0.0], [0.0, 0.5]])
        at = tool.project(points, tool.control_points)
        np.testing.assert_array_equal(tool.cut_off(at.facet, at.xi), [cut, cut, False])
