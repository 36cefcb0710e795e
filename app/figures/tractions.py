"""Tractions and films of contact pairs along the arc length of their slave surfaces, in the plane.

Axis letters: v vertices, f facets, q points, i space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tribox.app.figures import style
from tribox.app.figures.style import Floats, Unit
from tribox.geometry.surfaces.facets import chains

if TYPE_CHECKING:
    import meshio

    from tribox.app.results import Results

Ints = NDArray[np.int64]

MOST_POINTS = 20_000  # contact points beyond which they are left out: one colour, and slow
SMALL = 0.35  # share of a surface below which only what is pressed is shown
MARGIN = 0.25  # of the pressed length, then shown on either side of it
MOST_STAGES = 6  # of a run whose films are shown together
LOADED_FILM = 1e-2  # of the largest pressure, from which on a vertex counts as loaded
THINNEST, THICKEST = 0.7, 100.0  # of the least film, between which the axis lies
NO_LOAD = 1e-9  # of the largest mean pressure of a run, below which a pressure is round-off


@dataclass(frozen=True, slots=True)
class Line:
    """A slave surface in the plane, in the order of its arc length."""

    vertices: Ints  # (v,) numbers of the nodes of the contact file along the line, piece by piece
    arc: Floats  # (v,), m, undeformed arc length of each from the line's start
    starts: tuple[int, ...]  # positions in ``vertices`` where pieces begin, the first too

    def broken(self, values: Floats) -> tuple[Floats, Floats]:
        """Arc length, m, and values (v,) with a gap between two pieces, to draw as one line."""
        at = list(self.starts[1:])
        return np.insert(self.arc, at, np.nan), np.insert(values[self.vertices], at, np.nan)


def slave_line(reference: Floats, facets: Ints, pressed: NDArray[np.bool_]) -> Line:
    """Vertices of a slave surface in their order along it.

    From the left to the right, or from below to above; a closed one (a roller's) is cut in the
    middle of what is not pressed. Pieces that do not hang together follow one another.
    ``reference``: (n, i), m, of all nodes; ``facets``: (f, 2); ``pressed``: (n,), whether nodes
    are.
    """
    pieces = sorted(
        (_directed(chain, reference, pressed) for chain in chains(facets)),
        key=lambda chain: tuple(reference[chain[0]]),
    )
    arcs, starts, end, count = [], [], 0.0, 0
    for chain in pieces:
        steps = np.linalg.norm(np.diff(reference[chain], axis=0), axis=1)
        arcs.append(end + np.concatenate([[0.0], np.cumsum(steps)]))
        starts.append(count)
        end, count = float(arcs[-1][-1]), count + len(chain)
    return Line(np.concatenate(pieces), np.concatenate(arcs), tuple(starts))


def _directed(chain: Ints, reference: Floats, pressed: NDArray[np.bool_]) -> Ints:
    """A piece from left to right, or from below; a closed one cut where nothing is pressed."""
    if chain[0] == chain[-1] and len(chain) > 2:
        ring = chain[:-1]
        turned = np.roll(ring, -_middle_of_gap(pressed[ring]))
        arms = reference[turned] - reference[ring].mean(axis=0)
        # Twice the area within, > 0 against the clock.
        area = np.cross(np.c_[arms, np.zeros(len(arms))], np.roll(np.c_[arms, 0 * arms[:, :1]], -1,
                        axis=0))[:, 2].sum()  # fmt: skip
        turned = turned if area > 0.0 else np.roll(turned[::-1], 1)
        return np.append(turned, turned[0])
    ends = reference[chain[[0, -1]]]
    across = np.abs(ends[1] - ends[0])
    axis = 0 if across[0] >= across[1] else 1
    return chain if ends[0, axis] <= ends[1, axis] else chain[::-1]


def _middle_of_gap(pressed: NDArray[np.bool_]) -> int:
    """Place in the middle of the longest run of a ring that is not pressed; 0 if all of it is."""
    if pressed.all() or not pressed.any():
        return 0
    # From a pressed place on, so that no gap runs over the end of the row.
    first = int(np.argmax(pressed))
    around = np.roll(pressed, -first)
    edges = np.flatnonzero(np.diff(np.r_[True, around, True].astype(int)))
    begins, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - begins))
    return int(first + (begins[longest] + ends[longest]) // 2) % len(pressed)


def arc_of_points(line: Line, nodes: Floats, points: Floats) -> Floats:
    """Arc length (q,), m, of ``points`` (q, i) on the line of ``nodes`` (n, i), all undeformed."""
    from scipy.spatial import cKDTree

    within = np.setdiff1d(np.arange(len(line.vertices) - 1), np.array(line.starts[1:]) - 1)
    place = nodes[line.vertices]
    begin, along = place[within], place[within + 1] - place[within]
    # Of facets of unlike lengths the one with the nearest middle need not hold the point.
    near = min(3, len(within))
    _, candidates = cKDTree(begin + 0.5 * along).query(points, k=near)
    candidates = np.asarray(candidates).reshape(len(points), near)
    a, d = begin[candidates], along[candidates]
    share = ((points[:, None] - a) * d).sum(axis=2) / (d**2).sum(axis=2)
    share = np.clip(share, 0.0, 1.0)
    off = ((points[:, None] - a - share[..., None] * d) ** 2).sum(axis=2)
    best = np.argmin(off, axis=1)[:, None]
    facet = within[np.take_along_axis(candidates, best, axis=1)[:, 0]]
    t = np.take_along_axis(share, best, axis=1)[:, 0]
    return line.arc[facet] + t * (line.arc[facet + 1] - line.arc[facet])


def facets_of(mesh: meshio.Mesh, pair: int) -> Ints:
    """Facets (f, a) of a pair in a contact file, in all its blocks."""
    of = np.rint(np.asarray(mesh.point_data["pair"], dtype=np.float64)).astype(np.int64)
    blocks = [np.asarray(block.data, dtype=np.int64) for block in mesh.cells]
    own = [of[block[:, 0]] == pair for block in blocks]
    return np.concatenate([block[one] for block, one in zip(blocks, own, strict=True)])


def pairs_shown(nodes: meshio.Mesh, count: int, most: int) -> list[int]:
    """Numbers of the pairs to show: all, or those that carry most; in their order."""
    data = nodes.point_data
    force = np.bincount(
        np.rint(data["pair"]).astype(np.int64), data["pressure"] * data["area"], minlength=count
    )
    return sorted(int(pair) for pair in np.argsort(-force, kind="stable")[:most])


def roundoff_of(results: Results) -> float:
    """Pressure, Pa, below which there is none: far below the largest N/A of any step and pair."""
    table = results.table("contacts" if len(results.table("contacts")) else "history")
    if not len(table) or not {"normal_force", "contact_area"} <= table.columns.keys():
        return 0.0
    force, area = table["normal_force"], table["contact_area"]
    touching = area > 0.0
    return NO_LOAD * float(np.max(np.abs(force[touching]) / area[touching], initial=0.0))


def without_roundoff(nodes: meshio.Mesh, roundoff: float) -> meshio.Mesh:
    """The contact file, changed: no traction at nodes whose pressure is round-off."""
    data = nodes.point_data
    none = np.asarray(data["pressure"], dtype=np.float64) < roundoff
    for name in ("pressure", "tangential_traction", "friction_traction"):
        if name in data:
            data[name] = np.array(data[name], dtype=np.float64)
            data[name][none] = 0.0
    return nodes


def write_no_load(axes: Axes) -> None:
    """Write in a panel that its pair carries nothing."""
    axes.text(0.5, 0.5, "no load", transform=axes.transAxes, ha="center", va="center",
              fontsize=9, color="0.35")  # fmt: skip


def draw_tractions(
    axes: Axes,
    nodes: meshio.Mesh,
    points: meshio.Mesh | None,
    pair: int,
    length: Unit,
    stress: Unit,
) -> None:
    """Pressure and friction of a pair along its slave, if any: nodal as lines, of points faint."""
    reference = np.asarray(nodes.point_data["reference"], dtype=np.float64)[:, :2]
    pressure = np.asarray(nodes.point_data["pressure"], dtype=np.float64)
    line = slave_line(reference, facets_of(nodes, pair), pressure > 0.0)
    _show_pressed(axes, line, pressure, length)
    if not (pressure[line.vertices] > 0.0).any():
        write_no_load(axes)
        axes.set_yticks([])
        return
    shown = [
        ("pressure", style.CONTACT_PRESSURE, style.COLOURS[0]),
        ("tangential_traction", style.TRACTION, style.COLOURS[1]),
    ]
    for name, quantity, colour in shown:
        arc, values = line.broken(np.asarray(nodes.point_data[name], dtype=np.float64))
        label = quantity.words
        axes.plot(length.of(arc), stress.of(values), color=colour, lw=1.3, label=label)
    if points is not None and len(points.points) <= MOST_POINTS:
        data = points.point_data
        own = np.rint(data["pair"]) == pair
        at = arc_of_points(line, reference, np.asarray(data["reference"], float)[own, :2])
        for name, _, colour in shown:
            axes.plot(length.of(at), stress.of(data[name][own]), ".", color=colour, alpha=0.25,
                      ms=3, mew=0, zorder=1)  # fmt: skip


def _show_pressed(axes: Axes, line: Line, pressure: Floats, length: Unit) -> None:
    """Limits round what is pressed, where that is a small part of the surface."""
    at = line.arc[pressure[line.vertices] > 0.0]
    whole = line.arc[-1]
    if not len(at) or np.ptp(at) > SMALL * whole:
        axes.set_xlim(-0.02 * length.factor * whole, 1.02 * length.factor * whole)
        return
    margin = max(MARGIN * float(np.ptp(at)), 0.03 * whole)
    axes.set_xlim(length.factor * (at.min() - margin), length.factor * (at.max() + margin))


def line_starts(nodes: meshio.Mesh, pairs: Sequence[int]) -> dict[int, Floats]:
    """Current place (i,), m, of the point where the arc length of each pair begins."""
    reference = np.asarray(nodes.point_data["reference"], dtype=np.float64)[:, :2]
    pressed = np.asarray(nodes.point_data["pressure"]) > 0.0
    return {
        pair: nodes.points[slave_line(reference, facets_of(nodes, pair), pressed).vertices[0], :2]
        for pair in pairs
    }


# -- Films that are unknowns -----------------------------------------------------------------------


def film_figure(results: Results) -> Figure | None:
    """Film and both pressures along the slave at the end of each stage; None without such a film.

    Of many stages some are shown, evenly over the run. A column is a pair whose film is an unknown.
    """
    table = results.case.contact
    pairs = [n for n, one in enumerate(table) if one.film is not None and one.film.is_unknown]
    ends = [(name, step) for name, step in style.stage_ends(results) if step in results.steps]
    if not pairs or not ends:
        return None
    few = np.unique(np.linspace(0, len(ends) - 1, min(len(ends), MOST_STAGES)).round().astype(int))
    shown = [(ends[k][0], results.contact(ends[k][1])) for k in few]
    if "film_pressure" not in shown[0][1].point_data:
        return None
    figure = Figure(figsize=(6.5 * len(pairs), 6.4), layout="constrained")
    panels = figure.subplots(2, len(pairs), squeeze=False, sharex="col")
    for column, pair in zip(panels.T, pairs, strict=True):
        film = table[pair].film
        assert film is not None
        _draw_films(column, shown, pair, film.sigma or 0.0)
        column[0].set_title(style.pair_names(results)[pair] if len(pairs) > 1 else "", fontsize=9)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
    words = "the film, and what it and the asperities carry, at the end of stages"
    figure.suptitle(style.titled(results.case.title, words), fontsize=9)
    return figure


def _draw_films(
    panels: Sequence[Axes], shown: list[tuple[str, meshio.Mesh]], pair: int, sigma: float
) -> None:
    """The films of some states of a pair above, their pressures below."""
    lines, films, pressures = [], [], []
    for _, nodes in shown:
        data = {name: np.asarray(v, dtype=np.float64) for name, v in nodes.point_data.items()}
        wet, dry = data["film_pressure"], data["asperity_pressure"]
        loaded = wet + dry > LOADED_FILM * float(np.max(wet + dry, initial=0.0))
        line = slave_line(data["reference"][:, :2], facets_of(nodes, pair), loaded)
        film = np.where(data["film_thickness"] > 0.0, data["film_thickness"], np.nan)
        lines.append((line, loaded[line.vertices]))
        films.append(line.broken(film))
        pressures.append((line.broken(wet)[1], line.broken(dry)[1]))
    # Films are thin by far where they carry, and there alone they are of interest.
    inside = np.concatenate([line.arc[on] for line, on in lines])
    reach = max(float(np.ptp(inside)) if len(inside) else 0.0, 1e-12)
    length = style.fitting(lines[0][0].arc, "m")
    low = inside.min() - 0.4 * reach if len(inside) else 0.0
    high = inside.max() + 0.4 * reach if len(inside) else lines[0][0].arc[-1]
    low, high = max(low, 0.0), min(high, float(lines[0][0].arc[-1]))
    near = [h[(at >= low) & (at <= high) & np.isfinite(h)] for at, h in films]
    least = min((float(h.min()) for h in near if len(h)), default=1.0)
    most = max((float(h.max()) for h in near if len(h)), default=1.0)
    thin = style.fitting([least * 10.0], "m")
    stress = style.fitting(np.concatenate([p for both in pressures for p in both]), "Pa")
    for number, ((name, _), (at, h), (wet, dry)) in enumerate(
        zip(shown, films, pressures, strict=True)
    ):
        colour = style.colour_of(number)
        panels[0].plot(length.of(at), thin.of(h), color=colour, lw=1.3, label=name)
        panels[1].plot(length.of(at), stress.of(wet), color=colour, lw=1.3)
        if sigma > 0.0:
            panels[1].plot(length.of(at), stress.of(dry), color=colour, lw=1.1, ls="--")
    if sigma > 0.0:
        panels[0].axhline(float(thin.of(sigma)), color="0.5", lw=0.8, ls=":")
        panels[0].annotate("σ", (1.0, float(thin.of(sigma))), xycoords=("axes fraction", "data"),
                           xytext=(-4, 2), textcoords="offset points", ha="right",
                           fontsize=8, color="0.35")  # fmt: skip
    panels[0].set_yscale("log")
    ceiling = min(THICKEST * least, 1.5 * most)
    panels[0].set_ylim(float(thin.of(THINNEST * least)), float(thin.of(ceiling)))
    panels[0].set_xlim(float(length.of(low)), float(length.of(high)))
    panels[0].set_ylabel(f"film h ({thin.name})")
    words = "film p_f, asperities p_a dashed" if sigma > 0.0 else "film p_f"
    panels[1].set_ylabel(f"{words} ({stress.name})")
    panels[1].set_xlabel(f"undeformed arc length of the slave ({length.name})")
    style.thin_log_ticks(panels[0])
