"""Pressure on slaves in space: the rim, and from where it is seen."""

from __future__ import annotations

import meshio
import numpy as np
import pytest
from matplotlib.figure import Figure

from tribox.app.figures.deformed_space import draw_pairs, seen_along_normal, touching
from tribox.app.figures.tractions import without_roundoff

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


def test_the_rim_is_round():
    """Drawn down to zero at the open nodes, the rim would lie between 1 and 1.2 radii."""
    place, facets = grid()
    rim = touching(slave(np.eye(3)[:2]), facets, place).vertices
    distance = np.linalg.norm(rim[1:-1], axis=1)
    assert distance.max() / RADIUS < 1.02
    assert distance.min() / RADIUS > 0.97


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


def test_a_slave_without_load_says_so():
    mesh = slave(np.eye(3)[:2])
    mesh.point_data["pressure"] *= 1e-12
    figure = Figure(layout="constrained")
    panel = figure.subplots()
    draw_pairs(figure, [panel], without_roundoff(mesh, 1e-3), {0: "ball"})
    assert [text.get_text() for text in panel.texts] == ["no load"]


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
