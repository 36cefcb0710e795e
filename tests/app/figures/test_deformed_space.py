"""Pictures of results in space: both bodies, the pair, and what the title and the scale say."""

import json
from pathlib import Path

import meshio
import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.app.figures.made_results import history_row, write_index, write_rows
from tribox.app.figures import style
from tribox.app.figures.animation import animate
from tribox.app.figures.deformed import draw_deformed, draw_pairs, seen_along_normal
from tribox.app.results import Results, read

CASE = """
title = "box on a plate"
bodies.elastomer = { material = "neo-hookean", E = "5 MPa", nu = 0.45 }
bodies.aluminium = { material = "hencky", E = "70 GPa", nu = 0.33 }
boundary = [
 { surface = "bottom", displacement = { x = 0, y = 0, z = 0 } },
 { surface = "top", displacement = { x = 0, z = 0, y = [["0 s", "0 mm"], ["1 s", "-0.02 mm"]] } },
]
stage = [{ name = "press", duration = "1 s", steps = 2 }]
[geometry]
kind = "two-boxes"
upper = { width = "1 mm", height = "0.5 mm", depth = "1 mm", elements = [2, 1, 2] }
lower = { width = "2 mm", height = "0.5 mm", depth = "2 mm", elements = [3, 1, 3] }
[[contact]]
name = "sole"
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "coulomb", mu = 0.2 }
"""


def boxes(step: int) -> tuple[meshio.Mesh, meshio.Mesh]:
    """Fields and contact of an elastomer box on a plate, one cell each."""
    unit = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
    place = 1e-3 * np.concatenate([0.5 * unit + [0.25, 0.0, 0.25], unit - [0.0, 1.0, 0.0]])
    moved = np.zeros_like(place)
    moved[:8, 0] = 1e-4 * step
    fields = meshio.Mesh(
        place + moved,
        [("hexahedron", np.arange(16).reshape(2, 8))],
        point_data={"displacement": moved},
        cell_data={"body": [np.array([0, 1])], "von_mises_stress": [1e6 * step * np.array([1, 2])]},
    )
    sole = place[[0, 1, 5, 4]]
    contact = meshio.Mesh(
        sole + moved[:4],
        [("quad", np.array([[0, 1, 2, 3]]))],
        point_data={
            "reference": sole, "pair": np.zeros(4), "area": np.full(4, 1e-7),
            "pressure": np.full(4, 1e5 * step), "tangential_traction": np.full(4, 1e4),
            "friction_traction": np.tile([1e4, 0.0, 0.0], (4, 1)),
        },
    )  # fmt: skip
    return fields, contact


@pytest.fixture(scope="module")
def box(tmp_path_factory) -> Results:
    directory: Path = tmp_path_factory.mktemp("box")
    (directory / "case.toml").write_text(CASE)
    write_rows(directory / "history.csv", [history_row(s, stage="press") for s in (1, 2)])
    (directory / "summary.json").write_text(json.dumps({"status": "failed"}))
    write_index(directory, (1, 2))
    for kind in ("fields", "contact", "contact_points"):
        (directory / kind).mkdir()
    for step in (1, 2):
        fields, contact = boxes(step)
        fields.write(directory / f"fields/{step:06d}.vtu")
        contact.write(directory / f"contact/{step:06d}.vtu")
        contact.write(directory / f"contact_points/{step:06d}.vtu")
    return read(directory)


