"""What is prescribed of the displacements: values, and surfaces that move as one.

Prescribed displacements are kept among the unknowns; their rows and columns are replaced by the
identity. A rigid platen couples a surface's displacements in one direction to one unknown with a
given total force: the platen's unknowns are renumbered onto the first of them while the matrix is
assembled, so one factorisation of one matrix serves, and Newton stays quadratic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from geometry.surfaces.facets import Floats, Ints, Longs


@dataclass(slots=True)
class Prescribed:
    """Displacement components held at given values.

    Attributes:
        dofs: local scalar unknowns, owned by this rank.
        value: their displacement, m: one for all, or one for each.
    """

    dofs: Ints
    value: float | Floats = 0.0

    @classmethod
    def on(
        cls, u: dolfinx.fem.Function, facets: Ints, component: int, value: float = 0.0
    ) -> Prescribed:
        """One displacement component (0 is x) of all nodes on local facets."""
        return cls(component_dofs(u.function_space, facets, component), value)

    @classmethod
    def components(cls, u: dolfinx.fem.Function, facets: Ints) -> list[Prescribed]:
        """All displacement components of the nodes on local facets, at zero: one part for each."""
        return [cls.on(u, facets, axis) for axis in range(u.function_space.mesh.geometry.dim)]


@dataclass(slots=True)
class Platen:
    """One displacement for a whole surface, under a given total force or prescribed itself.

    Attributes:
        dofs: local scalar unknowns of the surface, owned by this rank.
        force: N (in plane strain per unit thickness), along the coordinate axis (negative:
            downwards).
        stiffness: N/m, likewise, of a spring that draws the surface; end: m, displacement of its
            far end.
        mass: kg, likewise, that the surface carries beside its own.
        displacement: m, along the coordinate axis; if given, it is prescribed and no force is.
        all_dofs: global unknowns of the surface on all ranks, sorted; the first leads.
    """

    dofs: Ints
    force: float = 0.0
    stiffness: float = 0.0
    end: float = 0.0
    mass: float = 0.0
    displacement: float | None = None
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


def _fix_rounding() -> None:
    """Have PETSc add up several products one by one, unless the user has said otherwise.

    Together, by BLAS, they are rounded as vectors happen to lie in memory; a run that is resumed
    would not give the same bits.
    """
    options = PETSc.Options()
    for name in ("vec_mdot_use_gemv", "vec_maxpy_use_gemv"):
        if not options.hasName(name):
            options[name] = False


class Unknowns:
    """The numbering of the unknowns: displacement components of nodes, rank by rank.

    Attributes:
        space: displacement space; comm: of its mesh; dim: unknowns per node.
        owned: number of unknowns on this rank; size: on all ranks.
        first: global number of this rank's first unknown.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace) -> None:
        """Read the numbering of a space."""
        _fix_rounding()
        index_map = space.dofmap.index_map
        self.space, self.comm = space, space.mesh.comm
        self.dim = space.dofmap.index_map_bs
        self.owned = index_map.size_local * self.dim
        self.first = index_map.local_range[0] * self.dim
        self.size = index_map.size_global * self.dim

    def new_vector(self) -> PETSc.Vec:
        """A global vector of unknowns, m, holding zeros."""
        vec = PETSc.Vec().createMPI((self.owned, None), bsize=self.dim, comm=self.comm)
        vec.set(0.0)
        return vec

    def of_nodes(self, nodes: Longs) -> NDArray[np.int32]:
        """Global scalar unknowns (…, i) of global nodes (…)."""
        out: NDArray[np.int32] = (nodes[..., None] * self.dim + np.arange(self.dim)).astype(
            PETSc.IntType
        )
        return out


class Constraints:
    """Prescribed displacements and platens, in residual and matrix.

    Attributes:
        unknowns: numbering; prescribed, platens: the parts.
    """

    def __init__(
        self, unknowns: Unknowns, prescribed: Sequence[Prescribed], platens: Sequence[Platen]
    ) -> None:
        """Gather the platens' unknowns of all ranks; collective."""
        self.unknowns = unknowns
        self.prescribed, self.platens = list(prescribed), list(platens)
        for platen in self.platens:
            platen.gather(unknowns.space)
        parts = [part.dofs for part in self.prescribed]
        self._supported: Ints = (
            np.unique(np.concatenate(parts)) if parts else np.empty(0, dtype=np.int32)
        )

    @property
    def held(self) -> list[Platen]:
        """The platens whose displacement is prescribed at present."""
        return [platen for platen in self.platens if platen.displacement is not None]

    @property
    def controls(self) -> list[bool]:
        """Of each platen, whether its displacement is prescribed at present."""
        return [platen.displacement is not None for platen in self.platens]

    @property
    def dofs(self) -> Ints:
        """Owned local unknowns with a prescribed displacement, sorted."""
        held = self.held
        if not held:
            return self._supported
        out: Ints = np.unique(np.concatenate([self._supported, *(p.dofs for p in held)]))
        return out

    def values(self, x: PETSc.Vec) -> Floats:
        """Owned unknowns (…,) with the prescribed values put into a copy of ``x``."""
        values: Floats = x.array_r.copy()
        for part in self.prescribed:
            values[part.dofs] = part.value
        for platen in self.held:
            values[platen.dofs] = platen.displacement
        return values

    # -- residual -----------------------------------------------------------------------------

    def constrain_residual(self, values: Floats, at: Floats) -> None:
        """Replace the rows of constrained unknowns; collective.

        Args:
            values: (n,), N, out-of-balance forces of the owned unknowns; changed.
            at: (n,), m, the unknowns.
        """
        for part in self.prescribed:
            values[part.dofs] = at[part.dofs] - part.value
        for platen in self.platens:
            if platen.displacement is None:
                self._balance_platen(platen, values, at)
            else:
                values[platen.dofs] = at[platen.dofs] - platen.displacement

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

    def condensed(self, dofs: NDArray[np.int32]) -> NDArray[np.int64]:
        """Global unknowns with those of each platen replaced by its leading one."""
        out = dofs.astype(np.int64)
        for platen in self.platens:
            out = np.where(np.isin(out, platen.all_dofs), platen.all_dofs[0], out)
        return out

    def condensed_map(self) -> PETSc.LGMap:
        """Local to global numbering with every platen's unknowns sent to its leader."""
        imap = self.unknowns.space.dofmap.index_map
        nodes = imap.local_to_global(np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32))
        dofs = self.condensed(self.unknowns.of_nodes(nodes.astype(np.int64))).reshape(-1)
        return PETSc.LGMap().create(dofs.astype(PETSc.IntType), bsize=1, comm=self.unknowns.comm)

    def constrain_matrix(self, A: PETSc.Mat) -> None:
        """Replace rows and columns of prescribed unknowns by the identity; collective."""
        A.zeroRowsColumns(self.dofs + self.unknowns.first, 1.0)

    def add_following_rows(self, A: PETSc.Mat) -> None:
        """Add rows u_i − u_leader = 0 of the unknowns that follow a platen, and its spring."""
        first, owned = self.unknowns.first, self.unknowns.owned
        for platen in self.platens:
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

    def add_pattern(self, A: PETSc.Mat, extra: PETSc.Mat) -> None:
        """Room in ``extra`` for entries of ``A`` renumbered onto a platen's leading unknown."""
        indptr, columns, _ = A.getValuesCSR()
        rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr)) + self.unknowns.first
        target_row, target_column = self.condensed(rows), self.condensed(columns)
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
        self.add_following_rows(extra)
