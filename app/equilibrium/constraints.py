"""Prescribed displacements and platens in residual and matrix.

Prescribed displacements are kept among the unknowns; their rows and columns are replaced by the
identity. A rigid platen couples a surface's displacements in one direction to one unknown with a
given total force: the platen's unknowns are renumbered onto the first of them while the matrix is
assembled, so one factorisation of one matrix serves, and Newton stays quadratic. Platens along no
axis have equations of their own (:mod:`tribox.app.equilibrium.slanted`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.app.equilibrium.pattern import Pattern
from tribox.app.equilibrium.slanted import SlantedPlaten, SlantedRows
from tribox.app.equilibrium.unknowns import (
    Platen,
    Prescribed,
    Unknowns,
    component_dofs,
    place_of_largest,
)
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs

__all__ = ["Constraints", "Platen", "Prescribed", "Unknowns", "component_dofs"]

Controls = tuple[bool | tuple[bool, bool], ...]


class Constraints:
    """Prescribed displacements and platens, in residual and matrix.

    Attributes:
        unknowns: numbering; prescribed, platens: the parts.
        aligned, slanted: the platens that move along an axis, and the others.
    """

    def __init__(
        self, unknowns: Unknowns, prescribed: Sequence[Prescribed], platens: Sequence[Platen]
    ) -> None:
        """Gather the platens' unknowns of all ranks; collective."""
        self.unknowns = unknowns
        # A block fills whole nodes: components that none of its numbers takes have no equation.
        padding = [Prescribed(block.padding) for block in unknowns.blocks]
        self.prescribed, self.platens = [*prescribed, *padding], list(platens)
        for platen in self.platens:
            platen.gather(unknowns.space)
        self.slanted = [p for p in self.platens if isinstance(p, SlantedPlaten)]
        self.aligned = [p for p in self.platens if not isinstance(p, SlantedPlaten)]
        self._known: tuple[Controls, Ints] = ((), np.empty(0, dtype=np.int32))
        self._leaders: dict[tuple[int, ...], Longs] = {}  # by the platens' identities
        self._rows: tuple[Controls, SlantedRows | None] = ((), None)

    @property
    def parts(self) -> list[Prescribed | Platen]:
        """What is prescribed, and then the platens."""
        return [*self.prescribed, *self.platens]

    @property
    def held(self) -> list[Platen]:
        """The platens along an axis whose displacement is prescribed at present."""
        return [p for p in self.aligned if p.acts and p.displacement is not None]

    @property
    def controls(self) -> Controls:
        """What acts at present: of each part, then of each platen, and if its motion is given."""
        return (
            *(part.acts for part in self.prescribed),
            *((platen.acts, platen.displacement is not None) for platen in self.platens),
        )

    @property
    def dofs(self) -> Ints:
        """Owned local unknowns with a prescribed displacement, sorted."""
        controls = self.controls
        if self._known[0] != controls or not controls:
            parts = [np.empty(0, dtype=np.int32), *(platen.dofs for platen in self.held)]
            parts += [part.dofs for part in self.prescribed if part.acts]
            self._known = controls, np.unique(np.concatenate(parts))
        return self._known[1]

    @property
    def slanted_rows(self) -> SlantedRows | None:
        """The equations of the slanted platens that act at present; None without; collective."""
        if self._rows[0] != self.controls:
            acting = [platen for platen in self.slanted if platen.acts]
            rows = SlantedRows(self.unknowns, acting, self.dofs) if acting else None
            self._rows = self.controls, rows
        return self._rows[1]

    def values(self, x: PETSc.Vec) -> Floats:
        """Owned unknowns (…,) with the prescribed values put into a copy of ``x``."""
        values: Floats = x.array_r.copy()
        for part in self.prescribed:
            if part.acts:
                values[part.dofs] = part.value
        for platen in self.held:
            values[platen.dofs] = platen.displacement
        if self.slanted and (rows := self.slanted_rows):
            rows.put(values)
        return values

    # -- residual -----------------------------------------------------------------------------

    def constrain_residual(self, values: Floats, at: Floats) -> None:
        """Replace the rows of constrained unknowns; collective.

        Args:
            values: (n,), N, out-of-balance forces of the owned unknowns; changed.
            at: (n,), m, the unknowns.
        """
        if self.slanted and (rows := self.slanted_rows):
            rows.constrain_residual(values, at)
        for part in self.prescribed:
            if part.acts:
                values[part.dofs] = at[part.dofs] - part.value
        for platen in self.acting:
            if platen.displacement is None:
                self._balance_platen(platen, values, at)
            else:
                values[platen.dofs] = at[platen.dofs] - platen.displacement

    def constrain_change(self, change: Floats) -> None:
        """The same of a change (n,), N, of out-of-balance forces at the same place; collective."""
        at, none = np.zeros_like(change), np.zeros_like(change)
        self.constrain_residual(none, at)
        self.constrain_residual(change, at)
        change -= none

    def reference_force(self, unbalanced: Floats, loads: Floats, contact_squared: float) -> float:
        """Force that the convergence test compares with: the largest of contact, reactions, loads.

        Collective.

        Args:
            unbalanced: (n,), N, out-of-balance forces of the owned unknowns, reactions included.
            loads: (n,), N, forces of the loads on the owned unknowns.
            contact_squared: norm of this rank's contact forces, squared.
        """
        reactions = float(np.sum(unbalanced[self.dofs] ** 2))
        given = [p for p in self.slanted if p.acts and p.displacement is not None]
        reactions += sum(float(np.sum(platen.along(unbalanced) ** 2)) for platen in given)
        local = np.array([contact_squared, reactions, float(loads @ loads)])
        total = self.unknowns.comm.allreduce(local)
        forces = (abs(p.force) for p in self.platens if p.acts)
        return max(float(np.sqrt(total.max())), *forces, 0.0)

    def worst_place(self, unbalanced: Floats) -> tuple[float, ...]:
        """Where the largest out-of-balance force (n,) of a free node is, m; collective."""
        free = np.abs(unbalanced)
        free[self.dofs] = free[self.unknowns.beside] = 0.0
        for platen in (p for p in self.platens if p.acts):
            free[platen.dofs] = 0.0
        worst = np.where(np.isfinite(free), free, np.inf)
        return place_of_largest(worst, self.unknowns.space)

    @property
    def acting(self) -> list[Platen]:
        """The platens along an axis that there are at present."""
        return [platen for platen in self.aligned if platen.acts]

    def _balance_platen(self, platen: Platen, values: Floats, at: Floats) -> None:
        """Row of the leading unknown: sum of forces; of the others: follow the leader."""
        comm = self.unknowns.comm
        total = comm.allreduce(float(values[platen.dofs].sum()), op=MPI.SUM)
        leader = int(platen.all_dofs[0]) - self.unknowns.first
        owner = 0 <= leader < self.unknowns.owned
        lead = comm.allreduce(float(at[leader]) if owner else 0.0, op=MPI.SUM)
        values[platen.dofs] = at[platen.dofs] - lead
        if owner:
            values[leader] = total - platen.pull(lead)

    # -- matrix -------------------------------------------------------------------------------

    def condensed(
        self, dofs: NDArray[np.int32], platens: Sequence[Platen] | None = None
    ) -> NDArray[np.int64]:
        """Global unknowns with those of each platen replaced by its leading one.

        Args:
            platens: along an axis; None: those that act at present.
        """
        platens = self.acting if platens is None else platens
        return self._leading(platens)[dofs] if platens else dofs.astype(np.int64)

    def _leading(self, platens: Sequence[Platen]) -> Longs:
        """For each global unknown (n,) itself, or the one that leads it."""
        which = tuple(map(id, platens))
        if which not in self._leaders:
            leading = np.arange(self.unknowns.size, dtype=np.int64)
            for platen in platens:
                leading[np.isin(leading, platen.all_dofs)] = platen.all_dofs[0]
            self._leaders[which] = leading
        return self._leaders[which]

    def condensed_map(self) -> PETSc.LGMap:
        """Local to global numbering with every platen's unknowns sent to its leader."""
        imap = self.unknowns.space.dofmap.index_map
        nodes = imap.local_to_global(np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32))
        dofs = self.condensed(self.unknowns.of_nodes(nodes.astype(np.int64))).reshape(-1)
        return PETSc.LGMap().create(dofs.astype(PETSc.IntType), bsize=1, comm=self.unknowns.comm)

    def constrain_matrix(self, A: PETSc.Mat) -> None:
        """Replace rows and columns of prescribed unknowns by the identity; collective."""
        A.zeroRowsColumns(self.dofs + self.unknowns.first, 1.0)

    def add_following_rows(self, A: PETSc.Mat, platens: Sequence[Platen] | None = None) -> None:
        """Add rows u_i − u_leader = 0 of the unknowns that follow a platen, and its spring.

        Args:
            platens: along an axis; None: those that act at present.
        """
        first, owned = self.unknowns.first, self.unknowns.owned
        for platen in self.acting if platens is None else platens:
            rows = (platen.dofs.astype(np.int64) + first).astype(PETSc.IntType)
            rows = rows[rows != platen.all_dofs[0]]
            columns = np.stack([rows, np.full_like(rows, platen.all_dofs[0])], axis=1)
            A.setValuesIJV(
                np.arange(0, 2 * len(rows) + 1, 2, dtype=PETSc.IntType),
                columns.reshape(-1),
                np.tile([1.0, -1.0], len(rows)),
                addv=PETSc.InsertMode.ADD_VALUES,
                rowmap=rows,
            )
            leader = int(platen.all_dofs[0])
            if platen.stiffness and first <= leader < first + owned:
                A.setValue(leader, leader, platen.stiffness, addv=PETSc.InsertMode.ADD_VALUES)

    def add_diagonal(self, A: PETSc.Mat, stiffness: Floats) -> None:
        """Add springs of the owned unknowns (n,), N/m, those of a platen to its leading one."""
        owned = np.nonzero(stiffness)[0]
        rows = self.condensed((owned + self.unknowns.first).astype(np.int32))
        A.setValuesIJV(
            np.arange(len(rows) + 1, dtype=PETSc.IntType),
            rows.astype(PETSc.IntType),
            stiffness[owned],
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=rows.astype(PETSc.IntType),
        )

    def moved(self, pairs: Longs, platens: Sequence[Platen]) -> Bools:
        """Whether pairs (p, 2) of global nodes have an unknown that follows a platen."""
        leading = self._leading(platens)
        follows = (leading != np.arange(len(leading))).reshape(-1, self.unknowns.dim).any(axis=1)
        moved: Bools = follows[pairs].any(axis=1)
        return moved

    def condensed_pairs(self, pairs: Longs, platens: Sequence[Platen]) -> Longs:
        """Row and column (e, 2) of all unknowns of global nodes (p, 2), platens' as their leaders.

        Those of a node that no platen moves stay where they are, and need room as well.
        """
        leading, dim = self._leading(platens), self.unknowns.dim
        each = pairs[:, :, None] * dim + np.arange(dim)
        rows, columns = np.broadcast_arrays(each[:, 0, :, None], each[:, 1, None, :])
        return leading[np.stack([rows, columns], axis=-1).reshape(-1, 2)]

    def room_of(self, pattern: Pattern, platens: Sequence[Platen]) -> Longs:
        """Row and column (e, 2) of entries that go to the leaders of platens, and of followers."""
        blocks = pattern.blocks.tocoo()
        pairs = np.stack([blocks.row + pattern.first, blocks.col], axis=1).astype(np.int64)
        found = [self.condensed_pairs(pairs[self.moved(pairs, platens)], platens)]
        for platen in platens:
            rows = platen.dofs.astype(np.int64) + self.unknowns.first
            found.append(np.stack([rows, np.full_like(rows, platen.all_dofs[0])], axis=1))
        return np.concatenate(found)
