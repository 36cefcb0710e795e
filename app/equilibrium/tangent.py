"""The tangent's matrix: its pattern, and what solids, contacts and platens put in.

The pattern has room for the contacts' windows (:mod:`tribox.app.equilibrium.contact_sparsity`) and
is widened when a contact leaves its window.
"""

from __future__ import annotations

from collections.abc import Sequence

import dolfinx
import dolfinx.fem.petsc
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.constraints import Constraints, Platen
from tribox.app.equilibrium.contact_sparsity import (
    BlockPlaces,
    ContactWindow,
    coupled_nodes,
    widened,
    without,
)
from tribox.app.equilibrium.holding_springs import HoldingSprings
from tribox.app.equilibrium.kept_tangent import KeptTangent
from tribox.app.equilibrium.matrix_values import is_direct, pattern_in_place, values_in_place
from tribox.app.equilibrium.slanted import room_of
from tribox.app.equilibrium.timers import Stopwatch
from tribox.forms.bodies.loads import Load
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.compiled_tangent import Entries
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.forms.contact.tangent import Coupling
from tribox.geometry.compat import add_matrix
from tribox.geometry.surfaces.facets import Floats, Ints, Longs


def pattern_form(space: dolfinx.fem.FunctionSpace) -> dolfinx.fem.Form:
    """A form over all cells, for the tangent's pattern: those of the solids each see one body."""
    trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
    return dolfinx.fem.form(ufl.inner(trial, test) * ufl.dx(metadata={"quadrature_degree": 1}))


