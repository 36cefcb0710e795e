"""Rectangles and boxes as bodies of their own."""

import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.build.mesh import bodies_sharing_nodes
from tribox.geometry.compat import cell_nodes
from tribox.geometry.generators.blocks import Blocks, PlacedBlock
from tribox.geometry.meshes.mesh import generate

STRIP = PlacedBlock("strip", (0.0, 0.0), (4.0, 1.0), (4, 2), grading=(8.0, 1.0))
PAD = PlacedBlock("soft pad", (1.0, 1.0), (3.0, 4.0), size=0.5)


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_rectangles_are_bodies_with_named_sides(cell):
    shape = Blocks((STRIP, PAD), cell)
    named = generate(shape, MPI.COMM_SELF)
    assert list(named.bodies) == ["strip", "soft pad"]
    sides = ("left", "right", "bottom", "top")
    assert list(named.surfaces) == [f"{b}_{s}" for b in named.bodies for s in sides]
    mesh = named.mesh
    assert mesh.topology.index_map(2).size_local == shape.cells()
    assert not bodies_sharing_nodes(named)
    x = mesh.geometry.x
    for block in (STRIP, PAD):
        nodes = x[np.unique(cell_nodes(mesh)[named.cells(block.name)])]
        assert nodes.min(axis=0)[:2] == pytest.approx(block.low)
        assert nodes.max(axis=0)[:2] == pytest.approx(block.high)
    assert len(named.facets("strip_top")) == 4 and len(named.facets("soft pad_left")) == 6


def test_elements_grow_from_the_low_end():
    named = generate(Blocks((STRIP,)), MPI.COMM_SELF)
    x = np.unique(named.mesh.geometry.x[:, 0].round(9))
    assert np.diff(x)[-1] / np.diff(x)[0] == pytest.approx(8.0)


@pytest.mark.parametrize("grading", [0.1, 1.0, 7.0])
def test_size_is_that_of_the_smallest_elements(grading):
    block = PlacedBlock("b", (0.0, 0.0), (1.0, 1.0), size=0.03, grading=(grading, 1.0))
    count, ratio = next(block.progressions())
    widths = ratio ** np.arange(count)
    smallest = widths.min() / widths.sum()
    assert 0.9 * 0.03 < smallest <= 0.03 * (1.0 + 1e-9)


def test_boxes_have_six_sides():
    box = PlacedBlock("box", (0.0, 0.0, 0.0), (1.0, 2.0, 3.0), (1, 2, 3))
    named = generate(Blocks((box,), "hexahedron"), MPI.COMM_SELF)
    counts = {name: len(named.facets(name)) for name in named.surfaces}
    assert counts == {
        **dict.fromkeys(("box_left", "box_right"), 6),
        **dict.fromkeys(("box_bottom", "box_top"), 3),
        **dict.fromkeys(("box_back", "box_front"), 2),
    }
    assert (
        generate(Blocks((box,), "tetrahedron"), MPI.COMM_SELF).mesh.topology.index_map(3).size_local
        == 6 * 6
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"high": (0.0, 1.0)}, "strip: x must go from a lower to a higher value"),
        ({"elements": None}, "strip: give either elements or size"),
        ({"elements": (4, 2, 1)}, "strip: elements needs 2 numbers, found 3"),
        ({"grading": (0.0, 1.0)}, "strip: grading = 0 is not allowed; it must be from"),
        ({"elements": None, "size": 1e-9}, "strip: size = 1e-09 m is too small"),
    ],
)
def test_a_wrong_block_is_named(change, said):
    given = {"name": "strip", "low": (0.0, 0.0), "high": (4.0, 1.0), "elements": (4, 2)}
    with pytest.raises(ValueError, match=said):
        PlacedBlock(**given | change)


def test_overlapping_blocks_are_refused_and_touching_ones_are_not():
    Blocks((STRIP, PAD))
    inside = PlacedBlock("other", (1.0, 0.5), (2.0, 2.0), (1, 1))
    with pytest.raises(ValueError, match="strip and other overlap"):
        Blocks((STRIP, inside))
    with pytest.raises(ValueError, match="strip: a block in the plane"):
        Blocks((STRIP,), "hexahedron")
