"""Room in the tangent for the contact: enough for every state, made seldom, and not too much."""

from __future__ import annotations

import dolfinx
import numpy as np
import pytest
import scipy.sparse
from petsc4py import PETSc

from tests.contact_boxes import Scene, take_all_for_kinked
from tests.forms.contact.test_tangent_ends import at_the_rim
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.tangent import BlockPlaces, coupled_nodes, widened
from tribox.app.equilibrium.unknowns import Platen, component_dofs
from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters

LAW = CoulombLaw(CoulombParameters(mu=0.3, K_T=60.0))
SHAPES = ["Q4", "T6", "tet4", "hex8", "tet10"]


def problem_of(scene):
    """The contact alone, without solids."""
    return Equilibrium(dolfinx.fem.Function(scene.space), [], [scene.term])


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


def on_a_long_way(scene):
    problem = problem_of(scene)
    down = -0.08
    start = scene.vector([*[0.0] * (scene.dim - 1), down], 0.03, 0.2)
    A = problem.new_matrix(start)
    for step in (0.01, 0.03, 0.1, 0.2, 0.15, 0.0):
        x = scene.vector([step, *[-0.5 * step] * (scene.dim - 2), down], 0.03, 0.2)
        problem.assemble_tangent(x, A)
        exact = scene.tangent(x)
        assert np.abs(exact).max() > 1e-2
        np.testing.assert_allclose(dense(A), exact, rtol=0, atol=1e-12)
        problem.commit()


def test_open_points_that_a_film_feels_need_room_too():
    """Those beside a vertex at the rim; without a film only closed points do."""
    scene, x = at_the_rim("hex8")
    trial = scene.term.evaluate(x, 1.0)
    open_points = trial.coupled() & ~trial.kinematics.closed
    assert open_points.any()
    window = widened(None, scene.term, trial)
    assert window.holds(scene.term, trial)
    keep = np.isin(
        np.arange(window.touching.shape[0]),
        scene.surface.slave.facet[trial.kinematics.closed],
    )
    window.touching = (scipy.sparse.diags(keep.astype(np.int32)) @ window.touching).tocsr()
    window.touching.eliminate_zeros()
    window.touching.sort_indices()
    assert not window.holds(scene.term, trial)
    trial.normal_contact.rim = None
    assert window.holds(scene.term, trial)


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


def test_fill_in_space_is_moderate():
    """Each slave node couples with the facets around its own, not with the whole master."""
    scene, problem = fine_master("hex8", 20)
    x = scene.vector([0.0, 0.0, -0.08], 0.0, 0.0)
    trial = scene.term.evaluate(x, 1.0)
    window = widened(None, scene.term, trial)
    assert window.holds(scene.term, trial)
    nodes = coupled_nodes(scene.term, window)
    assert len(np.unique(nodes, axis=0)) == len(nodes)
    assert (nodes[:, 0] < nodes[:, 1]).all()
    masters = len(scene.surface.master.nodes)
    among = np.isin(nodes, scene.surface.master.nodes).all(axis=1)
    # Two rings and the facets in use: at most a patch of 7 × 7 nodes for each.
    assert np.count_nonzero(among) < 0.5 * 49 * masters
    assert isinstance(problem.new_matrix(x), PETSc.Mat)


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


def test_room_made_bit_by_bit_is_that_made_at_once():
    """Of a contact that moves on, beside a platen that acts from the third step on."""
    scene = Scene("hex8", LAW, master=12)
    facets = scene.surface.slave.mesh_facet
    dofs = component_dofs(scene.space, np.unique(facets), 1)
    platen = Platen(dofs, force=-1.0, acts=False)
    u = dolfinx.fem.Function(scene.space)
    problem = Equilibrium(u, [], [scene.term], platens=[platen])
    A = problem.new_matrix(scene.vector([0.0, 0.0, -0.08], 0.02, 0.2))
    entries = []
    for step in range(6):
        platen.acts = step > 2
        problem.assemble_tangent(scene.vector([step / 12, 0.0, -0.08], 0.02, 0.2), A)
        problem.commit()
        entries.append(A.getValuesCSR()[:2])
    assert len({len(columns) for _, columns in entries}) > 3  # before and after the platen came
    problem.tangent._rooms.clear()
    problem.tangent.make_room(A)
    for made, once in zip(entries[-1], A.getValuesCSR()[:2], strict=True):
        np.testing.assert_array_equal(made, once)


def summed(nodes, blocks, size):
    """Blocks (q, m, i, n, j) summed densely."""
    dim = blocks.shape[2]
    dofs = (nodes[..., None] * dim + np.arange(dim)).reshape(len(nodes), nodes.shape[1] * dim)
    out = np.zeros((dim * size, dim * size))
    blocks = blocks.reshape(len(nodes), dofs.shape[1], dofs.shape[1])
    np.add.at(out, (dofs[:, :, None], dofs[:, None, :]), blocks)
    return out


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("count", [0, 1, 30])
def test_places_of_blocks_add_up_to_their_sum(dim, count):
    """Also where points share nodes, and where a point names a node twice."""
    rng = np.random.default_rng(dim)
    nodes = rng.integers(0, 12, size=(count, 5))
    blocks = rng.normal(size=(count, 5, dim, 5, dim))
    places = BlockPlaces(nodes, dim)
    for values in (blocks, 2.0 * blocks):  # the places serve again
        out = np.zeros((12 * dim, 12 * dim))
        rows = np.repeat(places.rows, np.diff(places.indptr))
        assert len(np.unique(rows * 100 + places.columns)) == len(rows)
        out[rows, places.columns] = places.add_up(values)
        np.testing.assert_allclose(out, summed(nodes, values, 12), rtol=0, atol=1e-12)
    assert places.add_up(None).shape == places.columns.shape
    assert not places.add_up(None).any()


def test_places_are_found_once_while_the_nodes_stay():
    scene = Scene("Q4", LAW, fine=True)
    problem = problem_of(scene)
    start = [scene.vector([x, -0.08], 0.03, 0.2) for x in (0.0, 1e-7, 0.3)]
    A = problem.new_matrix(start[0])
    problem.assemble_tangent(start[0], A)
    known = problem.tangent._known_places[0]
    problem.assemble_tangent(start[1], A)
    assert problem.tangent._known_places[0] is known
    problem.assemble_tangent(start[2], A)
    assert problem.tangent._known_places[0] is not known
    np.testing.assert_allclose(dense(A), scene.tangent(start[2]), rtol=0, atol=1e-12)
