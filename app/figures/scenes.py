"""Bodies in space as a picture: the camera, and a renderer of its own that needs no display.

Axis letters: n nodes, f facets, a corners, i space, t triangles, r rows of pixels in triangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from tribox.app.figures.body_shapes import Bodies, ColourScale, Ints
from tribox.app.figures.plane_bodies import Frame
from tribox.app.figures.style import Floats, fitting

if TYPE_CHECKING:
    from tribox.app.results import Results


OBLIQUE = (0.435, 0.819, 0.375)  # towards an eye on the right, in front and above
LIGHT = (0.010, 0.599, 0.801)  # unit vector to it, along the camera's right, up and eye
PIXELS = 900  # of the longer side of a picture
MARGIN = 0.03  # round the frame, of its longer side
EDGE, OUTLINE = 0.72, 0.35  # brightness of the lines between facets, and round bodies
EDGES_SHOWN = 20_000  # facets beyond which the lines between them are left out
CHUNK = 4_000_000  # pixels of facets at a time
SHARED = 1e-6  # pixels, by which triangles are wider: a common side is of both


@dataclass(frozen=True, slots=True)
class Camera:
    """Unit vectors (3,) along which the picture is drawn, and towards the eye."""

    right: Floats
    up: Floats
    eye: Floats

    @property
    def plane(self) -> Floats:
        """(3, 2), to take places in space to the picture."""
        return np.stack([self.right, self.up], axis=1)


def camera_at(eye: tuple[float, float, float], upwards: int = 1) -> Camera:
    """A camera that looks from ``eye``: to the right (x), to the front, and upwards (y 1, z 2)."""
    x, up = np.eye(3)[[0, upwards]]
    towards = np.array(eye) @ np.stack([x, np.cross(x, up), up])
    right = np.cross(up, towards)
    right = right if right.any() else x  # seen from above or below
    towards, right = towards / np.linalg.norm(towards), right / np.linalg.norm(right)
    return Camera(right, np.cross(towards, right), towards)


STANDARD = camera_at(OBLIQUE)


@dataclass(frozen=True, slots=True)
class Scene:
    """A state to render, in parallel projection: all of it in one scale."""

    position: Floats  # (n, 3), m
    polygons: NDArray[np.int64]  # (f, a), a ≥ 3, convex or nearly so
    colours: Floats  # (f, 3), of each polygon, 0 to 1
    body: NDArray[np.int64]  # (f,) number of its body
    low: Floats  # (3,), m, corners of the frame: scenes of one frame are seen from one place
    high: Floats  # likewise
    camera: Camera = STANDARD  # from where it is seen
    ambient: float = 0.62  # brightness of a facet that is turned away from the light

    @property
    def window(self) -> tuple[Floats, Floats]:
        """Corners of what is seen, m, in the camera's plane."""
        box = np.stack(np.meshgrid(*zip(self.low, self.high, strict=True)), axis=-1)
        seen = box.reshape(-1, 3) @ self.camera.plane
        low, high = seen.min(axis=0), seen.max(axis=0)
        margin = MARGIN * float((high - low).max() or 1.0)
        return low - margin, high + margin

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        low, high = self.window
        extent = (high - low) / (high - low).max()
        return int(np.ceil(extent[0] * PIXELS)), int(np.ceil(extent[1] * PIXELS))

    @property
    def pixel(self) -> float:
        """Width of a pixel, m."""
        low, high = self.window
        return float((high - low).max()) / PIXELS


def facets_seen(scene: Scene) -> NDArray[np.int64]:
    """The facet (h, w) that each pixel shows, from the top row on; −1 where there is none.

    Of all facets at the middle of a pixel the one nearest to the eye wins.
    """
    width, height = scene.size
    low, _ = scene.window
    corners = scene.position[scene.polygons]
    flat: Floats = np.asarray((corners @ scene.camera.plane - low) / scene.pixel)
    parts = [[0, k, k + 1] for k in range(1, corners.shape[1] - 1)]  # triangles of a facet
    places = flat[:, parts].reshape(-1, 3, 2)
    facet = np.repeat(np.arange(len(flat)), len(parts))
    origin, slopes = _depths(places, (corners @ scene.camera.eye)[:, parts].reshape(-1, 3))
    triangle, row, first, count = _spans(places, width, height)
    image = np.full(width * height, -1, dtype=np.int64)
    nearest = np.full(width * height, -np.inf)
    chunk = np.cumsum(count) // CHUNK
    for part in np.split(np.arange(len(row)), np.flatnonzero(np.diff(chunk)) + 1):
        many = count[part]
        of = np.repeat(triangle[part], many)
        # Runs of different lengths as one row of numbers: each starts at its first pixel and counts
        # on.
        column = np.repeat(first[part] - np.cumsum(many) + many, many) + np.arange(len(of))
        line = np.repeat(row[part], many)
        at = (height - 1 - line) * width + column
        depth = origin[of] + slopes[of, 0] * column + slopes[of, 1] * line
        # Depth buffer: the nearest of all facets at a pixel, however often a chunk has that pixel.
        np.maximum.at(nearest, at, depth)
        shown = depth == nearest[at]
        image[at[shown]] = facet[of[shown]]
    return image.reshape(height, width)


