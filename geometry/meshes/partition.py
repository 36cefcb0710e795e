"""The partition of a mesh: cells and slave facets divided evenly, touching facets on one rank.

A step works on all cells, then on all slave facets, and solves for one body after the other; ranks
wait for each other in between. A partition of the cells alone may leave every slave facet, or a
whole body, on one rank, since bodies share no node. So several weights are balanced at once, cells
of each large body and slave facets, after Karypis, Multi-constraint mesh partitioning for
contact/impact computations, SC 2003; and each slave facet's cell is joined by an edge to the cell
of the master facet next to it, so that facets that touch tend to be on one rank.

Axis letters: c cells, f facets, v vertices.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from collections.abc import Sequence
from functools import cache

import numpy as np
import numpy.typing as npt
import scipy.sparse
import scipy.sparse.csgraph
from scipy.spatial import cKDTree

from tribox.geometry.surfaces.facets import Floats, Ints, Longs

# Vertices (f, v) of the slave and of the master facets of a contact; of a tool (0, v).
Pair = tuple[Longs, Longs]

# An edge between touching cells: cutting one costs the tangent's entries of a slave and a master
# facet, about as many as the exchange of a face between two cells.
TOUCHING = 2
SLACK = 0.02  # of each weight over its mean
LARGE = 0.1  # share of all cells from which on a body's are balanced for themselves


def share_out(cells: Longs, position: Floats, contacts: Sequence[Pair], parts: int) -> Ints:
    """The part (c,) of each cell (c, v), of vertices (n, i); PartitionError of METIS.

    ``contacts``: facets of pairs, each a face of one cell; ``parts``: how many.
    """
    if parts >= len(cells):
        return np.arange(len(cells), dtype=np.int32)
    incidence = _incidence(cells, len(position))
    dim = position.shape[1]
    # Cells that share as many vertices as the least face has are neighbours.
    face = dim if cells.shape[1] == dim + 1 else 2 ** (dim - 1)
    graph = _sharing(incidence, incidence, face)
    weights = _cells_of_bodies(graph)
    for pair in contacts:
        (slaves, here), (masters, there) = (
            _cells_behind(facets, incidence, position) for facets in pair
        )
        weight = np.bincount(slaves, minlength=len(cells)).astype(np.int32)
        # Facets of no cell are reported later, by the surface's name; a slave of several masters
        # is one weight to be balanced.
        if len(slaves) and not any(np.array_equal(weight, other) for other in weights):
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
    return partition(graph, np.stack(weights, axis=1), parts, SLACK)


def _cells_of_bodies(graph: scipy.sparse.csr_matrix) -> list[Ints]:
    """Ones for the cells of each large body, joined by (c, c), and of all others together."""
    _, body = scipy.sparse.csgraph.connected_components(graph, directed=False)
    large = np.bincount(body) >= LARGE * len(body)
    number = np.where(large, np.cumsum(large), 0)[body]
    return [(number == one).astype(np.int32) for one in np.unique(number)]


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


# -- METIS through its C interface: several balance constraints at once ----------------------------
#
# DOLFINx's partitioners balance one weight only. METIS 5 balances several at
# once: Karypis & Kumar, Multilevel algorithms for multi-constraint graph partitioning, 1998.

_LIBRARY = "libmetis.so.5"
_OPTIONS = 40  # METIS_NOPTIONS
_OK = 1  # METIS_OK
_Array = Ints | npt.NDArray[np.float32] | None


class PartitionError(RuntimeError):
    """METIS did not find a partition."""


def metis_is_available() -> bool:
    """Whether METIS 5 with 32-bit integers is installed."""
    return _library() is not None


def partition(graph: scipy.sparse.csr_matrix, weights: Ints, parts: int, slack: float) -> Ints:
    """Divide a graph (n, n) into parts (n,) of equal weights, with light edges between them.

    ``graph``: symmetric, no diagonal, whole weights; ``weights``: (n, k), each column balanced for
    itself, within ``slack`` of the mean. The same for the same arguments; PartitionError of METIS.
    """
    library = _library()
    if library is None:
        raise PartitionError(f"{_LIBRARY} with 32-bit integers is not installed")
    count, constraints = weights.shape
    out, cut = np.zeros(count, dtype=np.int32), np.zeros(1, dtype=np.int32)
    arrays: list[_Array] = [
        np.array([count], dtype=np.int32),
        np.array([constraints], dtype=np.int32),
        graph.indptr.astype(np.int32),
        graph.indices.astype(np.int32),
        np.ascontiguousarray(weights, dtype=np.int32),
        None,
        graph.data.astype(np.int32),
        np.array([parts], dtype=np.int32),
        None,
        np.full(constraints, 1.0 + slack, dtype=np.float32),
        _default_options(library),
        cut,
        out,
    ]
    # With several weights it was faster, and cut no more, than k-way partitioning into 9 to 32.
    solve = library.METIS_PartGraphRecursive
    status = solve(*(None if a is None else ctypes.c_void_p(a.ctypes.data) for a in arrays))
    if status != _OK:
        raise PartitionError(f"METIS reports error {status} for {count} cells in {parts} parts")
    return out


@cache
def _library() -> ctypes.CDLL | None:
    """METIS, if it is installed with 32-bit integers."""
    for name in (_LIBRARY, ctypes.util.find_library("metis")):
        try:
            library = ctypes.CDLL(name) if name else None
        except OSError:
            continue
        # All defaults are -1: twice as many of these words are set where integers have 64 bits.
        if library is not None and np.count_nonzero(_default_options(library)) == _OPTIONS:
            return library
    return None


def _default_options(library: ctypes.CDLL) -> Ints:
    options = np.zeros(2 * _OPTIONS, dtype=np.int32)
    library.METIS_SetDefaultOptions(ctypes.c_void_p(options.ctypes.data))
    return options
