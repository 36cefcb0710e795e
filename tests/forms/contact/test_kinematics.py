"""Contact kinematics: every variation against central differences, and objectivity."""

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from tribox.forms.contact.kinematics import Anchor, opposite, relate, vary
from tribox.forms.contact.pressure import PointwisePressure
from tribox.forms.contact.state import AS_IS
from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.projection import FacetSurface, Projection

SEGMENT = facet_shape("interval", 1)

KINKED = np.array([[0.0, 0.0], [1.0, 0.31], [2.1, -0.12], [2.9, 0.33], [4.0, 0.2], [5.0, 0.6]])
RNG = np.random.default_rng(11)


def related(points, projection, anchor):
    """Kinematics and their variations in one; all points count as closed."""
    closed = np.ones(len(points), dtype=bool)
    both = (relate(points, projection, anchor, closed), vary(points, projection, anchor))
    return SimpleNamespace(**{f.name: getattr(k, f.name) for k in both for f in fields(k)})


class Scene:
    """Points against a kinked master, with an anchor from an earlier step on the same facets.

    Attributes:
        points: (q, i) and nodes: (n, i), current.
        facet, xi, components, length: (q, …), what the last step left.
    """

    def __init__(self, points, nodes, facet, xi, components, length):
        self.points, self.nodes = np.array(points), np.array(nodes)
        self.facet, self.xi = facet, xi
        self.components, self.length = components, length
        chain = np.stack([np.arange(len(nodes) - 1), np.arange(1, len(nodes))], axis=1)
        self.line = FacetSurface(SEGMENT, chain.astype(np.int32), self.nodes)

    def at(self, points, nodes):
        projection = self.line.project(points, nodes)
        ends = nodes[self.line.facets[self.facet]]
        tangents = np.einsum("qba,qai->qbi", SEGMENT.first(self.xi), ends)
        anchor = Anchor(
            foot=np.einsum("qa,qai->qi", SEGMENT.values(self.xi), ends),
            components=self.components,
            slip_image=np.einsum("qb,qbi->qi", self.components, tangents),
            slip_length=self.length,
        )
        return projection, related(points, projection, anchor)

    def now(self):
        return self.at(self.points, self.nodes)

    def coordinates(self, projection, d_points, d_nodes):
        """z = (a, b, c, d) of a variation of points and nodes, (q, 4 i)."""
        here = d_nodes[self.line.facets[projection.facet]]
        there = d_nodes[self.line.facets[self.facet]]
        a = d_points - np.einsum("qa,qai->qi", SEGMENT.values(projection.xi), here)
        b = here[:, 1] - here[:, 0]
        c = d_points - np.einsum("qa,qai->qi", SEGMENT.values(self.xi), there)
        d = self.components * (there[:, 1] - there[:, 0])
        return np.concatenate([a, b, c, d], axis=1)


