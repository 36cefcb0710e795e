"""The tangent's matrix: its pattern, and what solids, contacts and platens put in.

The pattern has room for the windows of the contacts (:class:`ContactWindow`) and is widened when a
contact leaves its window.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.constraints import Constraints
from tribox.app.equilibrium.matrix_values import (
    is_direct,
    pattern_in_place,
    values_in_place,
)
from tribox.app.equilibrium.pattern import Pattern
from tribox.app.equilibrium.slanted import room_of
from tribox.app.equilibrium.step_mode import HoldingSprings
from tribox.app.equilibrium.timers import Stopwatch
from tribox.forms.bodies.loads import Load
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.pair_loops import Entries
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.state import ContactTrial
from tribox.forms.contact.tangent import Coupling
from tribox.geometry.compat import add_matrix
from tribox.geometry.surfaces.facets import Bools, Ints, Longs
from tribox.geometry.surfaces.surface import ContactSurface, RigidMaster


class Tangent:
    """Makes the matrix and fills it.

    Attributes:
        constraints: with the numbering of the unknowns; bodies, contacts, loads: the parts.
        pattern_changes: how often the pattern was widened, when it was made included.
        windows: of each contact, what the pattern has room for; None before it is made.
        platen_sets: which of the aligned platens have acted together, of all there is room for.

    With slanted platens what is assembled is a matrix of its own, which their equations make the
    tangent from.
    """

    def __init__(
        self,
        constraints: Constraints,
        bodies: Bodies,
        contacts: Sequence[ContactTerm],
        loads: Sequence[Load],
    ) -> None:
        self.constraints = constraints
        self.bodies, self.contacts, self.loads = bodies, contacts, loads
        self.pattern_changes = 0
        self.windows: list[ContactWindow | None] = [None] * len(contacts)
        self._raw: PETSc.Mat | None = None
        self._mapped: tuple[bool, ...] = ()  # platens whose unknowns are sent to their leaders
        self.platen_sets: list[tuple[bool, ...]] = []
        self._rooms: dict[tuple[bool, ...], list[Longs]] = {}  # pairs of nodes, see `make_room`
        self._fitted: int | None = None  # pattern that a tangent with slanted platens has room for

    def new_matrix(self, trials: Sequence[ContactTrial]) -> PETSc.Mat:
        """A matrix with room for solids, platens and these contacts; collective."""
        self.windows = [None] * len(self.contacts)
        self._raw, self.platen_sets, self._rooms = None, [], {}
        if self.constraints.aligned:
            self.platen_sets = [tuple(platen.acts for platen in self.constraints.aligned)]
        self._pattern = Pattern(self.constraints.unknowns.space)
        self._pattern.add_cells()
        beside = self.constraints.unknowns.beside_nodes  # no cell gives them a diagonal
        self._pattern.add_nodes(np.stack([beside, beside], axis=1))
        self._choose_windows(trials)
        self._couple()
        A = self._pattern.matrix()
        self._plain_map = A.getLGMap()
        self._is_laid_out(A)
        if not self.constraints.slanted:
            return A
        self._raw = A
        out = A.duplicate(copy=True)
        self._fit(out)
        return out

    def assemble(
        self,
        A: PETSc.Mat,
        trials: Sequence[ContactTrial],
        timer: Stopwatch,
        holding: Sequence[HoldingSprings] = (),
        carried: bool = False,
    ) -> None:
        """Fill ``A`` at the displacements spread last; collective.

        All rows are free but those that follow a platen.
        """
        raw = A if self._raw is None else self._raw
        with timer("contact"):
            self._keep_pattern(raw, trials, timer)
            self._renumber(raw)
        with timer("assembly"):
            raw.zeroEntries()
            self._assemble_forms(raw, carried)
        with timer("contact"):
            for term, trial in zip(self.contacts, trials, strict=True):
                self._add_contact(raw, term, trial)
            self.constraints.add_following_rows(raw)
            for springs in holding:
                self.constraints.add_diagonal(raw, springs.stiffness)
            raw.assemble()
        if self._raw is not None:
            with timer("assembly"):
                self._slant(A)

    def _slant(self, A: PETSc.Mat) -> None:
        """Make the tangent ``A`` from what was assembled, with the slanted platens' equations."""
        assert self._raw is not None
        if self._fitted != self.pattern_changes:
            self._fit(A)
        rows = self.constraints.slanted_rows
        made = self._raw if rows is None else rows.constrained(self._raw)
        A.zeroEntries()
        A.axpy(1.0, made, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        if rows is not None:
            made.destroy()

    def _fit(self, A: PETSc.Mat) -> None:
        """Give ``A`` room for the slanted platens' equations, whichever of them act; collective."""
        assert self._raw is not None
        room = room_of(self.constraints.unknowns, self.constraints.slanted, self._raw)
        A.axpy(1.0, room, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        room.destroy()
        self._fitted = self.pattern_changes

    def _renumber(self, A: PETSc.Mat) -> None:
        """Send the unknowns of the platens that act now to their leaders; collective."""
        acting = tuple(platen.acts for platen in self.constraints.aligned)
        if acting and acting not in self.platen_sets:
            self.platen_sets.append(acting)
            self.make_room(A)
        if self._mapped != acting:
            maps = self.constraints.condensed_map() if any(acting) else None
            A.setLGMap(*(self._plain_map if maps is None else (maps, maps)))
            self._mapped = acting

    def _assemble_forms(self, A: PETSc.Mat, carried: bool) -> None:
        """Add solids and loads at the displacement at hand."""
        pattern, unrolled = (self.pattern_changes, self._mapped), bool(self.constraints.aligned)
        for index in range(len(self.bodies.solids)):
            self.bodies.add_tangent(A, index, pattern, carried)
        for load in self.loads:
            if load.tangent is not None and load.acts:
                add_matrix(A, load.tangent, unrolled=unrolled)

    def _add_contact(self, A: PETSc.Mat, term: ContactTerm, trial: ContactTrial) -> None:
        """Add the tangent of one pair, in place where that can be; collective."""
        if is_direct(A):
            with pattern_in_place(A) as (indptr, indices), values_in_place(A) as values:
                entries = Entries(indptr, indices, values, self._first_of)
                couplings = term.add_tangent(trial, entries)
        else:
            couplings = term.add_tangent(trial, Entries.none())
        for coupling in couplings:
            self._add_coupling(A, coupling)

    def _first_of(self, nodes: Longs) -> Ints:
        """Numbers (n,) of the first unknowns of nodes (n,) among this rank's own.

        −1 of nodes of other ranks, and of those of which an unknown is sent to a platen's leader.
        """
        unknowns = self.constraints.unknowns
        numbers = self.constraints.condensed(unknowns.of_nodes(nodes)) - unknowns.first
        mine = (numbers[:, 0] >= 0) & (numbers[:, -1] < unknowns.owned)
        mine &= np.all(numbers == numbers[:, :1] + np.arange(unknowns.dim), axis=1)
        return np.where(mine, numbers[:, 0], -1).astype(np.int32)

    def _add_coupling(self, A: PETSc.Mat, coupling: Coupling) -> None:
        """Add a sparse part of the tangent to global rows, of platens to those of the leaders."""
        matrix = coupling.matrix
        rows, columns = (
            self.constraints.condensed(self.constraints.unknowns.of_nodes(nodes))
            for nodes in (coupling.rows, coupling.columns)
        )
        A.setValuesIJV(
            matrix.indptr.astype(PETSc.IntType),
            columns.reshape(-1).astype(PETSc.IntType)[matrix.indices],
            matrix.data,
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=rows.reshape(-1).astype(PETSc.IntType),
        )

    # -- pattern ------------------------------------------------------------------------------

    def _keep_pattern(self, A: PETSc.Mat, trials: Sequence[ContactTrial], timer: Stopwatch) -> None:
        """Widen the pattern when a contact has left its window; collective."""
        missing = False
        for term, trial, window in zip(self.contacts, trials, self.windows, strict=True):
            missing |= window is None or not window.fitted(term.surface).holds(term, trial)
        if self.constraints.unknowns.comm.allreduce(missing, op=MPI.LOR):
            with timer("pattern"):
                self._widen(A, trials)

    def _widen(self, A: PETSc.Mat, trials: Sequence[ContactTrial]) -> None:
        """Give ``A`` zeros wherever solids, platens and contact windows may add; collective."""
        self._choose_windows(trials)
        self.make_room(A)

    def _choose_windows(self, trials: Sequence[ContactTrial]) -> None:
        for index, (term, trial) in enumerate(zip(self.contacts, trials, strict=True)):
            self.windows[index] = widened(self.windows[index], term, trial)

    def make_room(self, A: PETSc.Mat) -> None:
        """Give ``A`` zeros wherever solids, platens and the windows may add; collective."""
        A = A if self._raw is None else self._raw
        self._couple()
        A.setLGMap(*self._plain_map)
        self._pattern.lay_out(A)
        self._is_laid_out(A)

    def _is_laid_out(self, A: PETSc.Mat) -> None:
        self.pattern_changes += 1
        self._mapped, self._fitted = (), None
        # From here on an entry without room is an error, not an allocation that nobody sees.
        A.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)

    def _couple(self) -> None:
        """Add to the pattern what platens and the windows may couple; collective.

        What it has been given before is not looked up again.
        """
        pairs = self._coupled_pairs()
        none: Longs = np.empty((0, 2), dtype=np.int64)
        coupled: list[Longs] = [none]
        entries: list[Longs] = [none]
        for acting in self.platen_sets or [()]:
            aligned = self.constraints.aligned
            platens = [p for p, acts in zip(aligned, acting, strict=True) if acts]
            room = self._rooms.get(acting)
            for index, nodes in enumerate(pairs):
                new = nodes if room is None else without(nodes, room[index])
                if platens:
                    moved = self.constraints.moved(new, platens)
                    both = np.concatenate([new[moved], new[moved][:, ::-1]])
                    entries.append(self.constraints.condensed_pairs(both, platens))
                    new = new[~moved]
                coupled.append(new)
            if room is None and platens:
                entries.append(self.constraints.room_of(self._pattern, platens))
            self._rooms[acting] = pairs
        self._pattern.add_nodes(np.concatenate(coupled))
        self._pattern.add_entries(np.concatenate(entries))

    def _coupled_pairs(self) -> list[Longs]:
        """Pairs (p, 2) of nodes that the contacts' windows couple; collective."""
        pairs = []
        for term, window in zip(self.contacts, self.windows, strict=True):
            assert window is not None, "windows come first"
            pairs.append(coupled_nodes(term, window.fitted(term.surface)))
        return pairs


# -- Which entries of the tangent the contact of one pair may fill, now and in the steps to come ---
#
# Axis letters: s slave facets, f master facets, n nodes, q slave points. A slave facet couples with
# the master facets that its points touch, now and at the last step; those two couple with each
# other. Room is made for neighbours too, so that a sliding body does not need a new pattern, with a
# new symbolic factorisation, at every step. The room only grows.

# Rings of neighbouring master facets beyond those in use that a window includes, by the number of
# surface directions: in space every ring costs far more entries.
MARGIN = {1: 3, 2: 1}
NEAR = 2.0  # typical facet sizes up to which an open point counts as about to touch


@dataclass(slots=True)
class ContactWindow:
    """Pairs of facets that the tangent's pattern has room for."""

    touching: scipy.sparse.csr_matrix  # (s, f) sparse, slave facets against master facets
    # (f, f) sparse, master facets that one point touches now and at the last step
    together: scipy.sparse.csr_matrix
    rings: scipy.sparse.csr_matrix  # (f, f) sparse, the neighbours that room is made for

    def fitted(self, surface: ContactSurface) -> ContactWindow:
        """The same over all facets of the master that are known by now."""
        facets = len(_movers(surface))
        if self.rings.shape[0] == self.together.shape[0] == facets:
            return self
        touching, together = self.touching.copy(), self.together.copy()
        touching.resize(touching.shape[0], facets)
        together.resize(facets, facets)
        return ContactWindow(touching, together, _rings_of(surface))

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
    return isinstance(surface.master, RigidMaster)


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
    # The −1 stands behind the last key, where a search for more than that ends.
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
    window = None if window is None else window.fitted(surface)
    rings = _rings_of(surface) if window is None else window.rings
    used = _table(np.tile(slave, 2), np.concatenate([current, before]), (count, facets))
    touching = _present(used @ rings)
    pairs = _table(current, before, (facets, facets))
    # A point may go from any neighbour of where it was to any neighbour of where it is; and every
    # facet couples with its own neighbours, onto which a point moves next.
    pairs = _present(rings @ (pairs + pairs.T) @ rings + rings)
    if window is not None:
        touching = _present(touching + window.touching)
        pairs = _present(pairs + window.together)
    # Master facets that no slave facet may touch couple nothing.
    inside = np.bincount(touching.indices, minlength=facets) > 0
    keep = scipy.sparse.diags(inside.astype(np.int32), dtype=np.int32)
    return ContactWindow(touching, _present(keep @ pairs @ keep), rings)


def _rings_of(surface: ContactSurface) -> scipy.sparse.csr_matrix:
    """The neighbours of each facet that room is made for."""
    neighbours = np.ones((1, 1)) if _is_tool(surface) else surface.target.neighbours
    return _rings(_present(neighbours), MARGIN[surface.shape.directions])


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


def coupled_nodes(term: ContactTerm, window: ContactWindow) -> Longs:
    """Pairs (p, 2) of global nodes that a window couples; each pair once; collective.

    An averaged pressure couples all nodes of the facets around a vertex, and of those that they
    touch; of a vertex at the seam of two ranks those of both.
    """
    pairs = term.coupled_pairs()
    if pairs is not None:
        return pairs
    surface = term.surface
    _, first = np.unique(surface.slave.facet, return_index=True)
    mine = surface.slave.nodes[first]
    others = _movers(surface)
    of_blocks = _beside(term, first)
    mine = np.concatenate([mine, of_blocks], axis=1)
    every: Longs = np.concatenate([mine.reshape(-1), others.reshape(-1)])
    nodes = np.unique(every)
    active = np.diff(window.touching.indptr) > 0
    slaves = _incidence(np.searchsorted(nodes, mine), len(nodes))
    slaves = scipy.sparse.diags(active.astype(np.int32), dtype=np.int32) @ slaves
    masters = _incidence(np.searchsorted(nodes, others), len(nodes))
    touched = slaves + window.touching @ masters
    # Products of incidences: entry (n, m) counts facets that couple the nodes n and m. Slave nodes
    # with those of the facet and of what it touches, both ways, and the master's among themselves.
    pattern = slaves.T @ touched + touched.T @ slaves + masters.T @ (window.together @ masters)
    pairs = _upper(pattern, nodes)
    if of_blocks.size:  # coupled along the surface, touched or not
        linked = _incidence(np.searchsorted(nodes, of_blocks), len(nodes))
        pairs = _distinct(np.concatenate([pairs, _upper(linked.T @ linked, nodes)]))
    if not isinstance(term.rule, AveragedPressure):
        return pairs
    if surface.normals is not None:  # those take the vertices of the next facets too
        chain = surface.nodes[surface.chain_rows[first]]
        nodes, touched = _with(nodes, touched, chain, active)
    # Σ_A L_A R_Aᵀ: each vertex couples all nodes that any facet around it touches, a dense block
    # per vertex.
    around = _incidence(surface.vertices.of_point[first], surface.vertices.count).T
    shared, comm = surface.vertices.shared, surface.vertices.comm
    if isinstance(term, LubricatedTerm):  # a film couples all of its vertices, of all ranks
        around = scipy.sparse.csr_matrix(np.ones((1, around.shape[0]), dtype=np.int32)) @ around
        shared = np.ones(1, dtype=bool)
    patches, nodes = _of_all_ranks(around @ touched, nodes, shared, comm)
    return _distinct(np.concatenate([pairs, _upper(patches.T @ patches, nodes)]))


def _beside(term: ContactTerm, first: Longs) -> Longs:
    """Nodes (f, b) of blocks that belong to the vertices of the facets of points ``first`` (f,)."""
    if term.beside is None:
        return np.empty((len(first), 0), dtype=np.int64)
    nodes: Longs = term.beside[term.surface.vertices.of_point[first]]
    return nodes.reshape(len(first), nodes.shape[1] * nodes.shape[2])


def _distinct(pairs: Longs) -> Longs:
    """Distinct pairs (p, 2), in order."""
    width = np.int64(pairs.max(initial=0) + 1)
    keys: Longs = pairs[:, 0] * width + pairs[:, 1]
    keys = np.unique(keys)
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
    row = np.concatenate([known.row, np.repeat(np.nonzero(active)[0], more.shape[1])])
    node = np.concatenate([nodes[known.col], more[active].reshape(-1)])
    return both, _table(row, np.searchsorted(both, node), (len(more), len(both)))


def _upper(pattern: scipy.sparse.spmatrix, nodes: Longs) -> Longs:
    """Pairs (p, 2) of the global ``nodes`` above the diagonal of a symmetric pattern (n, n)."""
    upper = scipy.sparse.triu(_present(pattern), k=1, format="coo")
    return np.stack([nodes[upper.row], nodes[upper.col]], axis=1)


def _of_all_ranks(
    patches: scipy.sparse.spmatrix, nodes: Longs, shared: Bools, comm: MPI.Comm
) -> tuple[scipy.sparse.csr_matrix, Longs]:
    """Nodes around each vertex (v, n), of shared vertices those of all ranks; collective."""
    if comm.size == 1:
        return _present(patches), nodes
    mine = _present(patches).tocoo()
    offered = shared[mine.row]
    gathered = comm.allgather((mine.row[offered], nodes[mine.col[offered]]))
    # Of what others say, only that of vertices which lie here too.
    here = np.zeros(len(shared), dtype=bool)
    here[mine.row] = True
    vertex = np.concatenate([mine.row, *(row for row, _ in gathered)])
    node = np.concatenate([nodes[mine.col], *(column for _, column in gathered)])
    vertex, node = vertex[here[vertex]], node[here[vertex]]
    distinct, number = np.unique(node, return_inverse=True)
    return _table(vertex, number.reshape(-1), (len(shared), len(distinct))), distinct


def _incidence(table: Longs, count: int) -> scipy.sparse.csr_matrix:
    """Facets (f, a) against nodes."""
    indptr = np.arange(0, table.size + 1, table.shape[1])
    ones = np.ones(table.size, dtype=np.int32)
    return _present(scipy.sparse.csr_matrix((ones, table.reshape(-1), indptr), (len(table), count)))
