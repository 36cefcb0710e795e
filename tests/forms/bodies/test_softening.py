"""Softening by the largest load: closed forms in tension, tangents, what it costs, both solvers."""

import tomllib
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import erf

from tests.app.checkpoint.going_on import case_of
from tests.app.simulation.test_creeping_bodies import block
from tests.forms.bodies.test_viscous_points import BRANCHES, PLANE, identity, some
from tests.solved import solved as run
from tribox.app.results.probes import BodyProbes
from tribox.forms.bodies.materials import MooneyRivlin, NeoHookean, Ogden, Yeoh
from tribox.forms.bodies.point_state import PointsBeside
from tribox.forms.bodies.softening import LARGEST, Mullins, SofteningPoints
from tribox.forms.bodies.viscous_points import Viscoelastic, ViscousPoints

ENERGIES = [
    NeoHookean(1.0, 50.0),
    MooneyRivlin(0.4, 0.1, 50.0),
    Yeoh(0.5, -0.05, 0.02, 50.0),
    Ogden((1.0, -0.2), (1.5, -2.0), 50.0),
]
LAW = Mullins(1.5, 0.05, 0.1)


@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize("elastic", ENERGIES, ids=lambda energy: type(energy).__name__)
def test_tangent_and_stress_are_derivatives(elastic, space):
    """Of the stress, and of what is stored, below the largest energy; above it nothing is taken."""
    points, F = SofteningPoints(elastic, LAW, space), some(space)
    state = np.full((20, 1), 0.3)
    along, step = np.random.default_rng(1).normal(size=F.shape), 3e-6
    found = points.update(F, state, 1.0, True)
    sides = [points.update(F + s * step * along, state, 1.0, False) for s in (1.0, -1.0)]
    below = found.state[:, 0] == 0.3
    assert 5 < below.sum() and (found.P[~below] == 0.0).all() and (found.A[~below] == 0.0).all()
    slope = (sides[0].P - sides[1].P)[below] / (2.0 * step)
    product = np.einsum("npq,nq->np", found.A, along)[below]
    assert np.abs(product - slope).max() < 1e-7 * np.abs(slope).max()
    assert np.abs(found.A - found.A.transpose(0, 2, 1)).max() <= 1e-13 * np.abs(found.A).max()
    energy = (sides[0].elastic - sides[1].elastic)[below] / (2.0 * step)
    power = (found.P * along).sum(axis=1)[below]
    np.testing.assert_allclose(power, energy, rtol=0, atol=1e-7 * np.abs(energy).max())


def test_the_plane_is_a_part_of_space_and_what_is_inside_out_is_not_remembered():
    plane, space = (SofteningPoints(ENERGIES[1], LAW, s) for s in (False, True))
    F, wide = some(False), np.zeros((20, 9))
    wide[:, PLANE] = F
    state = np.full((20, 1), 0.5)
    one, other = (p.update(f, state, 1.0, True) for p, f in ((plane, F), (space, wide)))
    np.testing.assert_allclose(other.P[:, PLANE], one.P, rtol=0, atol=1e-14)
    np.testing.assert_allclose(other.A[:, PLANE][:, :, PLANE], one.A, rtol=0, atol=1e-13)
    F[3] *= -1.0
    bad = plane.update(F, state, 1.0, True)
    assert not bad.valid and np.isnan(bad.P[3]).all() and np.isfinite(bad.P[2]).all()
    assert bad.state[3] == 0.5


def test_a_closed_way_costs_what_was_dissipated():
    """Work of what softening adds, over a way there and back, against D: 1e-6 of it."""
    points, whole = SofteningPoints(ENERGIES[0], LAW, False), np.zeros(2)
    state, before = points.start(1), None
    for t in np.linspace(0.0, np.pi, 4001):
        F = identity(False)[None] + np.sin(t) * np.array([[0.3, 0.4, 0.1, -0.1, 0.0]])
        now = points.update(F, state, 1.0, False)
        if before is not None:
            whole += 0.5 * ((before[1] + now.P) * (F - before[0])).sum(), now.dissipation[0]
        state, before = now.state, (F, now.P)
    assert whole[1] == pytest.approx(LAW.lost(state[:, 0])[0], rel=1e-9)
    assert whole[0] == pytest.approx(whole[1], rel=1e-6) and whole[1] > 0.01
    assert now.elastic[0] == pytest.approx(0.0, abs=1e-9 * whole[1])


def test_branches_and_softening_add_up():
    body = Viscoelastic(ENERGIES[0], BRANCHES, LAW)
    both = body.points(False)
    assert isinstance(both, PointsBeside) and both.rated and both.columns[LARGEST].start == 18
    F, parts = (
        some(False),
        (ViscousPoints(BRANCHES, False), SofteningPoints(body.elastic, LAW, False)),
    )
    first = both.update(some(False, seed=4), both.start(20), 0.2, False)
    found = both.update(F, first.state, 0.2, True)
    apart = [p.update(F, np.ascontiguousarray(s), 0.2, True)
             for p, s in zip(parts, np.split(first.state, [18], axis=1), strict=True)]  # fmt: skip
    for name in ("P", "A", "elastic", "dissipation"):
        np.testing.assert_array_equal(getattr(found, name), sum(getattr(x, name) for x in apart))
    np.testing.assert_array_equal(found.state, np.hstack([x.state for x in apart]))
    assert found.dissipation.min() >= 0.0 and body.shear_modulus == 1.0 + 1.3


