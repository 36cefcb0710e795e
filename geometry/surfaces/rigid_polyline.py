"""A rigid polyline in the plane, its corners rounded by fillets or sharp.

Axis letters: q slave points, p pieces (the facets), e the two ends of a piece, i space.

Straight pieces and arcs meet without a kink at fillets, where the closest point passes from one to
the next with a continuous normal. At a sharp corner the normal is that from the corner to the
point. With pressure that is averaged over facets, points beside a convex sharp corner are projected
along the slave's normals instead, as on facets with kinks
(:mod:`tribox.geometry.surfaces.facet_search`): closest points below a punch would be on its flank
as soon as they are deeper than away from the corner. What looks at a flank that it only grazes
fades.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tribox.geometry.surfaces.rigid import CHORD, Feet, Outline, Places, RigidShape
from tribox.geometry.surfaces.rigid_pieces import GRAZING, STRAIGHT, CompiledPieces, Pieces, left_of
from tribox.geometry.surfaces.target import fade_at_ends

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
            ValueError: as of :func:`filleted`; a closed
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
        self._spheres, self._code = pieces.spheres(), CompiledPieces(pieces)
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
        place, tangent, bend = self._code.at(facet, xi[:, 0])
        return Places(place, tangent[:, None], bend[:, None, None])

    def excess(self, facet: Ints, xi: Floats) -> Floats:
        past = np.stack([-xi[:, 0], xi[:, 0] - 1.0], axis=1)
        return np.where(self._sharp[facet], past, -np.inf).max(axis=1)

    def cut_off(self, facet: Ints, xi: Floats) -> Bools:
        at_end = np.stack([xi[:, 0] <= 0.0, xi[:, 0] >= 1.0], axis=1)
        return (at_end & self._cut[facet]).any(axis=1)

    # -- closest points ---------------------------------------------------------------------------

    def closest(self, points: Floats, frozen_facets: Ints | None) -> Feet:
        facet, found, at_end = self._code.closest(points, _TIE * self.size)
        held, end = at_end > 0, np.maximum(at_end - 1, 0)
        if frozen_facets is not None and self._sharp.any():
            there = self.pieces.nearest(points, frozen_facets)
            low, high = self._limits[frozen_facets].T
            stays = np.maximum(low - there, there - high) <= OVERRUN
            facet = np.where(stays, frozen_facets, facet)
            found, held = np.where(stays, there, found), held & ~stays
        # Closest points, ``held`` (q,) at an ``end`` (q,) of their pieces: clamped if it is one.
        out = Feet(facet, found[:, None])
        past = held & self._open[facet, end]
        clamped = past | (held & self._sharp[facet, end])
        if past.any():
            out.on_surface = ~past
        if clamped.any():
            out.outward = np.where(clamped[:, None], self._outward[facet, end], np.nan)
        return out

    def _candidates(
        self, points: Floats, choose: Callable[[Floats, Floats, slice], Bools]
    ) -> tuple[Longs, Ints]:
        """Points and pieces (n,) to be looked at, sorted by point."""
        centre, radius = self._spheres
        step = max(1, AT_ONCE // len(radius))
        parts = []
        for first in range(0, len(points), step):
            here = slice(first, first + step)
            row, piece = np.nonzero(choose(points[here, None] - centre, radius, here))
            parts.append((row + first, piece.astype(np.int32)))
        point, pieces = (np.concatenate(p) for p in zip(*parts, strict=True))
        return point, pieces

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
        return Outline(pieces.places(facet, xi), cells if pieces.closed else cells[:-1])


# -- The corners of a polyline in the plane, rounded by fillets that fit ---------------------------
#
# Axis letters: n given points, p pieces, i space (the plane).

TIGHT = 1e-9  # length, over that of a side, that fillets may lack and below which none is made
REVERSED = np.radians(179.0)  # turn from which on the line goes back on itself


def filleted(points: Floats, radius: float | Floats, closed: bool) -> Pieces:
    """The pieces of a polyline through points (n, 2), m.

    ``radius``: m, of all fillets, or of each inner point in turn, of a ``closed`` line of each
    point; 0: sharp. ValueError of points that are not enough, not finite or the same; of a line
    that goes back on or crosses itself; of radii that are negative, of another number, or too large
    to fit.
    """
    points = _checked(points, closed)
    after = np.roll(points, -1, axis=0) if closed else points[1:]
    before = points if closed else points[:-1]
    way = after - before
    long = np.linalg.norm(way, axis=1)
    ahead = way / long[:, None]
    turn = _turns(ahead, closed)
    radii = _radii(radius, len(points), closed)
    # Way from the corner to where an arc of the radius R touches both sides: R tan(turn/2).
    cut = radii * np.tan(0.5 * np.abs(turn))
    rounded = (np.abs(turn) > STRAIGHT) & (cut > TIGHT * long.max())
    cut = np.where(rounded, cut, 0.0)
    cut_after = np.roll(cut, -1) if closed else cut[1:]
    cut_before = cut if closed else cut[:-1]
    _require_fit(radii, cut_before, cut_after, long)
    first = before + cut_before[:, None] * ahead
    last = after - cut_after[:, None] * ahead
    return _joined(first, last, ahead, turn, np.where(rounded, radii, 0.0), closed)


def _checked(points: Floats, closed: bool) -> Floats:
    points = np.array(points, dtype=np.float64)
    least = 3 if closed else 2
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < least:
        raise ValueError(f"a polyline needs at least {least} points (x, y), not {points.tolist()}")
    if not np.isfinite(points).all():
        raise ValueError("a polyline has points that are not finite")
    after = np.roll(points, -1, axis=0)
    same = np.all(points == after, axis=1)
    same[-1] &= closed
    if same.any():
        at = int(np.nonzero(same)[0][0])
        raise ValueError(
            f"points {at} and {(at + 1) % len(points)} of a polyline are the same: {points[at]} m"
        )
    _require_simple(points, after, closed)
    return points


def _require_simple(points: Floats, after: Floats, closed: bool) -> None:
    """Refuse pieces that cross others than their neighbours."""
    count = len(points) if closed else len(points) - 1
    a, b = points[:count], after[:count]
    first, second = np.triu_indices(count, k=2)
    if closed:
        apart = (first != 0) | (second != count - 1)
        first, second = first[apart], second[apart]
    side = _sides(a[first], b[first], a[second]) * _sides(a[first], b[first], b[second])
    other = _sides(a[second], b[second], a[first]) * _sides(a[second], b[second], b[first])
    cross = (side < 0.0) & (other < 0.0)
    if cross.any():
        at = int(np.nonzero(cross)[0][0])
        raise ValueError(
            f"a polyline crosses itself, after its points {first[at]} and {second[at]}"
        )


def _sides(a: Floats, b: Floats, c: Floats) -> Floats:
    """Twice the areas (p,) of triangles; positive where c is on the left of a to b."""
    u, v = b - a, c - a
    left: Floats = u[:, 0] * v[:, 1]
    return left - u[:, 1] * v[:, 0]


def _turns(ahead: Floats, closed: bool) -> Floats:
    """Turn (n,), rad, left positive, at each point; 0 at open ends."""
    before = np.roll(ahead, 1, axis=0)
    sine = before[:, 0] * ahead[:, 1] - before[:, 1] * ahead[:, 0]
    turn: Floats = np.arctan2(sine, np.einsum("ni,ni->n", before, ahead))
    if not closed:
        turn = np.concatenate([[0.0], turn[1:], [0.0]])
    back = np.nonzero(np.abs(turn) > REVERSED)[0]
    if len(back):
        raise ValueError(f"a polyline goes back on itself at its point {back[0]}")
    return turn


def _radii(radius: float | Floats, count: int, closed: bool) -> Floats:
    """Radius (n,), m, at each point; 0 at open ends."""
    given = np.array(radius, dtype=np.float64)
    corners = count if closed else count - 2
    if given.ndim and given.shape != (corners,):
        raise ValueError(f"{given.size} fillet radii for {corners} corners")
    if not np.all(np.isfinite(given) & (given >= 0.0)):
        raise ValueError(f"a fillet radius must not be negative: {given.tolist()} m")
    radii = np.array(np.broadcast_to(given, (corners,)))
    return radii if closed else np.concatenate([[0.0], radii, [0.0]])


def _require_fit(radii: Floats, before: Floats, after: Floats, long: Floats) -> None:
    """Refuse fillets whose tangents take more than the straight lines have."""
    wrong = np.nonzero(before + after > long * (1.0 + TIGHT))[0]
    if not len(wrong):
        return
    at = int(wrong[0])
    other = (at + 1) % len(radii)
    raise ValueError(
        f"fillets of radius {radii[at]:g} m at point {at} and {radii[other]:g} m at point {other} "
        f"take {before[at] + after[at]:.6g} m of the line between them, which is "
        f"{long[at]:.6g} m long"
    )


def _joined(
    first: Floats, last: Floats, ahead: Floats, turn: Floats, radii: Floats, closed: bool
) -> Pieces:
    """Straight pieces, each with the arc at its end behind it, but for those without length."""
    count = len(first)
    corner = (np.arange(count) + 1) % len(turn)  # point at the end of each straight piece
    radius = radii[corner]
    centre = last + (np.sign(turn[corner]) * radius)[:, None] * left_of(ahead)
    start = np.stack([first, last], axis=1).reshape(-1, 2)
    end = np.stack([last, np.roll(first, -1, axis=0)], axis=1).reshape(-1, 2)
    sweep = np.stack([np.zeros(count), turn[corner]], axis=1).reshape(-1)
    centres = np.stack([first, centre], axis=1).reshape(-1, 2)
    there = np.linalg.norm(last - first, axis=1)
    full = there > TIGHT * (there + radius + radii[:count])
    keep = np.stack([full, radius > 0.0], axis=1).reshape(-1)
    return Pieces(start[keep], end[keep], sweep[keep], centres[keep], closed)


# -- How much of a point counts near the ends and the sharp corners of a line in the plane ---------
#
# Axis letters: q points, p pieces, e the two ends of a piece, i space (the plane).
#
# At the end of a line a point fades to nothing over its reach, as at the end of facets. Projected
# along normals n of the slave, points behind a steep corner look at a flank that they only graze,
# far away, or at nothing: they would leave or join the contact at once as n turns a little. With
# the normal m of a piece they therefore count by how much it faces them,
#
# .. math:: s = \frac{m\cdot n - \cos_0}{\cos_1 - \cos_0}, \quad 0 \le s \le 1,
#
# and up to a sharp corner by what is the same on both sides of it, :math:`c = \min(s, s_{next})`:
#
# .. math:: \sigma = c + (s - c)\, w, \qquad w = \min(1, \text{way to the corner}/\text{reach}).

FACING = 0.45  # cosine between the normals of piece and slave from which on points count in full


@dataclass(slots=True)
class Shares:
    """Shares σ of points."""

    share: Floats  # (q,) σ
    slope: Floats  # (q,) ∂σ/∂ξ
    turn: Floats | None = None  # (q, i) ∂σ/∂n, None of closest points


class LineEnds:
    """The ends and corners of a line, and what they leave of points near them."""

    def __init__(self, pieces: Pieces) -> None:
        self._open, self._sharp = pieces.open_ends(), pieces.turns() != 0.0
        self._length, self._sweep = pieces.length, pieces.sweep
        out = left_of(pieces.directions())
        self._start = out[:, 0]
        self._next = np.stack(
            [np.roll(out[:, 1], 1, axis=0), np.roll(out[:, 0], -1, axis=0)], axis=1
        )

    def of_closest(self, piece: Ints, xi: Floats, on_line: Bools, reach: Floats) -> Shares | None:
        """Shares of closest points at ξ (q,) of pieces (q,); None: all are whole.

        ``on_line``: (q,) False past an open end; ``reach``: (q,), m, up to it over which they fade.
        """
        at = np.nonzero(self._open[piece].any(axis=1) & on_line)[0]
        if not len(at):
            return None
        out = Shares(np.ones(len(xi)), np.zeros(len(xi)))
        out.share[at], out.slope[at] = fade_at_ends(
            self._open[piece[at]], xi[at], self._length[piece[at]], reach[at]
        )
        return out

    def along_rays(
        self, piece: Ints, xi: Floats, met: Bools, reach: Floats, normals: Floats
    ) -> Shares:
        """Shares of points along normals (q, i) that have ``met`` (q,) pieces (q,) at ξ (q,)."""
        turn, start = xi * self._sweep[piece], self._start[piece]
        facing = np.cos(turn)[:, None] * start + np.sin(turn)[:, None] * left_of(start)
        own, d_own = _ramp(np.einsum("qi,qi->q", facing, normals))
        # On an arc the normal m turns with ξ by ω: ∂(m·n)/∂ξ.
        rolls = self._sweep[piece] * np.einsum("qi,qi->q", left_of(facing), normals)
        own_slope, own_turn = d_own * rolls, d_own[:, None] * facing
        end, w, d_w = self._ways(piece, xi, reach)
        beyond = self._next[piece, end]
        other, d_other = _ramp(np.einsum("qi,qi->q", beyond, normals))
        other = np.where(self._open[piece, end], 0.0, other)
        d_other = np.where(self._open[piece, end], 0.0, d_other)
        # At a corner the piece counts that the ray faces less, from either side: nothing jumps.
        least = other < own
        corner = np.where(least, other, own)
        corner_slope = np.where(least, 0.0, own_slope)
        corner_turn = np.where(least[:, None], d_other[:, None] * beyond, own_turn)
        share = corner + (own - corner) * w
        slope = corner_slope + (own_slope - corner_slope) * w + (own - corner) * d_w
        change = corner_turn + (own_turn - corner_turn) * w[:, None]
        return Shares(
            np.where(met, share, 1.0),
            np.where(met, slope, 0.0),
            np.where(met[:, None], change, 0.0),
        )

    def _ways(self, piece: Ints, xi: Floats, reach: Floats) -> tuple[Ints, Floats, Floats]:
        """The end (q,) that counts, the way to it over the reach, at most 1, and its slope.

        Of two ends the nearer one counts, and neither reaches further than to the middle.
        """
        ends = self._open[piece] | self._sharp[piece]
        end = np.where(ends[:, 0] & (~ends[:, 1] | (xi < 0.5)), 0, 1).astype(np.int32)
        length = self._length[piece]
        per_length = length / np.minimum(reach, np.where(ends.all(axis=1), 0.5, 1.0) * length)
        way = np.where(end == 0, xi, 1.0 - xi) * per_length
        near = (way < 1.0) & ends.any(axis=1)
        slope = np.where(near, np.where(end == 0, per_length, -per_length), 0.0)
        return end, np.where(near, way, 1.0), slope


def _ramp(cosine: Floats) -> tuple[Floats, Floats]:
    """S (q,) and ds/dcos of the cosine between the normals."""
    width = FACING - GRAZING
    share = (cosine - GRAZING) / width
    slope = np.where((share > 0.0) & (share < 1.0), 1.0 / width, 0.0)
    return np.clip(share, 0.0, 1.0), slope
