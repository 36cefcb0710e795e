"""Contact in space on several ranks: the same forces and tangent as on one, history included."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import dolfinx
import numpy as np
import pytest

from app.equilibrium import Equilibrium
from app.measure import measure_contact
from forms.coulomb import CoulombLaw, CoulombParameters
from tests.contact_boxes import Scene

ROOT = Path(__file__).resolve().parents[2]


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


RANKS = """
import json, sys
from mpi4py import MPI
sys.path.insert(0, sys.argv[1])
from tests.app.test_contact_ranks import facts
found = facts(sys.argv[2], True)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(found))
"""


@pytest.mark.mpi
@pytest.mark.parametrize("shape", ["hex8", "tet4"])
def test_forces_and_tangent_do_not_depend_on_the_ranks(shape):
    one, (count,) = facts(shape, False)
    environment = {
        key: value
        for key, value in os.environ.items()
        if not key.startswith(("PMIX_", "OMPI_COMM_WORLD", "OMPI_UNIVERSE", "PMI_"))
    }
    command = ["mpirun", "--oversubscribe", "-n", "3", sys.executable, "-m", "mpi4py", "-c", RANKS]
    done = subprocess.run(
        [*command, ROOT, shape], capture_output=True, text=True, timeout=120, env=environment
    )
    assert done.returncode == 0, done.stderr
    three, points = json.loads(done.stdout)
    assert sum(points) == count
    assert min(points) == 0, points
    assert one["friction"][0] > 0.01 and 0.0 < one["stick"] < 1.0
    for name, value in one.items():
        np.testing.assert_allclose(three[name], value, rtol=1e-10, atol=1e-13, err_msg=name)
