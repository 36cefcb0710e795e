"""Explicit steps against closed forms: impact, free flight, loads, films; and their energy."""

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from tests.laws import coulomb, viscous_map
from tribox.app.equilibrium.constraints import Platen, Prescribed, component_dofs
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.explicit.energies import EnergyWatch, ExplicitError
from tribox.app.explicit.stable_step import ExplicitOptions
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.forms.bodies.loads import FollowerPressure
from tribox.forms.bodies.materials import NeoHookean, Ogden
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.penalty import ContactTerm
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.surfaces.surface import ContactSurface

SOFT, HARD = NeoHookean(1.0, 2.0), NeoHookean(2.0, 4.0)
DENSITY = 1.5


class Bench:
    """Two blocks, the upper over the lower, and what is needed to move them."""

    def __init__(self, upper, lower, gap=0.0, formulation="q1", materials=(SOFT, HARD)):
        self.named = generate(
            TwoBlocks(Block(*upper), Block(*lower), 0.5 * (lower[0] - upper[0]), gap), MPI.COMM_SELF
        )
        self.space = dolfinx.fem.functionspace(self.named.mesh, ("Lagrange", 1, (2,)))
        self.u = dolfinx.fem.Function(self.space)
        self.solids = [
            Solid(name, self.u, self.named.cells(name), material, formulation, DENSITY)
            for name, material in zip(("elastomer", "aluminium"), materials, strict=True)
        ]

    def contact(self, law, penalty, film=0.0, degree=3, pressure="averaged"):
        facets = map(self.named.facets, ("elastomer_contact", "aluminium_contact"))
        surface = ContactSurface(self.space, *facets, degree)
        return ContactTerm(surface, law, penalty, film, pressure)

    def dofs(self, surface, component):
        return component_dofs(self.space, self.named.facets(surface), component)

    def body(self, name):
        """Unknowns (n, 2) of a body's nodes."""
        nodes = np.unique(np.asarray(self.space.dofmap.list)[self.named.cells(name)])
        return 2 * nodes[:, None] + np.arange(2)

    def problem(self, contacts=(), **loads):
        return Equilibrium(self.u, self.solids, list(contacts), **loads)


def stored(stepper):
    """Strain, interface and kinetic energy."""
    problem = stepper.problem
    pairs = zip(problem.contacts, problem.trials, strict=True)
    at_rest = stepper.bodies.strain_energy()
    at_rest += sum(term.interface_energy(trial) for term, trial in pairs)
    return at_rest + stepper.kinetic_energy()


class IntervalAverages:
    """Dissipation of the contacts by the trapezoidal rule, step by step."""

    def __init__(self, stepper):
        self.stepper, self.lost, self.least = stepper, 0.0, np.inf
        self.before = [t.state.friction_traction.copy() for t in stepper.problem.contacts]

    def enter(self):
        for number, trial in enumerate(self.stepper.problem.trials):
            weight = self.stepper.problem.contacts[number].surface.slave.weight
            parts, slip = trial.response.dissipation, trial.kinematics.slip
            jump = trial.response.traction - self.before[number]
            self.lost += weight @ (parts.total - 0.5 * np.sum(jump * slip, axis=1))
            self.least = min(self.least, float((parts.total - parts.numerical).min()))
            self.before[number] = trial.response.traction.copy()


# -- free flight -----------------------------------------------------------------------------------


def ringing(dt, end=3.0):
    """Largest relative energy error of a block that rings freely at large strain."""
    bench = Bench((1.0, 1.0, (5, 4)), (1.5, 1.0, (3, 3)), gap=5.0)
    where = bench.space.tabulate_dof_coordinates()[:, :2]
    velocity = 0.4 * np.sin(3.0 * where[:, ::-1] + [0.3, 1.0]).reshape(-1)
    stepper = ExplicitStepper(bench.problem(), velocity=velocity)
    start, error = stored(stepper), 0.0
    while stepper.time < end:
        stepper.advance(dt)
        error = max(error, abs(stored(stepper) - start) / start)
    assert stepper.energies.work == 0.0
    return error


def test_energy_of_free_flight_is_kept_to_second_order():
    coarse, fine = ringing(0.04), ringing(0.02)
    assert coarse < 0.01
    assert coarse / fine == pytest.approx(4.0, rel=0.4)


# -- loads --------------------------------------------------------------------------------


