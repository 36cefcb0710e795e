"""Planes of symmetry at which a surface ends, and its images beyond them.

Axis letters: f facets, a their nodes, s their sides, n nodes, i space.

What is smooth needs neighbours: beyond a plane of symmetry, which all that a node does leaves where
it is, facets and nodes of the image are there for the stencils alone. Films need to know where
nothing flows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tribox.geometry.surfaces.facets import Bools, FacetShape, Floats, Ints, Longs, unit_normals

ACROSS = 0.7  # of the normal along that of a plane, up to which a facet may go on beyond it
ON_PLANE = 1e-9  # of a surface's extent, within which nodes are on one plane
ALONG = 1.0 - 1e-6  # the same as ACROSS, from which a facet lies in the plane itself


@dataclass(frozen=True, slots=True)
class Held:
    """Nodes that stay where they are along axes, and so may be on planes of symmetry."""

    # by axis, global nodes (n,) of all ranks that stay where they are along it
    nodes: Sequence[Longs]
    levels: Sequence[Floats]  # by axis, m, where those are that the other surface of a pair has

    def shared(
        self, planes: Sequence[tuple[int, Bools]], position: Floats, extent: float
    ) -> list[tuple[int, Bools]]:
        """Those planes, each with the nodes (n,) on it, which the other surface has nodes on too.

        Args:
            planes: see above.
            position: (n, i), m; extent: m, of the surface.
        """
        within = ON_PLANE * extent
        return [
            (axis, on)
            for axis, on in planes
            if np.any(np.abs(self.levels[axis] - position[on, axis].mean()) <= within)
        ]


def held_along(held: Sequence[Longs], nodes: Longs) -> Bools:
    """Along which axes (n, i) global nodes (n,) are among those that stay where they are."""
    return np.stack([np.isin(nodes, those) for those in held], axis=1)


@dataclass(frozen=True, slots=True)
class Images:
    """What continues a surface beyond planes of symmetry, across the axes of coordinates."""

    facets: Ints  # (b, a) beyond them; rows of nodes, and behind these of the images
    of: Longs  # (g,) the nodes that there are images of
    across: Longs  # (g, i) nodes in the planes across the axes along which they are turned round
    signs: Floats  # (g, i) of the images' displacements over those of these nodes
    position: Floats  # (g, i), m, reference
    shift: Floats  # (g, i), m, of it over the nodes' times the signs

    def behind(self, nodes: Floats) -> Floats:
        """Positions (n, i), m, of the surface's own nodes, and behind them of the images."""
        return np.concatenate([nodes, self.signs * nodes[self.of] + self.shift])

    def give_back(self, values: Floats, first: int, sizes: bool = False) -> None:
        """Take what acts on images to the nodes that they are of, in place, with its sign.

        ``values``: (m, i) of a pair's nodes, the master's from row ``first`` on; ``sizes`` have
        none.
        """
        beyond = values[len(values) - len(self.of) :]
        signs = np.ones_like(beyond) if sizes else self.signs
        np.add.at(values, first + self.of, signs * beyond)
        axes = np.arange(values.shape[1])
        np.add.at(values, (first + self.across, axes), (1.0 - signs) * beyond)
        beyond[:] = 0.0


