"""Graph partitioning with several balance constraints, by METIS through its C interface.

DOLFINx's partitioners balance one weight only. METIS 5 balances several at
once: Karypis & Kumar, Multilevel algorithms for multi-constraint graph partitioning, 1998.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from functools import cache

import numpy as np
import numpy.typing as npt
import scipy.sparse

from tribox.geometry.surfaces.facets import Ints

_LIBRARY = "libmetis.so.5"
_OPTIONS = 40  # METIS_NOPTIONS
_OK = 1  # METIS_OK
# METIS's manual: recursive bisection gives better parts up to eight, and takes longer beyond.
_FEW = 8
_Array = Ints | npt.NDArray[np.float32] | None


class PartitionError(RuntimeError):
    """METIS did not find a partition."""


def is_available() -> bool:
    """Whether METIS 5 with 32-bit integers is installed."""
    return _library() is not None


def partition(graph: scipy.sparse.csr_matrix, weights: Ints, parts: int, slack: float) -> Ints:
    """Divide a graph into parts of equal weights, with light edges between them.

    Args:
        graph: (n, n), symmetric, without a diagonal; integer weights of the edges.
        weights: (n, k) of the vertices; each of the k columns is balanced for itself.
        parts: how many.
        slack: by which a part's weight may exceed the mean, relative.

    Returns:
        (n,) the part of each vertex; the same for the same arguments.

    Raises:
        PartitionError: METIS is not installed, or reports an error.
    """
    library = _library()
    if library is None:
        raise PartitionError(f"{_LIBRARY} with 32-bit integers is not installed")
    count, constraints = weights.shape
    few = parts <= _FEW
    solve = library.METIS_PartGraphRecursive if few else library.METIS_PartGraphKway
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
