"""cases/block-slide.toml: forces of other codes, Newton iterations, energies, and variants."""

from itertools import pairwise
from pathlib import Path

import pytest
from mpi4py import MPI

from tribox.app.build.model import build_model
from tribox.app.case.reading import load_case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

CASE = Path(__file__).parents[3] / "cases" / "block-slide.toml"

FRICTIONLESS = ['contact.0.friction={ law = "frictionless" }']
# Without a film all the map can do is Coulomb friction; mu_d below mu_s adds slip weakening.
LITERAL = [
    'contact.0.friction={ law = "friction-map", mu_s = 0.2, mu_d = 0.15, A_d = "10 um", '
    'B = "1e5 1/m", K_T = "1e13 Pa/m", eta_b = "0.8 Pa*s", D_max = "250 nm", alpha = 0.5, '
    'V_star = "1 m/s", V_star_at = "10 nm", flow_rule = "literal" }',
    'contact.0.film={ thickness = "10 nm" }',
]


def run(*overrides: str) -> list:
    simulation = Simulation(build_model(load_case(CASE, overrides), MPI.COMM_SELF))
    simulation.run(Observer())
    return simulation.rows


@pytest.fixture(scope="module")
def rows() -> list:
    return run()


def relative_energy_error(rows: list) -> float:
    return max(abs(r.energy_error) for r in rows) / max(abs(r.external_work) for r in rows)


def test_forces_are_those_of_codes_that_enforce_the_constraint_exactly(rows):
    assert rows[9].stage == "press" and rows[10].stage == "slide"
    assert rows[9].normal_force == pytest.approx(0.9684, rel=3e-3)
    assert rows[-1].normal_force == pytest.approx(0.8778, rel=3e-3)
    assert rows[-1].tangential_force == pytest.approx(0.1756, rel=3e-3)


def test_newton_needs_few_iterations(rows):
    assert len(rows) == 40 and all(row.attempts == 1 for row in rows)
    assert sum(row.newton_iterations for row in rows) <= 107
    gross = [
        row
        for before, last, row in zip(rows, rows[1:], rows[2:], strict=False)
        # The predictor repeats the step before: that, too, must have slid from its beginning.
        if before.stick_fraction == last.stick_fraction == row.stick_fraction == 0.0
    ]
    assert len(gross) >= 20
    assert max(row.newton_iterations for row in gross) <= 3


def test_all_points_slide_with_the_coefficient_of_friction(rows):
    gross = [row for row in rows if row.stage == "slide" and row.stick_fraction == 0.0]
    assert [row.friction_coefficient for row in gross] == pytest.approx([0.2] * len(gross), 1e-5)


def test_energies_balance_and_dissipation_grows(rows):
    assert relative_energy_error(rows) <= 1e-3
    dissipation = [row.dissipation for row in rows]
    assert all(b >= a for a, b in pairwise(dissipation))
    assert dissipation[-1] > 0.5 * rows[-1].external_work


def test_without_friction_nothing_drags_and_nothing_is_lost(rows):
    free = run(*FRICTIONLESS)
    assert all(row.tangential_force == 0.0 and row.dissipation == 0.0 for row in free)
    assert relative_energy_error(free) <= 1e-3
    # Friction holds the sliding surface back from spreading: without, the block is softer.
    assert 0.8 * rows[9].normal_force < free[9].normal_force < rows[9].normal_force
    # Sliding sideways over a flat body without friction changes nothing.
    assert free[-1].normal_force == pytest.approx(free[9].normal_force, rel=2e-2)


def test_literal_flow_rule_keeps_the_whole_threshold(rows):
    literal, weighted = run(*LITERAL), run(*LITERAL, "contact.0.friction.flow_rule=weighted")
    film = [0.5 * 0.8 * 1e-4 / 10e-9 * r[-1].contact_area for r in (literal, weighted)]
    for share, stress, one in zip((1.0, 0.5), film, (literal, weighted), strict=True):
        last = one[-1]
        friction = share * last.mu * last.normal_force
        assert last.tangential_force == pytest.approx(friction + stress, rel=1e-2)
        assert relative_energy_error(one) <= 2e-3
