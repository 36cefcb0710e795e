"""A strip that was bent and is let go: springback through the release of a surface."""

from __future__ import annotations

import tomllib

import pytest
from mpi4py import MPI

from tribox.app.case.case import Case
from tribox.app.results.recorder import force_balance
from tribox.app.run.run import run_case

BENT = """
[geometry]
kind = "blocks"
[geometry.blocks.strip]
x = ["0 mm", "8 mm"]
y = ["0 mm", "1 mm"]
elements = [8, 4]
[bodies.strip]
material = "elastoplastic"
formulation = "q2"
E = "70 GPa"
nu = 0.33
hardening = { law = "linear", yield_stress = "100 MPa", modulus = "500 MPa" }
[[boundary]]
surface = "strip_left"
platen = { direction = "x", force = 0 }
[[boundary]]
surface = "strip_right"
rotation = { axis = "z", centre = ["8 mm", "0.5 mm"], angle = [["0 s", 0], ["1 s", 0.16]] }
[[stage]]
name = "bend"
duration = "1 s"
steps = 8
[[stage]]
name = "let go"
duration = "1 s"
steps = 4
release = ["strip_right"]
"""


@pytest.mark.parametrize("steps", [1, 4])
def test_a_strip_let_go_springs_back_elastically_in_few_iterations(tmp_path, steps):
    data = tomllib.loads(BENT)
    data["stage"][1]["steps"] = steps
    run = run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    bent, free = run.rows[7], run.rows[8:]
    assert [row.attempts for row in free] == [1] * steps
    assert all(row.newton_iterations <= 8 for row in free)
    # What springs back gives back most of what was stored, and does not flow.
    assert 0.0 < free[-1].strain_energy < 0.5 * bent.strain_energy
    assert free[-1].plastic_dissipation == pytest.approx(bent.plastic_dissipation, rel=1e-3)
    log = (tmp_path / "out" / "log.txt").read_text()
    assert f"body strip floats in {steps} step" in log
    # It was bent by a moment alone: no force but that of a pair says what rest is small.
    assert force_balance(run) < 1e-6 and "add up to zero only" not in log


def test_one_step_and_four_come_to_the_same_shape(tmp_path):
    found = []
    for steps in (1, 4):
        data = tomllib.loads(BENT)
        data["stage"][1]["steps"] = steps
        case = Case.model_validate(data)
        run = run_case(case, tmp_path / f"{steps}", quiet=True, comm=MPI.COMM_SELF)
        found.append(run.rows[-1].strain_energy)
    assert found[0] == pytest.approx(found[1], rel=1e-3)
