"""Picture of the deformed bodies with the contact pressure along the interface."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from app.build.model import Model
from app.figures.style import COLOURS, STYLE, save
from app.results.contact_nodes import ContactNodes, contact_nodes
from app.results.contact_points import contact_arrays
from geometry.compat import cell_nodes
from geometry.pictures.space import add_facets, facet_polygons, frame, outer_facets
from geometry.surfaces.facets import Floats

BODY_COLOURS = ("#d8c3a5", "#b8c4ce")
SLENDER = 6.0  # width over height from which the picture is stretched
FRAME = 2.6  # width over height of the frame round the bodies, at most


def draw_deformed(model: Model, path: Path) -> None:
    """Draw the last converged state; collective, the first rank writes."""
    problem = model.problem
    flat = model.named.mesh.geometry.dim == 2
    cells = _deformed_cells(model) if flat else _deformed_facets(model)
    gathered = problem.comm.gather(cells)
    points, nodes = contact_arrays(model), contact_nodes(model)
    if gathered is None or points is None or nodes is None:
        return
    bodies = {
        name: np.concatenate([rank[name] for rank in gathered]) for name in model.named.bodies
    }
    with rc_context(STYLE):
        figure = _figure if flat else _figure_in_space
        save(figure(bodies, points, nodes, model.case.title), path)


def _deformed_cells(model: Model) -> dict[str, Floats]:
    """Corner positions (c, a, i), m, current, of this rank's cells by body."""
    mesh = model.named.mesh
    owned = mesh.topology.index_map(mesh.topology.dim).size_local
    moved = _moved_nodes(model)[:, :2]
    order = [0, 1, 3, 2] if mesh.topology.cell_name() == "quadrilateral" else [0, 1, 2]
    out = {}
    for name in model.named.bodies:
        cells = model.named.cells(name)
        out[name] = moved[cell_nodes(mesh)[cells[cells < owned]][:, order]]
    return out


def _deformed_facets(model: Model) -> dict[str, Floats]:
    """Corner positions (f, a, i), m, current, of this rank's outer facets by body."""
    facets, body = outer_facets(model.named)
    moved, mesh = _moved_nodes(model), model.named.mesh
    return {
        name: facet_polygons(mesh, facets[body == tag], moved)
        for name, tag in model.named.bodies.items()
    }


def _moved_nodes(model: Model) -> Floats:
    """Positions (n, 3), m, current, of the mesh's own nodes, which are its corners."""
    problem, geometry = model.problem, model.named.mesh.geometry
    layout = problem.space.dofmap.dof_layout
    nodes = cell_nodes(model.named.mesh)
    at = [layout.entity_dofs(0, corner)[0] for corner in range(nodes.shape[1])]
    moved: Floats = geometry.x.copy()
    values = problem.u.x.array.reshape(-1, problem.dim)
    # The displacement's own nodes may be more, and are numbered in their own way.
    displacement = np.zeros((len(moved), problem.dim))
    displacement[nodes] = values[problem.space.dofmap.list[:, at]]
    moved[:, : problem.dim] += displacement
    return moved


def _figure(
    bodies: dict[str, Floats], points: dict[str, Floats], nodes: ContactNodes, title: str
) -> Figure:
    """The bodies with the pressure between them, and below the tractions along the contact."""
    corners = np.concatenate([cells.reshape(-1, 2) for cells in bodies.values()])
    width, height = np.ptp(corners, axis=0)
    slender = width > SLENDER * height
    figure = Figure(figsize=(8, 6), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1))
    for colour, (name, cells) in zip(BODY_COLOURS, bodies.items(), strict=False):
        lines = 0.15 if len(cells) < 4000 else 0.0
        top.add_collection(
            PolyCollection(
                list(cells * 1e3), facecolors=colour, edgecolors="0.35", linewidths=lines
            )
        )
        top.plot([], [], "s", color=colour, label=name)
    top.autoscale_view()
    if not slender:
        # Both frames share x, so equal scales change the limits of y: of tall bodies they would cut
        # off the ends.
        middle = 0.5e3 * (corners[:, 0].min() + corners[:, 0].max())
        half = 0.525e3 * max(width, FRAME * height)
        top.set_xlim(middle - half, middle + half)
        top.set_aspect("equal", adjustable="datalim")
    top.grid(False)
    marks = top.add_collection(_pressed_facets(nodes))
    figure.colorbar(marks, ax=top, label="contact pressure (MPa)")
    # Below: bodies may fill all of the frame.
    top.legend(loc="upper center", bbox_to_anchor=(0.5, -0.02), ncols=len(bodies), fontsize=8)
    stretched = " (vertical scale stretched)" if slender else ""
    top.set_title(f"{title}\ndeformed{stretched}", fontsize=9)
    top.set_ylabel("y (mm)")
    _along(bottom, points, nodes)
    return figure


