"""Contact in space on several ranks: the same forces and tangent as on one, history included."""

import dolfinx
import numpy as np
import pytest

from tests.app.implicit.test_linear_solver import linear_step
from tests.conftest import Pair
from tests.contact_boxes import Scene
from tests.laws import coulomb
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.simulation.contact_resultants import measure_contact
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.mesh import generate


def facts(shape, parallel):
    """Numbers of a pair that was pressed and slid, that no numbering enters; collective."""
    law = coulomb(0.3)
    scene = Scene(shape, law, master=7, parallel=parallel)
    comm = scene.space.mesh.comm
    problem = Equilibrium(dolfinx.fem.Function(scene.space), [], [scene.term])
    f = problem.new_vector()
    for x in (
        scene.vector((0.01, 0.02, -0.07), 0.3, 0.4),
        scene.vector((0.02, 0.02, -0.09), 0.3, 0.4),
    ):
        problem.residual(None, x, f)
        trials = list(problem.trials)
        measure = measure_contact(scene.term, trials[0], comm, [1.0, 0.0, 0.0])
        A = problem.new_matrix(x)
        problem.assemble_tangent(x, A)
        problem.commit()
    where = scene.where[: f.getLocalSize() // 3]
    probe, image = f.duplicate(), f.duplicate()
    probe.array[:] = np.sin(
        np.stack([where @ [3, 1, 2], where @ [1, 5, 1], where @ [2, 2, 4]], 1)
    ).flat
    A.mult(probe, image)
    force = f.array_r.reshape(-1, 3)
    found = {f"moment {i}": comm.allreduce(force[:, i] @ where[:, 0] ** 2) for i in range(3)}
    found |= {
        "forces": f.norm(),
        "tangent": A.norm(),
        "image": image.norm(),
        "work": probe.dot(image),
    }
    found |= {name: getattr(measure, name) for name in measure.__slots__ if name != "numerical"}
    points = comm.allgather(len(scene.surface.slave.weight))
    return found, points


SHAPES = ("hex8", "tet4")


def facts_of_all(comm, directory):
    """The facts of each shape, and of a linear step of two blocks.

    In the step a rank knows its own unknowns by their global numbers.
    """
    found = {shape: facts(shape, comm.size > 1) for shape in SHAPES}
    blocks = TwoBlocks(Block(1.0, 0.5, (6, 2)), Block(2.0, 0.5, (7, 2)), offset=0.47)
    return {**found, "step": linear_step(Pair(generate(blocks, comm)), 1e-4)}


@pytest.mark.mpi(facts_of_all, 3)
@pytest.mark.parametrize("shape", SHAPES)
def test_forces_and_tangent_do_not_depend_on_the_ranks(shape, on_ranks):
    one, (count,) = on_ranks(facts_of_all, 1)[shape]
    three, points = on_ranks(facts_of_all, 3)[shape]
    assert sum(points) == count
    assert min(points) == 0, points
    assert one["friction"][0] > 0.01 and 0.0 < one["stick"] < 1.0
    for name, value in one.items():
        np.testing.assert_allclose(three[name], value, rtol=1e-10, atol=1e-13, err_msg=name)


@pytest.mark.mpi(facts_of_all, 3)
def test_a_linear_step_does_not_depend_on_the_ranks(on_ranks):
    one, three = (on_ranks(facts_of_all, ranks)["step"] for ranks in (1, 3))
    assert three == pytest.approx(one, rel=1e-9)
