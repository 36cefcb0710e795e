"""Tables of cells as the compiled loops take them: several cells side by side."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

LANES = 8  # cells that the loops take at a time


def in_lanes(table: NDArray[Any]) -> NDArray[Any]:
    """Rows (c, k) of the cells as (blocks, k, LANES), the last cell repeated to fill the last."""
    missing = -len(table) % LANES
    padded = np.concatenate([table, table[-1:].repeat(missing, axis=0)])
    return np.ascontiguousarray(padded.reshape(-1, LANES, table.shape[1]).transpose(0, 2, 1))
