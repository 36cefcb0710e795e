"""Forces on single unknowns: in the residual, in the loads, and scaled by their factor."""

import numpy as np
import pytest

from tribox.app.equilibrium.equilibrium import load_residuals
from tribox.app.equilibrium.unknowns import NodalLoad
from tribox.forms.bodies.loads import FollowerPressure


def test_nodal_loads_enter_the_residual_beside_those_with_forms(pair):
    blocks = pair()
    x = blocks.displaced(lambda X: 0.1 * X, lambda X: -0.05 * X)
    side = FollowerPressure(blocks.u, blocks.named.facets("elastomer_left"))
    force = NodalLoad(np.array([3, 8], dtype=np.int32), np.array([2.0, -0.5]))
    f = x.duplicate()
    without = blocks.problem(None)
    without.residual(None, x, f)
    bare, reference = f.array_r.copy(), without.reference_force
    problem = blocks.problem(None, loads=[side], nodal_loads=[force])
    side.set(0.3)
    force.factor = 4.0
    problem.residual(None, x, f)
    form, nodal = load_residuals(problem)
    expected = np.zeros(problem.owned)
    expected[[3, 8]] = [8.0, -2.0]
    np.testing.assert_array_equal(-nodal[: problem.owned], expected)
    np.testing.assert_allclose(f.array_r - bare, form + nodal, atol=1e-14)
    np.testing.assert_allclose(problem.load_forces(), -form - nodal, atol=1e-14)
    # Bodies that nothing but loads acts on are judged by these.
    assert reference == 0.0
    assert problem.reference_force == pytest.approx(np.linalg.norm(form + nodal))
    force.factor = 0.0
    side.set(0.0)
    problem.residual(None, x, f)
    np.testing.assert_array_equal(f.array_r, bare)