def test_picture_in_space(box, tmp_path, monkeypatch):
    kept: dict[str, Figure] = {}
    monkeypatch.setattr(style, "save", lambda f, path: kept.update({path.stem: f}))
    draw_deformed(box, tmp_path, "von_mises_stress")
    [figure] = kept.values()
    assert figure.get_suptitle().startswith("box on a plate\nstage press, t = 1 s, step 2 of 2; ")
    assert "before the failure" in figure.get_suptitle()
    [bodies] = [axes for axes in figure.axes if axes.images]
    assert {"elastomer", "aluminium", "x", "y", "z"} <= {t.get_text() for t in bodies.texts}
    picture = np.asarray(bodies.images[0].get_array())
    assert 0.2 < (picture < 250).any(axis=2).mean() < 0.9
    [panel] = [axes for axes in figure.axes if axes.get_title() == "sole"]
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("x (µm)", "−z (µm)")
    labels = {axes.get_xlabel() for axes in figure.axes}
    assert {"von Mises stress (MPa)", "contact pressure t_N (kPa)"} <= labels
    # The bar and the bodies are in one scale: the plate is 1 mm wide along x.
    [bar] = bodies.lines
    left, right, _, _ = bodies.images[0].get_extent()
    drawn = float(np.ptp(bar.get_xdata())) / (right - left) * picture.shape[1]
    length = next(
        t.get_text() for t in bodies.texts if "µm" in t.get_text() or "mm" in t.get_text()
    )
    in_mm = float(length.split()[0]) * (1e-3 if "µm" in length else 1.0)
    columns = np.flatnonzero((picture < 250).any(axis=(0, 2)))
    across = 0.884 + 0.469  # 1 mm along x and 1 mm along z, seen from the picture's eye
    assert np.ptp(columns) / drawn == pytest.approx(across / in_mm, rel=0.02)


def test_animation_in_space(box, tmp_path):
    assert animate(box, tmp_path / "a.gif", "displacement_x") == 2


# -- Pressure on slaves in space: the rim, and from where it is seen -------------------------------

SIZE, RADIUS = 21, 0.71


def grid() -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(*2 * [np.linspace(-1.0, 1.0, SIZE)])
    corner = np.add.outer(np.arange(SIZE - 1) * SIZE, np.arange(SIZE - 1)).ravel()
    return np.stack([x.ravel(), y.ravel()], axis=1), corner[:, None] + [0, 1, SIZE + 1, SIZE]


def hertz(place: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(1.0 - (place**2).sum(axis=1) / RADIUS**2, 0.0))


def share_inside(place: np.ndarray) -> np.ndarray:
    """Share of a node's surroundings (a cell of the grid round it) within the radius."""
    around = np.stack(np.meshgrid(*2 * [np.linspace(-0.05, 0.05, 21)]), axis=-1).reshape(-1, 2)
    inside = np.linalg.norm(place[:, None] + around, axis=2) < RADIUS
    return inside.mean(axis=1)


def slave(axes: np.ndarray) -> meshio.Mesh:
    """A grid under Hertz's pressure in the plane of two directions; friction along the first."""
    place, facets = grid()
    pressure = 1e6 * hertz(place)
    return meshio.Mesh(
        1e-3 * place @ axes,
        [("quad", facets)],
        point_data={
            "pair": np.zeros(len(place)), "pressure": pressure, "cover": share_inside(place),
            "friction_traction": np.outer(0.1 * pressure, axes[0]),
        },
    )  # fmt: skip


@pytest.mark.parametrize(
    ("axes", "names"),
    [
        ([[1, 0, 0], [0, 0, -1]], ("x", "−z")),  # normal +y
        ([[1, 0, 0], [0, 0, 1]], ("x", "−z")),  # normal −y: turned towards the viewer
        ([[0, 1, 0], [0, 0, 1]], ("−z", "y")),  # normal x
        ([[1, 0, 0], [0, 1, 0]], ("x", "y")),  # normal z
        ([[1, 0, 0], [0, 0.6, -0.8]], ("x", "along (0, 0.6, -0.8)")),
    ],
)
def test_a_slave_is_seen_along_its_normal(axes, names):
    plan = seen_along_normal(slave(np.array(axes, dtype=float)), 0)
    assert plan.names == names
    assert np.ptp(plan.across, axis=0) == pytest.approx([2e-3, 2e-3])


def test_colours_span_the_pressure_and_arrows_show_the_friction():
    mesh = slave(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]))
    figure = Figure(layout="constrained")
    panel = figure.subplots()
    draw_pairs(figure, [panel], mesh, {0: "ball"})
    arrows = panel.collections[-1]
    assert np.asarray(arrows.U).max() == pytest.approx(100.0, rel=0.02)  # kPa
    assert not np.asarray(arrows.V).any()
    assert panel.get_title() == "ball" and panel.get_xlabel() == "x (mm)"
    assert "up to 99" in panel.texts[-1].get_text() or "up to 100" in panel.texts[-1].get_text()
    assert figure.axes[-1].get_xlabel() == "contact pressure t_N (MPa)"
