"""Whether the cells of a mesh lie side by side, as those of a damaged or tangled file may not.

Axis letters: c cells, f facets of all cells, a corners, i space.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tribox.geometry.meshes.elements import SIDES
from tribox.geometry.meshes.gmsh_model import MeshError
from tribox.geometry.meshes.mesh_arrays import MeshArrays

Longs = npt.NDArray[np.int64]

FLAT = 1e-14
"""Smallest extent of a cell: its determinant over the power of its longest side."""

# Corners joined to the first one.
_AROUND = {
    "triangle": (1, 2),
    "quadrilateral": (1, 3),
    "tetrahedron": (1, 2, 3),
    "hexahedron": (1, 3, 4),
}


def check_neighbours(mesh: MeshArrays, source: str) -> None:
    """See that a facet is that of one cell, or of two on either side of it.

    Args:
        mesh: Whose cells are not folded, one by one.
        source: Name of the mesh in messages.

    Raises:
        MeshError: Cells have no extent, or lie on the same side of a facet of theirs.
    """
    cells = mesh.cells
    sign = _orientation(mesh, cells, source)
    facets = np.concatenate([cells[:, list(at)] for at in SIDES[mesh.cell]])
    side = np.tile(sign, len(SIDES[mesh.cell])) * _turn(facets)
    order = np.lexsort(np.sort(facets, axis=1).T[::-1])
    same = np.sort(facets[order], axis=1)
    begins = np.flatnonzero(np.r_[True, (same[1:] != same[:-1]).any(axis=1)])
    counts = np.diff(np.r_[begins, len(facets)])
    if (many := int(np.count_nonzero(counts > 2))) > 0:
        raise MeshError(f"{source}: {many} facets are those of more than two cells")
    sums = np.add.reduceat(side[order], begins)
    if (tangled := int(np.count_nonzero((counts == 2) & (sums != 0)))) > 0:
        raise MeshError(
            f"{source}: at {tangled} facets both cells lie on the same side, so that they overlap; "
            "a node is misplaced or a cell inverted"
        )


def _orientation(mesh: MeshArrays, cells: Longs, source: str) -> Longs:
    """+1 for cells (c,) numbered as gmsh does, −1 for mirrored ones."""
    corners = mesh.position[cells][:, :, : mesh.dim]
    edges = corners[:, list(_AROUND[mesh.cell])] - corners[:, :1]
    extent = np.ptp(corners, axis=1).max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.linalg.det(edges / extent[:, None, None])
    flat = int(np.count_nonzero(~(np.abs(ratio) > FLAT)))
    if flat:
        raise MeshError(f"{source}: {flat} cells are folded or without extent")
    return np.sign(ratio).astype(np.int64)


def _turn(facets: Longs) -> Longs:
    """+1 or −1 (f,): the sense in which the corners go round, whichever comes first."""
    count = facets.shape[1]
    if count == 2:
        return np.where(facets[:, 0] < facets[:, 1], 1, -1)
    first = facets.argmin(axis=1)
    rows = np.arange(len(facets))
    after, before = facets[rows, (first + 1) % count], facets[rows, (first - 1) % count]
    return np.where(after < before, 1, -1)
