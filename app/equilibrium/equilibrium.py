"""The discrete equilibrium of all bodies, contacts and loads: residual, tangent and their pattern.

Prescribed displacements are held by the unknowns themselves (their rows and columns are replaced by
the identity). A rigid platen couples a surface's displacements in one direction to one unknown
with a given total force: the platen's unknowns are renumbered onto the first of them while the
matrix is assembled, so one factorisation of one matrix serves, and Newton stays quadratic.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import dolfinx
import dolfinx.fem.petsc
import numpy as np
import ufl
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from app.equilibrium.contact_sparsity import BlockPlaces, ContactWindow, coupled_nodes, widened
from app.equilibrium.timers import Stopwatch
from forms.bodies.loads import FollowerPressure
from forms.bodies.solid import Solid
from forms.contact.penalty import ContactTerm, ContactTrial
from geometry.compat import add_matrix
from geometry.surfaces.facets import Floats, Longs

Ints = NDArray[np.int32]


@dataclass(slots=True)
class Prescribed:
    """Displacement components held at given values.

    Attributes:
        dofs: local scalar unknowns, owned by this rank.
        value: their displacement today, m: one for all, or one for each.
    """

    dofs: Ints
    value: float | Floats = 0.0


@dataclass(slots=True)
class Platen:
    """One displacement for a whole surface, under a given total force.

    Attributes:
        dofs: local scalar unknowns of the surface, owned by this rank.
        force: N (in plane strain per unit thickness), along the coordinate axis (negative:
            downwards).
        stiffness: N/m, likewise, of a spring that draws the surface; end: m, displacement of its
            far end.
        mass: kg, likewise, that the surface carries beside its own.
        all_dofs: global unknowns of the surface on all ranks, sorted; the first leads.
    """

    dofs: Ints
    force: float = 0.0
    stiffness: float = 0.0
    end: float = 0.0
    mass: float = 0.0
    all_dofs: Longs = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def pull(self, displacement: float) -> float:
        """Total force on the edge displaced by ``displacement`` (m), N per unit thickness."""
        return self.force + self.stiffness * (self.end - displacement)

    def gather(self, space: dolfinx.fem.FunctionSpace) -> None:
        """Collect the surface's unknowns of all ranks; collective."""
        first = space.dofmap.index_map.local_range[0] * space.dofmap.index_map_bs
        mine = self.dofs.astype(np.int64) + first
        self.all_dofs = np.unique(np.concatenate(space.mesh.comm.allgather(mine)))


def component_dofs(space: dolfinx.fem.FunctionSpace, facets: Ints, component: int) -> Ints:
    """Owned local scalar unknowns of one displacement component on local facets."""
    mesh = space.mesh
    fdim = mesh.topology.dim - 1
    mesh.topology.create_connectivity(fdim, fdim + 1)
    dofs = dolfinx.fem.locate_dofs_topological(space.sub(component), fdim, np.sort(facets))
    owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    return np.asarray(dofs[dofs < owned], dtype=np.int32)


def pattern_form(space: dolfinx.fem.FunctionSpace) -> dolfinx.fem.Form:
    """A form over all cells, for the tangent's pattern: those of the solids each see one body."""
    trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
    return dolfinx.fem.form(ufl.inner(trial, test) * ufl.dx(metadata={"quadrature_degree": 1}))


