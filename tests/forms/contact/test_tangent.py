"""Residual and tangent of the contact alone, in the plane and in space, on facets of all shapes."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.contact_boxes import GAP, PENALTY, SHAPES, Dense, Scene, held_ends
from tests.laws import FILM, coulomb, film_map
from tribox.forms.contact.explicit_compiled import explicit_contact
from tribox.forms.contact.state import AS_IS, ContactMode
from tribox.forms.contact.tangent import PairTangent
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.forms.friction.film import FilmTable
from tribox.forms.friction.law import Regime
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters
from tribox.geometry.surfaces.surface import NodalVector


@dataclass(frozen=True)
class State:
    """Where the upper box has been and is: along x, along y, down; and what is expected there."""

    law: object
    regime: Regime
    before: tuple[float, float, float] = (0.01, 0.02, -0.07)
    now: tuple[float, float, float] = (0.03, 0.01, -0.09)
    film: object = 0.0
    mode: ContactMode = AS_IS


STATES = {
    "no friction": State(FrictionlessLaw(), Regime.SLIP),
    "stick": State(coulomb(50.0), Regime.STICK),
    "slip": State(coulomb(0.2), Regime.SLIP, now=(0.13, -0.09, -0.09)),
    "film": State(film_map(), Regime.MIXED, now=(0.13, -0.09, -0.09), film=0.5),
    "closing": State(coulomb(50.0), Regime.STICK, before=(0.0, 0.0, 0.06)),
}


def slid(law, regime, film=FILM, **more):
    return State(law, regime, film=film, **{"now": (0.13, -0.09, -0.09), **more})


NEARLY_OFF = {"now": (0.12, 0.0, -0.04)}
STILL = {"now": (0.03, 0.01, -0.09)}
STRIBECK = StribeckParameters(mu_s=0.3, mu_d=0.2, V_s=0.1, delta=1.5, viscous=2.0, K_T=60.0)
THIN = film_map(tau_0=0.5, zeta=0.1, critical_rate=0.2, thinning_exponent=0.5, barus=0.1)
LAWS = {
    "stick of the map": slid(film_map(mu_s=50.0, mu_d=40.0), Regime.STICK, **STILL),
    "onset": slid(coulomb(0.7), Regime.STICK, 0.0, **STILL),
    "onset, sliding part": slid(coulomb(0.7), Regime.SLIP, 0.0, **STILL),
    "dry slip of the map": slid(film_map(), Regime.SLIP, 0.0),
    "stribeck": slid(StribeckLaw(STRIBECK), Regime.SLIP, 0.0),
    "partly open": slid(coulomb(0.3), Regime.SLIP, 0.0, **NEARLY_OFF),
    "literal flow rule": slid(film_map(flow_rule="literal"), Regime.MIXED),
    "in the transition": slid(film_map(V_star=0.11, transition_width=0.6), Regime.MIXED),
    "whole film at once": slid(film_map(film_onset_pressure=0.0), Regime.MIXED),
    "over pressure": slid(film_map(), Regime.MIXED, FilmTable(((0.0, 0.8), (20.0, 0.3)))),
    "film with a rheology": slid(THIN, Regime.MIXED),
    "rates off": slid(film_map(), Regime.MIXED, mode=ContactMode(rate_dependent=False), **STILL),
    "viscous by speed": slid(film_map(V_star=1e-3), Regime.VISCOUS),
    "viscous by thickness": slid(film_map(), Regime.VISCOUS, 1.5),
    "open part": slid(film_map(), Regime.OPEN, **NEARLY_OFF),
    "open": slid(coulomb(0.2), Regime.OPEN, 0.0, now=(0.0, 0.0, 0.3)),
}


# The same, but so bent that points hang in the grooves between the facets.
GROOVES = {
    name: replace(STATES[name], before=(0.01, 0.02, -0.12), now=(0.05, -0.03, -0.14))
    for name in ("stick", "slip")
}


def prepared(shape, state, bend=0.04, **options):
    scene = Scene(shape, state.law, film=state.film, **options)
    pick = [0, 2] if scene.dim == 2 else [0, 1, 2]
    before = scene.vector(np.array(state.before)[pick], 0.8 * bend, 0.9)
    scene.term.commit(scene.term.evaluate(before, 1.0))
    return scene, scene.vector(np.array(state.now)[pick], bend, 0.7, 0.01)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("state", STATES)
def test_tangent_against_differences(shape, state):
    scene, x = prepared(shape, STATES[state])
    _, trial = scene.residual(x)
    assert np.count_nonzero(trial.response.regime == STATES[state].regime) >= 2
    assert np.count_nonzero(trial.pressure) >= 2
    assert scene.error(x) < 1e-9


@pytest.mark.parametrize("pressure", ["averaged", "pointwise"])
@pytest.mark.parametrize("name", LAWS)
def test_tangent_of_each_law(name, pressure):
    state = LAWS[name]
    options = {"fine": True, "degree": 5, "pressure": pressure}
    scene, x = prepared("Q4", state, bend=0.1, **options)
    _, trial = scene.residual(x, mode=state.mode)
    regimes = trial.response.regime
    assert np.count_nonzero(regimes == state.regime) >= 3, np.bincount(regimes)
    assert scene.error(x, mode=state.mode) < 1e-9
    if state.regime != Regime.OPEN:  # with a history, under load
        slip = np.linalg.norm(trial.kinematics.elastic_slip, axis=1)[regimes == state.regime]
        assert slip.max() > 1e-3 and trial.pressure.max() > 0.1


@pytest.mark.parametrize("shape", ["T3", "Q4", "hex8"])
@pytest.mark.parametrize("state", STATES)
def test_tangent_of_a_smooth_master(shape, state):
    scene, x = prepared(shape, STATES[state], bend=0.1, master=4, smoothing_angle=0.5)
    _, trial = scene.residual(x)
    assert np.count_nonzero(trial.pressure) >= 2
    assert scene.error(x) < 1e-9


def mirrored(shape, state, pressure):
    """A smooth master that goes on as its image beyond all of its ends."""
    held = held_ends(shape, 2)
    options = {"smoothing_angle": 0.5, "held": held, "pressure": pressure}
    scene, x = prepared(shape, state, bend=0.1, master=2, **options)
    free = np.ones(scene.size)
    for axis, nodes in enumerate(held):
        free[scene.dim * nodes + axis] = x.array[scene.dim * nodes + axis] = 0.0
    return scene, x, free


@pytest.mark.parametrize("pressure", ["averaged", "pointwise"])
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize(("shape", "count"), [("Q4", 2), ("hex8", 16)])
def test_tangent_beside_planes_of_symmetry(shape, count, state, pressure):
    """Three nodes by three become five by five, in space, with images of images."""
    scene, x, free = mirrored(shape, STATES[state], pressure)
    assert len(scene.surface.master.images.of) == count
    force, trial = scene.residual(x)
    assert np.count_nonzero(trial.pressure) >= 2
    assert scene.error(x, free=free) < 1e-9
    np.testing.assert_allclose(force.reshape(-1, scene.dim).sum(axis=0), 0.0, atol=1e-13)
    # Explicit steps have the same forces.
    explicit = explicit_contact(scene.term)
    u, out = NodalVector(scene.space), NodalVector(scene.space)
    u.owned[:] = x.array_r
    explicit.evaluate(u, 1.0)
    explicit.add_forces(out)
    np.testing.assert_allclose(out.owned, force, atol=1e-12 * np.abs(force).max())


@pytest.mark.parametrize("shape", ["Q4", "tet4", "hex8", "tet10"])
@pytest.mark.parametrize("state", GROOVES)
def test_tangent_of_points_on_edges(shape, state):
    """In the plane these are corners."""
    scene, x = prepared(shape, GROOVES[state], bend=0.4, fine=True, degree=5)
    _, trial = scene.residual(x)
    assert np.count_nonzero(trial.projection.clamped & trial.kinematics.closed) >= 3
    assert scene.error(x) < 1e-9


def test_tangent_of_points_at_a_corner():
    """Few points hang in a pit: a master whose middle node is pulled down."""
    for state in STATES["stick"], STATES["slip"]:
        scene, x = prepared("tet4", state, bend=0.0, fine=True, degree=5)
        middle = np.argmin(np.linalg.norm(scene.where - [1 / 3, 0.55, 0.0], axis=1))
        x.array[3 * middle + 2] -= 0.5
        x.array[2::3][scene.where[:, 2] > 0.5 * GAP] -= 0.6
        trial = scene.term.evaluate(x, 1.0)
        along = trial.projection.along
        corner = trial.projection.clamped & trial.kinematics.closed & ~along.any(axis=1)
        assert np.count_nonzero(corner) >= 2
        assert scene.error(x) < 1e-9


@pytest.mark.parametrize("shape", ["T6", "Q9", "tet4", "hex8", "hex27"])
def test_momentum_balances(shape):
    """Forces sum to zero; moments up to ∫ g n × T."""
    scene, x = prepared(shape, STATES["slip"])
    force, trial = scene.residual(x)
    force = force.reshape(-1, scene.dim)
    assert np.abs(force).max() > 1e-3
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-13)
    where = scene.where + x.array_r.reshape(-1, scene.dim)
    k, T = trial.kinematics, trial.response.traction
    lever = scene.surface.slave.weight @ (k.gap[:, None] * cross(k.normal, T))
    np.testing.assert_allclose(cross(where, force).sum(axis=0), lever, atol=1e-13)


def cross(a, b):
    """Cross products (q, 1) or (q, 3)."""
    if a.shape[1] == 3:
        return np.cross(a, b)
    return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])[:, None]


@pytest.mark.parametrize("shape", ["tet4", "hex8", "hex27", "T6"])
def test_gross_sliding_is_the_same_in_all_directions(shape):
    """A flat master: traction μ p against the slip, whatever the direction."""
    scene = Scene(shape, coulomb(0.3))
    down = [0.0] * (scene.dim - 1) + [-GAP - 0.02]
    scene.term.commit(scene.term.evaluate(scene.vector(down, 0.0, 0.0), 1.0))
    angles = [0.0, np.pi] if scene.dim == 2 else np.linspace(0.0, 6.0, 7)
    for angle in angles:
        way = np.array([np.cos(angle), np.sin(angle)])[: scene.dim - 1]
        _, trial = scene.residual(scene.vector([*(0.1 * way), down[-1]], 0.0, 0.0))
        np.testing.assert_allclose(trial.pressure, 0.02 * PENALTY, rtol=1e-10)
        expected = 0.3 * 0.02 * PENALTY * np.broadcast_to(way, (len(trial.pressure), len(way)))
        np.testing.assert_allclose(trial.response.traction[:, :-1], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("shape", ["Q4", "tet4", "hex8", "hex27", "tet10"])
def test_rigid_motion_of_both_bodies_leaves_the_contact_alone(shape):
    """After a step with friction: no slip, the same elastic slip and energy, forces turned."""
    scene, x = prepared(shape, STATES["stick"], fine=True)
    first = scene.term.evaluate(x, 1.0)
    scene.term.commit(first)
    dim, moved = scene.dim, x.copy()
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(dim, dim)))[0]
    turn[0] *= np.linalg.det(turn)
    now = scene.where + x.array_r.reshape(-1, dim)
    moved.array[:] = (now @ turn.T + [0.4, -0.3, 0.2][:dim] - scene.where).reshape(-1)
    trial = scene.term.evaluate(moved, 1.0)
    np.testing.assert_allclose(trial.kinematics.slip, 0.0, atol=1e-12)
    np.testing.assert_allclose(trial.traction, first.traction @ turn.T, rtol=0, atol=1e-10)
    before, after = first.response.state.elastic_slip, trial.kinematics.elastic_slip
    np.testing.assert_allclose(after, before @ turn.T, rtol=0, atol=1e-13)
    assert np.linalg.norm(before, axis=1).max() > 1e-3
    energies = [scene.term.interface_energy(one) for one in (trial, first)]
    assert energies[0] == pytest.approx(energies[1], rel=1e-10)
    assert np.linalg.norm(first.response.traction, axis=1).max() > 0.1


@pytest.mark.parametrize("shape", ["Q4", "hex8"])
def test_tangent_after_a_way_is_that_of_a_fresh_one(shape):
    """The same points on other master facets, then with other vertices closed."""
    scene, _ = prepared(shape, STATES["slip"], fine=True, degree=5, master=8)
    found = []
    for shift, down, waves in ((0.0, -0.12, 0.0), (0.1, -0.12, 0.0), (0.1, -0.05, 0.02)):
        x = scene.vector([shift, 0.0, down][:: 4 - scene.dim], 0.0, 0.0, waves)
        trial = scene.term.evaluate(x, 1.0)
        fresh = PairTangent(scene.surface, scene.term.rule)
        mine, its = (Dense(scene.dim, len(scene.where)) for _ in range(2))
        scene.term.add_tangent(trial, mine.entries())
        fresh.add(scene.term.state, trial, its.entries())
        np.testing.assert_array_equal(mine.values, its.values)
        found.append((trial.kinematics.closed.sum(), trial.projection.facet))
    assert found[0][0] == found[1][0] > found[2][0]
    assert not np.array_equal(found[0][1], found[1][1])
