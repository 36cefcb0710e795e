"""A rigid polyline in the plane, its corners rounded by fillets or sharp.

Axis letters: q slave points, p pieces (the facets), e the two ends of a piece, i space.

Straight pieces and arcs meet without a kink at fillets, where the closest point passes from one to
the next with a continuous normal. At a sharp corner the normal is that from the corner to the
point. With pressure that is averaged over facets, points beside a convex sharp corner are projected
along the slave's normals instead, as on facets with kinks (:mod:`tribox.geometry.surfaces.rays`):
closest points below a punch would be on its flank as soon as they are deeper than away from the
corner. What looks at a flank that it only grazes fades
(:mod:`tribox.geometry.surfaces.rigid_shares`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tribox.geometry.surfaces.rigid import CHORD, Feet, Outline, Places, RigidShape
from tribox.geometry.surfaces.rigid_fillets import filleted
from tribox.geometry.surfaces.rigid_pieces import Pieces, left_of
from tribox.geometry.surfaces.rigid_shares import LineEnds

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
    from tribox.geometry.surfaces.target import Projection

KINK = np.radians(3.0)  # turn of a sharp corner from which on it is a kink, as of facets
OVERRUN = 1e-4  # ξ past a corner up to which a point may stay on its piece, as on facets
AT_ONCE = 500_000  # pairs of points and pieces, for memory's sake
_TIE = 1e-12  # distances closer than this, over the size, are equal


class Polyline(RigidShape):
    """Straight pieces and arcs, see :class:`~tribox.geometry.surfaces.rigid_pieces.Pieces`.

    The material is on the right of the direction of travel.

    Attributes:
        pieces: in order.
    """

    def __init__(
        self,
        points: Floats,
        radius: float | Floats = 0.0,
        closed: bool = False,
        continued: tuple[bool, bool] = (False, False),
        inside: Floats | None = None,
    ) -> None:
        """Round the corners.

        Args:
            points: (n, 2), m.
            radius: m, of all fillets, or of each inner point in turn, of a closed line of each
                point; 0: the corner is sharp.
            closed: whether the last point is joined to the first.
            continued: whether the line goes on straight, without end, before its first point and
                behind its last one; otherwise contact ends there.
            inside: (2,), m: a point in the material; the line is run through backwards if need be.

        Raises:
            ValueError: as of :func:`~tribox.geometry.surfaces.rigid_fillets.filleted`; a closed
                line that is continued, or an arc that is; a point ``inside`` that lies on the line.
        """
        if closed and any(continued):
            raise ValueError("a closed polyline cannot be continued")
        pieces = replace(filleted(points, radius, closed), continued=continued)
        if any(on and pieces.sweep[-end] != 0.0 for end, on in enumerate(continued)):
            raise ValueError("fillets leave nothing straight of a polyline that is continued")
        self._lay_out(pieces)
        if inside is None:
            return
        place = np.array(inside, dtype=np.float64)[None]
        gap = float(self.project(place, self.control_points).gap[0])
        if not abs(gap) > _TIE * self.size:
            raise ValueError(f"the point inside of a polyline lies on it: {place[0]} m")
        if gap > 0.0:
            self._lay_out(pieces.reversed())

    def _lay_out(self, pieces: Pieces) -> None:
        """Take the pieces, and find what is at their ends."""
        self.pieces = pieces
        turns = pieces.turns()
        self._open, self._sharp = pieces.open_ends(), turns != 0.0
        # An arc ends there, or a chord of one.
        chord = self._sharp.any(axis=1) & (np.abs(turns).max(axis=1) < CHORD)
        self._cut = self._open & ((pieces.sweep != 0.0) | chord)[:, None]
        self.has_kinks = bool(np.any(np.abs(turns) > KINK))
        self._limits, self._ends = pieces.limits(), LineEnds(pieces)
        self._spheres = pieces.spheres()
        self.least_radius = float(np.min(pieces.radius, where=pieces.sweep != 0.0, initial=np.inf))
        # At a corner between the normals of both pieces.
        out = left_of(pieces.directions())
        joint = out[:, 1] + np.roll(out[:, 0], -1, axis=0)
        outward = np.where(
            self._sharp[..., None], np.stack([np.roll(joint, 1, axis=0), joint], axis=1), out
        )
        self._outward = outward / np.linalg.norm(outward, axis=2)[..., None]
        low, high = replace(pieces, continued=(False, False)).bounds()
        size = 0.5 * float(np.linalg.norm(high - low))
        super().__init__(len(turns), 0.5 * (low + high), size, pieces.bounds())

    def at(self, facet: Ints, xi: Floats) -> Places:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`."""
        place, tangent, bend = self.pieces.at(facet, xi[:, 0])
        return Places(place, tangent[:, None], bend[:, None, None])

    def place(self, facet: Ints, xi: Floats) -> Floats:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`."""
        return self.pieces.places(facet, xi[:, 0])

    def excess(self, facet: Ints, xi: Floats) -> Floats:
        """See :class:`~tribox.geometry.surfaces.target.Target`."""
        past = np.stack([-xi[:, 0], xi[:, 0] - 1.0], axis=1)
        out: Floats = np.where(self._sharp[facet], past, -np.inf).max(axis=1)
        return out

    def cut_off(self, facet: Ints, xi: Floats) -> Bools:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`."""
        at_end = np.stack([xi[:, 0] <= 0.0, xi[:, 0] >= 1.0], axis=1)
        out: Bools = (at_end & self._cut[facet]).any(axis=1)
        return out

    # -- closest points ---------------------------------------------------------------------------

    def closest(self, points: Floats, frozen_facets: Ints | None) -> Feet:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidShape`.

        Of pieces equally close the first is taken, one that holds the point inside before one that
        holds it at its end.
        """
        if not len(points):
            return Feet(np.empty(0, dtype=np.int32), np.empty((0, 1)))
        point, piece = self._candidates(points, _near)
        free = self.pieces.nearest(points[point], piece)
        xi = np.clip(free, *self._limits[piece].T)
        distance = np.linalg.norm(points[point] - self.pieces.places(piece, xi), axis=1)
        start, count = np.searchsorted(point, np.arange(len(points))), len(self._limits)
        tie = distance <= np.minimum.reduceat(distance, start)[point] + _TIE * self.size
        rank = piece + np.where(tie, np.where(xi != free, count, 0), 2 * count)
        best = np.nonzero(rank == np.minimum.reduceat(rank, start)[point])[0]
        facet, found, held = piece[best], xi[best], (xi != free)[best]
        end = (free > xi)[best].astype(np.int32)
        if frozen_facets is not None and self._sharp.any():
            there = self.pieces.nearest(points, frozen_facets)
            low, high = self._limits[frozen_facets].T
            stays = np.maximum(low - there, there - high) <= OVERRUN
            facet = np.where(stays, frozen_facets, facet)
            found, held = np.where(stays, there, found), held & ~stays
        return self._feet(facet, found, held, end)

    def _candidates(
        self, points: Floats, choose: Callable[[Floats, Floats, slice], Bools]
    ) -> tuple[Longs, Ints]:
        """Points and pieces (n,) to be looked at, sorted by point.

        Args:
            points: (q, i), m.
            choose: (k, p), from the ways (k, p, i) of a slice of the points from the centres of
                spheres round the pieces, and their radii (p,).
        """
        centre, radius = self._spheres
        step = max(1, AT_ONCE // len(radius))
        parts = []
        for first in range(0, len(points), step):
            here = slice(first, first + step)
            row, piece = np.nonzero(choose(points[here, None] - centre, radius, here))
            parts.append((row + first, piece.astype(np.int32)))
        point, pieces = (np.concatenate(p) for p in zip(*parts, strict=True))
        return point, pieces

    def _feet(self, facet: Ints, xi: Floats, held: Bools, end: Ints) -> Feet:
        """Closest points, ``held`` (q,) at an ``end`` (q,) of their pieces: clamped if it is one.

        Where pieces go on into each other smoothly, both hold the point by no more than round-off.
        """
        out = Feet(facet, xi[:, None])
        past = held & self._open[facet, end]
        clamped = past | (held & self._sharp[facet, end])
        if past.any():
            out.on_surface = ~past
        if clamped.any():
            out.outward = np.where(clamped[:, None], self._outward[facet, end], np.nan)
        return out

    # -- along rays, and at the ends --------------------------------------------------------------

    def hits(self, points: Floats, normals: Floats, feet: Feet) -> tuple[Feet, Bools]:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidShape`; the nearest hit of each ray."""
        met = np.zeros(len(points), dtype=bool)
        out = Feet(feet.facet.copy(), feet.xi.copy())
        if not len(points):
            return out, met

        def crossed(apart: Floats, radius: Floats, here: slice) -> Bools:
            off: Floats = np.einsum("kpi,ki->kp", apart, left_of(normals[here]))
            return np.abs(off) <= (1.0 + _TIE) * radius

        point, piece = self._candidates(points, crossed)
        xi = self.pieces.met(points[point], normals[point], piece)
        low, high = self._limits[piece].T
        inside = np.nonzero((xi >= low - _TIE) & (xi <= high + _TIE))[0]  # never NaN
        point, piece = point[inside], piece[inside]
        xi = np.clip(xi[inside], low[inside], high[inside])
        distance = np.linalg.norm(points[point] - self.pieces.places(piece, xi), axis=1)
        order = np.lexsort((piece, distance, point))
        rows, first = np.unique(point[order], return_index=True)
        best = order[first]
        out.facet[rows], out.xi[rows, 0], met[rows] = piece[best], xi[best], True
        return out, met

    def fade(self, out: Projection, reach: Floats) -> None:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidShape`; beside corners too."""
        piece, xi = out.facet, out.xi[:, 0]
        if out.rays is None:
            found = self._ends.of_closest(piece, xi, out.on_surface, reach)
        else:
            found = self._ends.along_rays(piece, xi, out.on_surface, reach, out.rays.normal)
        if found is not None:
            out.share, out.share_turn = found.share, found.turn
            out.share_slope = found.slope[:, None]

    def outline(self, box: Floats, count: int = 64) -> Outline:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`; ``count`` per turn."""
        pieces = self.pieces
        parts = np.ceil(np.abs(pieces.sweep) * count / (2.0 * np.pi)).astype(np.int32) + 1
        facet = np.repeat(np.arange(len(parts), dtype=np.int32), parts)
        xi = np.concatenate([np.linspace(0.0, 1.0, k, endpoint=False) for k in parts])
        if not pieces.closed:
            facet, xi = np.append(facet, len(parts) - 1).astype(np.int32), np.append(xi, 1.0)
        far = float(np.linalg.norm(box[1] - box[0]) + np.linalg.norm(box.mean(0) - self._middle))
        for end, sign in ((0, -1.0), (-1, 1.0)):
            if pieces.continued[end]:
                xi[end] += sign * far / pieces.length[end]
        number = np.arange(len(xi), dtype=np.int32)
        cells = np.stack([number, np.roll(number, -1)], axis=1)
        places = pieces.places(facet, xi)
        return Outline(places, cells if pieces.closed else cells[:-1])


def _near(apart: Floats, radius: Floats, here: slice) -> Bools:
    """Pieces (k, p) whose spheres begin before the nearest one has ended."""
    distance = np.linalg.norm(apart, axis=2)
    reach = (distance + radius).min(axis=1, keepdims=True)
    near: Bools = distance - radius <= (1.0 + _TIE) * reach
    return near