class Equilibrium:
    """Residual and tangent of the whole problem, as SNES asks for them.

    Attributes:
        u: displacement function; holds the last vector that was evaluated.
        contacts, solids, pressures, prescribed, platens: the parts.
        dt: length of the step being tried, s.
        trials: contacts at the last evaluation; committed: at the last converged step.
        timer: seconds by part.
        size: number of unknowns on all ranks; owned: on this rank.
        roundoff: N/m, residual norm below which only round-off is left.
    """

    def __init__(
        self,
        u: dolfinx.fem.Function,
        solids: Sequence[Solid],
        contacts: Sequence[ContactTerm],
        prescribed: Sequence[Prescribed] = (),
        platens: Sequence[Platen] = (),
        pressures: Sequence[FollowerPressure] = (),
    ) -> None:
        """Put the parts together; collective."""
        self.u = u
        self.space = u.function_space
        self.comm = self.space.mesh.comm
        self.solids, self.contacts = list(solids), list(contacts)
        self.prescribed, self.platens = list(prescribed), list(platens)
        self.pressures = list(pressures)
        self.dim = self.space.dofmap.index_map_bs
        self.owned = self.space.dofmap.index_map.size_local * self.dim
        self.first = self.space.dofmap.index_map.local_range[0] * self.dim
        self.size = self.space.dofmap.index_map.size_global * self.dim
        for platen in self.platens:
            platen.gather(self.space)
        parts = [p.dofs for p in self.prescribed]
        self._constrained = (
            np.unique(np.concatenate(parts)) if parts else np.empty(0, dtype=np.int32)
        )
        self.dt = 1.0
        self.timer = Stopwatch()
        self.trials: list[ContactTrial] = []
        self.committed: list[ContactTrial] = []
        self._strain_energy: float | None = None
        self.unbalanced = np.zeros(self.owned)
        self.reference_force = 0.0
        self._work = dolfinx.la.vector(self.space.dofmap.index_map, self.dim)
        self.pattern_changes = 0
        self._known_places: list[BlockPlaces] = []  # of blocks added lately
        noise = sum(solid.roundoff_force() for solid in self.solids)
        self.roundoff = 4.0 * float(np.sqrt(self.comm.allreduce(noise)))
        self._windows: list[ContactWindow | None] = [None] * len(self.contacts)

    # -- vectors ----------------------------------------------------------------------------

    def new_vector(self) -> PETSc.Vec:
        """A global vector of unknowns, m, holding zeros."""
        vec = PETSc.Vec().createMPI((self.owned, None), bsize=self.dim, comm=self.comm)
        vec.set(0.0)
        return vec

    def spread(self, x: PETSc.Vec) -> None:
        """Copy the unknowns into the displacement function, ghosts included; collective."""
        self._strain_energy = None
        self.u.x.array[: self.owned] = x.array_r
        self.u.x.scatter_forward()

    def strain_energy(self) -> float:
        """Strain energy of all bodies at the displacement spread last, J/m; collective."""
        if self._strain_energy is None:
            local = sum(solid.strain_energy() for solid in self.solids)
            self._strain_energy = float(self.comm.allreduce(local, op=MPI.SUM))
        return self._strain_energy

    def is_evaluated(self, x: PETSc.Vec) -> bool:
        """Whether ``x`` is what was evaluated last, on all ranks; collective."""
        same = np.array_equal(self.u.x.array[: self.owned], x.array_r)
        return bool(self.comm.allreduce(same, op=MPI.LAND))

    def constrained_dofs(self) -> Ints:
        """Owned local unknowns with a prescribed displacement."""
        return self._constrained

    def constrained_values(self, x: PETSc.Vec) -> Floats:
        """Owned unknowns (…,) with today's prescribed values put into a copy of ``x``."""
        values: Floats = x.array_r.copy()
        for part in self.prescribed:
            values[part.dofs] = part.value
        return values

    @contextmanager
    def softened(self, share: float, reach: float = 0.0) -> Iterator[None]:
        """Within a ``with`` block all penalties are this share of what they are.

        Args:
            share: of the penalties.
            reach: gap, in slave facets, up to which they pull as well.
        """
        penalties = [term.penalty for term in self.contacts]
        try:
            for term, penalty in zip(self.contacts, penalties, strict=True):
                term.penalty = share * penalty
                term.reach = reach * term.surface.facet_length
            yield
        finally:
            for term, penalty in zip(self.contacts, penalties, strict=True):
                term.penalty, term.reach = penalty, 0.0

    @contextmanager
    def settled(self) -> Iterator[None]:
        """Within a ``with`` block points stay on their facets of the last evaluation at edges."""
        try:
            for term, trial in zip(self.contacts, self.trials, strict=True):
                term.kept = trial.projection.facet
            yield
        finally:
            for term in self.contacts:
                term.kept = None

    @contextmanager
    def yielding(self) -> Iterator[None]:
        """Within a ``with`` block friction is a load: bodies slide on one another freely."""
        try:
            for term in self.contacts:
                term.yielding = True
            yield
        finally:
            for term in self.contacts:
                term.yielding = False

    def commit(self) -> None:
        """Make the contacts evaluated last the state that the next step starts from."""
        self.committed = list(self.trials)
        for term, trial in zip(self.contacts, self.trials, strict=True):
            term.commit(trial)

    # -- residual -----------------------------------------------------------------------------

    def residual(self, snes: PETSc.SNES | None, x: PETSc.Vec, f: PETSc.Vec) -> None:
        """Out-of-balance forces at ``x`` (N per unit thickness); the SNES function."""
        self.spread(x)
        with self.timer("assembly"):
            f.array[:] = self._assembled([p.residual for s in self.solids for p in s.forms])
            if self.pressures:
                f.array[:] += self._assembled([p.residual for p in self.pressures])
        with self.timer("contact"):
            self.trials = [term.evaluate(x, self.dt) for term in self.contacts]
            contact = self._contact_forces(f)
        self.unbalanced = f.array_r.copy()
        self.reference_force = self._reference(contact)
        values, at = f.array, x.array_r
        for part in self.prescribed:
            values[part.dofs] = at[part.dofs] - part.value
        for platen in self.platens:
            self._balance_platen(platen, values, at)

    def load_forces(self) -> Floats:
        """Owned part of the pressures' forces on the bodies at the last state, N/m; collective."""
        if not self.pressures:
            return np.zeros(self.owned)
        return -self._assembled([p.residual for p in self.pressures])

    def _assembled(self, forms: Sequence[dolfinx.fem.Form]) -> Floats:
        """Sum of linear forms at the owned unknowns; collective."""
        self._work.array[:] = 0.0
        for form in forms:
            dolfinx.fem.assemble_vector(self._work.array, form)
        self._work.scatter_reverse(dolfinx.la.InsertMode.add)
        mine: Floats = self._work.array[: self.owned].copy()
        return mine

    def _contact_forces(self, f: PETSc.Vec) -> float:
        """Add the contact residuals to ``f``; returns their norm over all ranks, squared."""
        squared = 0.0
        for term, trial in zip(self.contacts, self.trials, strict=True):
            nodes, values = term.nodal_forces(trial)
            f.setValues(
                self._expand(nodes).reshape(-1),
                values.reshape(-1),
                addv=PETSc.InsertMode.ADD_VALUES,
            )
            squared += float(np.sum(values**2))
        f.assemble()
        return squared

    def _expand(self, nodes: Longs) -> NDArray[np.int32]:
        """Global scalar unknowns (…, i) of global nodes (…)."""
        out: NDArray[np.int32] = (nodes[..., None] * self.dim + np.arange(self.dim)).astype(
            PETSc.IntType
        )
        return out

    def _condensed(self, dofs: NDArray[np.int32]) -> NDArray[np.int64]:
        """Global unknowns with those of each platen replaced by its leading one."""
        out = dofs.astype(np.int64)
        for platen in self.platens:
            out = np.where(np.isin(out, platen.all_dofs), platen.all_dofs[0], out)
        return out

    def _reference(self, contact_squared: float) -> float:
        """Force that the convergence test compares with: the larger of contact and reactions."""
        constrained = self.constrained_dofs()
        local = np.array([contact_squared, float(np.sum(self.unbalanced[constrained] ** 2))])
        total = np.empty_like(local)
        self.comm.Allreduce(local, total, op=MPI.SUM)
        return max(float(np.sqrt(total.max())), *(abs(p.force) for p in self.platens), 0.0)

    def _balance_platen(self, platen: Platen, values: Floats, at: Floats) -> None:
        """Row of the leading unknown: sum of forces; of the others: follow the leader."""
        total = self.comm.allreduce(float(values[platen.dofs].sum()), op=MPI.SUM)
        leader = int(platen.all_dofs[0]) - self.first
        owner = 0 <= leader < self.owned
        lead = self.comm.allreduce(float(at[leader]) if owner else 0.0, op=MPI.SUM)
        values[platen.dofs] = at[platen.dofs] - lead
        if owner:
            values[leader] = total - platen.pull(lead)

    def worst_place(self) -> tuple[float, ...]:
        """Where the largest out-of-balance force of the last evaluation is, m; collective."""
        free = np.abs(self.unbalanced)
        free[self.constrained_dofs()] = 0.0
        for platen in self.platens:
            free[platen.dofs] = 0.0
        free = np.where(np.isfinite(free), free, np.inf)
        mine: tuple[float, tuple[float, ...]] = (-1.0, ())
        if self.owned:
            at = int(np.argmax(free))
            where = self.space.tabulate_dof_coordinates()[at // self.dim, : self.dim]
            mine = (float(free[at]), tuple(map(float, where)))
        place: tuple[float, ...] = max(self.comm.allgather(mine))[1]
        return place

    # -- tangent ------------------------------------------------------------------------------

    def jacobian(self, snes: PETSc.SNES | None, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        """Exact tangent at ``x`` into ``A``; the SNES Jacobian. ``P`` is the same matrix."""
        self.assemble_tangent(x, A)
        with self.timer("assembly"):
            A.zeroRowsColumns(self.constrained_dofs() + self.first, 1.0)

    def assemble_tangent(self, x: PETSc.Vec, A: PETSc.Mat) -> None:
        """Tangent at ``x`` with all rows free but those that follow a platen; collective."""
        self.spread(x)
        with self.timer("contact"):
            self.trials = [term.evaluate(x, self.dt) for term in self.contacts]
            self._keep_pattern(A)
            pairs = zip(self.contacts, self.trials, strict=True)
            blocks = [group for term, trial in pairs for group in term.tangent(trial)]
        with self.timer("assembly"):
            A.zeroEntries()
            self._assemble_forms(A)
        with self.timer("contact"):
            for nodes, values in blocks:
                self._add_blocks(A, nodes, values)
            self._follow_platens(A)
            A.assemble()

    def _assemble_forms(self, A: PETSc.Mat) -> None:
        forms = [part.tangent for solid in self.solids for part in solid.forms]
        forms += [p.tangent for p in self.pressures if p.value.value != 0.0]
        for form in forms:
            add_matrix(A, form, unrolled=bool(self.platens))

    def _add_blocks(self, A: PETSc.Mat, nodes: Longs, blocks: Floats | None) -> None:
        """Add point blocks (q, m, i, n, j) (None: zeros, for the pattern) to global rows."""
        places = self._places(nodes)
        A.setValuesIJV(
            places.indptr.astype(PETSc.IntType),
            self._condensed(places.columns).astype(PETSc.IntType),
            places.add_up(blocks),
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=self._condensed(places.rows).astype(PETSc.IntType),
        )

    def _places(self, nodes: Longs) -> BlockPlaces:
        """Places of blocks in the matrix: those of an earlier call while nodes stay the same."""
        for places in self._known_places:
            if np.array_equal(places.nodes, nodes):
                return places
        places = BlockPlaces(nodes, self.dim)
        self._known_places = [places, *self._known_places[: 2 * len(self.contacts) - 1]]
        return places

    def _follow_platens(self, A: PETSc.Mat) -> None:
        """Rows u_i − u_leader = 0 of the unknowns that follow a platen."""
        for platen in self.platens:
            rows = (platen.dofs.astype(np.int64) + self.first).astype(PETSc.IntType)
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
            if platen.stiffness and self.first <= leader < self.first + self.owned:
                A.setValue(leader, leader, platen.stiffness, addv=PETSc.InsertMode.ADD_VALUES)

    # -- pattern ------------------------------------------------------------------------------

    def new_matrix(self, x: PETSc.Vec) -> PETSc.Mat:
        """The tangent's matrix with room for solids, platens and the contact at ``x``."""
        self.trials = [term.evaluate(x, self.dt) for term in self.contacts]
        self._windows = [None] * len(self.contacts)
        A = dolfinx.fem.petsc.assemble_matrix(pattern_form(self.space))
        A.assemble()
        self._widen(A)
        return A

    def _keep_pattern(self, A: PETSc.Mat) -> None:
        """Widen the pattern when a contact has left its window; collective."""
        missing = False
        for term, trial, window in zip(self.contacts, self.trials, self._windows, strict=True):
            missing |= window is None or not window.holds(term, trial)
        if self.comm.allreduce(missing, op=MPI.LOR):
            with self.timer("pattern"):
                self._widen(A)

    def _widen(self, A: PETSc.Mat) -> None:
        """Give ``A`` zeros wherever solids, platens and contact windows may add; collective."""
        self.pattern_changes += 1
        extra = PETSc.Mat().create(comm=self.comm)
        extra.setSizes(A.getSizes())
        extra.setBlockSize(self.dim)
        extra.setType(PETSc.Mat.Type.AIJ)
        extra.setUp()
        extra.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        for index, (term, trial) in enumerate(zip(self.contacts, self.trials, strict=True)):
            window = widened(self._windows[index], term, trial)
            self._windows[index] = window
            nodes = coupled_nodes(term, window)
            if len(nodes):
                self._add_blocks(extra, nodes, None)
        if self.platens:
            self._platen_pattern(A, extra)
        extra.assemble()
        rows, columns = A.getLGMap()
        A.axpy(1.0, extra, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        extra.destroy()
        if self.platens:
            rows = columns = self._condensed_map()
        A.setLGMap(rows, columns)
        A.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)

    def _platen_pattern(self, A: PETSc.Mat, extra: PETSc.Mat) -> None:
        """Room for rows and columns that are renumbered onto a platen's leading unknown."""
        indptr, columns, _ = A.getValuesCSR()
        rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr)) + self.first
        target_row, target_column = self._condensed(rows), self._condensed(columns)
        moved = (target_row != rows) | (target_column != columns)
        pairs = np.unique(np.stack([target_row[moved], target_column[moved]], axis=1), axis=0)
        leaders, start = np.unique(pairs[:, 0], return_index=True)
        extra.setValuesIJV(
            np.append(start, len(pairs)).astype(PETSc.IntType),
            pairs[:, 1].astype(PETSc.IntType),
            np.zeros(len(pairs)),
            addv=PETSc.InsertMode.ADD_VALUES,
            rowmap=leaders.astype(PETSc.IntType),
        )
        self._follow_platens(extra)

    def _condensed_map(self) -> PETSc.LGMap:
        """Local to global numbering with every platen's unknowns sent to its leader."""
        imap = self.space.dofmap.index_map
        nodes = imap.local_to_global(np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32))
        dofs = self._condensed(self._expand(nodes.astype(np.int64))).reshape(-1)
        return PETSc.LGMap().create(dofs.astype(PETSc.IntType), bsize=1, comm=self.comm)
