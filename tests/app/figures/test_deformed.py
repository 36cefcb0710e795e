"""The picture of the deformed bodies in the plane: all bodies, all pairs, what it says of them."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from tests.app.figures.made_results import CELLS, PAIRS, strip_contact, write_strip
from tribox.app.figures import style
from tribox.app.figures.deformed import draw_deformed, draw_mesh
from tribox.app.figures.plane_bodies import pair_colour
from tribox.app.figures.run_figures import draw_figures
from tribox.app.results import read


@pytest.fixture
def kept(monkeypatch) -> dict[str, Figure]:
    """The figures themselves, by name, in place of their files."""
    found: dict[str, Figure] = {}
    monkeypatch.setattr(style, "save", lambda figure, path: found.update({path.stem: figure}))
    return found


def panels(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.get_title(loc="left")]


def bodies_of(figure: Figure) -> tuple[Axes, dict[float, int]]:
    """The axes with the bodies, and the number of their cells by value."""
    [(top, cells)] = [
        (axes, shown)
        for axes in figure.axes
        for shown in axes.collections
        if isinstance(shown, PathCollection)
    ]
    counts = [np.sum(path.codes == path.CLOSEPOLY) for path in cells.get_paths()]
    return top, dict(zip(cells.get_array(), counts, strict=True))


def test_all_bodies_and_pairs_are_shown(strip, kept, tmp_path):
    draw_deformed(strip, tmp_path, "von_mises_stress")
    assert set(kept) == {"deformed-1-press", "deformed-highest-load", "deformed"}
    figure = kept["deformed"]
    top, cells = bodies_of(figure)
    stress = dict(zip([5.0, 10.0, 15.0], CELLS, strict=True))  # MPa
    assert {round(value, 9): count for value, count in cells.items()} == stress
    assert {text.get_text() for text in top.texts} == {"punch", "strip", "die"}
    assert (top.get_xlabel(), top.get_ylabel()) == ("x (mm)", "y (mm)")
    assert "von Mises stress (MPa)" in [axes.get_ylabel() for axes in figure.axes]
    assert "strip between punch and die\nstage slide" in figure.get_suptitle()
    # One line of what is pressed for each pair, in the colour of its panel's title.
    found = panels(figure)
    assert [axes.get_title(loc="left") for axes in found] == list(PAIRS)
    marked = [tuple(c.get_colors()[0]) for c in top.collections if c.get_linewidths()[0] == 2.0]
    assert marked == [to_rgba(pair_colour(k)) for k in range(2)]


def test_the_mesh_is_shown_before_anything_moved(strip, kept, tmp_path):
    assert draw_mesh(strip, tmp_path) == [tmp_path / "mesh.png"]
    figure = kept["mesh"]
    top, cells = bodies_of(figure)
    assert sum(cells.values()) == sum(CELLS) and len(cells) == 3  # a colour for each body
    assert f"{sum(CELLS)} cells" in figure.get_suptitle()
    assert {text.get_text() for text in top.texts} == {"punch", "strip", "die"}
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == [f"slave of {pair}" for pair in PAIRS]


def test_one_scale_of_colours_holds_for_all_pictures_of_a_run(strip, kept, tmp_path):
    draw_deformed(strip, tmp_path, "von_mises_stress")  # which grows with every step
    assert len(kept) == 3
    limits = {
        (shown.norm.vmin, shown.norm.vmax)
        for figure in kept.values()
        for axes in figure.axes
        for shown in axes.collections
        if isinstance(shown, PathCollection)
    }
    assert limits == {(0.0, 15.0)}


def test_tractions_are_drawn_over_the_arc_length(strip, kept, tmp_path):
    draw_deformed(strip, tmp_path, "von_mises_stress")
    data = strip_contact(5).point_data
    for number, axes in enumerate(panels(kept["deformed"])):
        curves = {line.get_label(): line.get_data() for line in axes.lines}
        own = data["pair"] == number
        for name, label in (
            ("pressure", "contact pressure t_N"),
            ("tangential_traction", "friction traction T"),
        ):
            arc, values = curves[label]
            np.testing.assert_allclose(arc, np.linspace(0.0, 4.0, 9), atol=1e-12)  # mm
            np.testing.assert_allclose(values, 1e-6 * data[name][own])
        faint = [line for line in axes.lines if line.get_marker() == "."]
        np.testing.assert_allclose(np.sort(faint[0].get_xdata()), np.arange(0.25, 4.0, 0.5))
    below = panels(kept["deformed"])[0].figure
    words = "arc length along the slave from the dot (mm); lengths and areas undeformed"
    assert below.get_supxlabel() == words


@pytest.mark.parametrize("unloaded", [(0,), (0, 1)])
def test_roundoff_of_a_pair_without_load_is_no_curve(kept, tmp_path, unloaded):
    """Beside the 5 MPa of the run 1e-6 Pa are none."""
    directory = write_strip(tmp_path / "out", outputs=(5,))
    mesh = strip_contact(5)
    away = np.isin(mesh.point_data["pair"], unloaded)
    for name in ("pressure", "tangential_traction"):
        mesh.point_data[name][away] *= 1e-6 / mesh.point_data["pressure"].max()
    mesh.write(directory / "contact/000005.vtu")
    draw_deformed(read(directory), tmp_path, "von_mises_stress")
    top, _ = bodies_of(kept["deformed"])
    marked = [c for c in top.collections if c.get_linewidths()[0] == 2.0]
    found = panels(kept["deformed"])
    for number, axes in enumerate(found):
        none = number in unloaded
        assert [text.get_text() for text in axes.texts] == none * ["no load"]
        assert (not axes.lines) == none == (not marked[number].get_segments())
        assert axes.get_ylabel() == ("" if none else "traction (MPa)")
        assert axes.get_xlim() == pytest.approx((-0.08, 4.08))  # mm
    assert not any(axes.get_legend() for axes in found)  # it would lie on the name of a pair
    assert len(found[0].figure.legends) == (1 if unloaded == (0,) else 0)


def test_names_are_never_formulae(kept, tmp_path):
    """What stands between two dollars matplotlib takes for a formula, and this for a wrong one."""
    directory = write_strip(tmp_path / "out")
    for name in ("case.toml", "contacts.csv"):
        text = (directory / name).read_text().replace("upper,", "$\\up$,")
        text = text.replace('name = "upper"', r"name = '$\up$'")
        (directory / name).write_text(text.replace('title = "strip', "title = '$2 to $3'  # \""))
    found = draw_figures(read(directory))
    assert directory / "figures" / "history.png" in found
    figure = kept["deformed"]
    assert figure.get_suptitle().startswith("$2 to $3")
    assert not figure._suptitle.get_parse_math()
    assert r"$\up$" in [axes.get_title(loc="left") for axes in panels(figure)]


def test_another_field_and_an_axisymmetric_section(kept, tmp_path):
    results = read(write_strip(tmp_path / "out", section="axisymmetric"))
    draw_deformed(results, tmp_path, "displacement_x")
    figure = kept["deformed-displacement_x"]
    top, cells = bodies_of(figure)
    assert (top.get_xlabel(), top.get_ylabel()) == ("r (mm)", "z (mm)")
    assert {round(value, 9): count for value, count in cells.items()} == {
        300.0: CELLS[0],  # µm
        0.0: CELLS[1] + CELLS[2],
    }
    assert "displacement u_x (µm)" in [axes.get_ylabel() for axes in figure.axes]
