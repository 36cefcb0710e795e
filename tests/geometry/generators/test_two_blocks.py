"""The two-block generator: sizes, counts, grading, names, and what it refuses."""

import math
import signal

import gmsh
import numpy as np
import pytest

from tests.geometry.generators.conftest import group_points
from tribox.geometry.generators.two_blocks import Block, Box, TwoBlocks
from tribox.geometry.meshes.extraction import arrays_of
from tribox.geometry.meshes.gmsh_model import gmsh_session, write_msh
from tribox.geometry.meshes.mesh import _generated

UPPER = Block(1.0e-3, 0.5e-3, (4, 3))
LOWER = Block(2.0e-3, 0.4e-3, (7, 2))


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-7])
@pytest.mark.parametrize("grading", [1.0, 5.0, 0.25])
def test_grading_is_a_progression_from_the_contact(model, scale, grading):
    block = Block(1.0 * scale, 0.5 * scale, (2, 8), grading=grading)
    TwoBlocks(block, block).build()
    for name in ("elastomer_left", "aluminium_right"):
        heights = np.diff(np.sort(np.abs(group_points(name, 1)[:, 1])))
        assert heights[-1] / heights[0] == pytest.approx(grading, rel=1e-6)
        np.testing.assert_allclose(heights[1:] / heights[:-1], grading ** (1 / 7), rtol=1e-6)
        assert heights.sum() == pytest.approx(0.5 * scale, rel=1e-12)


@pytest.mark.parametrize(
    ("block", "counts"),
    [
        (Block(1.0e-3, 0.5e-3, size=0.1e-3), [10, 5]),
        (Block(1.0e-3, 0.5e-3, size=0.15e-3), [7, 4]),
        (Block(0.1 + 0.2, 0.5, size=0.1), [3, 5]),  # 0.1 + 0.2 is above 0.3
        (Block(1.0, 0.5, size=3.0), [1, 1]),
        # heights 1, 2, 4 and 1, 2: the smallest may be as large as the size
        (Block(1.0, 7.0, size=1.0, grading=4.0), [1, 3]),
        (Block(1.0, 3.0, size=1.0, grading=2.0), [1, 2]),
        (Block(1.0, 0.1 + 0.2, size=0.1, grading=2.0), [10, 2]),
        (Block(1.0, 7.0, size=0.999, grading=4.0), [2, 4]),
        (Block(1.0, 7.0, size=1.0, grading=0.25), [1, 3]),
        (Box(1.0, 0.5, 0.31, size=0.1), [10, 5, 4]),
    ],
)
def test_counts_from_a_size(block, counts):
    for placed in TwoBlocks(block, block).blocks().blocks:
        assert placed.counts() == counts


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"width": -1.0}, "offset"), ({"height": math.nan}, "elastomer: y must go from"),
        ({"height": -1.0}, "elastomer: y must go from"),
        ({"grading": 0.0}, "grading = 0 is not allowed; it must be from 0.001 to 1000.0"),
        ({"grading": 1e308}, "grading = 1e"), ({"grading": math.nan}, "grading = nan"),
        ({"elements": None}, "either elements or size"), ({"size": 0.1}, "either elements or size"),
        ({"elements": None, "size": -0.1}, "size = -0.1"),
        ({"elements": None, "size": 1e-14}, "size = 1e-14 m is too small"),
        ({"elements": (0, 3)}, r"elements = \[0, 3\]: give whole numbers"),
        ({"elements": (2.5, 3)}, r"elements = \[2.5, 3\]: give whole numbers"),
        ({"elements": (2, 3, 4)}, "elements needs 2 numbers, found 3"),
        ({"elements": (2, 1), "grading": 2.0}, "grading takes two elements or more"),
        ({"elements": (100_000, 1000)}, "more than 10000000 cells"),
    ],
)  # fmt: skip
def test_bad_block_is_refused(values, said):
    block = Block(**{"width": 1.0, "height": 1.0, "elements": (2, 2), **values})
    with pytest.raises(ValueError, match=said):
        TwoBlocks(block, block)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"gap": -1e-9}, "gap = -1e-09 m"),
        ({"gap": math.inf}, "gap = inf m"),
        ({"offset": 2.0e-3}, "offset = 0.002 m.*between -0.001 and 0.002 m"),
        ({"offset": -1.0e-3}, "offset = -0.001 m"),
        ({"offset": math.nan}, "offset = nan m"),
        ({"cell": "hexagon"}, "cell = 'hexagon'.*quadrilateral, triangle"),
        ({"upper_name": "aluminium"}, "two different names"),
        ({"lower_name": ""}, "two different names"),
    ],
)
def test_bad_pair_is_refused(values, said):
    with pytest.raises(ValueError, match=said):
        TwoBlocks(UPPER, LOWER, **values)


