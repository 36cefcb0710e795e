"""Which entries of the tangent the contact of one pair may fill, now and in the steps to come.

Axis letters: s slave facets, f master facets, n nodes, q slave points. A slave facet couples with
the master facets that its points touch, now and at the last step; those two couple with each
other. Room is made for neighbours too, so that a sliding body does not need a new pattern, with a
new symbolic factorisation, at every step. The room only grows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse

from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.state import ContactTrial
from tribox.forms.contact.tie import TieTerm
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
from tribox.geometry.surfaces.surface import ContactSurface, RigidMaster
from tribox.geometry.surfaces.vertices import SlaveVertices

# Rings of neighbouring master facets beyond those in use that a window includes, by the number of
# surface directions: in space every ring costs far more entries.
MARGIN = {1: 3, 2: 1}
NEAR = 2.0  # typical facet sizes up to which an open point counts as about to touch


@dataclass(slots=True)
class ContactWindow:
    """Pairs of facets that the tangent's pattern has room for.

    Attributes:
        touching: (s, f) sparse, slave facets against master facets.
        together: (f, f) sparse, master facets that one point touches now and at the last step.
        rings: (f, f) sparse, the neighbours that room is made for.
    """

    touching: scipy.sparse.csr_matrix
    together: scipy.sparse.csr_matrix
    rings: scipy.sparse.csr_matrix

    def arrays(self) -> dict[str, Ints]:
        """The columns and the row ends of its tables, for :meth:`with_arrays`."""
        out: dict[str, Ints] = {}
        for name in ("touching", "together"):
            table = getattr(self, name)
            out |= {f"{name}_columns": table.indices, f"{name}_ends": table.indptr}
        return out

    def with_arrays(self, arrays: Mapping[str, Ints]) -> ContactWindow:
        """The same neighbours, with the tables that :meth:`arrays` gave."""
        tables = {}
        for name in ("touching", "together"):
            columns = arrays[f"{name}_columns"]
            parts = (np.ones(len(columns), dtype=np.int32), columns, arrays[f"{name}_ends"])
            tables[name] = scipy.sparse.csr_matrix(parts, shape=getattr(self, name).shape)
        return replace(self, **tables)

    def holds(self, term: ContactTerm, trial: ContactTrial) -> bool:
        """Whether the tangent of a trial fits in."""
        closed = trial.coupled()
        slave = term.surface.slave.facet[closed]
        current, before = _pieces(term, trial, closed)
        moved = current != before
        return (
            _contains(self.touching, slave, current)
            and _contains(self.touching, slave[moved], before[moved])
            and _contains(self.together, current[moved], before[moved])
        )


def _is_tool(surface: ContactSurface) -> bool:
    """Whether the master is a tool, which two nodes move wherever it is touched."""
    return isinstance(surface.master, RigidMaster) and surface.master.motion is not None


def _pieces(term: ContactTerm, trial: ContactTrial, take: Bools) -> tuple[Ints, Ints]:
    """Master facets of points ``take``, now and at the last step; a tool counts as one."""
    current, before = trial.projection.facet[take], term.state.facet[take]
    if _is_tool(term.surface):
        return np.zeros_like(current), np.zeros_like(before)
    return current, before


def _movers(surface: ContactSurface) -> Longs:
    """Global nodes (f, m) that move each master facet, or a tool as one."""
    nodes: Longs = surface.master.nodes
    return nodes[None] if _is_tool(surface) else nodes[surface.target.stencil]


def _contains(table: scipy.sparse.csr_matrix, row: Ints, column: Ints) -> bool:
    """Whether all entries are present; the indices of ``table`` are sorted."""
    width = np.int64(table.shape[1])
    rows = np.repeat(np.arange(table.shape[0], dtype=np.int64), np.diff(table.indptr))
    keys = np.append(rows * width + table.indices, -1)
    wanted = row * width + column
    return bool(np.all(keys[np.searchsorted(keys[:-1], wanted)] == wanted))


def widened(window: ContactWindow | None, term: ContactTerm, trial: ContactTrial) -> ContactWindow:
    """A window that holds the last one, the facets in use now, and rings of their neighbours."""
    surface = term.surface
    near = trial.projection.gap <= NEAR * surface.target.search.slack
    near = trial.coupled() | (near & trial.projection.on_surface)
    slave = surface.slave.facet[near]
    current, before = _pieces(term, trial, near)
    facets = len(_movers(surface))
    count = int(surface.slave.facet.max(initial=-1)) + 1
    if window is None:
        neighbours = np.ones((1, 1)) if _is_tool(surface) else surface.target.neighbours
        rings = _rings(_present(neighbours), MARGIN[surface.shape.directions])
    else:
        rings = window.rings
    used = _table(np.tile(slave, 2), np.concatenate([current, before]), (count, facets))
    touching = _present(used @ rings)
    pairs = _table(current, before, (facets, facets))
    pairs = _present(rings @ (pairs + pairs.T) @ rings + rings)
    if window is not None:
        touching = _present(touching + window.touching)
        pairs = _present(pairs + window.together)
    inside = np.bincount(touching.indices, minlength=facets) > 0
    keep = scipy.sparse.diags(inside.astype(np.int32), dtype=np.int32)
    return ContactWindow(touching, _present(keep @ pairs @ keep), rings)


def _rings(neighbours: scipy.sparse.csr_matrix, count: int) -> scipy.sparse.csr_matrix:
    """Facets within ``count`` rings of each facet."""
    out = neighbours
    for _ in range(count - 1):
        out = _present(out @ neighbours)
    return out


def _table(row: Ints, column: Ints, shape: tuple[int, int]) -> scipy.sparse.csr_matrix:
    return _present(
        scipy.sparse.csr_matrix((np.ones(len(row), dtype=np.int32), (row, column)), shape=shape)
    )


def _present(matrix: scipy.sparse.spmatrix) -> scipy.sparse.csr_matrix:
    """The same pattern filled with ones, indices sorted."""
    out = scipy.sparse.csr_matrix(matrix)
    out.eliminate_zeros()
    out.sum_duplicates()
    out.data = np.ones_like(out.data)
    return out


class BlockPlaces:
    """Where blocks that couple the nodes of each point go in a sparse matrix of unknowns.

    Finding the places takes far longer than adding up the blocks in them, and they stay the same
    as long as the points keep their nodes.

    Attributes:
        nodes: (q, m) global nodes of the points.
        indptr, columns: rows of the matrix, sorted by node; unknowns are global.
        rows: global unknown of each of these rows.
    """

    def __init__(self, nodes: Longs, dim: int) -> None:
        """Find the places of blocks (q, m, i, n, j), with ``dim`` unknowns i and j at a node."""
        self.nodes = nodes
        distinct, number = np.unique(nodes, return_inverse=True)
        number = number.reshape(nodes.shape)
        count = len(distinct)
        key = number[:, :, None] * count + number[:, None, :]
        pairs, place = np.unique(key.reshape(-1), return_inverse=True)
        row, column = np.divmod(pairs, max(count, 1))
        width = np.bincount(row, minlength=count)
        first = np.cumsum(width) - width
        axes = np.arange(dim)
        lengths = np.repeat(dim * width, dim)
        self.indptr = np.append(0, np.cumsum(lengths))
        self.rows = (distinct[:, None] * dim + axes).reshape(-1)
        # Entry (i, j) of a pair of nodes: its row's start, then its place among the row's columns.
        start = (
            self.indptr[:-1].reshape(count, dim)[row]
            + dim * (np.arange(len(row)) - first[row])[:, None]
        )
        entries = start[:, :, None] + axes
        self.columns = np.empty(self.indptr[-1], dtype=np.int64)
        self.columns[entries] = (distinct[column][:, None] * dim + axes)[:, None, :]
        self._entries, self._pair = entries, place.reshape(key.shape)
        self._entry: Longs | None = None  # of each number of the blocks; a pattern needs none

    def add_up(self, blocks: Floats | None) -> Floats:
        """Values of the matrix's entries from blocks (q, m, i, n, j); None: zeros."""
        if blocks is None:
            return np.zeros(len(self.columns))
        if self._entry is None:
            # (q, m, n, i, j), as the pairs have them, to (q, m, i, n, j).
            self._entry = self._entries[self._pair].transpose(0, 1, 3, 2, 4).reshape(-1)
        summed = np.bincount(self._entry, blocks.reshape(-1), len(self.columns))
        return np.asarray(summed, dtype=np.float64)


