"""Ties of boxes that do not match, with a gap between them or without."""

import numpy as np
import pytest
from petsc4py import PETSc

from tests.contact_boxes import GAP, PENALTY, SHAPES, Scene
from tribox.forms.contact import tie
from tribox.forms.contact.explicit_compiled import explicit_contact
from tribox.forms.contact.stiffness import PairStiffness
from tribox.forms.contact.tie import TieTerm
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.geometry.surfaces.surface import NodalVector


@pytest.fixture(autouse=True)
def _reaches_over_the_gap(monkeypatch):
    monkeypatch.setattr(tie, "REACH", 0.5)


def scene(shape, fine=False):
    made = Scene(shape, FrictionlessLaw(), fine=fine)
    made.term = TieTerm(made.surface, PENALTY)
    return made


def unknowns(scene, values):
    out = PETSc.Vec().createSeq(scene.size)
    out.array[:] = values.reshape(-1)
    return out


def rotation(dim):
    c, s = np.cos(0.7), np.sin(0.7)
    if dim == 2:
        return np.array([[c, -s], [s, c]])
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return about_x @ np.array([[s, -c, 0], [c, s, 0], [0, 0, 1]])


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("fine", [False, True])
def test_no_rigid_motion_makes_a_force_across_a_gap(shape, fine):
    """Both bodies turned by 40° and moved far: the offsets of 0.05 turn with the master."""
    boxes = scene(shape, fine)
    turned = boxes.where @ (rotation(boxes.dim) - np.eye(boxes.dim)).T + 3.0
    force, trial = boxes.residual(unknowns(boxes, turned))
    assert np.abs(force).max() < 1e-12 * PENALTY
    assert boxes.term.interface_energy(trial) < 1e-24 * PENALTY
    assert boxes.term.share == pytest.approx(1.0)


@pytest.mark.parametrize("shape", ["T3", "Q9", "tet4", "hex8"])
def test_forces_are_those_of_the_energy_and_balance(shape):
    """∂E/∂u by differences; resultant zero, and moment too, offsets included."""
    boxes = scene(shape, fine=True)
    x = boxes.vector([0.03, 0.02, -0.01][: boxes.dim], 0.05, 0.4, 0.02)
    force, trial = boxes.residual(x)
    rng, h = np.random.default_rng(1), 1e-6
    for _ in range(3):
        d = rng.normal(size=boxes.size)
        ends = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved.array[:] = x.array_r + sign * h * d
            ends.append(boxes.term.interface_energy(boxes.residual(moved)[1]))
        assert (ends[0] - ends[1]) / (2 * h) == pytest.approx(float(force @ d), rel=1e-6)
    each, place = force.reshape(-1, boxes.dim), boxes.where + x.array_r.reshape(-1, boxes.dim)
    scale = np.abs(each).sum()
    assert scale > 0.0
    assert np.abs(each.sum(axis=0)).max() < 1e-13 * scale
    pad = ((0, 0), (0, 3 - boxes.dim))
    moment = np.cross(np.pad(place, pad), np.pad(each, pad)).sum(axis=0)
    assert np.abs(moment).max() < 1e-12 * scale
    upper = boxes.where[:, -1] > 0.5 * GAP
    total = boxes.surface.slave.weight @ trial.traction
    assert np.allclose(total, -each[upper].sum(axis=0), atol=2e-3 * np.abs(total).max())


@pytest.mark.parametrize("shape", ["T3", "Q4", "T6", "Q9"])
def test_the_tangent_in_the_plane_is_exact(shape):
    boxes = scene(shape)
    x = boxes.vector([0.03, -0.01], 0.05, 0.4, 0.02)
    assert boxes.error(x, steps=(1e-3, 1e-4)) < 1e-9
    # All nodes that it couples are known beforehand: the matrix has room for them.
    row, column = np.nonzero(np.triu(boxes.tangent(x)) != 0.0)
    coupled = {pair for pair in zip(row // 2, column // 2, strict=True) if pair[0] < pair[1]}
    assert coupled and coupled <= set(map(tuple, boxes.term.coupled_pairs()))


@pytest.mark.parametrize("shape", ["tet4", "hex8"])
def test_the_tangent_in_space_leaves_out_the_turning_of_a_gap(shape):
    """Exact without a gap along the normal (to round-off); with one, to a share of it."""
    boxes = scene(shape)
    x = boxes.vector([0.03, -0.01, 0.02], 0.05, 0.4, 0.02)
    small = boxes.vector([0.0003, -0.0001, 0.0002], 0.0005, 0.4, 0.0002)
    assert boxes.error(small) < 0.005 < boxes.error(x)
    boxes.term._bulges = False
    assert boxes.error(x, steps=(1e-3, 1e-4)) < 1e-9


@pytest.mark.parametrize("shape", ["T3", "Q4"])
def test_the_stiffness_for_explicit_steps_is_that_of_the_undeformed_tie(shape):
    boxes = scene(shape)
    contact = explicit_contact(boxes.term)
    u, w, out = (NodalVector(boxes.space) for _ in range(3))
    contact.evaluate(u, 1.0)
    w.owned[:] = np.random.default_rng(3).normal(size=boxes.size)
    PairStiffness(contact).add(w, out)
    wanted = boxes.tangent(unknowns(boxes, np.zeros(boxes.size))) @ w.owned
    np.testing.assert_allclose(out.owned, wanted, atol=1e-12 * np.abs(wanted).max())


def test_a_tie_with_nothing_beside_it_is_refused(monkeypatch):
    monkeypatch.setattr(tie, "REACH", 1e-3)
    with pytest.raises(ValueError, match="nothing is tied"):
        scene("Q4")
