"""Contact in space on several ranks: the same forces and tangent as on one, history included."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from app.equilibrium.equilibrium import Equilibrium
from app.simulation.contact_resultants import measure_contact
from forms.friction.coulomb import CoulombLaw, CoulombParameters
from geometry.generators.two_blocks import Block, TwoBlocks
from geometry.meshes.mesh import generate
from tests.app.implicit.test_linear_solver import linear_step
from tests.conftest import Pair
from tests.contact_boxes import Scene

ROOT = Path(__file__).resolve().parents[3]


def facts(shape, parallel):
    """Numbers of a pair that was pressed and slid, that no numbering enters; collective."""
    law = CoulombLaw(CoulombParameters(mu=0.3, K_T=60.0))
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
RANKS = """
import json, sys
from mpi4py import MPI
sys.path.insert(0, sys.argv[1])
from tests.app.equilibrium.test_contact_ranks import SHAPES, facts, step_facts
found = {shape: facts(shape, True) for shape in SHAPES}
found["step"] = step_facts(MPI.COMM_WORLD)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(found))
"""


def step_facts(comm):
    """A linear step of two blocks: a rank knows its own unknowns by their global numbers."""
    blocks = TwoBlocks(Block(1.0, 0.5, (6, 2)), Block(2.0, 0.5, (7, 2)), offset=0.47)
    return linear_step(Pair(generate(blocks, comm)), 1e-4)


@pytest.fixture(scope="module")
def on_three_ranks(environment):
    """The facts of each shape, all from one start of MPI."""
    command = ["mpirun", "--oversubscribe", "-n", "3", sys.executable, "-m", "mpi4py", "-c", RANKS]
    done = subprocess.run(
        [*command, ROOT], capture_output=True, text=True, timeout=120, env=environment
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.mpi
@pytest.mark.parametrize("shape", SHAPES)
def test_forces_and_tangent_do_not_depend_on_the_ranks(shape, on_three_ranks):
    one, (count,) = facts(shape, False)
    three, points = on_three_ranks[shape]
    assert sum(points) == count
    assert min(points) == 0, points
    assert one["friction"][0] > 0.01 and 0.0 < one["stick"] < 1.0
    for name, value in one.items():
        np.testing.assert_allclose(three[name], value, rtol=1e-10, atol=1e-13, err_msg=name)


@pytest.mark.mpi
def test_a_linear_step_does_not_depend_on_the_ranks(on_three_ranks):
    assert on_three_ranks["step"] == pytest.approx(step_facts(MPI.COMM_SELF), rel=1e-9)
