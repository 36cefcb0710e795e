"""Explicit steps with a film do not depend on the number of ranks, to round-off."""

import numpy as np
import pytest

from benchmarks.explicit import sliding


def many_steps(comm, directory):
    """A block pressed and dragged on a film: sums over the contact, work, energies, limits."""
    case = sliding(0.4)
    stepper, rows = case.stepper, []
    found = stepper.estimate()
    platen = stepper.problem.platens[0]
    full, platen.force = 3.0 * platen.force, 0.0
    for step in range(400):
        platen.force = full * min(step / 120.0, 1.0)
        case.top.value += 20.0 * 0.05 * 1e-7 * min(step / 120.0, 1.0)
        stepper.advance(1e-7)
        trial = stepper.problem.trials[0]
        weight = stepper.problem.contacts[0].surface.slave.weight
        sums = [weight @ trial.traction[:, 0], weight @ trial.traction[:, 1]]
        sums += [weight @ (trial.pressure > 0.0), weight @ trial.response.regime]
        sums += [weight @ trial.response.dissipation.total, stepper.work]
        sums.append(stepper.internal.energy(stepper.problem.u.x.array))
        rows.append([*comm.allreduce(np.array(sums)), stepper.kinetic_energy()])
    limits = [found.limit, found.elements, found.penalty, found.closing, *found.place]
    return {"rows": rows, "limits": [float(value) for value in limits]}


@pytest.mark.mpi(many_steps, 3)
def test_a_many_steps(on_ranks):
    alone = np.array(on_ranks(many_steps, 1)["rows"])
    largest = np.abs(alone).max(axis=0)
    assert largest.min() > 0.0
    apart = np.abs(np.array(on_ranks(many_steps, 3)["rows"]) - alone).max(axis=0)
    assert (apart <= 1e-10 * largest).all(), apart / largest


@pytest.mark.mpi(many_steps, 3)
def test_the_stable_step(on_ranks):
    alone = on_ranks(many_steps, 1)["limits"]
    np.testing.assert_allclose(on_ranks(many_steps, 3)["limits"], alone, rtol=1e-9)
