"""The corners of a polyline in the plane, rounded by fillets that fit.

Axis letters: n given points, p pieces, i space (the plane).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tribox.geometry.surfaces.rigid_pieces import STRAIGHT, Pieces

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facets import Floats

TIGHT = 1e-9  # length, over that of a side, that fillets may lack and below which none is made
REVERSED = np.radians(179.0)  # turn from which on the line goes back on itself


def filleted(points: Floats, radius: float | Floats, closed: bool) -> Pieces:
    """The pieces of a polyline.

    Args:
        points: (n, 2), m.
        radius: m, of all fillets, or of each inner point in turn, of a closed line of each point;
            0: the corner is sharp.
        closed: whether the last point is joined to the first.

    Raises:
        ValueError: points that are not enough, not finite or the same; a line that goes back on or
            crosses itself; radii that are negative, of another number, or too large to fit.
    """
    points = _checked(points, closed)
    after = np.roll(points, -1, axis=0) if closed else points[1:]
    before = points if closed else points[:-1]
    way = after - before
    long = np.linalg.norm(way, axis=1)
    ahead = way / long[:, None]
    turn = _turns(ahead, closed)
    radii = _radii(radius, len(points), closed)
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
    out: Floats = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    return out


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
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    radius = radii[corner]
    centre = last + (np.sign(turn[corner]) * radius)[:, None] * left
    start = np.stack([first, last], axis=1).reshape(-1, 2)
    end = np.stack([last, np.roll(first, -1, axis=0)], axis=1).reshape(-1, 2)
    sweep = np.stack([np.zeros(count), turn[corner]], axis=1).reshape(-1)
    centres = np.stack([first, centre], axis=1).reshape(-1, 2)
    there = np.linalg.norm(last - first, axis=1)
    full = there > TIGHT * (there + radius + radii[:count])
    keep = np.stack([full, radius > 0.0], axis=1).reshape(-1)
    return Pieces(start[keep], end[keep], sweep[keep], centres[keep], closed)
