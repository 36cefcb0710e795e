"""Bodies that flow, solved: Newton's convergence, cut steps, energies, both solvers, units."""

from itertools import pairwise

import dolfinx
import numpy as np
import pytest

from tests.grid import grid
from tribox.app.equilibrium.constraints import Prescribed, component_dofs
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.explicit.stable_step import ExplicitOptions
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.implicit.newton import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.app.simulation.energy_balance import EnergyBalance
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Backstress, Perzyna, Voce
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.memory_solid import make_solid
from tribox.forms.bodies.softening import Mullins
from tribox.forms.bodies.viscous_points import Branch, Viscoelastic

HARDENING = (100e6, 180e6, 10.0, 100e6)
BACK = (Backstress(2e9, 40.0), Backstress(50e6))  # 50 MPa at last, and one that goes on
RUBBER = NeoHookean(1e6, 20e6)
KINDS = {  # of what points remember
    "flows": None,
    "reverses": ElastoPlastic(26e9, 70e9, Voce(*HARDENING), None, BACK),
    "creeps": Viscoelastic(RUBBER, (Branch(1e6, 1.0), Branch(5e5, 0.1))),
    "softens": Viscoelastic(RUBBER, (Branch(1e6, 1.0),), Mullins(1.5, 2e4, 0.1)),
}
SQUARE, CUBE = ("quadrilateral", (4, 4)), ("hexahedron", (2, 2, 2))


class Billet:
    """A square block or cube between platens that it sticks to, compressed by its upper side."""

    def __init__(
        self,
        formulation="q1-sri",
        section="plane-strain",
        rate=None,
        units=(1.0, 1.0),
        kinematic=(),
        material=None,
    ):
        """Units: metres and pascals over those of the numbers."""
        metre, pascal = units
        cell, counts = CUBE if section == "3D" else SQUARE
        dim = len(counts)
        mesh = grid(cell, counts, [1.0 / metre] * dim)
        self.u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,))))
        stress, saturation, exponent, modulus = HARDENING
        law = Voce(stress / pascal, saturation / pascal, exponent, modulus / pascal)
        material = material or ElastoPlastic(26e9 / pascal, 70e9 / pascal, law, rate, kinematic)
        cells = np.arange(np.prod(counts), dtype=np.int32)
        density = 2700.0
        self.solid = make_solid("billet", self.u, cells, material, formulation, density, section)
        self.sides = [self.side(y, axis) for y in (0.0, 1.0 / metre) for axis in range(dim)]
        self.top = self.sides[dim + 1]
        self.problem = Equilibrium(self.u, [self.solid], [], self.sides)
        self.metre = metre

    def side(self, y, axis):
        space = self.u.function_space
        dim = space.mesh.topology.dim - 1
        facets = dolfinx.mesh.locate_entities_boundary(
            space.mesh, dim, lambda x: np.isclose(x[1], y)
        )
        return Prescribed(component_dofs(space, facets, axis))

    def press(self, depth):
        self.top.value = -depth / self.metre

    def force(self):
        return self.problem.reaction(self.top)


def pressed(billet, depths, tolerance=1e-8, dt=1.0):
    """The steps' results, the stepper and the balance, after steps to some depths."""
    stepper = ImplicitStepper(billet.problem, ImplicitOptions(tolerance))
    balance = EnergyBalance(billet.problem, billet.problem.new_vector())
    results = []
    for depth in depths:
        billet.press(depth)
        results.append(stepper.advance(dt))
        balance.add(stepper.x, [])
    return results, stepper, balance


@pytest.mark.parametrize("kind", KINDS)
def test_a_step_that_fails_leaves_no_trace(kind):
    """Bits: with a step in between that turns cells inside out, and without."""
    states = []
    for fails in (False, True):
        billet = Billet(material=KINDS[kind])
        _, stepper, _ = pressed(billet, [0.02, 0.05])
        if fails:
            billet.press(0.99)
            assert not stepper.attempt(1.0).converged
        billet.press(0.08)
        # The start of the failed step is not that of the next: begin both from the same.
        stepper.predictor._path.clear()
        stepper.solver.assemble(stepper.x)
        assert stepper.advance(1.0).converged
        states.append((stepper.x.array.copy(), billet.solid.points.committed))
    for one, other in zip(*states, strict=True):
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-9 * np.abs(one).max())