def test_platen_is_a_rigid_edge_with_a_mass_of_its_own():
    """The centre of mass of block and platen follows the force; the edge stays straight."""
    bench = Bench((1.0, 1.0, (4, 3)), (1.5, 1.0, (2, 2)), gap=1.0)
    platen = Platen(bench.dofs("top", 1), force=0.05, mass=0.7)
    stepper = ExplicitStepper(bench.problem(platens=[platen]))
    dofs = bench.body("elastomer")[:, 1]
    for _ in range(200):
        stepper.advance(0.02)
        edge = stepper.x.array_r[platen.dofs]
        assert np.ptp(edge) == 0.0
    assert stepper.dynamics.mass[dofs].sum() == pytest.approx(DENSITY + 0.7)
    momentum = float(stepper.dynamics.mass[dofs] @ stepper.v[dofs])
    assert momentum == pytest.approx(0.05 * (4.0 - 0.01), rel=1e-12)
    assert stepper.energies.work == pytest.approx(0.05 * edge[0], rel=1e-12)
    assert stored(stepper) == pytest.approx(stepper.energies.work, rel=1e-3)


def test_block_on_a_spring():
    """Period 2π √(m/k) of a rigid block, whose far end of the spring is moved by a jump."""
    bench = Bench((1.0, 1.0, (2, 2)), (1.5, 1.0, (2, 2)), gap=1.0, materials=(HARD, HARD))
    stiffness = 0.02
    platen = Platen(bench.dofs("top", 1), stiffness=stiffness, end=0.1)
    stepper = ExplicitStepper(bench.problem(platens=[platen]))
    period = 2.0 * np.pi * np.sqrt(DENSITY / stiffness)
    dt = 0.9 * stepper.stable_step()
    places = []
    for _ in range(int(period / dt)):
        stepper.advance(dt)
        places.append(stepper.x.array_r[platen.dofs[0]])
    time = dt * np.arange(1, len(places) + 1)
    expected = 0.1 * (1.0 - np.cos(2.0 * np.pi * time / period))
    np.testing.assert_allclose(places, expected, atol=2e-3)
    assert stored(stepper) == pytest.approx(stepper.energies.work, abs=2e-6)


def test_a_stiff_spring_is_in_the_stable_step():
    bench = Bench((1.0, 1.0, (2, 2)), (1.5, 1.0, (2, 2)), gap=1.0)
    platen = Platen(bench.dofs("top", 1), stiffness=500.0)
    found = ExplicitStepper(bench.problem(platens=[platen])).estimate()
    edge_mass = DENSITY / 4.0
    assert found.limit == pytest.approx(2.0 / np.sqrt(500.0 / edge_mass), rel=0.05)
    assert found.limit < 0.5 * found.elements


def test_the_energy_balance_closes_with_all_loads_together():
    """Supports that move, a follower pressure, a platen with a mass, friction and damping."""
    bench = Bench((1.0, 0.6, (5, 3)), (1.8, 0.6, (6, 3)))
    term = bench.contact(coulomb(0.4), 60.0)
    held = [Prescribed(bench.dofs("bottom", 0)), Prescribed(bench.dofs("bottom", 1))]
    held.append(Prescribed(bench.dofs("top", 0)))
    platen = Platen(bench.dofs("top", 1), mass=0.2)
    load = FollowerPressure(bench.u, bench.named.facets("elastomer_left"))
    problem = bench.problem([term], prescribed=held, platens=[platen], loads=[load])
    stepper = ExplicitStepper(problem, ExplicitOptions(damping=0.3))
    averages, work, dt = IntervalAverages(stepper), 0.0, 0.02
    while stepper.time < 6.0:
        rise = min((stepper.time + dt) / 3.0, 1.0)
        rise = rise**3 * (10.0 - 15.0 * rise + 6.0 * rise**2)
        held[1].value, held[2].value = 0.03 * rise, 0.15 * rise
        platen.force = -0.2 * rise
        load.set(0.1 * rise)
        stepper.advance(dt)
        averages.enter()
        work = max(work, abs(stepper.energies.work))
    assert averages.lost > 0.05 * work and stepper.energies.damped > 1e-3 * work
    assert averages.least >= -1e-15
    error = stepper.energies.work - stored(stepper) - averages.lost - stepper.energies.damped
    assert abs(error) < 4e-5 * work


