"""A line in the plane made of straight pieces and arcs, one after another.

Axis letters: q points, p pieces, e the two ends of a piece, i space (the plane). ξ goes from 0 to 1
along a piece in equal steps of length, so that a place is P + ξ D on a straight one and
M + R(ξ ω)(P − M) on an arc. The normal is the direction of travel turned left.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tribox.geometry.native.compiler import library, packed, start_of

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facets import Bools, Floats, Ints

STRAIGHT = 1e-7  # rad, turn up to which there is no corner
GRAZING = 0.05  # cosine between a piece and t below which a ray only grazes it, as on facets


@dataclass(frozen=True, slots=True)
class Pieces:
    """The pieces in order."""

    start: Floats  # (p, i), m
    end: Floats  # likewise
    sweep: Floats  # (p,), rad: ω, the angle that an arc turns through, left positive; 0 if straight
    centre: Floats  # (p, i), m: M of arcs; the start of straight ones
    closed: bool  # whether the last piece goes on into the first
    # whether the line goes on straight, without end, at its start and at its end
    continued: tuple[bool, bool] = (False, False)

    @property
    def length(self) -> Floats:
        """(p,), m."""
        chord = np.linalg.norm(self.end - self.start, axis=1)
        return np.where(self.sweep == 0.0, chord, np.abs(self.sweep) * self.radius)

    @property
    def radius(self) -> Floats:
        """(p,), m, of arcs."""
        return np.linalg.norm(self.start - self.centre, axis=1)

    def reversed(self) -> Pieces:
        """The same line run through backwards."""
        back = slice(None, None, -1)
        start, end, sweep = self.end[back], self.start[back], -self.sweep[back]
        centre = np.where(sweep[:, None] == 0.0, start, self.centre[back])
        return Pieces(start, end, sweep, centre, self.closed, self.continued[::-1])

    def limits(self) -> Floats:
        """Least and largest ξ (p, e): 0 and 1, but where the line goes on without end."""
        out = np.tile([0.0, 1.0], (len(self.sweep), 1))
        for end, sign in ((0, -1.0), (1, 1.0)):
            if self.continued[end]:
                out[-end, end] = sign * np.inf
        return out

    def open_ends(self) -> Bools:
        """Ends (p, e) of pieces at which the line ends."""
        out = np.zeros((len(self.sweep), 2), dtype=bool)
        if not self.closed:
            out[0, 0], out[-1, 1] = (not on for on in self.continued)
        return out

    def directions(self) -> Floats:
        """Unit directions of travel (p, e, i) at both ends."""
        chord = self.end - self.start
        # Tangents of an arc at its ends are its chord turned by ∓ω/2.
        out = np.stack([turned(chord, -0.5 * self.sweep), turned(chord, 0.5 * self.sweep)], axis=1)
        return out / np.linalg.norm(out, axis=2)[..., None]

    def turns(self) -> Floats:
        """Turn (p, e), rad, left positive, at the ends of each piece, 0 at those of the line."""
        ways = self.directions()
        before, after = ways[:, 1], np.roll(ways[:, 0], -1, axis=0)
        sine = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        turn = np.arctan2(sine, np.einsum("pi,pi->p", before, after))
        if not self.closed:
            turn[-1] = 0.0
        turn = np.where(np.abs(turn) > STRAIGHT, turn, 0.0)
        return np.stack([np.roll(turn, 1), turn], axis=1)

    def places(self, piece: Ints, xi: Floats) -> Floats:
        """Places (q, i), m, at ξ (q,) of pieces (q,)."""
        start, sweep = self.start[piece], self.sweep[piece]
        out: Floats = start + xi[:, None] * (self.end[piece] - start)
        arcs = np.nonzero(sweep)[0]
        if len(arcs):
            centre = self.centre[piece[arcs]]
            out[arcs] = centre + turned(start[arcs] - centre, xi[arcs] * sweep[arcs])
        return out

    def nearest(self, points: Floats, piece: Ints) -> Floats:
        """ξ (q,) of the nearest places on pieces (q,), as if all went on as they are."""
        start = self.start[piece]
        way = self.end[piece] - start
        apart = points - start
        straight = np.einsum("qi,qi->q", apart, way) / np.einsum("qi,qi->q", way, way)
        return self._or_round(straight, points - self.centre[piece], piece)

    def met(self, points: Floats, normals: Floats, piece: Ints) -> Floats:
        """ξ (q,) where lines along the normals (q, i) meet pieces (q,) that face them; else NaN.

        With t the normal turned right, t·(x − ȳ) = 0 and t·τ > 0. On an arc of radius R that is
        ȳ − M = h t − w n for ω > 0 and h t + w n for ω < 0, with h = t·(x − M) and h² + w² = R².
        """
        start, centre = self.start[piece], self.centre[piece]
        way, along = self.end[piece] - start, -left_of(normals)
        slope = np.einsum("qi,qi->q", along, way)
        steep = slope > GRAZING * np.linalg.norm(way, axis=1)
        apart = np.einsum("qi,qi->q", points - start, along)
        straight = np.where(steep, apart / np.where(steep, slope, 1.0), np.nan)
        h = np.einsum("qi,qi->q", points - centre, along)
        squared = np.sum((start - centre) ** 2, axis=1)
        rest = squared - h**2
        steep = rest > GRAZING**2 * squared
        w = -np.sign(self.sweep[piece]) * np.sqrt(np.where(steep, rest, 0.0))
        arm = h[:, None] * along + w[:, None] * normals
        return self._or_round(straight, np.where(steep[:, None], arm, np.nan), piece)

    def _or_round(self, straight: Floats, arm: Floats, piece: Ints) -> Floats:
        """ξ (q,) as given on straight pieces, and of the directions ``arm`` (q, i) on arcs.

        By the angle from the middle, so that it jumps opposite to the arc.
        """
        arcs = np.nonzero(self.sweep[piece])[0]
        if not len(arcs):
            return straight
        # arctan2 of the angle between the arc's middle and the arm: within ±π, with its jump
        # opposite.
        middle = turned(self.start - self.centre, 0.5 * self.sweep)[piece[arcs]]
        arm = arm[arcs]
        angle = np.arctan2(
            np.einsum("qi,qi->q", left_of(middle), arm), np.einsum("qi,qi->q", middle, arm)
        )
        out = straight.copy()
        out[arcs] = 0.5 + angle / self.sweep[piece[arcs]]
        return out

    def spheres(self) -> tuple[Floats, Floats]:
        """Centres (p, i) and radii (p,), m, that hold the pieces; infinite where one goes on."""
        every = np.arange(len(self.sweep), dtype=np.int32)
        # No place is farther from the middle of its piece than half the length.
        centre = self.places(every, np.full(len(every), 0.5))
        endless = np.isinf(self.limits()).any(axis=1)
        return centre, np.where(endless, np.inf, 0.5 * self.length)

    def bounds(self) -> Floats:
        """Least and largest coordinates (2, i), m, infinite where the line goes on without end."""
        places = [self.start, self.end]
        radius = self.radius[:, None]
        every = np.arange(len(self.sweep), dtype=np.int32)
        # An arc reaches farthest along an axis where its normal lies along that, or at its ends.
        for side in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
            there = self.centre + radius * np.array(side)
            xi = self.nearest(there, every)
            places.append(there[(self.sweep != 0.0) & (xi > 0.0) & (xi < 1.0)])
        known = np.concatenate(places)
        out = np.stack([known.min(axis=0), known.max(axis=0)])
        ways = self.directions()
        for on, way in zip(self.continued, (-ways[0, 0], ways[-1, 1]), strict=True):
            if on:
                out[0, way < -STRAIGHT], out[1, way > STRAIGHT] = -np.inf, np.inf
        return out


class _Line(ctypes.Structure):
    """``Line`` of the C source, field by field in the same order."""

    _fields_ = (
        ("pieces", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in "start end centre sweep middle".split()),
        *((name, ctypes.c_void_p) for name in "limits sphere radius".split()),
    )


class CompiledPieces:
    """The loops over the points of a line, by the source ``polyline.c``."""

    def __init__(self, pieces: Pieces) -> None:
        middle = turned(pieces.start - pieces.centre, 0.5 * pieces.sweep)
        arrays = pieces.start, pieces.end, pieces.centre, pieces.sweep, middle
        every = (*arrays, pieces.limits(), *pieces.spheres())
        self._arrays = [np.ascontiguousarray(array, dtype=np.float64) for array in every]
        self._line = _Line(len(pieces.sweep), *map(start_of, self._arrays))
        self._room = np.empty((len(pieces.sweep), 2))

    def at(self, piece: Ints, xi: Floats) -> tuple[Floats, Floats, Floats]:
        """Places, tangents ∂/∂ξ and second derivatives (q, i), m, at ξ (q,) of pieces (q,)."""
        out = tuple(np.empty((len(xi), 2)) for _ in range(3))
        piece, xi = packed(piece, np.int32), packed(xi)
        self._call("places", len(xi), *map(start_of, (piece, xi, *out)))
        return out[0], out[1], out[2]

    def closest(self, points: Floats, tie: float) -> tuple[Ints, Floats, Ints]:
        """Pieces (q,) and ξ (q,) of the points closest to (q, i), m, and whether ends hold them.

        Of those within ``tie``, m, the first that holds inside, 0, then at first or second end, 1,
        2.
        """
        count, points = len(points), packed(points)
        piece, xi = np.zeros(count, dtype=np.int32), np.zeros(count)
        held = np.zeros(count, dtype=np.uint8)
        found = map(start_of, (piece, xi, held, self._room))
        self._call("closest", count, start_of(points), ctypes.c_double(tie), *found)
        return piece, xi, held.astype(np.int32)

    def _call(self, name: str, count: int, *arguments: Any) -> None:
        function = getattr(library("polyline.c"), f"tribox_line_{name}")
        function.restype = None
        function(ctypes.byref(self._line), ctypes.c_int64(count), *arguments)


def left_of(vectors: Floats) -> Floats:
    """Vectors (…, i) turned left by 90°."""
    out = np.empty_like(vectors)
    out[..., 0], out[..., 1] = -vectors[..., 1], vectors[..., 0]
    return out


def turned(vectors: Floats, angle: Floats) -> Floats:
    """Vectors (p, i) turned left by angles (p,), rad."""
    cosine, sine = np.cos(angle), np.sin(angle)
    out = np.empty_like(vectors)
    x, y = vectors[:, 0], vectors[:, 1]
    out[:, 0] = cosine * x - sine * y
    out[:, 1] = cosine * y + sine * x
    return out
