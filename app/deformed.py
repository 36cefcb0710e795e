"""Picture of the deformed bodies with the contact pressure along the interface."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from app.contact_output import contact_arrays
from app.figures import COLOURS, STYLE, save
from app.model import Model
from geometry.projection import Floats

SLENDER = 6.0  # width over height from which the picture is stretched


def draw_deformed(model: Model, path: Path) -> None:
    """Draw the last converged state; collective, the first rank writes."""
    problem = model.problem
    cells = _deformed_cells(model)
    gathered = problem.comm.gather(cells)
    points = contact_arrays(model)
    if gathered is None or points is None:
        return
    bodies = {
        name: np.concatenate([rank[name] for rank in gathered]) for name in model.named.bodies
    }
    with plt.rc_context(STYLE):
        save(_figure(bodies, points, model.case.title), path)


def _deformed_cells(model: Model) -> dict[str, Floats]:
    """Corner positions (c, a, i), m, current, of this rank's cells by body."""
    problem = model.problem
    space, mesh = problem.space, model.named.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    moved = space.tabulate_dof_coordinates()[:, :2] + problem.u.x.array.reshape(-1, problem.dim)
    order = [0, 1, 3, 2] if mesh.topology.cell_name() == "quadrilateral" else [0, 1, 2]
    out = {}
    for name in model.named.bodies:
        cells = model.named.cells(name)
        out[name] = moved[space.dofmap.list[cells[cells < owned]][:, order]]
    return out


def _figure(bodies: dict[str, Floats], points: dict[str, Floats], title: str) -> Figure:
    corners = np.concatenate([cells.reshape(-1, 2) for cells in bodies.values()])
    width, height = np.ptp(corners, axis=0)
    slender = width > SLENDER * height
    figure, (top, bottom) = plt.subplots(
        2, 1, figsize=(8, 6), sharex=True, height_ratios=(1.4, 1), layout="constrained"
    )
    for colour, (name, cells) in zip(("#d8c3a5", "#b8c4ce"), bodies.items(), strict=False):
        lines = 0.15 if len(cells) < 4000 else 0.0
        top.add_collection(
            PolyCollection(
                list(cells * 1e3), facecolors=colour, edgecolors="0.35", linewidths=lines
            )
        )
        top.plot([], [], "s", color=colour, label=name)
    top.autoscale_view()
    if not slender:
        top.set_aspect("equal", adjustable="datalim")
    top.grid(False)
    pressed = points["pressure"] > 0.0
    marks = top.scatter(
        *(points["position"][pressed] * 1e3).T,
        c=points["pressure"][pressed] / 1e6,
        s=6,
        cmap="inferno",
        zorder=3,
    )
    figure.colorbar(marks, ax=top, label="contact pressure (MPa)")
    top.legend(loc="upper right", fontsize=8)
    stretched = " (vertical scale stretched)" if slender else ""
    top.set_title(f"{title}\ndeformed{stretched}", fontsize=9)
    top.set_ylabel("y (mm)")
    _along(bottom, points)
    return figure


def _along(axes: Axes, points: dict[str, Floats]) -> None:
    """Pressure and friction along the interface."""
    for pair in np.unique(points["pair"]):
        chosen = points["pair"] == pair
        order = np.argsort(points["position"][chosen][:, 0])
        x = points["position"][chosen][order, 0] * 1e3
        for colour, name, label in (
            (COLOURS[0], "pressure", "pressure"),
            (COLOURS[1], "tangential_traction", "friction"),
        ):
            axes.plot(
                x,
                points[name][chosen][order] / 1e6,
                color=colour,
                lw=1.2,
                label=label if pair == 0 else None,
            )
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("traction (MPa)")
    axes.legend(fontsize=8)
