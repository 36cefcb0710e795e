"""Orders of places and of segments that do not depend on how the mesh is partitioned."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]


def order_by_place(position: Floats) -> Longs:
    """Order of points (q, i), by x first; round-off that depends on the partition has no effect."""
    size = float(np.ptp(position, axis=0).max()) or 1.0
    # The offset moves round numbers away from the points where the rounding changes.
    steps = np.floor((position - position.min(axis=0)) / (1e-8 * size) + 0.3183)
    return np.lexsort(steps.T[::-1])


def chains(facets: Longs) -> Iterator[Longs]:
    """Vertices of each connected piece of a surface in the plane, one after the other.

    Open pieces come first and begin at the end with the smaller number; a closed one begins at its
    smallest number, which is there again at its end.

    Args:
        facets: (f, 2) vertices of the segments.
    """
    beside: dict[int, list[int]] = {}
    for a, b in ((int(a), int(b)) for a, b in facets):
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    ends = sorted(v for v, others in beside.items() if len(others) == 1)
    left = set(beside)
    for start in (*ends, *sorted(beside)):
        if start in left:
            yield np.array(_piece(start, beside, left), dtype=np.int64)


def _piece(start: int, beside: dict[int, list[int]], left: set[int]) -> list[int]:
    """The vertices from one on, as long as there are more; taken out of ``left``."""
    piece, here = [start], start
    left.remove(start)
    while onward := [v for v in sorted(beside[here]) if v in left]:
        here = onward[0]
        left.remove(here)
        piece.append(here)
    if len(piece) > 2 and start in beside[here]:
        piece.append(start)
    return piece
