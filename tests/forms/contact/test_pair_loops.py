"""Slip and forces of a pair by compiled loops against those of numpy, tangents of all matrices."""

import numpy as np
import pytest

from tests import numpy_pair
from tests.contact_boxes import (
    GAP,
    PENALTY,
    Dense,
    Scene,
    held_ends,
    nodal_forces,
    take_all_for_kinked,
)
from tests.forms.contact.test_explicit import LAWS
from tests.forms.contact.test_tangent_ends import at_the_rim
from tests.numpy_pair import anchor_of, relate
from tribox.forms.contact.pair_loops import Entries
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactMode

CASES = {
    "hexahedra": ("hex8", "map", {}),
    "tetrahedra": ("tet4", "coulomb", {}),
    "quadratic": ("tet10", "film over the pressure", {}),
    "smooth": ("hex8", "map", {"smoothing_angle": 0.5}),
    "mirrored": ("hex8", "map", {"smoothing_angle": 0.5}),
    "point by point": ("hex8", "coulomb", {"pressure": "pointwise"}),
    "plane": ("Q4", "map", {}),
    "plane, quadratic": ("T6", "film over the pressure", {}),
    "plane, smooth": ("Q4", "map", {"smoothing_angle": 0.5}),
    "plane, mirrored": ("Q4", "map", {"smoothing_angle": 0.5}),
    "plane, along rays": ("Q4", "coulomb", {}),
    "plane, point by point": ("Q4", "coulomb", {"pressure": "pointwise"}),
}


def states(scene):
    """Contacts at some steps, each from the one before: inside, over edges, over the end."""
    way = ((0.0, 0.0), (0.01, -0.02), (0.05, 0.02), (0.3, 0.1), (0.33, 0.12))
    for number, (x, y) in enumerate(way):
        bend = (0.02, 0.06, 0.08, 0.06, 0.05)[number]
        shift = (x, y, -GAP - 0.03) if scene.dim == 3 else (x, -GAP - 0.03)
        vector = scene.vector(shift, bend, 0.4, 0.01)
        trial = scene.term.evaluate(vector, 0.5)
        # Of images, beside supports that hold: test_tangent.py.
        assert scene.surface.images is not None or scene.error(vector) < 1e-9
        yield trial, scene.tangent(vector, 0.5)
        scene.term.commit(trial)


def scene_of(name, patch=None):
    shape, law, options = CASES[name]
    if name == "plane, along rays":
        take_all_for_kinked(patch)
    pressure = options.get("pressure", "averaged")
    if name.endswith("mirrored"):
        options = options | {"held": held_ends(shape, 3, fine=True)}
    scene = Scene(shape, LAWS[law][0], fine=True, master=3, **options)
    scene.term = ContactTerm(scene.surface, LAWS[law][0], PENALTY, LAWS[law][1], pressure)
    assert (scene.surface.images is not None) == name.endswith("mirrored")
    return scene


@pytest.mark.parametrize("name", CASES)
def test_the_tangent_is_exact_whatever_the_matrix_holds(monkeypatch, name):
    """With all nodes in the matrix; with some that are not; over a master as it was and moved."""
    scene = scene_of(name, monkeypatch)
    assert (scene.surface.normals is not None) == name.endswith("rays")
    every = np.unique(scene.surface.nodes)
    seen = dict.fromkeys(("on a side", "another facet", "friction"), False)
    for trial, exact in states(scene):
        at, closed = trial.projection, trial.kinematics.closed
        seen["on a side"] |= bool((at.clamped & closed).any())
        seen["another facet"] |= bool((closed & (at.facet != scene.term.state.facet)).any())
        seen["friction"] |= bool(trial.response.state.elastic_slip.any())
        for outside in ((), every[:2], every):
            matrix = Dense(scene.dim, len(scene.where), outside)
            rest = scene.term.add_tangent(trial, matrix.entries())
            assert bool(rest) == (len(outside) > 0)
            found = matrix.with_rest(rest)
            largest = np.abs(exact).max()
            np.testing.assert_allclose(found, exact, rtol=0, atol=1e-13 * largest)
            assert matrix.values.any() == (len(outside) < len(every))
        alone = Dense(scene.dim, len(scene.where)).with_rest(
            scene.term.add_tangent(trial, Entries.none())
        )
        np.testing.assert_allclose(alone, exact, rtol=0, atol=1e-13 * largest)
    smooth = "smoothing_angle" in CASES[name][2]
    seen["on a side"] |= smooth or scene.dim == 2
    seen["another facet"] |= smooth
    assert all(seen.values())


@pytest.mark.parametrize(
    "name", [name for name in CASES if "point" not in name and "rays" not in name]
)
def test_its_forces_are_those_of_numpy(name):
    scene = scene_of(name)
    for trial, _ in states(scene):
        expected = nodal_forces(scene.term, trial, len(scene.where))
        found = np.zeros_like(expected)
        nodes, sums, squared = scene.term.forces_at_nodes(trial)
        np.add.at(found, nodes, sums)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
        values = numpy_pair.nodal_forces(scene.term, trial)[1]  # the last of a tool is a moment
        points = values if trial.carried is None else values[:, :-1]
        assert squared == pytest.approx(np.sum(points**2), rel=1e-12)
        assert squared > 0.0
        anchor, closed = anchor_of(scene.term, trial.nodes), trial.kinematics.closed
        exact = relate(trial.position, trial.projection, anchor, closed)
        for name in ("slip", "elastic_slip"):
            found, expected = (getattr(k, name) for k in (trial.kinematics, exact))
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)
        np.testing.assert_allclose(trial.anchor.foot, anchor.foot, rtol=0, atol=1e-14)


def test_open_points_beside_the_rim_count():
    """A film feels the gaps of vertices that are open: R holds more points than L."""
    scene, x = at_the_rim("hex8")
    trial = scene.term.evaluate(x, 1.0)
    assert np.count_nonzero(trial.coupled()) > np.count_nonzero(trial.kinematics.closed)
    matrix, exact = Dense(scene.dim, len(scene.where)), scene.tangent(x)
    assert scene.term.add_tangent(trial, matrix.entries()) == []
    found = matrix.with_rest([])
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-13 * np.abs(exact).max())


def test_other_modes_and_no_contact():
    """Softened; open everywhere."""
    scene = scene_of("hexahedra")
    x = scene.vector((0.02, 0.01, -GAP - 0.03), 0.05, 0.4)
    assert scene.error(x, mode=ContactMode(penalty_scale=0.3)) < 1e-9
    apart = scene.term.evaluate(scene.vector((0.0, 0.0, 0.2), 0.0, 0.0), 0.5)
    matrix = Dense(scene.dim, len(scene.where))
    assert scene.term.add_tangent(apart, matrix.entries()) == []
    assert not matrix.values.any()


def test_a_matrix_without_room_is_refused():
    """Entries that the pattern lacks are not lost without a word."""
    scene = scene_of("hexahedra")
    trial = scene.term.evaluate(scene.vector((0.0, 0.0, -GAP - 0.03), 0.05, 0.4), 0.5)
    size = scene.size + 1
    diagonal = np.arange(size + 1, dtype=np.int32)
    entries = Entries(
        diagonal, diagonal[:-1], np.zeros(size), Dense(scene.dim, len(scene.where)).first
    )
    with pytest.raises(RuntimeError, match="not in the matrix's pattern"):
        scene.term.add_tangent(trial, entries)