ROUND = {
    2: [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
    3: [[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))],
}


@pytest.mark.parametrize("shape", [
    TwoBlocks(UPPER, LOWER, gap=1e-5),
    TwoBlocks(Box(1e-3, 0.5e-3, 0.8e-3, (4, 3, 2)), Box(2e-3, 0.4e-3, 1e-3, (5, 2, 3)), gap=1e-5),
])  # fmt: skip
def test_blocks_of_equal_cells_are_those_of_gmsh(shape):
    with gmsh_session("TwoBlocks") as module:
        shape.build()
        theirs = arrays_of(module, "TwoBlocks")
    ours = _generated(shape)
    assert ours.cell == theirs.cell and ours.order == theirs.order
    for mine, other in ((ours.bodies, theirs.bodies), (ours.surfaces, theirs.surfaces)):
        assert list(mine) == list(other)
        for name, part in mine.items():
            assert part.tag == other[name].tag
            middles = [
                sorted(map(tuple, x[nodes].mean(axis=1).round(12)))
                for x, nodes in ((ours.position, part.nodes), (theirs.position, other[name].nodes))
            ]
            np.testing.assert_allclose(*middles, atol=1e-14)
    # In what order nodes go round a cell, and that no facet is crossed.
    for body in ours.bodies.values():
        corners = ours.position[body.nodes]
        extent = np.where(np.ptp(corners, axis=1) > 0.0, np.ptp(corners, axis=1), 1.0)
        unit = (corners - corners.min(axis=1, keepdims=True)) / extent[:, None]
        np.testing.assert_allclose(unit, np.broadcast_to(ROUND[shape.dim], unit.shape), atol=1e-12)
    for surface in ours.surfaces.values():
        edges = np.diff(ours.position[surface.nodes], axis=1)
        assert np.all(np.count_nonzero(np.abs(edges) > 1e-9, axis=2) == 1)


@pytest.mark.parametrize("change", [{"grading": 2.0}, {"cell": "triangle"}])
def test_other_meshes_are_left_to_gmsh(change):
    cell = change.pop("cell", "quadrilateral")
    block = Block(1e-3, 1e-3, elements=(2, 3), **change)
    assert TwoBlocks(block, block, cell=cell).regular() is None


def test_session_leaves_gmsh_and_signals_as_found(capfd):
    def ours(number, frame):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, ours)
    try:
        with gmsh_session("test"):
            TwoBlocks(UPPER, LOWER).build()
            assert signal.getsignal(signal.SIGINT) is ours
        assert signal.getsignal(signal.SIGINT) is ours
    finally:
        signal.signal(signal.SIGINT, before)
    assert not gmsh.isInitialized()
    assert capfd.readouterr() == ("", "")


def test_failed_write_leaves_nothing(tmp_path):
    (tmp_path / "blocks.msh").mkdir()
    with pytest.raises(IsADirectoryError):
        write_msh(TwoBlocks(UPPER, LOWER), tmp_path / "blocks.msh")
    assert [p.name for p in tmp_path.iterdir()] == ["blocks.msh"]


def test_write_says_what_is_wrong_with_the_path(tmp_path):
    with pytest.raises(ValueError, match=r"must end in \.msh"):
        write_msh(TwoBlocks(UPPER, LOWER), tmp_path / "blocks.vtk")
    with pytest.raises(FileNotFoundError, match="none: no such directory"):
        write_msh(TwoBlocks(UPPER, LOWER), tmp_path / "none" / "blocks.msh")
