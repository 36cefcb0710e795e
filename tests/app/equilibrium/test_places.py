"""Places in the undeformed bodies, found and put into words."""

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.equilibrium.unknowns import place_of_largest, place_text


def test_places_are_read_without_roundoff():
    assert place_text((6e-4, 2.776e-21)) == "(0.0006, 0) m"
    assert place_text((0.0, 0.0)) == "(0, 0) m"


def test_the_place_of_the_largest_number():
    mesh = dolfinx.mesh.create_rectangle(MPI.COMM_SELF, [[0.0, 0.0], [2.0, 1.0]], (4, 3))
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    where = space.tabulate_dof_coordinates()[:, :2]
    for component in (0, 1):
        values = np.zeros(where.shape)
        values[:, component] = np.exp(-((where - [1.5, 1.0]) ** 2).sum(axis=1))
        assert place_of_largest(values.reshape(-1), space) == pytest.approx((1.5, 1.0))
