"""The stable step: stable below what is reported, unstable above the exact limit."""

import numpy as np
import pytest

from tests.laws import coulomb, viscous_map
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.explicit.energies import ExplicitError
from tribox.app.explicit.stable_step import LOOK, ExplicitOptions
from tribox.app.explicit.stepper import ExplicitStepper, MassScaling
from tribox.app.implicit.newton import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.forms.friction.coulomb import FrictionlessLaw

NEVER = 10**9
DEPTH = 0.02


def pressed(pair, law, penalty, film=0.0, pressure="averaged"):
    """Two blocks pressed together between rigid plates, at rest, with their history."""
    blocks = pair()
    held = [blocks.held(s, c) for s in ("bottom", "top") for c in (0, 1)]
    problem = blocks.problem(law, penalty, film, prescribed=held, degree=3, pressure=pressure)
    for solid in problem.solids:
        solid.density = 1.0
    problem.u.x.array[:] = 0.0
    held[3].value = -DEPTH
    implicit = ImplicitStepper(problem, ImplicitOptions(tolerance=1e-11))
    implicit.rate_dependent = False
    assert implicit.attempt(1.0).converged
    implicit.commit()
    return problem, implicit.x.array_r.copy()


def stepper(problem, x, seed=0, size=1e-7, **options):
    shaken = size * np.random.default_rng(seed).standard_normal(len(x))
    shaken[problem.constrained_dofs()] = 0.0
    return ExplicitStepper(
        problem, ExplicitOptions(check_every=NEVER, **options), displacement=x, velocity=shaken
    )


def dense(problem, stepper, x, dt=1.0, rate_dependent=True):
    """Tangent and masses of the free unknowns, from the implicit solution's exact tangent."""
    vec = problem.new_vector()
    vec.array[:] = x
    matrix = problem.new_matrix(vec)
    step = StepMode.of_stage(dt, problem.contacts, rate_dependent)
    problem.assemble_tangent(vec, matrix, step)
    free = np.setdiff1d(np.arange(problem.owned), problem.constrained_dofs())
    rows, columns, values = matrix.getValuesCSR()
    full = np.zeros((problem.owned, problem.owned))
    for row in range(problem.owned):
        full[row, columns[rows[row] : rows[row + 1]]] = values[rows[row] : rows[row + 1]]
    return full[np.ix_(free, free)], stepper.dynamics.mass[free]


def growth(stepper, dt, steps):
    """Largest velocity after many steps over the largest at the start."""
    before = np.abs(stepper.v).max()
    with np.errstate(all="ignore"):
        for _ in range(steps):
            try:
                stepper.advance(dt)
            except ExplicitError:
                return np.inf
    return np.abs(stepper.v).max() / before


def without_dashpots(one):
    for contact in one.contacts:
        contact.dashpots, contact.set_dashpots = None, lambda *given: None
    return one


@pytest.mark.parametrize(("penalty", "kind"), [(20.0, "averaged"), (800.0, "pointwise")])
def test_penalty_contact(pair, penalty, kind):
    """The bodies limit the step at the low penalty, the contact at the high one."""
    law = coulomb(0.5, 30.0)
    problem, x = pressed(pair, law, penalty, pressure=kind)
    one = stepper(problem, x)
    stiffness, mass = dense(problem, one, x)
    exact = 2.0 / np.sqrt(np.linalg.eigvals(stiffness / mass[:, None]).real.max())
    found = one.estimate()
    assert (found.penalty < 0.7 * found.elements) == (penalty > 100.0)
    # Points that are open now count as closed, and the estimate is on the safe side.
    assert 0.97 * exact < found.penalty < 1.001 * exact
    assert found.limit <= found.penalty
    # What dashpots there are, they take from the step only beyond that limit.
    assert growth(one, found.limit, 1500) < 20.0
    problem, x = pressed(pair, law, penalty, pressure=kind)
    assert growth(without_dashpots(stepper(problem, x)), 0.95 * found.penalty, 1500) < 20.0
    assert growth(stepper(problem, x), 1.1 * exact, 400) > 1e3


