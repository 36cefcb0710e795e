"""The picture of a mesh: complete and labelled."""

from dataclasses import replace
from itertools import combinations

import dolfinx
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.image import imread
from matplotlib.text import Text
from mpi4py import MPI

from tribox.app.figures.mesh_picture import Arrow, Marks, draw, save_picture
from tribox.geometry.generators.two_blocks import Block, Box, TwoBlocks
from tribox.geometry.meshes.mesh import NamedMesh, generate

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
    save_picture(generate(BLOCKS, MPI.COMM_SELF), tmp_path / "mesh.png", "Blocks")
    assert [p.name for p in tmp_path.iterdir()] == ["mesh.png"]
    image = imread(tmp_path / "mesh.png")
    assert image.shape[1] > 1000
    assert len(np.unique(image.reshape(-1, image.shape[2]), axis=0)) > 20


BOXES = TwoBlocks(Box(1e-3, 0.5e-3, 0.6e-3, (4, 2, 3)), Box(2e-3, 0.4e-3, 1e-3, (5, 2, 3)))


def words(figure):
    return [handle.get_text() for handle in figure.legends[0].get_texts()]


@pytest.mark.parametrize(("cell", "factor"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_outer_facets_of_a_mesh_in_space(cell, factor, tmp_path):
    """Every outer facet once, in the colour of its surface, y upwards and z towards the viewer."""
    named = generate(replace(BOXES, cell=cell), MPI.COMM_SELF)
    figure = draw(named, "Boxes")
    counts = {name: int(number) for name, number in (w.split(": ") for w in words(figure))}
    assert counts["elastomer_contact"] == factor * 12 and counts["bottom"] == factor * 15
    assert counts["elastomer_front"] == factor * 8 and counts["aluminium_left"] == factor * 6
    assert sum(counts.values()) == factor * (2 * (12 + 6 + 8) + 2 * (15 + 6 + 10))
    assert "other facets" not in counts
    first, _, front, above = figure.axes
    assert [t.get_text() for t in first.texts if t.get_text() in named.bodies] == [*named.bodies]
    assert (front.get_xlabel(), front.get_ylabel()) == ("x (mm)", "y (mm)")
    assert (above.get_xlabel(), above.get_ylabel()) == ("x (mm)", "z (mm)")
    for axes, rows in ((front, (-0.4e-3, 0.5e-3)), (above, (-1e-3, 0.0))):
        # From the front the upper box is the middle half of the lower, from above .6 of its depth.
        picture = np.asarray(axes.images[0].get_array())
        left, right, low, high = axes.images[0].get_extent()
        assert left < 0.0 < 2e-3 < right and low < rows[0] < rows[1] < high
        drawn = (picture < 255).any(axis=2)
        pixel = (right - left) / drawn.shape[1]
        assert drawn.any(axis=0).sum() * pixel == pytest.approx(2e-3, abs=2 * pixel)
        assert drawn.any(axis=1).sum() * pixel == pytest.approx(rows[1] - rows[0], abs=2 * pixel)
    save_picture(named, tmp_path / "mesh.png", "")
    assert imread(tmp_path / "mesh.png").shape[1] > 1000


def sheet(direction):
    """A sheet that is thin along y or z."""
    x, thin = [20e-3, 20e-3, 20e-3], 1e-3
    x[direction] = thin
    cube = dolfinx.mesh.create_box(MPI.COMM_SELF, [[0.0] * 3, x], [2, 2, 2])
    cells = dolfinx.mesh.meshtags(cube, 3, np.arange(48, dtype=np.int32), np.ones(48, np.int32))
    side = dolfinx.mesh.locate_entities_boundary(cube, 2, lambda p: np.isclose(p[0], 0.0))
    facets = dolfinx.mesh.meshtags(cube, 2, np.sort(side), np.ones(len(side), np.int32))
    return NamedMesh(cube, cells, facets, {"sheet": 1}, {"side": 1})


def test_a_platen_presses_whatever_sense_its_direction_has():
    """Into the body on either side of it; an arrow that does not press keeps its own sense."""
    inwards = np.array([[0.6, -0.8], [0.0, 1.0]])
    platen = Arrow((0.0, 1.0, 0.0), "loaded", presses=True)
    assert platen.ways(inwards).tolist() == [[0.0, -1.0], [0.0, 1.0]]
    assert Arrow((0.0, 1.0), "moved").ways(inwards).tolist() == [[0.0, 1.0], [0.0, 1.0]]


@pytest.mark.parametrize(("thin", "upwards"), [(1, "y"), (2, "z")])
def test_a_sheet_lies_flat_and_slaves_decide(thin, upwards):
    """What lies flat is seen from above, whatever a drawing calls upwards."""
    named = sheet(thin)
    front = draw(named).axes[2]
    assert front.get_ylabel() == f"{upwards} (mm)"
    # A slave across x decides nothing.
    assert draw(named, marks=Marks(slaves=["side"])).axes[2].get_ylabel() == "y (mm)"


def test_what_is_done_is_drawn_where_it_is_seen():
    """Pressure along x: an arrow into the body from the front and above, by as much in each."""
    done = {"side": [Arrow(None, "loaded"), Arrow((0.0, 1.0, 0.0), "held")]}
    figure = draw(sheet(1), marks=Marks(arrows=done))
    for axes in figure.axes[2:]:
        [arrow] = [t for t in axes.texts if t.arrowprops]
        (tip, _), (tail, _) = arrow.xy, arrow.get_position()
        assert tip == pytest.approx(0.0, abs=1e-12) and tail == pytest.approx(-4e-3)
        assert axes.get_xlim()[0] < tail, "all of it is in the picture"
    assert words(figure)[-2:] == ["held", "loaded"]


def test_facets_of_no_named_surface_are_drawn_too():
    cube = dolfinx.mesh.create_unit_cube(MPI.COMM_SELF, 2, 1, 1)
    none = np.empty(0, np.int32)
    cells = dolfinx.mesh.meshtags(cube, 3, np.arange(12, dtype=np.int32), np.ones(12, np.int32))
    facets = dolfinx.mesh.meshtags(cube, 2, none, none)
    assert words(draw(NamedMesh(cube, cells, facets, {"body": 1}, {}))) == ["other facets: 20"]