def test_supports_that_speed_up_pay_for_the_mass_they_carry():
    """Their own nodes' kinetic energy is work of theirs, at every moment of the motion."""
    bench = Bench((1.0, 1.0, (2, 2)), (1.5, 1.0, (3, 2)), gap=1.0)
    support = Prescribed(bench.dofs("bottom", 0))
    stepper = ExplicitStepper(bench.problem(prescribed=[support]))
    dt = 0.02
    for step in range(1, 151):
        support.value = 0.5 * 0.1 * (step * dt) ** 2
        stepper.advance(dt)
        carried = 0.5 * stepper.dynamics.mass[support.dofs] @ stepper.v[support.dofs] ** 2
        assert abs(stepper.energies.work - stored(stepper)) < 1e-3 * carried
    assert carried > 0.05 * stepper.energies.work


def test_rest_stops_all_but_the_supports():
    bench = Bench((1.0, 1.0, (2, 2)), (1.5, 1.0, (2, 2)), gap=1.0)
    held = Prescribed(bench.dofs("bottom", 0))
    platen = Platen(bench.dofs("top", 1), force=0.1)
    stepper = ExplicitStepper(bench.problem(prescribed=[held], platens=[platen]))
    for _ in range(10):
        held.value += 0.001
        stepper.advance(0.02)
    stepper.rest()
    expected = np.zeros(len(stepper.v))
    expected[held.dofs] = 0.05
    np.testing.assert_allclose(stepper.v, expected, atol=1e-12)
    place = stepper.x.array_r[platen.dofs[0]]
    stepper.advance(0.02)
    assert stepper.x.array_r[platen.dofs[0]] - place < 0.02 * 0.02 * 0.1


# -- contact and film -----------------------------------------------------------------------------


def two_in_flight(law, film=0.0, pressure="averaged", **options):
    """Two free blocks that press on each other and slide apart; nothing else acts on them."""
    bench = Bench((1.0, 0.5, (5, 2)), (1.4, 0.5, (6, 2)))
    problem = bench.problem([bench.contact(law, 40.0, film, pressure=pressure)])
    velocity = np.zeros(problem.owned)
    velocity[bench.body("elastomer")] = [0.2, -0.15]
    velocity[bench.body("aluminium")] = [-0.1, 0.15]
    return ExplicitStepper(problem, ExplicitOptions(**options), velocity=velocity)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("kind", ["coulomb", "thin film", "map"])
def test_momentum_and_energy_are_balanced(kind, compiled):
    law, film = {
        "coulomb": (coulomb(0.4), 0.0),
        "thin film": (viscous_map(50.0), 0.5),
        "map": (viscous_map(5.0, alpha=0.5), 0.5),
    }[kind]
    stepper = two_in_flight(law, film, compiled=compiled)
    start, mass = stored(stepper), stepper.dynamics.mass.reshape(-1, 2)
    momentum = (mass * stepper.v.reshape(-1, 2)).sum(axis=0)
    averages, dt = IntervalAverages(stepper), 0.3 * stepper.stable_step()
    while stepper.time < 1.5:
        stepper.advance(dt)
        averages.enter()
    after = (mass * (stepper.v + 0.5 * dt * stepper.a).reshape(-1, 2)).sum(axis=0)
    np.testing.assert_allclose(after, momentum, atol=1e-14)
    assert averages.lost > 0.02 * start
    assert averages.least >= -1e-15
    assert stepper.energies.damped > 0.01 * start  # by the contact's dashpots
    lost = averages.lost + stepper.energies.damped
    assert stored(stepper) + lost == pytest.approx(start, rel=0.003)


def sliding(viscosity, law=None, penalty=40.0, **options):
    """A block pressed on a fixed one by a platen and dragged along at a speed that rises to 0.2."""
    bench = Bench((1.0, 0.4, (6, 2)), (2.4, 0.4, (13, 2)))
    term = bench.contact(law or viscous_map(viscosity), penalty, 0.5)
    held = [Prescribed(bench.dofs("bottom", k)) for k in (0, 1)]
    held.append(Prescribed(bench.dofs("top", 0)))
    platen = Platen(bench.dofs("top", 1))
    problem = bench.problem([term], prescribed=held, platens=[platen])
    return ExplicitStepper(problem, ExplicitOptions(**options)), held[2], platen


def drag(stepper, top, platen, dt, end, speed=0.2, pressure=0.3):
    """Press within 2 and move from 2 to 4 with a rising speed; returns the tangential force."""
    force = []
    while stepper.time < end - 1e-9:
        time = stepper.time + dt
        platen.force = -pressure * min(time / 2.0, 1.0)
        rise = min(max(time - 2.0, 0.0) / 2.0, 1.0)
        top.value = speed * (max(time - 4.0, 0.0) + 2.0 * (rise**3 - 0.5 * rise**4))
        stepper.advance(dt)
        weight = stepper.problem.contacts[0].surface.slave.weight
        force.append(float(weight @ stepper.problem.trials[0].response.traction[:, 0]))
    return np.array(force)


