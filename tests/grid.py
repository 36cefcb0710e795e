"""Blocks of equal cells, with the coordinate element that meshes of gmsh have.

DOLFINx's own meshes have another one, of the same functions at degree 1. Forms on them are not
those that the image holds: the tests that make them would compile them.
"""

from collections.abc import Sequence

import basix.ufl
import dolfinx
import numpy as np
import ufl
from mpi4py import MPI

from tribox.geometry.compat import cell_nodes


def coordinate_element(cell: str, dim: int, order: int = 1) -> ufl.Mesh:
    """The domain of meshes of straight cells, as `generate` makes them, or of curved ones."""
    kind = {"lagrange_variant": basix.LagrangeVariant.equispaced, "shape": (dim,)}
    return ufl.Mesh(basix.ufl.element("Lagrange", cell, order, **kind))


def grid(
    cell: str,
    counts: Sequence[int],
    high: Sequence[float] | None = None,
    low: Sequence[float] | None = None,
) -> dolfinx.mesh.Mesh:
    """A rectangle or box between two corners, the unit square or cube by itself, on one rank."""
    dim = len(counts)
    corners = [list(low or [0.0] * dim), list(high or [1.0] * dim)]
    make = dolfinx.mesh.create_box if dim == 3 else dolfinx.mesh.create_rectangle
    made = make(MPI.COMM_SELF, corners, list(counts), dolfinx.mesh.CellType[cell])
    cells = cell_nodes(made).astype(np.int64)
    x = made.geometry.x[:, :dim]
    return dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells, x=x, e=coordinate_element(cell, dim))
