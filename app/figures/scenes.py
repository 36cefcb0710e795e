"""Bodies in space as a picture: the camera, and a renderer of its own that needs no display.

Axis letters: n nodes, f facets, a corners, i space, s samples of a facet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tribox.app.figures.style import Floats

# Towards the eye: from the front (z), from the right (x), and from above (y).
EYE = np.array([0.435, 0.375, 0.819]) / np.linalg.norm([0.435, 0.375, 0.819])
RIGHT = np.cross([0.0, 1.0, 0.0], EYE) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], EYE))
UP = np.cross(EYE, RIGHT)
LIGHT = np.array([0.25, 0.85, 0.45]) / np.linalg.norm([0.25, 0.85, 0.45])
PIXELS = 900  # of the longer side of a picture
MARGIN = 0.03  # round the frame, of its longer side
AMBIENT = 0.62  # brightness of a facet that is turned away from the light
EDGE, OUTLINE = 0.72, 0.35  # brightness of the lines between facets, and round bodies
EDGES_SHOWN = 20_000  # facets beyond which the lines between them are left out
DENSITY = 1.5  # samples per pixel in each direction of a facet
CHUNK = 4_000_000  # samples at a time


@dataclass(frozen=True, slots=True)
class Scene:
    """A state to render, in parallel projection: all of it in one scale.

    Attributes:
        position: (n, 3), m. polygons: (f, a), a = 3 or 4.
        colours: (f, 3), of each polygon, 0 to 1. body: (f,) number of its body.
        low, high: (3,), m, corners of the frame: scenes of one frame are seen from one place.
    """

    position: Floats
    polygons: NDArray[np.int64]
    colours: Floats
    body: NDArray[np.int64]
    low: Floats
    high: Floats

    @property
    def window(self) -> tuple[Floats, Floats]:
        """Corners of what is seen, m, along RIGHT and UP."""
        box = np.stack(np.meshgrid(*zip(self.low, self.high, strict=True)), axis=-1)
        seen = box.reshape(-1, 3) @ np.stack([RIGHT, UP]).T
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

    Every facet is sampled more densely than there are pixels; the sample nearest to the eye wins.
    """
    width, height = scene.size
    low, _ = scene.window
    corners = scene.position[scene.polygons]
    flat = (corners @ np.stack([RIGHT, UP]).T - low) / scene.pixel
    depth = corners @ EYE
    image = np.full(width * height, -1, dtype=np.int64)
    nearest = np.full(width * height, -np.inf)
    extent = np.ptp(flat, axis=1).max(axis=1)
    counts = 2 ** np.ceil(np.log2(np.maximum(DENSITY * extent, 1.0))).astype(np.int64) + 1
    for count in np.unique(counts):
        weights = _weights(int(count), corners.shape[1])
        some = np.flatnonzero(counts == count)
        for part in np.array_split(some, -(-len(some) * len(weights) // CHUNK)):
            place = np.einsum("sa,fai->fsi", weights, flat[part])
            away = np.einsum("sa,fa->fs", weights, depth[part]).reshape(-1)
            column, row = np.floor(place).astype(np.int64).reshape(-1, 2).T
            at = (height - 1 - row) * width + column
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            facet = np.repeat(part, len(weights))
            order = np.argsort(away)
            order = order[inside[order]]
            order = order[away[order] > nearest[at[order]]]
            image[at[order]] = facet[order]  # of several for one pixel the last stays: the nearest
            nearest[at[order]] = away[order]
    return image.reshape(height, width)


def _weights(count: int, corners: int) -> Floats:
    """Weights (s, a) of the corners at a grid of samples over a facet."""
    u, v = (g.reshape(-1) for g in np.meshgrid(*2 * [np.linspace(0.0, 1.0, count)]))
    if corners == 3:
        below = u + v <= 1.0 + 1e-12
        u, v = u[below], v[below]
        return np.stack([1.0 - u - v, u, v], axis=1)
    return np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)


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
    corners = scene.position[scene.polygons]
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    length = np.linalg.norm(normal, axis=1)
    # Sides may be numbered either way round; the one that is seen is turned towards the eye.
    towards = np.sign(normal @ EYE) * (normal @ LIGHT) / np.where(length > 0.0, length, 1.0)
    return AMBIENT + (1.0 - AMBIENT) * np.clip(towards, 0.0, 1.0)


def changes(values: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Pixels whose value differs from that to the right or below."""
    out = np.zeros(values.shape, dtype=bool)
    out[:, :-1] |= values[:, :-1] != values[:, 1:]
    out[:-1] |= values[:-1] != values[1:]
    return out
