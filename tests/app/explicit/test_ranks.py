"""Explicit steps with a film do not depend on the number of ranks, to round-off."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.mpi

RUN = """
import json
import sys
import numpy as np
from mpi4py import MPI
from app.bench.explicit import sliding

comm = MPI.COMM_WORLD
case = sliding(0.4)
stepper, rows = case.stepper, []
found = stepper.estimate()
platen = stepper.problem.platens[0]
full, platen.force = 3.0 * platen.force, 0.0
for step in range(1000):
    platen.force = full * min(step / 300.0, 1.0)
    case.top.value += 20.0 * 0.05 * 1e-7 * min(step / 300.0, 1.0)
    stepper.advance(1e-7)
    trial = stepper.problem.trials[0]
    weight = stepper.problem.contacts[0].surface.slave.weight
    sums = [weight @ trial.traction[:, 0], weight @ trial.traction[:, 1]]
    sums += [weight @ (trial.pressure > 0.0), weight @ trial.response.regime]
    sums += [weight @ trial.response.dissipation.total, stepper.work]
    sums.append(stepper.internal.energy(stepper.problem.u.x.array))
    rows.append([*comm.allreduce(np.array(sums)), stepper.kinetic_energy()])
if comm.rank == 0:
    limits = [found.limit, found.elements, found.penalty, found.closing, *found.place]
    with open(sys.argv[1], "w") as file:
        json.dump({"rows": rows, "limits": limits}, file)
"""


@pytest.fixture(scope="module")
def histories(tmp_path_factory, environment):
    """A thousand steps of a block pressed and dragged on a film, on one, two and three ranks."""
    where, found = tmp_path_factory.mktemp("ranks"), {}
    for ranks in (1, 2, 3):
        out = where / f"{ranks}.json"
        start = ["mpirun", "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []
        done = subprocess.run(
            [*start, sys.executable, "-c", RUN, str(out)],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300.0,
        )
        assert done.returncode == 0, done.stderr
        found[ranks] = json.loads(out.read_text())
    return found


def test_a_thousand_steps(histories):
    alone = np.array(histories[1]["rows"])
    largest = np.abs(alone).max(axis=0)
    assert largest.min() > 0.0
    for ranks in (2, 3):
        apart = np.abs(np.array(histories[ranks]["rows"]) - alone).max(axis=0)
        assert (apart <= 1e-10 * largest).all(), (ranks, apart / largest)


def test_the_stable_step(histories):
    for ranks in (2, 3):
        np.testing.assert_allclose(histories[ranks]["limits"], histories[1]["limits"], rtol=1e-9)
