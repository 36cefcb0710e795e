"""An order of places that does not depend on how the mesh is partitioned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geometry.surfaces.facets import Floats


def order_by_place(position: Floats) -> NDArray[np.int64]:
    """Order of points (q, i), by x first; round-off that depends on the partition has no effect."""
    size = float(np.ptp(position, axis=0).max()) or 1.0
    # The offset moves round numbers away from the points where the rounding changes.
    steps = np.floor((position - position.min(axis=0)) / (1e-8 * size) + 0.3183)
    return np.lexsort(steps.T[::-1])
