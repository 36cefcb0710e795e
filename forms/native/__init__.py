"""C sources, and the libraries that they are compiled to."""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path

from tribox.geometry.native.compiler import compiled

SOURCES = (
    *("plane_kernel.c", "space_kernel.c", "elastic_points.c", "plane_contact.c", "space_contact.c"),
    *("space_pair.c", "plane_pair.c", "central_slip.c", "plastic_points.c", "viscous_points.c"),
    *("point_cells.c", "cell_places.c", "block_sweeps.c", "film_balance.c"),
)


@functools.cache
def library(name: str) -> ctypes.CDLL:
    """The compiled library of the source ``name``; KernelError if it cannot be made."""
    return compiled(Path(__file__).with_name(name))