def _pressed_facets(nodes: ContactNodes) -> LineCollection:
    """The slave facets that carry pressure, in its colours, in the plane."""
    values, facets = nodes.values, nodes.facets
    pressure = values["pressure"][facets].mean(axis=1)
    pressed = pressure > 0.0
    return LineCollection(
        list(values["position"][facets[pressed]] * 1e3),
        array=pressure[pressed] / 1e6,
        cmap="inferno",
        linewidths=2.5,
        zorder=3,
    )


def _figure_in_space(
    bodies: dict[str, Floats], points: dict[str, Floats], nodes: ContactNodes, title: str
) -> Figure:
    """The bodies from outside, and the pressure on the contact seen from above."""
    figure = Figure(figsize=(11, 5.5), layout="constrained")
    left = figure.add_subplot(1, 2, 1, projection="3d")
    colours = dict(zip(bodies, itertools.cycle(BODY_COLOURS), strict=False))
    add_facets(left, [(facets * 1e3, colours[name]) for name, facets in bodies.items()])
    for name, colour in colours.items():
        left.plot([], [], "s", color=colour, label=name)
    frame(left, np.concatenate([f.reshape(-1, 3) for f in bodies.values()]) * 1e3, "mm")
    left.legend(loc="upper right", fontsize=8)
    left.set_title(f"{title}\ndeformed", fontsize=9)
    right = figure.add_subplot(1, 2, 2)
    marks = _seen_from_above(right, nodes)
    open_ = points["pressure"] <= 0.0
    x, z = points["position"][open_][:, 0] * 1e3, points["position"][open_][:, 2] * 1e3
    right.plot(x, z, ".", color="0.8", ms=1)
    figure.colorbar(marks, ax=right, label="contact pressure (MPa)")
    right.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal")
    right.set_title("contact, from above", fontsize=9)
    right.invert_yaxis()  # z points towards the viewer
    right.grid(False)
    return figure


def _seen_from_above(axes: Axes, nodes: ContactNodes) -> Collection:
    """Nodal pressure over the slave's facets, shaded between the nodes."""
    values, facets = nodes.values, nodes.facets
    halves = [facets[:, :3]] if nodes.kind == "triangle" else [facets[:, :3], facets[:, [0, 2, 3]]]
    triangles = np.concatenate(halves)
    pressed = (values["pressure"][triangles] > 0.0).any(axis=1)
    x, z = values["position"][:, 0] * 1e3, values["position"][:, 2] * 1e3
    mesh = Triangulation(x, z, triangles, mask=~pressed)
    return axes.tripcolor(mesh, values["pressure"] / 1e6, shading="gouraud", cmap="inferno")


def _along(axes: Axes, points: dict[str, Floats], nodes: ContactNodes) -> None:
    """Pressure and friction along the interface: nodal ones as lines, those of points faint."""
    values = nodes.values
    for pair in np.unique(values["pair"]):
        at, of = (np.nonzero(table["pair"] == pair)[0] for table in (values, points))
        at = at[np.argsort(values["position"][at, 0])]
        for colour, name, label in (
            (COLOURS[0], "pressure", "pressure"),
            (COLOURS[1], "tangential_traction", "friction"),
        ):
            shown = label if pair == 0 else None
            axes.plot(
                points["position"][of, 0] * 1e3,
                points[name][of] / 1e6,
                ".",
                color=colour,
                alpha=0.25,
                ms=3,
                mew=0,
            )
            place, value = values["position"][at, 0] * 1e3, values[name][at] / 1e6
            axes.plot(place, value, color=colour, lw=1.2, label=shown)
    axes.set_xlabel("x (mm)")
    axes.set_ylabel("traction (MPa), points faint")
    axes.legend(fontsize=8)