class Tangent:
    """Makes the matrix and fills it.

    Attributes:
        constraints: with the numbering of the unknowns; bodies, contacts, loads: the parts.
        pattern_changes: how often the pattern was widened, when it was made included.
        windows: of each contact, what the pattern has room for; None before it is made.
        seen: which of the aligned platens have acted together, of all there is room for.
        keeper: of the tangents of stiff bodies.

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
        """Begin without a matrix."""
        self.constraints = constraints
        self.bodies, self.contacts, self.loads = bodies, contacts, loads
        self.keeper = KeptTangent(bodies, contacts)
        self.pattern_changes = 0
        self._known_places: list[BlockPlaces] = []  # of blocks added lately
        self.windows: list[ContactWindow | None] = [None] * len(contacts)
        self._raw: PETSc.Mat | None = None
        self._mapped: tuple[bool, ...] = ()  # platens whose unknowns are sent to their leaders
        self.seen: list[tuple[bool, ...]] = []
        self._rooms: dict[tuple[bool, ...], list[Longs]] = {}  # pairs of nodes, see `make_room`
        self._fitted: int | None = None  # pattern that a tangent with slanted platens has room for

    def new_matrix(self, trials: Sequence[ContactTrial]) -> PETSc.Mat:
        """A matrix with room for solids, platens and these contacts; collective."""
        self.windows = [None] * len(self.contacts)
        self._raw, self.seen, self._rooms = None, [], {}
        if self.constraints.aligned:
            self.seen = [tuple(platen.acts for platen in self.constraints.aligned)]
        A = dolfinx.fem.petsc.assemble_matrix(pattern_form(self.constraints.unknowns.space))
        A.assemble()
        self._plain_map = A.getLGMap()
        self._widen(A, trials)
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

        Args:
            A: the matrix.
            trials: contacts at these displacements.
            timer: seconds by part.
            holding: springs that hold bodies and tools.
            carried: whether the volumetric parts take the pressures carried to them last.
        """
        raw = A if self._raw is None else self._raw
        with timer("contact"):
            self._keep_pattern(raw, trials, timer)
            self._renumber(raw)
        with timer("assembly"):
            self.keeper.decide()
            self.keeper.begin(raw, (self.pattern_changes, self._mapped), self._add_solids)
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
        if acting and acting not in self.seen:
            self.seen.append(acting)
            self.make_room(A)
        if self._mapped != acting:
            maps = self.constraints.condensed_map() if any(acting) else None
            A.setLGMap(*(self._plain_map if maps is None else (maps, maps)))
            self._mapped = acting

    @property
    def kept(self) -> tuple[bool, ...]:
        """Of each solid, whether the last tangent is that of its undeformed state."""
        return self.keeper.on

    def _assemble_forms(self, A: PETSc.Mat, carried: bool) -> None:
        """Add all but what is kept."""
        solids = self.keeper.others
        self._add_solids(A, solids, carried)
        for load in self.loads:
            if load.tangent is not None and load.acts:
                add_matrix(A, load.tangent, unrolled=bool(self.constraints.aligned))

    def _add_solids(self, A: PETSc.Mat, solids: Sequence[Solid], carried: bool = False) -> None:
        """Add the tangents of solids at the displacement at hand."""
        pattern, unrolled = (self.pattern_changes, self._mapped), bool(self.constraints.aligned)
        for solid in solids:
            index = self.bodies.solids.index(solid)
            self.bodies.add_tangent(A, index, pattern, carried, unrolled)

    def _add_contact(self, A: PETSc.Mat, term: ContactTerm, trial: ContactTrial) -> None:
        """Add the tangent of one pair, in place where that can be; collective."""
        if is_direct(A) and np.dtype(PETSc.IntType) == np.int32:
            with pattern_in_place(A) as (indptr, indices), values_in_place(A) as values:
                entries = Entries(indptr, indices, values, self._first_of)
                blocks, couplings = term.add_tangent(trial, entries)
        else:
            blocks, couplings = term.add_tangent(trial, None)
        for nodes, added in blocks:
            self._add_blocks(A, nodes, added)
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

    def _add_blocks(
        self,
        A: PETSc.Mat,
        nodes: Longs,
        blocks: Floats | None,
        platens: Sequence[Platen] | None = None,
    ) -> None:
        """Add point blocks (q, m, i, n, j) (None: zeros, for the pattern) to global rows.

        Those of platens (None: that act at present) go to the rows of the leaders.
        """
        places = self._places(nodes)
        A.setValuesIJV(
            places.indptr.astype(PETSc.IntType),
            self.constraints.condensed(places.columns, platens).astype(PETSc.IntType),
            places.add_up(blocks),
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=self.constraints.condensed(places.rows, platens).astype(PETSc.IntType),
        )

    def _add_coupling(self, A: PETSc.Mat, coupling: Coupling) -> None:
        """Add a sparse part of the tangent to global rows."""
        of_nodes, matrix = self.constraints.unknowns.of_nodes, coupling.matrix
        columns = of_nodes(coupling.columns).reshape(-1)[matrix.indices]
        A.setValuesIJV(
            matrix.indptr.astype(PETSc.IntType),
            self.constraints.condensed(columns).astype(PETSc.IntType),
            matrix.data,
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=self.constraints.condensed(of_nodes(coupling.rows).reshape(-1)).astype(
                PETSc.IntType
            ),
        )

    def _places(self, nodes: Longs) -> BlockPlaces:
        """Places of blocks in the matrix: those of an earlier call while nodes stay the same."""
        for places in self._known_places:
            if np.array_equal(places.nodes, nodes):
                return places
        places = BlockPlaces(nodes, self.constraints.unknowns.dim)
        self._known_places = [places, *self._known_places[: 2 * len(self.contacts) - 1]]
        return places

    # -- pattern ------------------------------------------------------------------------------

    def _keep_pattern(self, A: PETSc.Mat, trials: Sequence[ContactTrial], timer: Stopwatch) -> None:
        """Widen the pattern when a contact has left its window; collective."""
        missing = False
        for term, trial, window in zip(self.contacts, trials, self.windows, strict=True):
            missing |= window is None or not window.holds(term, trial)
        if self.constraints.unknowns.comm.allreduce(missing, op=MPI.LOR):
            with timer("pattern"):
                self._widen(A, trials)

    def _widen(self, A: PETSc.Mat, trials: Sequence[ContactTrial]) -> None:
        """Give ``A`` zeros wherever solids, platens and contact windows may add; collective."""
        for index, (term, trial) in enumerate(zip(self.contacts, trials, strict=True)):
            self.windows[index] = widened(self.windows[index], term, trial)
        self.make_room(A)

    def make_room(self, A: PETSc.Mat) -> None:
        """Give ``A`` zeros wherever solids, platens and the windows may add; collective.

        What it has been given before is not looked up again.
        """
        self.pattern_changes += 1
        self.keeper.forget()
        A = A if self._raw is None else self._raw
        extra, pairs = self._empty_like(A), self._coupled_pairs()
        for acting in self.seen or [()]:
            aligned = self.constraints.aligned
            platens = [p for p, acts in zip(aligned, acting, strict=True) if acts]
            room = self._rooms.get(acting)
            if room is None and platens:
                self.constraints.add_pattern(A, extra, platens)
            for index, nodes in enumerate(pairs):
                new = nodes if room is None else without(nodes, room[index])
                if len(new):
                    self._add_blocks(extra, new, None, platens)
            self._rooms[acting] = pairs
        extra.assemble()
        A.axpy(1.0, extra, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        extra.destroy()
        A.setLGMap(*self._plain_map)
        self._mapped, self._fitted = (), None
        A.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)

    def _coupled_pairs(self) -> list[Longs]:
        """Pairs (p, 2) of nodes that the contacts' windows couple; collective."""
        pairs = []
        for term, window in zip(self.contacts, self.windows, strict=True):
            assert window is not None, "windows come first"
            pairs.append(coupled_nodes(term, window))
        return pairs

    def _empty_like(self, A: PETSc.Mat) -> PETSc.Mat:
        """A matrix of the size of ``A`` that takes entries anywhere."""
        unknowns = self.constraints.unknowns
        out = PETSc.Mat().create(comm=unknowns.comm)
        out.setSizes(A.getSizes())
        out.setBlockSize(unknowns.dim)
        out.setType(PETSc.Mat.Type.AIJ)
        out.setUp()
        out.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        return out
