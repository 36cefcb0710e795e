"""The partition of a mesh: cells and slave facets divided evenly, touching facets on one rank.

A step works first on all cells, then on all slave facets, and ranks wait for each other in between.
A partition of the cells alone may leave every slave facet on one rank, since bodies share no node.
So two weights are balanced at once, cells and slave facets, after Karypis, Multi-constraint mesh
partitioning for contact/impact computations, SC 2003; and each slave facet's cell is joined by an
edge to the cell of the master facet next to it, so that facets that touch tend to be on one rank.

Axis letters: c cells, f facets, v vertices.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse
from scipy.spatial import cKDTree

from tribox.geometry.meshes import metis
from tribox.geometry.surfaces.facets import Floats, Ints, Longs

# Vertices (f, v) of the slave and of the master facets of a contact; of a tool (0, v).
Pair = tuple[Longs, Longs]

# An edge between touching cells: cutting one costs the tangent's entries of a slave and a master
# facet, about as many as the exchange of a face between two cells.
TOUCHING = 2
SLACK = 0.02  # of each weight over its mean


def share_out(cells: Longs, position: Floats, contacts: Sequence[Pair], parts: int) -> Ints:
    """The part of each cell.

    Args:
        cells: (c, v) vertices, rows of ``position``.
        position: (n, i) of all vertices.
        contacts: facets of the pairs, each a face of one cell; of a master that is no part of the
            mesh there are none.
        parts: how many.

    Returns:
        (c,) numbers of the parts.

    Raises:
        tribox.geometry.meshes.metis.PartitionError: METIS is missing or failed.
    """
    if parts >= len(cells):
        return np.arange(len(cells), dtype=np.int32)
    incidence = _incidence(cells, len(position))
    dim = position.shape[1]
    # Cells that share as many vertices as the least face has are neighbours.
    face = dim if cells.shape[1] == dim + 1 else 2 ** (dim - 1)
    graph = _sharing(incidence, incidence, face)
    weights: list[Ints] = [np.ones(len(cells), dtype=np.int32)]
    for pair in contacts:
        (slaves, here), (masters, there) = (
            _cells_behind(facets, incidence, position) for facets in pair
        )
        weight = np.bincount(slaves, minlength=len(cells)).astype(np.int32)
        # Facets of no cell are reported later, by the surface's name; a slave of several masters
        # is one weight to be balanced.
        if len(slaves) and not any(np.array_equal(weight, other) for other in weights[1:]):
            weights.append(weight)
        if not len(slaves) or not len(masters):
            continue
        beside = masters[cKDTree(there).query(here)[1]]
        edges = np.full(len(slaves), TOUCHING, dtype=np.int32)
        joined = scipy.sparse.coo_matrix((edges, (slaves, beside)), shape=graph.shape)
        graph = graph + joined + joined.T
    graph = scipy.sparse.csr_matrix(graph)
    graph.setdiag(0)
    graph.eliminate_zeros()
    return metis.partition(graph, np.stack(weights, axis=1), parts, SLACK)


def _incidence(elements: Longs, count: int) -> scipy.sparse.csr_matrix:
    """Elements (e, v) against ``count`` vertices."""
    indptr = np.arange(0, elements.size + 1, elements.shape[1])
    ones = np.ones(elements.size, dtype=np.int32)
    return scipy.sparse.csr_matrix((ones, elements.reshape(-1), indptr), (len(elements), count))


def _sharing(
    first: scipy.sparse.csr_matrix, second: scipy.sparse.csr_matrix, least: int
) -> scipy.sparse.csr_matrix:
    """Ones where elements (e, n) share at least so many vertices with others (g, n)."""
    shared = scipy.sparse.csr_matrix(first @ second.T)
    shared.data = (shared.data >= least).astype(np.int32)
    shared.eliminate_zeros()
    return shared


def _cells_behind(
    facets: Longs, incidence: scipy.sparse.csr_matrix, position: Floats
) -> tuple[Ints, Floats]:
    """Cells (f,) whose faces facets are, and the facets' middles (f, i)."""
    found = _sharing(_incidence(facets, len(position)), incidence, facets.shape[1]).tocoo()
    return found.col, position[facets[found.row]].mean(axis=1)