@pytest.mark.parametrize("section", ["plane-strain", "axisymmetric", "3D"])
def test_pressed_and_pulled_back_with_a_backstress(section):
    """Newton's method and energies in all sections; pulled, the metal bears less than pressed."""
    reversals = []
    for kinematic in (BACK, ()):
        billet = Billet(section=section, kinematic=kinematic)
        results, stepper, balance = pressed(billet, [0.01, 0.02, 0.03, 0.04], 1e-11)
        down, spent = billet.force(), [balance.plastic]
        for depth in (0.0395, 0.034, 0.03):
            billet.press(depth)
            results.append(stepper.advance(1.0))
            balance.add(stepper.x, [])
            spent.append(balance.plastic)
        for result in results[1:]:
            assert result.iterations <= 8
            small = [r for r in result.residuals if r < 1e-3]
            for before, after in pairwise(small):
                assert after <= max(100.0 * before**2, 1e-9)
        assert spent[0] == spent[1] < spent[2] < spent[3]
        assert abs(balance.error) < 0.01 * balance.work
        reversals.append(-billet.force() / down)
    with_it, without = reversals
    assert 0.3 < with_it < 0.85 * without


@pytest.mark.parametrize("formulation", ["q1", "q1-sri"])
def test_the_energies_add_up(formulation):
    """What the steps add to the dissipation falls with them, and what is left with their square."""
    errors, numerical = [], []
    for count in (5, 10, 20):
        billet = Billet(formulation)
        _, _, balance = pressed(billet, np.linspace(0.0, 0.1, count + 1)[1:])
        assert balance.strain == pytest.approx(billet.problem.strain_energy())
        errors.append(abs(balance.error) / balance.work)
        numerical.append(balance.numerical / balance.work)
    spent = (balance.plastic - balance.numerical) / balance.work
    assert errors[0] < 2e-3 and spent > 0.4
    for coarse, fine in pairwise(errors):
        assert coarse < 1e-7 or coarse / fine == pytest.approx(4.0, rel=0.15)
    for coarse, fine in pairwise(numerical):
        assert coarse / fine == pytest.approx(2.1, rel=0.15)


@pytest.mark.parametrize(
    ("rate", "kinematic"),
    [(None, ()), (Perzyna(reference_rate=500.0, exponent=1.0), ()), (None, BACK)],
    ids=["plain", "rate", "backstress"],
)
def test_slow_explicit_steps_give_the_implicit_solution(rate, kinematic):
    depth, duration = 0.02, 0.02
    steady = Billet(rate=rate, kinematic=kinematic)
    times = np.linspace(0.0, 1.0, 41)[1:]
    smooth = times**3 * (10.0 - 15.0 * times + 6.0 * times**2)
    _, _, balance = pressed(steady, depth * smooth, dt=duration / 40)
    moved = Billet(rate=rate, kinematic=kinematic)
    stepper = ExplicitStepper(moved.problem, ExplicitOptions(damping=2e3))
    count = int(np.ceil(duration / (0.9 * stepper.stable_step())))
    for step in range(1, count + 1):
        s = step / count
        moved.press(depth * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
        stepper.advance(duration / count)
    force = float(stepper.residual[moved.top.dofs].sum())
    assert force == pytest.approx(steady.force(), rel=5e-3)
    strains = [billet.solid.plastic_strain() for billet in (steady, moved)]
    np.testing.assert_allclose(strains[1], strains[0], rtol=0, atol=0.02 * strains[0].max())
    spent, numerical = moved.problem.plastic_dissipation()
    assert spent - numerical == pytest.approx(balance.plastic - balance.numerical, rel=0.01)
    assert numerical <= 1e-3 * spent
    moved.problem.spread(stepper.x)
    stored = moved.problem.strain_energy() + stepper.kinetic_energy() + stepper.energies.damped
    assert stepper.energies.work == pytest.approx(stored + spent - numerical, rel=2e-3)


def test_rates_are_felt_by_stages_that_say_so():
    """The same step, of a stage that feels time and of one that does not."""
    forces = []
    for rated in (True, False):
        billet = Billet(rate=Perzyna(reference_rate=1.0, exponent=1.0))
        stepper = ImplicitStepper(billet.problem, ImplicitOptions())
        stepper.rate_dependent = rated
        billet.press(0.05)
        stepper.advance(0.01)
        forces.append(abs(billet.force()))
    plain = Billet()
    pressed(plain, [0.05])
    assert forces[1] == pytest.approx(abs(plain.force()), rel=1e-7)
    assert forces[0] > 2.0 * forces[1]
