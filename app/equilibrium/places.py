"""Places in the undeformed bodies, found and put into words."""

from __future__ import annotations

from collections.abc import Iterable

import dolfinx
import numpy as np

from tribox.geometry.surfaces.facets import Floats


def place_text(place: Iterable[float]) -> str:
    """Coordinates as they are read: what is round-off beside the others is zero."""
    values = np.array(list(place))
    values[np.abs(values) < 1e-12 * np.max(np.abs(values), initial=0.0)] = 0.0
    return "(" + ", ".join(f"{value:.4g}" for value in values) + ") m"


def place_of_largest(values: Floats, space: dolfinx.fem.FunctionSpace) -> tuple[float, ...]:
    """Where the largest of ``values`` on all ranks is, m, undeformed; collective.

    Args:
        values: (n,) one number for each owned unknown, >= 0.
        space: blocked space of the displacement.
    """
    dim = space.dofmap.index_map_bs
    mine: tuple[float, tuple[float, ...]] = (-1.0, ())
    if len(values):
        at = int(np.argmax(values))
        where = space.tabulate_dof_coordinates()[at // dim, :dim]
        mine = (float(values[at]), tuple(map(float, where)))
    place: tuple[float, ...] = max(space.mesh.comm.allgather(mine))[1]
    return place
