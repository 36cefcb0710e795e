"""The picture of a mesh: complete, labelled, and the same from several processes."""

from dataclasses import replace
from itertools import combinations

import dolfinx
import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.image import imread
from matplotlib.text import Text
from mpi4py import MPI

from tribox.geometry.generators.two_blocks import Block, Box, TwoBlocks
from tribox.geometry.meshes.mesh import NamedMesh, generate
from tribox.geometry.pictures import draw, save_picture

BLOCKS = TwoBlocks(Block(1.0e-3, 0.5e-3, (8, 4)), Block(2.0e-3, 0.4e-3, (13, 5)))


def area(polygon):
    """The area of one closed polygon (n, 2); zero or wrong if its corners are not in order."""
    x, y = polygon[:, 0], polygon[:, 1]
    return 0.5 * abs(float(np.dot(x[:-1], y[1:]) - np.dot(x[1:], y[:-1])))


def drawn(kind, named):
    return [c for c in draw(named).axes[0].collections if isinstance(c, kind)]


@pytest.mark.parametrize(("cell", "factor"), [("quadrilateral", 1), ("triangle", 2)])
def test_every_cell_is_drawn_once(cell, factor):
    named = generate(TwoBlocks(BLOCKS.upper, BLOCKS.lower, cell=cell), MPI.COMM_SELF)
    bodies = drawn(PolyCollection, named)
    assert [len(b.get_paths()) for b in bodies] == [factor * 32, factor * 65]
    totals = [sum(area(p.vertices) for p in b.get_paths()) for b in bodies]
    assert totals == pytest.approx([0.5, 0.8])  # mm^2
    assert [b.get_label() for b in bodies] == [
        f"elastomer: {factor * 32} {cell}s",
        f"aluminium: {factor * 65} {cell}s",
    ]


@pytest.mark.parametrize("height", [0.01e-3, 0.5e-3, 9.0e-3])
def test_every_surface_has_a_label_that_overlaps_no_other(height):
    named = generate(
        TwoBlocks(Block(1.0e-3, height, (8, 4)), Block(2.0e-3, height, (13, 5))), MPI.COMM_SELF
    )
    figure = draw(named)
    figure.draw_without_rendering()
    texts = figure.axes[0].texts
    assert sorted(t.get_text() for t in texts) == sorted(named.surfaces)
    # An annotation's own extent holds its leader line too.
    boxes = [Text.get_window_extent(t) for t in texts]
    frame = figure.axes[0].get_window_extent()
    for box in boxes:
        assert frame.x0 <= box.x0 and box.x1 <= frame.x1
        assert frame.y0 <= box.y0 and box.y1 <= frame.y1
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))


def test_saved_picture_is_an_image_and_nothing_else_is_left(tmp_path):
    save_picture(generate(BLOCKS, MPI.COMM_SELF), tmp_path / "mesh.png", title="Blocks")
    assert [p.name for p in tmp_path.iterdir()] == ["mesh.png"]
    image = imread(tmp_path / "mesh.png")
    assert image.shape[1] > 1000
    assert len(np.unique(image.reshape(-1, image.shape[2]), axis=0)) > 20


@pytest.mark.parametrize(("cell", "factor"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_outer_facets_of_a_mesh_in_space(cell, factor, tmp_path):
    """Every outer facet once, in the colour of its surface, y upwards and z towards the viewer."""
    boxes = TwoBlocks(Box(1e-3, 0.5e-3, 0.6e-3, (4, 2, 3)), Box(2e-3, 0.4e-3, 1e-3, (5, 2, 3)))
    named = generate(replace(boxes, cell=cell), MPI.COMM_SELF)
    figure = draw(named, "Boxes")
    axes = figure.axes[0]
    labels = [handle.get_text() for handle in figure.legends[0].get_texts()]
    counts = {label.split(": ")[0]: int(label.split(": ")[1]) for label in labels}
    assert counts["elastomer_contact"] == factor * 12 and counts["bottom"] == factor * 15
    assert counts["elastomer_front"] == factor * 8 and counts["aluminium_left"] == factor * 6
    assert sum(counts.values()) == factor * (2 * (12 + 6 + 8) + 2 * (15 + 6 + 10))
    assert "other facets" not in counts
    [facets] = axes.collections
    assert len(facets.get_facecolor()) == sum(counts.values())
    assert len(np.unique(facets.get_facecolor(), axis=0)) == len(counts)
    assert axes.get_zlim() == pytest.approx((-0.4, 0.5)) and axes.get_xlabel() == "x (mm)"
    assert axes.get_ylim() == pytest.approx((-1.0, 0.0))
    save_picture(named, tmp_path / "mesh.png")
    assert imread(tmp_path / "mesh.png").shape[1] > 1000


def test_facets_of_no_named_surface_are_drawn_too():
    cube = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 2, 1, 1)
    none = np.empty(0, np.int32)
    cells = dolfinx.mesh.meshtags(cube, 3, np.arange(12, dtype=np.int32), np.ones(12, np.int32))
    facets = dolfinx.mesh.meshtags(cube, 2, none, none)
    figure = draw(NamedMesh(cube, cells, facets, {"body": 1}, {}))
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["other facets: 20"]


def facts(comm, directory):
    """What is drawn: area and number of each body's cells, ends and number of each surface's."""
    figure = draw(generate(BLOCKS, comm))
    if comm.rank > 0:
        assert figure is None
        return None
    axes = figure.axes[0]
    bodies = [c for c in axes.collections if isinstance(c, PolyCollection)]
    lines = [c for c in axes.collections if isinstance(c, LineCollection)]
    return {
        "area": [sum(area(p.vertices) for p in b.get_paths()) for b in bodies],
        "labels": [b.get_label() for b in bodies] + sorted(t.get_text() for t in axes.texts),
        "facets": [len(line.get_segments()) for line in lines],
        "ends": [np.concatenate(line.get_segments()).sum(axis=0).tolist() for line in lines],
    }


@pytest.mark.mpi(facts, 2)
def test_two_ranks_draw_what_one_draws(on_ranks):
    one, two = on_ranks(facts, 1), on_ranks(facts, 2)
    assert (two["labels"], two["facets"]) == (one["labels"], one["facets"])
    assert two["area"] == pytest.approx(one["area"], rel=1e-12)
    np.testing.assert_allclose(two["ends"], one["ends"], atol=1e-12)
