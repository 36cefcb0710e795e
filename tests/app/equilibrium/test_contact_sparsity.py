"""Room in the tangent for the contact: enough for every state, made seldom, and not too much."""

import dolfinx
import numpy as np
import pytest

from tests.contact_boxes import Scene, take_all_for_kinked
from tests.laws import coulomb
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.unknowns import Platen

LAW = coulomb(0.3)
SHAPES = ["Q4", "T6", "tet4", "hex8", "tet10"]


def problem_of(scene, platens=()):
    """The contact alone, without solids."""
    u = dolfinx.fem.Function(scene.space)
    return Equilibrium(u, [], [scene.term], platens=list(platens))


def dense(A):
    indptr, columns, values = A.getValuesCSR()
    out = np.zeros(A.getSize())
    out[np.repeat(np.arange(len(indptr) - 1), np.diff(indptr)), columns] = values
    return out


@pytest.mark.parametrize(
    ("shape", "smoothing_angle"), [*((shape, None) for shape in SHAPES), ("Q4", 0.5), ("hex8", 0.5)]
)
def test_matrix_holds_the_whole_tangent_on_a_long_way(shape, smoothing_angle):
    """Over many facets and back, each step larger than the last; facets as they are or smooth."""
    on_a_long_way(Scene(shape, LAW, fine=True, smoothing_angle=smoothing_angle))


@pytest.mark.parametrize("shape", ["T3", "Q9"])
@pytest.mark.parametrize("fine", [True, False])
def test_matrix_holds_the_tangent_along_rays(monkeypatch, shape, fine):
    """Normals of the slave take the vertices of the next facets too, open ones as well."""
    take_all_for_kinked(monkeypatch)
    scene = Scene(shape, LAW, fine=fine, master=7)
    assert scene.surface.normals is not None
    on_a_long_way(scene)


@pytest.mark.parametrize("shape", ["Q4", "hex8"])
@pytest.mark.parametrize("axis", [0, 1])
def test_matrix_holds_the_tangent_where_a_platen_ends_in_the_contact(shape, axis):
    """Nodes that a platen moves along one axis are coupled by the contact along the others too."""
    scene = Scene(shape, LAW, fine=True)
    nodes = np.unique(scene.surface.slave.nodes)[:3]
    on_a_long_way(scene, Platen((nodes * scene.dim + axis).astype(np.int32)))


def condensed(matrix, leader, *followers):
    """A full matrix in which unknowns follow a leader."""
    unknowns = np.eye(len(matrix))
    for follower in followers:
        unknowns[follower, [follower, leader]] = 0.0, 1.0
    out = unknowns.T @ matrix @ unknowns
    for follower in followers:
        out[follower, [follower, leader]] = 1.0, -1.0
    return out


def on_a_long_way(scene, platen=None):
    problem = problem_of(scene, [] if platen is None else [platen])
    down = -0.08
    A = problem.new_matrix(scene.vector([*[0.0] * (scene.dim - 1), down], 0.03, 0.2))
    for step in (0.01, 0.03, 0.1, 0.2, 0.15, 0.0):
        x = scene.vector([step, *[-0.5 * step] * (scene.dim - 2), down], 0.03, 0.2)
        problem.assemble_tangent(x, A)
        exact = scene.tangent(x)
        if platen is not None:
            exact = condensed(exact, *platen.all_dofs)
        assert np.abs(exact).max() > 1e-2
        np.testing.assert_allclose(dense(A), exact, rtol=0, atol=1e-12)
        problem.commit()


def fine_master(cell, count):
    """A strip of many master facets under one slave, for counting changes of the pattern."""
    scene = Scene(cell, LAW, master=count)
    return scene, problem_of(scene)


def test_pattern_changes_are_few_in_the_plane():
    """Ten facets of sliding, a quarter of a facet each step: a margin of three facets serves."""
    scene, problem = fine_master("Q4", 40)
    A = problem.new_matrix(scene.vector([0.0, -0.08], 0.0, 0.0))
    first = problem.pattern_changes
    way = np.arange(41) / 4 / 40
    for x in way:
        problem.assemble_tangent(scene.vector([x, -0.08], 0.0, 0.0), A)
        problem.commit()
    assert 2 <= problem.pattern_changes - first <= 4
    # The room is kept: the way back costs nothing.
    there = problem.pattern_changes
    for x in way[::-1]:
        problem.assemble_tangent(scene.vector([x, -0.08], 0.0, 0.0), A)
        problem.commit()
    assert problem.pattern_changes == there


def test_open_points_ask_for_no_room():
    """A body that flies past changes nothing until it comes near."""
    scene, problem = fine_master("Q4", 40)
    A = problem.new_matrix(scene.vector([0.0, 0.3], 0.0, 0.0))
    count = problem.pattern_changes
    for x in (0.0, 0.05, 0.1, 0.15):
        problem.assemble_tangent(scene.vector([x, 0.3], 0.0, 0.0), A)
    assert problem.pattern_changes == count
    problem.assemble_tangent(scene.vector([0.15, -0.08], 0.0, 0.0), A)
    assert problem.pattern_changes == count + 1


@pytest.mark.parametrize("shape", ["Q4", "hex8"])
def test_room_for_the_neighbours_that_move_a_smooth_patch(shape):
    """Half a facet a step: the last facet of the margin still finds the nodes of its patch."""
    scene = Scene(shape, LAW, master=12, smoothing_angle=0.5)
    problem = problem_of(scene)
    A = problem.new_matrix(scene.vector([0.0] * (scene.dim - 1) + [-0.08], 0.02, 0.2))
    for step in range(1, 8):
        x = scene.vector([step / 24] + [0.0] * (scene.dim - 2) + [-0.08], 0.02, 0.2)
        problem.assemble_tangent(x, A)
        np.testing.assert_allclose(dense(A), scene.tangent(x), rtol=0, atol=1e-12)
        problem.commit()
    assert problem.pattern_changes < 6