def scene(kind):
    """All points interior or clamped ('groove', 'ridge')."""
    q = 24
    if kind == "groove":
        # Below the reflex vertex at (2.1, −0.12), in the wedge between the two facets' normals.
        vertex, left, right = KINKED[2], KINKED[1] - KINKED[2], KINKED[3] - KINKED[2]
        normals = [np.array([left[1], -left[0]]), np.array([-right[1], right[0]])]
        normals = [v / np.linalg.norm(v) for v in normals]
        t = RNG.uniform(0.2, 0.8, (q, 1))
        points = vertex - RNG.uniform(0.02, 0.1, (q, 1)) * (t * normals[0] + (1 - t) * normals[1])
        facet = RNG.integers(1, 3, q)
    elif kind == "ridge":
        points = KINKED[1] + RNG.uniform([-0.01, 0.03], [0.01, 0.1], (q, 2))
        facet = RNG.integers(0, 2, q)
    else:
        facet = RNG.integers(0, 5, q)
        start, tau = KINKED[facet], KINKED[facet + 1] - KINKED[facet]
        n = np.stack([-tau[:, 1], tau[:, 0]], axis=1) / np.linalg.norm(tau, axis=1)[:, None]
        depth = RNG.uniform(0.01, 0.06, (q, 1))
        points = start + RNG.uniform(0.2, 0.8, (q, 1)) * tau - depth * n
    xi = RNG.uniform(0.1, 0.9, (q, 1))
    components = RNG.normal(size=(q, 1)) * 0.1
    components[1] = 0.0
    length = np.abs(components[:, 0]) * RNG.uniform(0.8, 1.2, q)
    return Scene(points, KINKED, facet.astype(np.int32), xi, components, length)


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize("kind", ["interior", "groove", "ridge"])
def test_variations_against_central_differences(kind):
    """Interior points on tilted facets, and points clamped to a vertex of either kind."""
    s = scene(kind)
    projection, k = s.now()
    assert (projection.clamped == (kind in ("groove", "ridge"))).all()
    assert (k.gap < 0.0).all() == (kind != "ridge")
    h = 1e-6
    for _ in range(6):
        d_points, d_nodes = RNG.normal(size=s.points.shape), RNG.normal(size=s.nodes.shape)
        after, k_after = s.at(s.points + h * d_points, s.nodes + h * d_nodes)
        before, k_before = s.at(s.points - h * d_points, s.nodes - h * d_nodes)
        np.testing.assert_array_equal(after.clamped, projection.clamped)
        z = s.coordinates(projection, d_points, d_nodes)

        def check(name, exact, plus, minus):
            difference = (plus - minus) / (2.0 * h)
            scale = max(np.abs(difference).max(), 1e-3)
            np.testing.assert_allclose(exact, difference, rtol=0, atol=2e-7 * scale, err_msg=name)

        check("gap", np.einsum("qr,qr->q", k.d_gap, z), k_after.gap, k_before.gap)
        # A vertex belongs to two facets: either may be named, and ξ is then 0 or 1.
        same = (after.facet == projection.facet) & (before.facet == projection.facet)
        assert same.any()
        check("xi", np.einsum("qbr,qr->qb", k.d_xi, z)[same], after.xi[same], before.xi[same])
        for name, field in (("normal", "normal"), ("slip", "slip"), ("elastic", "elastic_slip")):
            exact = np.einsum("qir,qr->qi", getattr(k, f"d_{name}"), z)
            check(name, exact, getattr(k_after, field), getattr(k_before, field))


def test_every_block_of_the_variations_is_used():
    """The comparison above would miss nothing: no block of coordinates has only zeros."""
    _, k = scene("interior").now()
    a, b, c, d = (slice(2 * i, 2 * i + 2) for i in range(4))
    for table, blocks in (
        (k.d_gap, (a,)),
        (k.d_normal, (b,)),
        (k.d_xi, (a, b)),
        (k.d_slip, (b, c)),
        (k.d_elastic, (b,)),
    ):
        for block in blocks:
            assert np.abs(table[..., block]).max() > 1e-3
    _, clamped = scene("groove").now()
    for table, blocks in ((clamped.d_normal, (a,)), (clamped.d_slip, (a, c))):
        for block in blocks:
            assert np.abs(table[..., block]).max() > 1e-3
    # In the plane a vector of given length has one freedom, the angle of the normal.
    assert np.abs(k.d_elastic[..., d]).max() < 1e-12


def test_elastic_slip_keeps_its_length_and_lies_in_the_plane():
    s = scene("interior")
    rng = np.random.default_rng(5)
    nodes = s.nodes + 0.1 * rng.normal(size=s.nodes.shape)
    _, k = s.at(s.points, nodes)
    length = np.linalg.norm(k.elastic_slip, axis=1)
    expected = np.where(s.components[:, 0] != 0.0, s.length, 0.0)
    np.testing.assert_allclose(length, expected, rtol=1e-13)
    np.testing.assert_allclose(np.einsum("qi,qi->q", k.normal, k.elastic_slip), 0.0, atol=1e-16)
    np.testing.assert_array_equal(k.elastic_slip[1], 0.0)


@pytest.mark.parametrize("kind", ["interior", "groove"])
@pytest.mark.parametrize("angle", [1e-4, 0.7, 3.0])
def test_rigid_motion_changes_nothing(kind, angle):
    """Slip and elastic slip turn with the bodies."""
    s = scene(kind)
    _, k = s.now()
    turn, shift = rotation(angle), np.array([0.3, -0.8])
    _, moved = s.at(s.points @ turn.T + shift, s.nodes @ turn.T + shift)
    np.testing.assert_allclose(moved.gap, k.gap, rtol=0, atol=1e-14)
    np.testing.assert_allclose(moved.slip, k.slip @ turn.T, rtol=0, atol=1e-13)
    np.testing.assert_allclose(moved.elastic_slip, k.elastic_slip @ turn.T, rtol=0, atol=1e-13)
    length = np.linalg.norm(moved.elastic_slip, axis=1)
    np.testing.assert_allclose(length, np.linalg.norm(k.elastic_slip, axis=1), rtol=1e-13)


