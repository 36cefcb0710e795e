"""Regular meshes made without gmsh have the numbers that gmsh gives them."""

import numpy as np
import pytest

from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.extraction import arrays_of
from tribox.geometry.meshes.gmsh_model import gmsh_session
from tribox.geometry.meshes.mesh import _generated


@pytest.mark.parametrize(
    ("upper", "lower"), [((4, 3), (3, 2)), ((1, 1), (1, 2)), ((2, 1), (1, 3)), ((7, 5), (11, 4))]
)
def test_numbers_are_those_of_gmsh(upper, lower):
    shape = TwoBlocks(
        Block(1e-3, 0.5e-3, elements=upper), Block(2e-3, 0.25e-3, elements=lower), gap=1e-5
    )
    with gmsh_session("TwoBlocks") as gmsh:
        shape.build()
        theirs = arrays_of(gmsh, "TwoBlocks")
    ours = _generated(shape)
    assert ours.cell == theirs.cell and ours.order == theirs.order
    np.testing.assert_allclose(ours.position, theirs.position, atol=1e-11 * 2e-3)
    for mine, other in ((ours.bodies, theirs.bodies), (ours.surfaces, theirs.surfaces)):
        assert list(mine) == list(other)
        for name, part in mine.items():
            assert part.tag == other[name].tag
            np.testing.assert_array_equal(part.nodes, other[name].nodes)


@pytest.mark.parametrize("change", [{"grading": 2.0}, {"cell": "triangle"}])
def test_other_meshes_are_left_to_gmsh(change):
    cell = change.pop("cell", "quadrilateral")
    block = Block(1e-3, 1e-3, elements=(2, 3), **change)
    assert TwoBlocks(block, block, cell=cell).regular() is None
