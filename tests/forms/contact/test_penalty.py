"""The contact term: forces, history and energy of one pair at given displacements."""

from typing import get_args

import numpy as np
import pytest

from tests.contact_boxes import dense_tangent, nodal_forces
from tests.laws import coulomb
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import PressureKind
from tribox.forms.contact.state import ContactMode
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import Regime
from tribox.forms.friction.parameters import FrictionMapParameters

PENALTY = 50.0
DOWN = -0.02


KINDS = get_args(PressureKind)


def term_of(blocks, law, film=0.0, degree=5, pressure="averaged", penalty=PENALTY):
    return ContactTerm(blocks.surface(degree), law, penalty, film, pressure)


def shifted(x, y):
    return lambda X: np.broadcast_to([x, y], X.shape)


def still(X):
    return np.zeros_like(X)


def summed(*motions):
    return lambda X: sum(motion(X) for motion in motions)


def committed(term, x, dt=1.0):
    trial = term.evaluate(x, dt)
    term.commit(trial)
    return trial


def test_sticking_and_sliding_in_numbers(pair):
    """Signs: the slave is dragged to +x, so that friction pulls it to −x; T/N = μ when sliding."""
    blocks = pair()
    for mu, move, expected in ((0.3, 0.001, 60.0 * 0.001), (0.3, 0.1, 0.3 * PENALTY * 0.02)):
        term = term_of(blocks, coulomb(mu))
        committed(term, blocks.displaced(shifted(0.0, DOWN), still))
        trial = term.evaluate(blocks.displaced(shifted(move, DOWN), still), 1.0)
        np.testing.assert_allclose(trial.kinematics.slip[:, 0], move, rtol=1e-10)
        np.testing.assert_allclose(trial.traction[:, 0], -expected, rtol=1e-9)
        forces = nodal_forces(term, trial, blocks.u.function_space.dofmap.index_map.size_local)
        slave = np.unique(term.surface.slave.nodes)
        # The residual is minus the force on the body; the slave surface has unit length.
        np.testing.assert_allclose(forces[slave].sum(axis=0), [expected, -PENALTY * 0.02])
        np.testing.assert_allclose(forces[term.surface.master.nodes].sum(axis=0), [-expected, 1.0])


def test_slip_is_the_way_since_the_last_step_over_a_master_that_stretches(pair):
    blocks = pair()
    term = term_of(blocks, coulomb(0.3))
    committed(term, blocks.displaced(shifted(0.0, DOWN), still))
    x = blocks.displaced(shifted(0.05, DOWN), lambda X: 0.1 * X * [1.0, 0.0])
    slip = term.evaluate(x, 1.0).kinematics.slip
    np.testing.assert_allclose(slip[:, 0], 0.05 - 0.1 * term.surface.slave.position[:, 0])


def test_another_duration_or_rate_is_another_evaluation(pair):
    law = FrictionMap(
        FrictionMapParameters(
            mu_s=0.3, K_T=60.0, eta_b=5.0, D_max=1.0, alpha=0.4, V_star=1e3, V_star_at=0.5
        )
    )
    blocks = pair()
    term = term_of(blocks, law, film=0.5)
    committed(term, blocks.displaced(shifted(0.0, DOWN), still))
    x = blocks.displaced(shifted(0.1, DOWN), still)
    solid = 0.6 * 0.3 * PENALTY * 0.02
    for dt in (1.0, 2.0):
        film = 0.4 * 5.0 / 0.5 * 0.1 / dt
        traction = term.evaluate(x, dt).response.traction
        np.testing.assert_allclose(traction[:, 0], solid + film, rtol=1e-10)
    traction = term.evaluate(x, 2.0, ContactMode(rate_dependent=False)).response.traction
    np.testing.assert_allclose(traction[:, 0], solid, rtol=1e-10)