def coupled_nodes(term: ContactTerm, window: ContactWindow) -> Longs:
    """Pairs (p, 2) of global nodes that a window couples; each pair once; collective.

    An averaged pressure couples all nodes of the facets around a vertex, and of those that they
    touch; of a vertex at the seam of two ranks those of both.
    """
    if isinstance(term, TieTerm):
        return term.coupled_pairs()
    surface = term.surface
    _, first = np.unique(surface.slave.facet, return_index=True)
    mine = surface.slave.nodes[first]
    others = _movers(surface)
    nodes = np.unique(np.concatenate([mine.reshape(-1), others.reshape(-1)]))
    active = np.diff(window.touching.indptr) > 0
    slaves = _incidence(np.searchsorted(nodes, mine), len(nodes))
    slaves = scipy.sparse.diags(active.astype(np.int32), dtype=np.int32) @ slaves
    masters = _incidence(np.searchsorted(nodes, others), len(nodes))
    touched = slaves + window.touching @ masters
    pattern = slaves.T @ touched + touched.T @ slaves + masters.T @ (window.together @ masters)
    pairs = _upper(pattern, nodes)
    if not isinstance(term.rule, AveragedPressure):
        return pairs
    if surface.normals is not None:  # those take the vertices of the next facets too
        chain = surface.nodes[surface.chain_rows[first]]
        nodes, touched = _with(nodes, touched, chain, active)
    around = _incidence(surface.vertices.of_point[first], surface.vertices.count).T
    if isinstance(term, LubricatedTerm):  # a film couples all of its vertices
        around = scipy.sparse.csr_matrix(np.ones((1, around.shape[0]), dtype=np.int32)) @ around
    patches, nodes = _of_all_ranks(around @ touched, nodes, surface.vertices)
    return _distinct(np.concatenate([pairs, _upper(patches.T @ patches, nodes)]))


