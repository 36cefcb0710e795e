"""Bodies in space: the rendered picture with their names, a scale and the directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from tribox.app.figures.body_shapes import Bodies, Ints
from tribox.app.figures.field_values import ColourScale
from tribox.app.figures.scenes import RIGHT, UP, Scene, rendered
from tribox.app.figures.style import Floats
from tribox.app.figures.units import fitting


@dataclass(frozen=True, slots=True)
class View:
    """A rendered scene.

    Attributes:
        scene: what is seen. seen: (h, w) the facet that each pixel shows.
        picture: (h, w, 3) as pyvista renders it; None: our own renderer.
        veil: (h, w, 4) translucent tools over it; None without any.
    """

    scene: Scene
    seen: Ints
    picture: NDArray[np.uint8] | None
    veil: Floats | None = None

    @property
    def shown(self) -> NDArray[np.uint8]:
        """The picture (h, w, 3)."""
        return rendered(self.scene, self.seen) if self.picture is None else self.picture


def scene_of(
    bodies: Bodies, scale: ColourScale, low: Floats | None = None, high: Floats | None = None
) -> Scene:
    """A state as pyvista renders it; in a given frame, m, or one round the bodies."""
    return Scene(
        bodies.position,
        bodies.polygons,
        polygon_colours(bodies, scale)[:, :3],
        bodies.body,
        bodies.position.min(axis=0) if low is None else low,
        bodies.position.max(axis=0) if high is None else high,
    )


def polygon_colours(bodies: Bodies, scale: ColourScale) -> Floats:
    """Colours (f, 4) of the outer facets."""
    shade = colormaps[scale.colours](scale.norm(bodies.field.values * scale.unit.factor))
    return np.asarray(shade, dtype=np.float64)


def draw_space(axes: Axes, view: View, names: Sequence[str]) -> None:
    """Draw a rendered scene with the names of the bodies, a scale and the three directions."""
    scene = view.scene
    height, width = view.seen.shape
    frame = (0.0, float(width), 0.0, float(height))
    axes.imshow(view.shown, extent=frame, interpolation="bilinear")
    if view.veil is not None:
        axes.imshow(view.veil, extent=frame, interpolation="bilinear")
    axes.set_axis_off()
    body = np.where(view.seen >= 0, scene.body[view.seen], -1)
    for number, name in enumerate(names):
        rows, columns = np.nonzero(body == number)
        if not len(rows):
            continue
        middle = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
        place = (float(columns[middle]), float(height - rows[middle]))
        halo = withStroke(linewidth=2.2, foreground="w", alpha=0.8)
        axes.annotate(name, place, ha="center", va="center", fontsize=8, path_effects=[halo])
    _draw_scale(axes, width, height, scene.pixel)


def _draw_scale(axes: Axes, width: int, height: int, pixel: float) -> None:
    """A bar of a round length, and arrows along the axes, below the picture.

    Args:
        axes: of the picture, in pixels.
        width: of the picture, in pixels.
        height: likewise.
        pixel: width of one, m.
    """
    room = 0.25 * width * pixel
    decade = 10.0 ** float(np.floor(np.log10(room)))
    length = decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= room)
    foot, left = -0.06 * width, width - length / pixel
    axes.plot([left, width], [foot, foot], color="0.15", lw=2.5, clip_on=False)
    axes.annotate(fitting([length], "m").text(length), (0.5 * (left + width), foot),
                  xytext=(0, 4), textcoords="offset points", ha="center", fontsize=8)  # fmt: skip
    x, y, reach = 0.06 * width, foot - 0.02 * width, 0.11 * width
    for axis, name in enumerate("xyz"):
        right, up = float(RIGHT[axis]) * reach, float(UP[axis]) * reach
        axes.annotate("", (x + right, y + up), (x, y), arrowprops={"arrowstyle": "-|>", "lw": 1.0,
                      "color": "0.25", "shrinkA": 0, "shrinkB": 0})  # fmt: skip
        axes.annotate(name, (x + 1.25 * right, y + 1.25 * up), ha="center", va="center",
                      fontsize=8, annotation_clip=False)  # fmt: skip
    axes.set_xlim(0.0, width)
    axes.set_ylim(foot - 0.12 * width, height)