def test_what_opens_and_closes_needs_a_shorter_step(pair):
    """Dozens of rebounds on stiff springs alone: the energy runs away at the linear limit."""
    problem, x = pressed(pair, FrictionlessLaw(), 800.0)
    x[:] = 0.0
    problem.prescribed[3].value = 0.0
    state = problem.contacts[0].state
    energies = {}
    for share in ("reported", "linear"):
        problem.contacts[0].adopt(state)
        one = ExplicitStepper(
            problem,
            ExplicitOptions(check_every=NEVER),
            displacement=x,
            velocity=thrown(problem, pair(), -0.02),
        )
        found = one.estimate()
        assert found.limit == found.closing < 0.75 * found.penalty
        assert "opening and closing" in found.reason
        start = one.kinetic_energy()
        one = one if share == "reported" else without_dashpots(one)
        while one.time < 30.0:
            one.advance(0.95 * (found.limit if share == "reported" else found.penalty))
        term = problem.contacts[0]
        stored = one.bodies.strain_energy() + term.interface_energy(problem.trials[0])
        energies[share] = (stored + one.kinetic_energy() + one.energies.damped) / start
    # At the very limit closing springs lose some more than the dashpots take; nothing is made.
    assert 0.85 < energies["reported"] < 1.0
    assert energies["linear"] > 2.5