RING = """
boundary = [
 { surface = "rubber_bottom", displacement = { y = 0 } },
 { surface = "rubber_left", displacement = { x = 0 } },
 { surface = "rubber_top" },
]
stage = [{ name = "pull", duration = 4 }]
solver = { tolerance = 1e-11 }
[geometry]
kind = "blocks"
section = "axisymmetric"
blocks = { rubber = { x = ["0 m", "1 m"], y = ["0 m", "1 m"], elements = [1, 1] } }
[bodies.rubber]
material = "neo-hookean"
G = 1e6
K = 1e8
mullins = { r = 1.5, m = "0.2 MPa", beta = 0.1 }
"""
TURNS = [1.0, 2.0, 1.2, 2.4, 1.0]  # stretches at whole seconds: pulled, let go, pulled again


def in_tension(stretch, largest):
    """Nominal stress, Pa, and distortional energy, J/m³, of the bar as RING has it."""
    G, K, r, m, beta = 1e6, 1e8, 1.5, 0.2e6, 0.1

    def energy(across):
        squares, J = stretch**2 + 2.0 * across**2, stretch * across**2
        return 0.5 * G * (squares - 3.0) - G * np.log(J)

    def left(across):
        most = max(largest, energy(across))
        return 1.0 - erf((most - energy(across)) / (m + beta * most)) / r

    def stress(x, across):
        volume = (K - 2.0 / 3.0 * G) * np.log(stretch * across**2)
        return left(across) * G * (x - 1.0 / x) + volume / x

    across = brentq(lambda a: stress(a, a), 0.3, 1.1, xtol=1e-15)
    return stress(stretch, across), energy(across)


@pytest.fixture(scope="module")
def pulled():
    """Stretches, and the run of the bar that is pulled, let go and pulled further."""
    data = tomllib.loads(RING)
    data["boundary"][2]["displacement"] = {"y": [[t, x - 1.0] for t, x in enumerate(TURNS)]}
    data["stage"][0]["steps"] = 40
    done = run(case_of(data, fields_every=0))
    return np.interp(np.array([row.time for row in done.rows]), range(5), TURNS), done


def test_a_bar_pulled_let_go_and_pulled_again_follows_the_closed_form(pulled):
    stretches, done = pulled
    forces = done.state.motion.of_surface("rubber_top", "force_y") / np.pi
    largest, softer, lost = 0.0, [], 0.0
    law = Mullins(1.5, 0.2e6, 0.1)
    for stretch, force, row in zip(stretches, forces, done.rows, strict=True):
        wanted, energy = in_tension(stretch, largest)
        largest = max(largest, energy)
        assert abs(force) == pytest.approx(abs(wanted), rel=1e-6, abs=1.0)
        softer.append(wanted / in_tension(stretch, 0.0)[0] if stretch > 1.0 else 1.0)
        lost = np.pi * law.lost(np.array([largest]))[0]
        assert row.viscous_dissipation == pytest.approx(lost, rel=1e-6, abs=1e-3)
    assert min(softer) < 0.6 and max(row.newton_iterations for row in done.rows) <= 9
    last = done.rows[-1]
    assert last.strain_energy == pytest.approx(0.0, abs=1e-6 * lost)
    assert abs(last.energy_error) < 0.01 * max(row.external_work for row in done.rows)
    probe = BodyProbes(done.model, [("whole", "rubber")])
    assert dict(zip(probe.columns, probe.rows()[0], strict=True))["softening_dissipation"] == (
        pytest.approx(lost, rel=1e-6)
    )


def test_both_solvers_find_the_same():
    """Pressed and let go, with a branch: work, stored energy, loss and what softening took."""
    way = {"x": 0, "y": [["0 s", 0], ["0.5 ms", "-0.15 mm"], ["1 ms", "-0.03 mm"]]}
    rubber = {"mullins": {"r": 1.3, "m": "10 kPa", "beta": 0.1}, "prony": [[0.4, "0.2 ms"]]}
    found = []
    for solver in ({"kind": "implicit"}, {"kind": "explicit", "damping": "2000 1/s"}):
        done = block("plane-strain", steps=80, rubber=rubber, solver=solver, way=way)
        last = done.rows[-1]
        assert abs(last.energy_error) < 3e-3 * max(row.external_work for row in done.rows)
        (body,) = done.model.problem.solids
        softening = body.dissipated[0] - body.dissipated_by_part.sum()
        found.append([last.external_work, last.strain_energy, last.viscous_dissipation, softening])
        rising = [row.viscous_dissipation for row in done.rows]
        assert all(b >= a for a, b in pairwise(rising))
    slow, fast = found
    np.testing.assert_allclose(fast[:3], slow[:3], rtol=0.02, atol=0.01 * slow[2])
    assert slow[3] * done.model.thickness > 0.05 * slow[2]