@pytest.mark.parametrize("kind", ["interior", "groove"])
def test_a_point_at_rest_on_a_turning_master_does_not_slip(kind):
    """The anchor is the point's own projection; also where that is a vertex in a groove."""
    s = scene(kind)
    projection, _ = s.now()
    s.facet, s.xi = projection.facet, projection.xi
    for angle in (0.0, 0.7):
        turn = rotation(angle)
        _, k = s.at(s.points @ turn.T, s.nodes @ turn.T)
        np.testing.assert_allclose(k.slip, 0.0, atol=1e-13)


def test_slip_over_a_flat_master_is_the_motion_along_it():
    """Also across nodes, and whatever the master's stretch since."""
    x = np.array([0.0, 0.5, 1.7, 2.0, 3.0])
    nodes = np.stack([x, np.zeros(5)], axis=1)
    points = np.array([[0.9, -0.01], [2.4, -0.01]])
    facet, xi = np.array([0, 1], dtype=np.int32), np.array([[0.5], [0.25]])
    s = Scene(points, nodes, facet, xi, np.zeros((2, 1)), np.zeros(2))
    _, k = s.now()
    np.testing.assert_allclose(k.slip, [[0.9 - 0.25, 0.0], [2.4 - 0.8, 0.0]], atol=1e-15)
    stretched = nodes * [1.1, 1.0]
    _, k = s.at(points, stretched)
    np.testing.assert_allclose(k.slip[:, 0], [0.9 - 0.275, 2.4 - 0.88], atol=1e-15)


def test_touching_counts_as_closed_and_past_the_end_does_not():
    nodes = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    points = np.array([[0.5, 1e-10], [0.5, 1e-8], [0.5, -0.1], [2.1, -0.1]])
    zero = np.zeros(4, dtype=np.int32)
    s = Scene(points, nodes, zero, np.full((4, 1), 0.5), np.zeros((4, 1)), np.zeros(4))
    projection, _ = s.now()
    points = SimpleNamespace(slave=SimpleNamespace(weight=np.ones(4)))
    normal = PointwisePressure(points, 50.0).evaluate(projection, AS_IS)
    np.testing.assert_array_equal(normal.closed, [True, False, True, False])
    np.testing.assert_allclose(normal.pressure, [0.0, 0.0, 5.0, 0.0], rtol=1e-12)


class Triangle:
    """Points against one flat triangle in space: the formulae with two surface directions.

    Nodes are y0, y1, y2; ȳ(ξ) = y0 + ξ¹ τ₁ + ξ² τ₂, and the elastic slip has two components.
    """

    def __init__(self, count=12):
        rng = np.random.default_rng(8)
        self.nodes = np.array([[0.0, 0.1, 0.2], [1.2, 0.0, -0.1], [0.3, 1.1, 0.4]])
        self.xi_before = rng.uniform(0.1, 0.4, (count, 2))
        self.components = rng.normal(size=(count, 2)) * 0.1
        self.length = rng.uniform(0.05, 0.1, count)
        foot, _, n = self.surface(self.nodes, rng.uniform(0.1, 0.4, (count, 2)))
        self.points = foot - rng.uniform(0.01, 0.05, (count, 1)) * n

    @staticmethod
    def surface(nodes, xi):
        tau = nodes[1:] - nodes[0]
        n = np.cross(tau[0], tau[1])
        return nodes[0] + xi @ tau, tau, n / np.linalg.norm(n)

    def at(self, points, nodes):
        _, tau, n = self.surface(nodes, self.xi_before)
        xi = np.linalg.solve(tau @ tau.T, tau @ (points - nodes[0]).T).T
        foot = nodes[0] + xi @ tau
        q = len(points)
        projection = Projection(
            facet=np.zeros(q, dtype=np.int32),
            xi=xi,
            foot=foot,
            normal=np.broadcast_to(n, (q, 3)),
            tangents=np.broadcast_to(tau, (q, 2, 3)),
            gap=(points - foot) @ n,
            clamped=np.zeros(q, dtype=bool),
            on_surface=np.ones(q, dtype=bool),
        )
        anchor = Anchor(
            foot=nodes[0] + self.xi_before @ tau,
            components=self.components,
            slip_image=self.components @ tau,
            slip_length=self.length,
        )
        return projection, related(points, projection, anchor)

    def coordinates(self, projection, d_points, d_nodes):
        d_tau = d_nodes[1:] - d_nodes[0]
        a = d_points - d_nodes[0] - projection.xi @ d_tau
        b = np.broadcast_to(d_tau.reshape(-1), (len(a), 6))
        c = d_points - d_nodes[0] - self.xi_before @ d_tau
        return np.concatenate([a, b, c, self.components @ d_tau], axis=1)


