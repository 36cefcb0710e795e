"""Two boxes: where they lie, what their sides are called, counts, and mistakes."""

from dataclasses import replace

import dolfinx
import numpy as np
import pytest
import ufl
from mpi4py import MPI

from tribox.geometry.generators.two_blocks import Box, TwoBlocks
from tribox.geometry.meshes.mesh import generate

UPPER = Box(1.0e-3, 0.5e-3, 0.6e-3, (4, 3, 2), grading=3.0)
LOWER = Box(2.0e-3, 0.4e-3, 1.0e-3, (5, 2, 3))
BOXES = TwoBlocks(UPPER, LOWER, offset=(0.35e-3, 0.1e-3), gap=0.1e-3)

# name: (axis, position, area)
SIDES = {
    "elastomer_contact": (1, 0.1e-3, 0.6e-6), "top": (1, 0.6e-3, 0.6e-6),
    "elastomer_left": (0, 0.35e-3, 0.3e-6), "elastomer_right": (0, 1.35e-3, 0.3e-6),
    "elastomer_back": (2, 0.1e-3, 0.5e-6), "elastomer_front": (2, 0.7e-3, 0.5e-6),
    "aluminium_contact": (1, 0.0, 2.0e-6), "bottom": (1, -0.4e-3, 2.0e-6),
    "aluminium_left": (0, 0.0, 0.4e-6), "aluminium_right": (0, 2.0e-3, 0.4e-6),
    "aluminium_back": (2, 0.0, 0.8e-6), "aluminium_front": (2, 1.0e-3, 0.8e-6),
}  # fmt: skip


def integral(named, dim, entities):
    mesh = named.mesh
    marks = dolfinx.mesh.meshtags(mesh, dim, np.sort(entities), np.ones(len(entities), np.int32))

    measure = ufl.Measure("dx" if dim == 3 else "ds", domain=mesh, subdomain_data=marks)(1)
    one = dolfinx.fem.Constant(mesh, 1.0)
    return mesh.comm.allreduce(dolfinx.fem.assemble_scalar(dolfinx.fem.form(one * measure)))


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_sides_lie_where_their_names_say(cell):
    named = generate(replace(BOXES, cell=cell), MPI.COMM_SELF)
    assert named.mesh.topology.cell_name() == cell and named.mesh.geometry.dim == 3
    assert set(named.surfaces) == set(SIDES) and set(named.bodies) == {"elastomer", "aluminium"}
    for name, (axis, position, area) in SIDES.items():
        facets = named.facets(name)
        middles = dolfinx.mesh.compute_midpoints(named.mesh, 2, facets)
        np.testing.assert_allclose(middles[:, axis], position, atol=1e-15)
        assert integral(named, 2, facets) == pytest.approx(area, rel=1e-12)
    assert integral(named, 3, named.cells("elastomer")) == pytest.approx(0.3e-9, rel=1e-12)
    assert integral(named, 3, named.cells("aluminium")) == pytest.approx(0.8e-9, rel=1e-12)