def images_beyond(
    shape: FacetShape,
    facets: Ints,
    nodes: Floats,
    held: Bools,
    smoothing_angle: float,
    is_open: Bools | None = None,
    extent: float | None = None,
) -> Images:
    """Images of the facets that touch planes of symmetry: of one plane after the other.

    So where two planes meet there are images of images. There are none where a surface and its
    image would meet at an angle from ``smoothing_angle``, rad, on. ``shape``: straight segments or
    bilinear; ``facets``: (f, a), normals outward; ``nodes``: (n, i), m; ``held``: (n, i) along
    axes; ``is_open``: (f, s), None: those of one facet; ``extent``: m, of the whole surface.
    """
    planes = planes_of_symmetry(shape, facets, nodes, held, smoothing_angle, is_open, extent)
    of: Longs = np.arange(len(nodes))
    across: Longs = np.repeat(of[:, None], nodes.shape[1], axis=1)
    every, place, signs = facets, nodes, np.ones_like(nodes)
    while planes:
        axis, on = planes.pop(0)
        sources, beside, beyond = _reflected(every, on)
        way = np.ones(nodes.shape[1])
        way[axis] = -1.0
        mirrored = place[sources] * way
        mirrored[:, axis] += 2.0 * place[beside, axis]
        across = np.concatenate([across, across[sources]])
        across[len(of) :, axis] = of[beside]
        every, place = np.concatenate([every, beyond]), np.concatenate([place, mirrored])
        signs, of = np.concatenate([signs, signs[sources] * way]), np.append(of, of[sources])
        planes = [
            (other, np.append(there, there[sources] & (other != axis))) for other, there in planes
        ]
    own = slice(len(nodes), None)
    shift: Floats = (place - signs * nodes[of])[own]
    return Images(every[len(facets) :], of[own], across[own], signs[own], place[own], shift)


def _reflected(facets: Ints, on: Bools) -> tuple[Longs, Longs, Ints]:
    """Nodes (s,) on a plane (``on``, (n,)), those next to it, and images of its facets (f, a)."""
    touching = facets[on[facets].any(axis=1)]
    sources = np.unique(touching[~on[touching]]).astype(np.int64)
    twin = np.arange(len(on), dtype=np.int32)
    twin[sources] = len(on) + np.arange(len(sources))
    plane_of = np.arange(len(on))
    plane_of[touching] = np.take_along_axis(touching, on[touching].argmax(axis=1)[:, None], axis=1)
    # Run through so that the images' normals point outwards too.
    turned = [1, 0] if facets.shape[1] == 2 else [0, 2, 1, 3]
    return sources, plane_of[sources], twin[touching][:, turned]


def planes_of_symmetry(
    shape: FacetShape,
    facets: Ints,
    nodes: Floats,
    held: Bools,
    smoothing_angle: float | None = None,
    is_open: Bools | None = None,
    extent: float | None = None,
) -> list[tuple[int, Bools]]:
    """Axes across which there are planes of symmetry, each with the nodes (n,) that are on it.

    Nodes there are free to move in the plane, and all facets round them are on one side of it.

    Arguments as for :func:`images_beyond`; without a smoothing angle the surface may go on beyond
    the plane as sharply as it will.
    """
    sides = np.stack([facets[:, list(side.nodes)] for side in shape.sides], axis=1)
    if is_open is None:
        ends = np.sort(sides.reshape(-1, sides.shape[2]), axis=1)
        _, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
        is_open = (count[number.reshape(-1)] == 1).reshape(sides.shape[:2])
    middle: Floats = shape.points.mean(axis=0)[None]
    tangents = np.einsum("ba,fai->fbi", shape.first(middle)[0], nodes[facets])
    # Across the plane the surface goes on nearly straight: its normal is in the plane.
    most = ALONG if smoothing_angle is None else min(float(np.sin(0.5 * smoothing_angle)), ACROSS)
    found: list[tuple[int, Bools]] = []
    within = ON_PLANE * (float(np.ptp(nodes, axis=0).max()) if extent is None else extent)
    clamped: Bools = np.any(np.all(held, axis=1)[sides], axis=2)
    for axis in range(nodes.shape[1]):
        level = nodes[sides, axis]
        flat = np.ptp(level, axis=2) <= within
        ends_here = is_open & held[sides, axis].all(axis=2) & flat & ~clamped
        ends_here &= (np.abs(unit_normals(tangents)[:, axis]) < most)[:, None]
        rows, levels = sides[ends_here], level[ends_here].mean(axis=1)
        while len(rows):
            mine = np.abs(levels - levels[0]) <= within
            on, above, below = np.zeros((3, len(nodes)), dtype=bool)
            on[rows[mine]] = True
            beside = nodes[facets, axis] - levels[0]
            above[facets[(beside > within).any(axis=1)]] = True
            below[facets[(beside < -within).any(axis=1)]] = True
            if (on := on & ~(above & below)).any():
                found.append((axis, on))
            rows, levels = rows[~mine], levels[~mine]
    return found
