"""The compiled tangent and forces of a pair in space against those of numpy."""

import numpy as np
import pytest

from tests.contact_boxes import GAP, PENALTY, Scene, held_ends, nodal_forces, with_blocks
from tests.forms.contact.test_explicit import LAWS
from tests.forms.contact.test_tangent_ends import at_the_rim
from tribox.forms.contact.compiled_tangent import CompiledTangent, Entries
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactMode

CASES = {
    "hexahedra": ("hex8", "map", {}),
    "tetrahedra": ("tet4", "coulomb", {}),
    "quadratic": ("tet10", "film over the pressure", {}),
    "smooth": ("hex8", "map", {"smoothing_angle": 0.5}),
    "mirrored": ("hex8", "map", {"smoothing_angle": 0.5}),
    "point by point": ("hex8", "coulomb", {"pressure": "pointwise"}),
}


class Dense:
    """A dense matrix as entries, in which some nodes are not."""

    def __init__(self, nodes, outside=()):
        self.size, self.outside = 3 * nodes, np.asarray(outside, dtype=np.int64)
        self.values = np.zeros(self.size**2)

    def entries(self):
        indptr = np.arange(0, self.size**2 + 1, self.size, dtype=np.int32)
        columns = np.tile(np.arange(self.size, dtype=np.int32), self.size)
        return Entries(indptr, columns, self.values, self.first)

    def first(self, nodes):
        return np.where(np.isin(nodes, self.outside), -1, 3 * nodes).astype(np.int32)

    def with_rest(self, blocks, couplings):
        """The whole, with what is not in the matrix added."""
        out = self.values.reshape(self.size, self.size).copy()
        inside = out.copy()
        at = (3 * self.outside[:, None] + np.arange(3)).reshape(-1)
        inside[at], inside[:, at] = 0.0, 0.0
        np.testing.assert_array_equal(out, inside)  # nothing of nodes that are not in it
        return with_blocks(out, blocks, couplings, 3)


def states(scene):
    """Contacts at some steps, each from the one before: inside, over edges, over the end."""
    way = ((0.0, 0.0), (0.01, -0.02), (0.05, 0.02), (0.3, 0.1), (0.33, 0.12))
    for number, (x, y) in enumerate(way):
        bend = (0.02, 0.06, 0.08, 0.06, 0.05)[number]
        vector = scene.vector((x, y, -GAP - 0.03), bend, 0.4, 0.01)
        trial = scene.term.evaluate(vector, 0.5)
        yield trial, scene.tangent(vector, 0.5)
        scene.term.commit(trial)


def scene_of(name):
    shape, law, options = CASES[name]
    pressure = options.get("pressure", "averaged")
    if name == "mirrored":
        options = options | {"held": held_ends(shape, 3, fine=True)}
    scene = Scene(shape, LAWS[law][0], fine=True, master=3, **options)
    scene.term = ContactTerm(scene.surface, LAWS[law][0], PENALTY, LAWS[law][1], pressure)
    assert isinstance(scene.term.compiled, CompiledTangent)
    assert (scene.surface.images is not None) == (name == "mirrored")
    return scene


@pytest.mark.parametrize("name", CASES)
def test_it_adds_the_tangent_of_numpy(name):
    """With all nodes in the matrix; with some that are not; over a master as it was and moved."""
    scene = scene_of(name)
    nodes = len(scene.where)
    every = np.unique(scene.surface.nodes)
    seen = dict.fromkeys(("on a side", "another facet", "friction"), False)
    for trial, exact in states(scene):
        at, closed = trial.projection, trial.kinematics.closed
        seen["on a side"] |= bool((at.clamped & closed).any())
        seen["another facet"] |= bool((closed & (at.facet != scene.term.state.facet)).any())
        seen["friction"] |= bool(trial.response.state.elastic_slip.any())
        for outside in ((), every[:2], every):
            matrix = Dense(nodes, outside)
            rest = scene.term.add_tangent(trial, matrix.entries())
            if not len(outside):
                assert not rest[1] and not rest[0]
            found = matrix.with_rest(*rest)
            largest = np.abs(exact).max()
            np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12 * largest)
            assert matrix.values.any() == (len(outside) < len(every))
    assert all(seen.values()) or ("smoothing_angle" in CASES[name][2] and seen["friction"])


@pytest.mark.parametrize("name", ["hexahedra", "quadratic", "smooth", "mirrored"])
def test_its_forces_are_those_of_numpy(name):
    scene = scene_of(name)
    for trial, _ in states(scene):
        expected = nodal_forces(scene.term, trial, len(scene.where))
        found = np.zeros_like(expected)
        nodes, sums, squared = scene.term.forces_at_nodes(trial)
        np.add.at(found, nodes, sums)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
        if scene.surface.images is None:  # numpy has what planes of symmetry turn round as well
            points = np.sum(scene.term.nodal_forces(trial)[1] ** 2)
            assert squared == pytest.approx(points, rel=1e-12)
        assert squared > 0.0


def test_open_points_beside_the_rim_count():
    """A film feels the gaps of vertices that are open: R holds more points than L."""
    scene, x = at_the_rim("hex8")
    trial = scene.term.evaluate(x, 1.0)
    assert np.count_nonzero(trial.coupled()) > np.count_nonzero(trial.kinematics.closed)
    matrix, exact = Dense(len(scene.where)), scene.tangent(x)
    assert scene.term.add_tangent(trial, matrix.entries()) == ([], [])
    found = matrix.values.reshape(exact.shape)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12 * np.abs(exact).max())


def test_other_modes_and_no_contact():
    """Softened and without friction's stiffness; open everywhere."""
    scene = scene_of("hexahedra")
    x = scene.vector((0.02, 0.01, -GAP - 0.03), 0.05, 0.4)
    mode = ContactMode(penalty_scale=0.3, friction_as_load=True)
    trial = scene.term.evaluate(x, 0.5, mode)
    matrix = Dense(len(scene.where))
    scene.term.add_tangent(trial, matrix.entries())
    blocks, coupling = scene.term.tangent(trial), scene.term.coupling(trial)
    exact = Dense(len(scene.where)).with_rest(blocks, [coupling])
    found = matrix.values.reshape(exact.shape)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12 * np.abs(exact).max())
    apart = scene.term.evaluate(scene.vector((0.0, 0.0, 0.2), 0.0, 0.0), 0.5)
    matrix = Dense(len(scene.where))
    assert scene.term.add_tangent(apart, matrix.entries()) == ([], [])
    assert not matrix.values.any()


def test_a_matrix_without_room_is_refused():
    """Entries that the pattern lacks are not lost without a word."""
    scene = scene_of("hexahedra")
    trial = scene.term.evaluate(scene.vector((0.0, 0.0, -GAP - 0.03), 0.05, 0.4), 0.5)
    size = 3 * len(scene.where)
    diagonal = np.arange(size + 1, dtype=np.int32)
    entries = Entries(diagonal, diagonal[:-1], np.zeros(size), Dense(len(scene.where)).first)
    with pytest.raises(RuntimeError, match="not in the matrix's pattern"):
        scene.term.add_tangent(trial, entries)