def test_film_feels_the_stretch_of_the_last_step(pair):
    """The film's stress is per current area: its traction per reference area grows with da/dA."""
    law = FrictionMap(
        FrictionMapParameters(
            mu_s=0.0, K_T=60.0, eta_b=5.0, D_max=1.0, alpha=0.4, V_star=1e3, V_star_at=0.5
        )
    )
    blocks = pair()
    term = term_of(blocks, law, film=2.0)

    def wider(X):
        return np.stack([0.2 * (X[:, 0] - 0.97), np.full(len(X), DOWN)], axis=1)

    first = term.evaluate(blocks.displaced(wider, still), 1.0)
    np.testing.assert_allclose(first.area_ratio, 1.2, rtol=1e-12)
    term.commit(first)
    trial = term.evaluate(blocks.displaced(summed(wider, shifted(0.1, 0.0)), still), 1.0)
    np.testing.assert_allclose(trial.response.traction[:, 0], 1.2 * 5.0 / 2.0 * 0.1, rtol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_open_points_carry_nothing_and_are_left_out_of_the_tangent(pair, kind):
    """A tilted block: closed where the own gap, or the mean gap of a vertex of the facet, is."""
    blocks = pair()
    term = term_of(blocks, coulomb(0.3), pressure=kind)

    def tilted(X):
        return np.stack([0.0 * X[:, 0], 0.05 * (X[:, 0] - 0.9)], axis=1)

    trial = term.evaluate(blocks.displaced(tilted, still), 1.0)
    closed = trial.kinematics.closed
    assert 3 < np.count_nonzero(closed) < len(closed) - 3
    x, vertices = term.surface.slave.position[:, 0], term.surface.vertices
    if kind == "pointwise":
        np.testing.assert_array_equal(closed, trial.kinematics.gap < 0.0)
    else:
        # Of a straight gap the mean over the hat of a vertex is its value there, but at the ends:
        # a third of a facet h off them.
        place, h = vertices.position[:, 0].copy(), 1.0 / 6.0
        place[np.argmin(place)] += h / 3.0
        place[np.argmax(place)] -= h / 3.0
        np.testing.assert_allclose(trial.nodal_gap, 0.05 * (place - 0.9), atol=1e-15)
        active = place < 0.9
        np.testing.assert_array_equal(closed, active[vertices.of_point].any(axis=1))
        nodal = PENALTY * 0.05 * np.maximum(0.9 - place, 0.0)
        np.testing.assert_allclose(trial.nodal_pressure, nodal, atol=1e-14)
        order = np.argsort(vertices.position[:, 0])
        expected = np.interp(x, vertices.position[order, 0], nodal[order])
        np.testing.assert_allclose(trial.pressure, expected, atol=1e-14)
        assert np.any(trial.pressure[trial.kinematics.gap > 0.0] > 0.0)
    assert not trial.traction[~closed].any()
    assert (trial.response.regime[~closed] == Regime.OPEN).all()
    count = blocks.u.function_space.dofmap.index_map.size_local
    moved = dense_tangent(term, trial, count).reshape(count, 2, -1).any(axis=(1, 2))
    nodes = term.surface.slave.nodes[closed]
    # Averaged ones feel the vertices of facets beside theirs.
    assert set(np.unique(nodes)) <= set(np.nonzero(moved)[0])
    open_nodes = np.setdiff1d(term.surface.slave.nodes, nodes)
    assert len(open_nodes) and not moved[open_nodes].any()


def test_past_the_end_of_the_master_there_is_no_contact(pair):
    """The slave slides over the right end; the history of those points says so."""
    blocks = pair()
    term = term_of(blocks, coulomb(0.3))
    committed(term, blocks.displaced(shifted(0.0, DOWN), still))
    trial = term.evaluate(blocks.displaced(shifted(0.9, DOWN), still), 1.0)
    beyond = trial.position[:, 0] > 2.0
    assert 3 < np.count_nonzero(beyond) < len(beyond) - 3
    np.testing.assert_array_equal(trial.pressure > 0.0, ~beyond)
    term.commit(trial)
    np.testing.assert_array_equal(np.isinf(term.state.gap), beyond)
    back = term.evaluate(blocks.displaced(shifted(0.85, DOWN), still), 1.0)
    new = beyond & (back.pressure > 0.0)
    # The speed is that of the whole way; the asperities have slid from the end, and no further.
    assert new.any()
    way = back.position[new, 0] - 2.0
    assert way.min() < -0.01
    slip, elastic = back.kinematics.slip[new, 0], back.kinematics.elastic_slip[new, 0]
    np.testing.assert_allclose(slip, -0.05, atol=1e-12)
    np.testing.assert_allclose(slip + elastic, way, atol=1e-12)


def test_slip_and_friction_do_not_depend_on_penalty_and_step_that_close_the_contact(pair):
    """A block that comes down while it slides: the way of the step counts in full."""
    blocks = pair()
    friction = {}
    for kind, penalty, above in (
        ("averaged", PENALTY, 0.01),
        ("averaged", 1e3 * PENALTY, 0.01),
        ("averaged", PENALTY, 1.0),
        ("pointwise", PENALTY, 1.0),
    ):
        term = term_of(blocks, coulomb(50.0), pressure=kind, penalty=penalty)
        committed(term, blocks.displaced(shifted(0.0, above), still))
        trial = term.evaluate(blocks.displaced(shifted(0.07, DOWN), still), 1.0)
        np.testing.assert_allclose(trial.kinematics.slip, [[0.07, 0.0]] * 18, atol=1e-14)
        friction[kind, penalty, above] = trial.response.traction
    for traction in friction.values():
        np.testing.assert_allclose(traction, [[60.0 * 0.07, 0.0]] * 18, atol=1e-12)