@pytest.mark.parametrize("viscosity", [0.5, 40.0])
def test_steady_sliding_on_a_film_is_exact(viscosity):
    """T = c V da/dA at every point, also where one step is many relaxation times."""
    speed = 0.04 if viscosity < 1.0 else 3e-3
    stepper, top, platen = sliding(viscosity, damping=3.0)
    dt = 0.9 * stepper.stable_step()
    drag(stepper, top, platen, dt, 14.0 if viscosity < 1.0 else 160.0, speed)
    contact, term = stepper.contacts[0], stepper.problem.contacts[0]
    stiffness = float((contact.film * dt * contact.compliance).max())
    assert stiffness > 30.0 if viscosity > 1.0 else stiffness < 2.0
    # Facets that pass each other make the speed ripple; the means over one passage do not.
    traction, expected = 0.0, 0.0
    steps = int(2.4 / 13.0 / speed / dt)
    for _ in range(steps):
        top.value += speed * dt
        stepper.advance(dt)
        slip = stepper.problem.trials[0].kinematics.slip[:, 0]
        traction = traction + stepper.problem.trials[0].response.traction[:, 0]
        expected = expected + viscosity * slip / dt * term.state.area_ratio
    np.testing.assert_allclose(traction, expected, rtol=5e-3)
    total = viscosity * speed * float(term.surface.slave.weight @ term.state.area_ratio)
    assert term.surface.slave.weight @ traction / steps == pytest.approx(total, rel=0.02)


def test_films_converge_in_transients():
    """To first order as the step falls."""
    histories = []
    for dt in (0.008, 0.004, 0.001):
        stepper, top, platen = sliding(3.0, damping=0.5)
        assert dt < stepper.stable_step()
        histories.append(
            drag(stepper, top, platen, dt, 3.6)[round(0.008 / dt) - 1 :: round(0.008 / dt)]
        )
    apart = [np.abs(one - histories[2]).max() / np.abs(histories[2]).max() for one in histories[:2]]
    assert apart[0] < 0.02
    assert apart[1] < 0.5 * apart[0]  # 3/7 of first order


def test_a_film_that_opens_loses_its_traction():
    stepper, top, platen = sliding(500.0)
    dt = 0.9 * stepper.stable_step()
    drag(stepper, top, platen, dt, 5.0)
    assert np.abs(stepper.contacts[0].film_traction).max() > 0.0
    platen.force = 1.0
    for _ in range(100):
        stepper.advance(dt)
    trial = stepper.problem.trials[0]
    assert not trial.kinematics.closed.any()
    np.testing.assert_array_equal(trial.traction, 0.0)
    np.testing.assert_array_equal(stepper.contacts[0].film_traction, 0.0)


def test_what_the_energy_of_a_body_at_rest_rounds_to_is_no_instability():
    """Ogden's energy of an undeformed body is a difference of large numbers, of either sign."""
    rubber = Ogden((0.63e6, 0.0012e6, -0.01e6), (1.3, 5.0, -2.0), 5e6)
    bench = Bench((0.01, 0.004, (20, 6)), (0.01, 0.004, (1, 1)), materials=(rubber, HARD))
    stepper = ExplicitStepper(bench.problem(), ExplicitOptions())
    watch, sizes = EnergyWatch(stepper.problem, ExplicitOptions().energy_limit, 0.0), []
    for _ in range(100):
        stepper.advance(0.5 * stepper.stable_step())
        sizes.append(abs(stored(stepper)))
    watch.check(max(sizes), 0.0, 0.0, np.zeros(1))
    assert max(sizes) > 0.0
    strain, area, moving = 1e-5, 0.01 * 0.004, np.zeros(stepper.problem.owned)
    moving[[3, 2 * 17 + 1]] = 2.0, 3.0  # one of the unknowns of the second and of the 18th node
    for fastest in (17, 5):
        with pytest.raises(ExplicitError, match="energy runs away") as error:
            watch.check(0.5 * rubber.shear_modulus * strain**2 * area, 0.0, 0.0, moving)
        place = stepper.problem.space.tabulate_dof_coordinates()[fastest, :2]
        assert error.value.place == pytest.approx(tuple(place), abs=1e-12)
        moving[2 * 5] = np.nan  # what has overflowed is fastest of all