def _depths(places: Floats, depth: Floats) -> tuple[Floats, Floats]:
    """Depth (t,) at the middle of pixel 0, 0, and its growth (t, 2) from pixel to pixel."""
    sides, rise = places[:, 1:] - places[:, :1], depth[:, 1:] - depth[:, :1]
    # Depth is linear over a triangle: its gradient by Cramer's rule, 0 of triangles seen edge on.
    twice = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    over = np.divide(1.0, twice, out=np.zeros_like(twice), where=twice != 0.0)
    along = (rise[:, 0] * sides[:, 1, 1] - rise[:, 1] * sides[:, 0, 1]) * over
    up = (rise[:, 1] * sides[:, 0, 0] - rise[:, 0] * sides[:, 1, 0]) * over
    slopes = np.stack([along, up], axis=1)
    return depth[:, 0] + ((0.5 - places[:, 0]) * slopes).sum(axis=1), slopes


def _spans(
    places: Floats, width: int, height: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The pixels in triangles (t, 3, 2): triangle, row, first column and number of columns (r,)."""
    y = places[:, :, 1]
    lowest = np.maximum(np.ceil(y.min(axis=1) - 0.5), 0.0).astype(np.int64)
    highest = np.minimum(np.floor(y.max(axis=1) - 0.5), height - 1.0).astype(np.int64)
    rows = np.maximum(highest - lowest + 1, 0)
    triangle = np.repeat(np.arange(len(places)), rows)
    row = np.repeat(lowest - np.cumsum(rows) + rows, rows) + np.arange(len(triangle))
    left: Floats = np.full(len(row), -np.inf)
    right: Floats = np.full(len(row), np.inf)
    for k in range(3):
        here, there, other = (places[:, (k + m) % 3] for m in range(3))
        side = there - here
        level = side[:, 1] == 0.0
        slope = np.divide(side[:, 0], side[:, 1], out=np.zeros(len(side)), where=~level)
        where = here[triangle, 0] + slope[triangle] * (row + 0.5 - here[triangle, 1])
        # The triangle lies to the right of a side that its third corner lies to the right of.
        third: Floats = other - here
        beyond: Floats = third[:, 0] - slope * third[:, 1]
        begins, ends = (beyond > 0.0) & ~level, (beyond < 0.0) & ~level
        left = np.where(begins[triangle], np.maximum(left, where), left)
        right = np.where(ends[triangle], np.minimum(right, where), right)
    first = np.maximum(np.ceil(left - 0.5 - SHARED), 0.0)
    last = np.minimum(np.floor(right - 0.5 + SHARED), width - 1.0)
    some = last >= first  # false of triangles without area, which have no sides
    some &= np.isfinite(left) & np.isfinite(right)
    count = (last - first)[some].astype(np.int64) + 1
    return triangle[some], row[some], first[some].astype(np.int64), count


def rendered(scene: Scene, seen: NDArray[np.int64]) -> NDArray[np.uint8]:
    """The picture (h, w, 3) of a scene, of what :func:`facets_seen` says, on white."""
    shade = scene.colours * brightness(scene)[:, None]
    picture = np.where(seen[..., None] >= 0, shade[seen], 1.0)
    body = np.where(seen >= 0, scene.body[seen], -1)
    lines = changes(seen) if len(scene.polygons) <= EDGES_SHOWN else np.zeros(seen.shape, bool)
    picture[lines & (seen >= 0)] *= EDGE
    around = changes(body)
    picture[around] = np.minimum(picture[around], OUTLINE)
    return np.rint(picture * 255.0).astype(np.uint8)


def brightness(scene: Scene) -> Floats:
    """Brightness of each facet (f,), by the angle between its normal and the light."""
    normal, camera = area_vectors(scene.position[scene.polygons]), scene.camera
    length = np.linalg.norm(normal, axis=1)
    light = np.array(LIGHT) @ np.stack([camera.right, camera.up, camera.eye])
    # Sides may be numbered either way round; the one that is seen is turned towards the eye.
    towards = np.sign(normal @ camera.eye) * (normal @ light) / np.where(length > 0.0, length, 1.0)
    return scene.ambient + (1.0 - scene.ambient) * np.clip(towards, 0.0, 1.0)


def area_vectors(corners: Floats) -> Floats:
    """Area vectors (f, i) of triangles and quadrilaterals (f, a, i), by their diagonals.

    Of facets with nodes at the middle of their sides only the directions are right.
    """
    diagonals = corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]
    return np.asarray(0.5 * np.cross(*diagonals))


def changes(values: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Pixels whose value differs from that to the right or below."""
    out = np.zeros(values.shape, dtype=bool)
    out[:, :-1] |= values[:, :-1] != values[:, 1:]
    out[:-1] |= values[:-1] != values[1:]
    return out


# -- Bodies in space: the rendered picture with their names, a scale and the directions  ----------


@dataclass(frozen=True, slots=True)
class View:
    """A rendered scene."""

    scene: Scene  # what is seen
    seen: Ints  # (h, w) the facet that each pixel shows
    veil: Floats | None = None  # (h, w, 4) translucent tools over it; None without any


def scene_of(
    bodies: Bodies, scale: ColourScale, low: Floats | None = None, high: Floats | None = None
) -> Scene:
    """A state to render; in a given frame, m, or one round the bodies."""
    colours = colormaps[scale.colours](scale.norm(bodies.field.values * scale.unit.factor))
    return Scene(
        bodies.position,
        bodies.polygons,
        np.asarray(colours, dtype=np.float64)[:, :3],
        bodies.body,
        bodies.position.min(axis=0) if low is None else low,
        bodies.position.max(axis=0) if high is None else high,
    )


def show(axes: Axes, view: View) -> None:
    """Draw a rendered scene and its tools, in m along the camera's right and up."""
    scene = view.scene
    low, _ = scene.window
    left, foot = (float(v) for v in low)
    right, top = (float(v) for v in low + np.array(scene.size) * scene.pixel)
    for picture in (rendered(scene, view.seen), view.veil):
        if picture is not None:
            axes.imshow(picture, extent=(left, right, foot, top), interpolation="bilinear")


def draw_space(axes: Axes, view: View, names: Sequence[str]) -> None:
    """Draw a rendered scene with the names of the bodies, a scale and the three directions."""
    scene = view.scene
    show(axes, view)
    axes.set_axis_off()
    body = np.where(view.seen >= 0, scene.body[view.seen], -1)
    low, _ = scene.window
    for number, name in enumerate(names):
        rows, columns = np.nonzero(body == number)
        if not len(rows):
            continue
        # At a pixel of the body, which the middle of its pixels need not be.
        middle = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
        place = low + np.array([columns[middle], len(body) - rows[middle]]) * scene.pixel
        x, y = (float(v) for v in place)
        halo = withStroke(linewidth=2.2, foreground="w", alpha=0.8)
        axes.annotate(name, (x, y), ha="center", va="center", fontsize=8, path_effects=[halo])
    # A bar of a round length, and arrows along the axes, below the picture
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    width = right - left
    decade = 10.0 ** float(np.floor(np.log10(0.25 * width)))
    length = decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= 0.25 * width)
    foot = bottom - 0.06 * width
    axes.plot([right - length, right], [foot, foot], color="0.15", lw=2.5, clip_on=False)
    axes.annotate(fitting([length], "m").text(length), (right - 0.5 * length, foot),
                  xytext=(0, 4), textcoords="offset points", ha="center", fontsize=8)  # fmt: skip
    x, y, reach = left + 0.06 * width, foot - 0.02 * width, 0.11 * width
    for axis, name in enumerate("xyz"):
        along, up = (float(v) * reach for v in scene.camera.plane[axis])
        axes.annotate("", (x + along, y + up), (x, y), annotation_clip=False, arrowprops={
            "arrowstyle": "-|>", "lw": 1.0, "color": "0.25", "shrinkA": 0, "shrinkB": 0,
        })  # fmt: skip
        axes.annotate(name, (x + 1.25 * along, y + 1.25 * up), ha="center", va="center",
                      fontsize=8, annotation_clip=False)  # fmt: skip
    axes.set(xlim=(left, right), ylim=(foot - 0.12 * width, top))