def thrown(problem, blocks, speed):
    velocity = np.zeros((problem.owned // 2, 2))
    velocity[blocks.nodes("elastomer"), 1] = speed
    velocity = velocity.reshape(-1)
    velocity[problem.constrained_dofs()] = 0.0
    return velocity


def test_a_film_does_not_limit_the_step(pair):
    """Stable at 0.95 of the step of the bodies and the penalty, far beyond that of the film."""
    problem, x = pressed(pair, viscous_map(2000.0), 20.0, film=0.5)
    one = stepper(problem, x)
    found = one.estimate()
    (stiffness, mass), (whole, _) = dense(problem, one, x, 1.0, False), dense(problem, one, x)
    fastest = np.linalg.eigvals((whole - stiffness) / mass[:, None]).real.max()
    assert 2.0 / fastest < 0.02 * found.penalty  # where explicit dashpots would be stable
    # The film takes energy from the shaken blocks: what is left is less than there was.
    assert growth(one, 0.95 * found.penalty, 1500) < 5.0


def test_an_inverted_element_ends_the_run_with_place_and_time(pair):
    problem, x = pressed(pair, FrictionlessLaw(), 20.0)
    where = problem.space.tabulate_dof_coordinates()
    nodes = pair().nodes("elastomer")
    middle = nodes[np.abs(where[nodes, 1] - 0.25) < 0.01]
    corner = middle[np.argmax(where[middle, 0])]
    velocity = np.zeros(problem.owned)
    velocity[2 * corner] = -8.0
    options = ExplicitOptions(check_every=10)
    one = ExplicitStepper(problem, options, displacement=x, velocity=velocity)
    with pytest.raises(ExplicitError, match="inside out") as error:
        for _ in range(200):
            one.advance(1e-3)
    assert error.value.time == pytest.approx(one.time + 1e-3)
    # What is left is the state before, and the contact is that of its places.
    u, [trial] = problem.u.x.array, problem.committed
    assert one.bodies.evaluate(u, np.zeros_like(u))
    surface = problem.contacts[0].surface
    slave = surface.gather(one.x)[surface.slave_rows]
    points = problem.contacts[0].surface.slave_positions(slave)
    assert np.allclose(points, trial.position, rtol=0, atol=1e-14)
    assert np.linalg.norm(np.array(error.value.place) - where[corner, :2]) < 0.3
    assert f"{error.value.place[0]:.4g}" in str(error.value)


def test_energy_from_nowhere_ends_the_run(pair):
    problem, x = pressed(pair, FrictionlessLaw(), 20.0)
    one = ExplicitStepper(
        problem,
        ExplicitOptions(check_every=1),
        displacement=x,
        velocity=1e-9 * np.random.default_rng(0).standard_normal(problem.owned),
    )
    with pytest.raises(ExplicitError, match="energy runs away") as error:
        for _ in range(500):
            one.advance(1.02 * one.estimate().penalty)
    assert 0.0 < error.value.time <= one.time and len(error.value.place) == 2


def test_the_estimate_follows_the_deformation(pair):
    """Compressed to a half, cells pass a wave in less time; the estimate is renewed when due."""
    problem, x = pressed(pair, FrictionlessLaw(), 20.0)
    one = stepper(problem, x, size=0.0, reestimate_every=NEVER)
    before = one.estimate()
    one.state.steps += LOOK
    assert one.estimate() is before
    where = problem.space.tabulate_dof_coordinates()[: problem.owned // 2, :2]
    one.problem.u.x.array.reshape(-1, 2)[:, 1] -= 0.4 * where[:, 1]
    one.state.steps += LOOK - 1
    assert one.estimate() is before
    one.state.steps += 1
    assert one.estimate().elements < 0.8 * before.elements


def test_the_estimate_is_renewed_after_a_number_of_steps(pair):
    one = stepper(*pressed(pair, FrictionlessLaw(), 20.0), size=0.0, reestimate_every=5)
    before = one.estimate()
    one.state.steps += 4
    assert one.estimate() is before
    one.state.steps += 1
    assert one.estimate() is not before


# -- mass scaling ---------------------------------------------------------------------------------


def test_uniform_mass_scaling(pair):
    problem, x = pressed(pair, FrictionlessLaw(), 20.0)
    plain = stepper(problem, x)
    scaled = stepper(problem, x, mass_scaling=MassScaling("uniform", factor=4.0))
    assert scaled.estimate().limit == pytest.approx(2.0 * plain.estimate().limit, rel=1e-2)
    assert scaled.masses.added == pytest.approx(3.0 * 1.5)  # both blocks weigh 1.5
    assert scaled.masses.original == pytest.approx(1.5)
    wanted = 3.0 * plain.estimate().limit
    reached = stepper(problem, x, mass_scaling=MassScaling("uniform", step=wanted))
    assert wanted * 0.99 < reached.estimate().penalty < 1.6 * wanted


def test_mass_only_where_the_step_is_limited(pair):
    """The lighter upper block alone is made heavier, but for what the contact asks for."""
    problem, x = pressed(pair, FrictionlessLaw(), 2.0)
    problem.solids[1].density = 4.0
    plain = stepper(problem, x)
    wanted = 1.2 * plain.estimate().penalty
    scaled = stepper(problem, x, mass_scaling=MassScaling("limiting", step=wanted))
    assert 0.99 * wanted < scaled.estimate().penalty < 1.2 * wanted
    ratio = (scaled.dynamics.mass / plain.dynamics.mass).reshape(-1, 2)[:, 0]
    blocks = pair()
    np.testing.assert_allclose(ratio[blocks.nodes("aluminium")], 1.0)
    assert ratio[blocks.nodes("elastomer")].min() > 1.2
    assert scaled.masses.scaled == pytest.approx(12.0 / 26.0)
    assert scaled.masses.added == pytest.approx(scaled.dynamics.mass.sum() / 2.0 - 4.5)
    same = stepper(problem, x, mass_scaling=MassScaling("limiting", step=1e-3 * wanted))
    assert same.masses.added == 0.0 and same.masses.scaled == 0.0
    problem.contacts[0].rule.penalty[:] = 400.0
    stiff = stepper(problem, x, mass_scaling=MassScaling("limiting", step=wanted))
    assert stiff.estimate().penalty > 0.99 * wanted
    assert stiff.masses.added > 1.5 * scaled.masses.added
    assert stiff.dynamics.mass[2 * blocks.nodes("aluminium")].sum() > 4.0
