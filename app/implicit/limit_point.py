"""Whether a path of equilibria ends because its load has come to the largest value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from tribox.geometry.surfaces.facets import Floats

STATES = 4  # of the path: past a kink two slopes in a row are equal, or were before it
FALLS = 0.9  # most that is left of a slope from one of the states to the next
FURTHER = 2.0  # of the last attempt's length: the one before it was as long, and failed too

Sum = Callable[[Floats], Floats]


def slopes(path: Sequence[tuple[float, Floats]], add: Sum) -> Floats:
    """Growth of the load over the way (k,) between the last states of a path; collective.

    Args:
        path: load and owned unknowns (n,) of converged states, the latest last.
        add: sum of values (k,) over the ranks.
    """
    loads = np.array([load for load, _ in path[-STATES:]])
    states = [values for _, values in path[-STATES:]]
    squares = [np.sum((b - a) ** 2) for a, b in pairwise(states)]
    way = np.sqrt(add(np.array(squares)))
    return np.diff(loads) / np.where(way > 0.0, way, np.inf)


def falls(slope: Floats) -> bool:
    """Whether slopes (k,) fall from state to state, as they do on the way to a limit."""
    enough = len(slope) >= STATES - 1
    return enough and bool(np.all(slope > 0.0) and np.all(slope[1:] <= FALLS * slope[:-1]))


def is_limit(slope: Floats, last: float, now: float, reach: float) -> bool:
    """Whether the load is largest before it has grown by little more than ``reach``.

    Before a smooth maximum the square of the slope is proportional to what is missing of the load.

    Args:
        slope: (k,) between the last states; last: growth of the load between the last two.
        now: slope at the last state, by its tangent.
        reach: growth of the load in the step without a solution.
    """
    if not falls(np.append(slope, max(now, np.finfo(float).tiny))):
        return False
    missing = 0.5 * last * now**2 / (slope[-1] ** 2 - now**2)
    return bool(missing <= FURTHER * reach)
