"""The structures that the compiled loops of a pair read, and how arrays get there.

Axis letters as in :mod:`tribox.forms.contact.tangent`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from tribox.forms.contact.vertex_rows import Coupling
from tribox.forms.native import library
from tribox.geometry.native.compiler import packed, require_size, start_of
from tribox.geometry.surfaces.facets import Floats, Ints, Longs

SOURCES = {2: "plane_pair.c", 3: "space_pair.c"}  # by the dimension of space
MOST = {2: (4, 4, 4), 3: (9, 64, 16)}  # corners, movers and shapes that they have room for
_LONGS = ("corners", "movers", "shapes", "first_master", "vertices")
_POINTERS = (
    *("weight", "shape", "slave_rows", "of_point", "vertex_shape", "chain_rows"),
    *("stencil", "signs", "turn", "bend", "powers", "coefficients", "extraction"),
    *("facet", "xi", "share_of", "slope_of", "normal", "tangents", "distance", "curvature"),
    *("clamped", "along", "chords", "share", "share_slope", "share_turn", "per_share"),
    *("position", "foot", "gap", "spring", "pressure_slope", "traction", "by_slip", "by_elastic"),
    *("by_pressure", "drawn", "closed"),
    *("facet_before", "xi_before", "ahead", "share_before", "slope_before", "components"),
    *("anchor", "image", "slip_length"),
)
_KINDS = {
    **dict.fromkeys(("slave_rows", "of_point", "chain_rows"), np.int64),
    **dict.fromkeys(("stencil", "powers", "facet", "facet_before"), np.int32),
    **dict.fromkeys(("clamped", "closed"), np.uint8),
}


class PairStructure(ctypes.Structure):
    """``Pair`` of the C source, field by field in the same order."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in _LONGS),
        *((name, ctypes.c_void_p) for name in _POINTERS),
    )


class EntriesStructure(ctypes.Structure):
    """``Entries`` of the C source, likewise."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("indptr", "indices", "values")),
        *((name, ctypes.c_void_p) for name in ("row_first", "column_first")),
        *((name, ctypes.c_int64) for name in ("count", "room")),
        *((name, ctypes.POINTER(ctypes.c_int64)) for name in ("row", "column")),
        ("block", ctypes.POINTER(ctypes.c_double)),
    )


def pair_library(dim: int) -> ctypes.CDLL:
    """The loops for pairs in the plane, or in space; RuntimeError if their structure is another."""
    code = library(SOURCES[dim])
    require_size(code.tribox_pair_size(), PairStructure, SOURCES[dim])
    code.tribox_pair_forces.restype = ctypes.c_double
    return code


class PairFields:
    """A structure with the arrays that it points to, which live as long as it has them."""

    def __init__(self, **sizes: int) -> None:
        self.structure = PairStructure(**sizes)
        self._alive: dict[str, NDArray[Any] | None] = {}

    def set(self, **arrays: NDArray[Any] | None) -> None:
        """Give it arrays; None: none."""
        for name, array in arrays.items():
            if array is not None and array is self._alive.get(name):
                continue
            kept = packed(array, _KINDS.get(name, np.float64))
            self._alive[name] = kept
            setattr(self.structure, name, None if kept is None else start_of(kept).value)


@dataclass(frozen=True, slots=True)
class Entries:
    """The part of a matrix that contacts may add to in place: rows and columns of one rank."""

    indptr: Ints  # its pattern, columns in ascending order
    indices: Ints  # likewise
    values: Floats  # its values, N/m
    # from global nodes (n,) to the numbers (n,) int32 of their first unknowns in it; −1 of nodes
    # that are not in it with all their unknowns, one after the other
    first: Callable[[Longs], Ints]

    @classmethod
    def none(cls) -> Entries:
        """A matrix that no node is in."""
        start: Ints = np.zeros(1, dtype=np.int32)
        return cls(start, start[:0], np.empty(0), lambda nodes: np.full(len(nodes), -1, np.int32))


class Target:
    """A matrix that loops add to, and what they list of nodes that are not in it."""

    def __init__(
        self, entries: Entries, nodes: tuple[Longs, Longs], code: ctypes.CDLL, dim: int
    ) -> None:
        """Take global nodes (n,) of rows and of columns."""
        self.rows, self.columns = nodes
        self.row_first = packed(entries.first(self.rows), np.int32)
        same = self.columns is self.rows
        self.column_first = (
            self.row_first if same else packed(entries.first(self.columns), np.int32)
        )
        self._code, self._dim, self.size = code, dim, len(entries.indptr) - 1
        self._arrays = entries.indptr, entries.indices, entries.values
        firsts = self.row_first, self.column_first
        self.structure = EntriesStructure(*(start_of(a) for a in (*self._arrays, *firsts)))

    def beside(self) -> list[Coupling]:
        """What was listed; it is let go of."""
        made, dim = self.structure, self._dim
        if not made.count:
            self._code.tribox_forget_beside(ctypes.byref(made))
            return []
        shape, width = (made.count,), len(self.columns)
        row, column = (np.ctypeslib.as_array(a, shape) for a in (made.row, made.column))
        # Points list the same blocks again and again.
        key = row * width + column
        order = np.argsort(key, kind="stable")
        first = np.nonzero(np.diff(key[order], prepend=-1))[0]
        blocks = np.ctypeslib.as_array(made.block, (*shape, dim, dim))[order]
        sums, (row, column) = np.add.reduceat(blocks, first), np.divmod(key[order[first]], width)
        used, start = np.unique(row, return_index=True)
        ends, size = np.append(start, len(row)), (dim * len(used), dim * width)
        matrix = scipy.sparse.bsr_matrix((sums, column, ends), shape=size).tocsr()
        self._code.tribox_forget_beside(ctypes.byref(made))
        return [Coupling(self.rows[used], self.columns, matrix)]


def require_room(failed: int) -> None:
    """Refuse what loops could not add; RuntimeError if they failed."""
    if failed:
        raise RuntimeError("contact: an entry of the tangent is not in the matrix's pattern")
