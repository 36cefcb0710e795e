"""Sizes beyond reason: counts that are told before a mesh is made, and lengths that are refused."""

from dataclasses import replace

import gmsh
import pytest
from mpi4py import MPI

from tribox.geometry.generators.cylinders import FlatBlock, HalfCylinder, LineContact
from tribox.geometry.generators.sphere_on_block import SphereOnBlock
from tribox.geometry.generators.two_blocks import Block, Box, TwoBlocks
from tribox.geometry.meshes.gmsh_model import MeshError
from tribox.geometry.meshes.mesh import generate

BLOCKS = TwoBlocks(Block(1.0, 0.5, (3, 2)), Block(1.0, 0.5, size=0.3))
BOXES = TwoBlocks(Box(1.0, 0.5, 1.0, (3, 2, 1)), Box(1.0, 0.5, 1.0, size=0.5))
LINE = LineContact(HalfCylinder(1.0, 0.4, 0.1), FlatBlock(2.0, 1.0, 0.4, 0.1), growth=1.5)
SPHERE = SphereOnBlock(1.0, 1.0, 1.0, 0.4, 0.1, growth=2.0)


@pytest.mark.parametrize(
    "shape",
    [
        *(replace(shape, cell=cell) for shape in (BLOCKS, LINE, SPHERE)
         for cell in ("quadrilateral", "triangle")),
        *(replace(BOXES, cell=cell) for cell in ("hexahedron", "tetrahedron")),
        replace(SPHERE, part="quarter", cell="hexahedron"),
    ],
)  # fmt: skip
def test_the_number_of_cells_is_known_beforehand(shape):
    mesh = generate(shape, MPI.COMM_SELF).mesh
    assert shape.cells() == mesh.topology.index_map(mesh.topology.dim).size_global


def test_the_number_of_free_tetrahedra_is_about_known():
    shape = replace(SPHERE, part="quarter", cell="tetrahedron", growth=1.3)
    mesh = generate(shape, MPI.COMM_SELF).mesh
    assert 0.5 < shape.cells() / mesh.topology.index_map(3).size_global < 2.0


@pytest.mark.parametrize("value", [1e300, 1e-300])
@pytest.mark.parametrize(
    "make",
    [
        lambda x: TwoBlocks(*[Block(x, 1.0, (1, 1))] * 2),
        lambda x: TwoBlocks(*[Box(1.0, 1.0, x, (1, 1, 1))] * 2),
        lambda x: HalfCylinder(x, 1e-301, 1e-302),
        lambda x: FlatBlock(1.0, x, 0.5, 0.1),
        lambda x: replace(SPHERE, radius=x),
    ],
)
def test_lengths_that_cannot_be_calculated_with_are_refused(make, value):
    with pytest.raises(ValueError, match=r"is not allowed; it must be from 1e-15 to 1e\+15 m"):
        make(value)


class Broken:
    """A line between points that are not there."""

    def build(self) -> None:
        gmsh.model.geo.addLine(1, 2)


def test_what_gmsh_cannot_mesh_is_one_line():
    with pytest.raises(MeshError, match=r"^gmsh cannot mesh this geometry: .*nknown") as caught:
        generate(Broken(), MPI.COMM_SELF)
    assert "\n" not in str(caught.value)