# -- Rigid tools in pictures of space: translucent before what they hide, hidden by what is nearer -
#
# Axis letters: c triangles, a their corners, i space.


VEIL, LINE = 0.35, 0.9  # opacity of a tool, and of the lines round what is seen of it
PARTS = 16  # of the picture, that a triangle spans at most: larger ones are divided
NEARER = 2e-3  # of the frame, that tools are moved to the eye, to be before what they touch


def tool_triangles(results: Results, step: int) -> Floats | None:
    """Triangles, in the plane lines, (c, a, i), m, of tools at a step; None in a case without."""
    if not results.case.tools:
        return None
    mesh = results.tool_outlines(step)
    return np.asarray(mesh.points[mesh.cells[0].data], dtype=np.float64)


def room_for(low: Floats, high: Floats, triangles: Floats | None) -> tuple[Floats, Floats]:
    """Corners (i,), m, of a frame round bodies, with some room where there are tools."""
    if triangles is None or not triangles.size:
        return low, high
    points, room = triangles.reshape(-1, len(low)), ROOM * float((high - low).max())
    return (
        np.minimum(low, np.maximum(points.min(axis=0), low - room)),
        np.maximum(high, np.minimum(points.max(axis=0), high + room)),
    )


def veil_of(scene: Scene, triangles: Floats | None) -> Floats | None:
    """Colours and opacity (h, w, 4) of the tools over the picture of a scene; None without any."""
    if triangles is None:
        return None
    # What may be seen (c, a, i) of triangles, in parts that are small beside the picture.
    low, high = scene.window
    plane, most = scene.camera.plane, float((high - low).max()) / PARTS
    done, left = [], triangles
    while len(left):
        flat = left @ plane
        inside = (flat.max(axis=1) >= low).all(axis=1) & (flat.min(axis=1) <= high).all(axis=1)
        small: NDArray[np.bool_] = np.ptp(flat, axis=1).max(axis=1) <= most
        done.append(left[inside & small])
        a, b, c = np.moveaxis(left[inside & ~small], 1, 0)  # four of each
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        left = np.concatenate([np.stack(part, axis=1) for part in parts])
    near = np.concatenate(done) if done else triangles
    near = near + NEARER * float((scene.high - scene.low).max()) * scene.camera.eye
    corners = scene.polygons.shape[1]
    numbers = len(scene.position) + np.arange(near[..., 0].size).reshape(-1, 3)
    added = numbers[:, [0, 1, *[2] * (corners - 2)]]  # all polygons have as many corners
    both = replace(
        scene,
        position=np.concatenate([scene.position, near.reshape(-1, 3)]),
        polygons=np.concatenate([scene.polygons, added]),
    )
    seen = facets_seen(both)
    tool = seen >= len(scene.polygons)
    out = np.zeros((*seen.shape, 4))
    out[tool, :3] = np.array(to_rgb(TOOL)) * brightness(both)[seen[tool], None]
    out[tool, 3] = VEIL
    out[changes(tool.astype(np.int64)), :] = (*to_rgb(TOOL), LINE)
    return out


# -- Rigid tools in pictures of the plane: their outlines, and room for them in the frame ----------

ROOM = 0.12  # of the largest extent, that a tool is shown of beside the bodies at most
TOOL = "#2b4c7e"


def tool_lines(results: Results, step: int) -> Floats | None:
    """Lines (c, 2, 2), m, of all tools at a step; None in a case without tools."""
    cells = tool_triangles(results, step)
    return None if cells is None else cells[..., :2]


def with_room(frame: Frame, lines: Floats | None) -> Frame:
    """The frame with some room where there are tools beside the bodies."""
    if lines is None or frame.stretched:
        return frame
    low, high = room_for(frame.low, frame.high, lines)
    return replace(frame, low=low, high=high, unit=fitting([(high - low).max()], "m"))


def draw_tools(axes: Axes, lines: Floats | None, frame: Frame) -> None:
    """Draw the outlines; what is outside of the frame is cut off."""
    if lines is None:
        return
    scaled = list(lines * frame.unit.factor)
    axes.add_collection(LineCollection(scaled, colors=TOOL, linewidths=1.6, zorder=3))