def _distinct(pairs: Longs) -> Longs:
    """Distinct pairs (p, 2), in order."""
    width = np.int64(pairs.max(initial=0) + 1)
    keys = np.unique(pairs[:, 0] * width + pairs[:, 1])
    return np.stack(np.divmod(keys, width), axis=1)


def without(pairs: Longs, known: Longs) -> Longs:
    """The distinct pairs (p, 2) that are not among the ``known`` ones (k, 2)."""
    width = np.int64(max(pairs.max(initial=0), known.max(initial=0)) + 1)
    keys, others = (both[:, 0] * width + both[:, 1] for both in (pairs, known))
    return np.stack(np.divmod(np.setdiff1d(keys, others, assume_unique=True), width), axis=1)


def _with(
    nodes: Longs, touched: scipy.sparse.spmatrix, more: Longs, active: Bools
) -> tuple[Longs, scipy.sparse.csr_matrix]:
    """Nodes (n,) and those of each facet (f, n), with ``more`` (f, s) for the ``active`` ones."""
    both = np.unique(np.concatenate([nodes, more.reshape(-1)]))
    known = _present(touched).tocoo()
    facets = np.repeat(np.nonzero(active)[0], more.shape[1])
    row = np.concatenate([known.row, facets])
    node = np.concatenate([nodes[known.col], more[active].reshape(-1)])
    return both, _table(row, np.searchsorted(both, node), (len(more), len(both)))


def _upper(pattern: scipy.sparse.spmatrix, nodes: Longs) -> Longs:
    """Pairs (p, 2) of the global ``nodes`` above the diagonal of a symmetric pattern (n, n)."""
    upper = scipy.sparse.triu(_present(pattern), k=1, format="coo")
    return np.stack([nodes[upper.row], nodes[upper.col]], axis=1)


def _of_all_ranks(
    patches: scipy.sparse.spmatrix, nodes: Longs, vertices: SlaveVertices
) -> tuple[scipy.sparse.csr_matrix, Longs]:
    """Nodes around each vertex (v, n), of shared vertices those of all ranks; collective."""
    if vertices.comm.size == 1:
        return _present(patches), nodes
    mine = _present(patches).tocoo()
    shared = vertices.shared[mine.row]
    gathered = vertices.comm.allgather((mine.row[shared], nodes[mine.col[shared]]))
    here = np.zeros(vertices.count, dtype=bool)
    here[mine.row] = True
    vertex = np.concatenate([mine.row, *(row for row, _ in gathered)])
    node = np.concatenate([nodes[mine.col], *(column for _, column in gathered)])
    vertex, node = vertex[here[vertex]], node[here[vertex]]
    distinct, number = np.unique(node, return_inverse=True)
    return _table(vertex, number.reshape(-1), (vertices.count, len(distinct))), distinct


def _incidence(table: Longs, count: int) -> scipy.sparse.csr_matrix:
    """Facets (f, a) against nodes."""
    indptr = np.arange(0, table.size + 1, table.shape[1])
    ones = np.ones(table.size, dtype=np.int32)
    return _present(scipy.sparse.csr_matrix((ones, table.reshape(-1), indptr), (len(table), count)))
