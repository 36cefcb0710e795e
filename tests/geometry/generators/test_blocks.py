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


def test_overlapping_blocks_are_refused_and_touching_ones_are_not():
    Blocks((STRIP, PAD))
    inside = PlacedBlock("other", (1.0, 0.5), (2.0, 2.0), (1, 1))
    with pytest.raises(ValueError, match="strip and other overlap"):
        Blocks((STRIP, inside))
    with pytest.raises(ValueError, match="strip: a block in the plane"):
        Blocks((STRIP,), "hexahedron")