def test_variations_with_two_surface_directions():
    """In space the elastic slip can turn within the plane: the block d matters."""
    s = Triangle()
    projection, k = s.at(s.points, s.nodes)
    assert np.abs(k.d_elastic[..., -3:]).max() > 0.1
    rng = np.random.default_rng(9)
    h = 1e-6
    for _ in range(4):
        d_points, d_nodes = rng.normal(size=s.points.shape), rng.normal(size=(3, 3))
        after, k_after = s.at(s.points + h * d_points, s.nodes + h * d_nodes)
        before, k_before = s.at(s.points - h * d_points, s.nodes - h * d_nodes)
        z = s.coordinates(projection, d_points, d_nodes)
        for exact, plus, minus in (
            (np.einsum("qr,qr->q", k.d_gap, z), k_after.gap, k_before.gap),
            (np.einsum("qbr,qr->qb", k.d_xi, z), after.xi, before.xi),
            (np.einsum("qir,qr->qi", k.d_normal, z), k_after.normal, k_before.normal),
            (np.einsum("qir,qr->qi", k.d_slip, z), k_after.slip, k_before.slip),
            (
                np.einsum("qir,qr->qi", k.d_elastic, z),
                k_after.elastic_slip,
                k_before.elastic_slip,
            ),
        ):
            difference = (plus - minus) / (2.0 * h)
            np.testing.assert_allclose(
                exact, difference, rtol=0, atol=2e-7 * np.abs(difference).max()
            )


# -- open points ----------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_open_points_of_equal_bodies_are_opposite_their_images(sign):
    """A straight master falls by 0.2 radians, its image rises; also past its end, at x = 1."""
    fall = np.array([np.cos(0.2), -np.sin(0.2)])
    image = np.array([1.0, -1.0])
    along = np.array([0.3, 0.8, 1.3])
    points = along[:, None] * fall * image + [0.0, 0.3]
    line = FacetSurface(SEGMENT, np.array([[0, 1]], dtype=np.int32), np.array([[0.0, 0.0], fall]))
    at = line.project(points, np.array([[0.0, 0.0], fall]))
    normal = at.normal[0]
    ahead, way = opposite(
        at, points, np.tile(sign * normal * -image, (3, 1)), np.tile(normal, (3, 1))
    )
    np.testing.assert_allclose(at.xi[:, 0] + ahead[:, 0], along, atol=1e-14)
    assert not np.allclose(ahead[:2], 0.0)
    np.testing.assert_array_equal(at.on_surface, [True, True, False])
    np.testing.assert_allclose(way, [0.0, 0.0, 0.3], atol=1e-14)


def test_where_surfaces_do_not_face_each_other_closest_points_serve():
    nodes = np.array([[0.0, 0.0], [1.0, 0.0]])
    points = np.array([[0.4, 0.1], [1.3, 0.1]])
    at = FacetSurface(SEGMENT, np.array([[0, 1]], dtype=np.int32), nodes).project(points, nodes)
    normal = np.tile([0.0, 1.0], (2, 1))
    ahead, way = opposite(at, points, np.tile([-1.0, 0.1], (2, 1)), normal)
    # Past the end the place is that below the point.
    np.testing.assert_allclose(at.xi[:, 0] + ahead[:, 0], points[:, 0], atol=1e-14)
    np.testing.assert_allclose(way, [0.0, 0.3], atol=1e-14)
