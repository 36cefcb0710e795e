r"""Platens, and planes of symmetry, along no axis.

The displacement of each of their nodes along the unit vector n is one unknown U: n·u = U. At a node
the component j in which n is largest among those that are not prescribed is eliminated,

    u_j = (U − Σ_{k≠j} n_k u_k)/n_j,

which is exact and leaves the other components as they are. With the out-of-balance forces f the
virtual work then gives, of each node and of all together,

    f_k − (n_k/n_j) f_j = 0 (k ≠ j),      Σ f_j/n_j = F,

F the platen's force along n. These are rows, combinations of the rows of f, that take the place of
the rows of the unknowns k, and of that of the leading node's u_j; in the rows of all other u_j
stands n·u = n·u_leader. Where the platen's displacement is given, they all say n·u = U. In the
matrix it is a product from the left, L K + C, so that Newton's method stays quadratic and the
unknowns stay what they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from app.equilibrium.prescribed import Platen
from app.equilibrium.unknowns import Unknowns
from geometry.surfaces.facets import Floats, Ints, Longs

_Entries = list[tuple[Longs, Longs, Floats]]
"""Rows, columns and values, in global numbers."""


@dataclass(slots=True)
class SlantedPlaten(Platen):
    """A platen along no axis, or a plane of symmetry: one whose displacement is 0.

    Attributes:
        dofs: local scalar unknowns of the surface, owned by this rank: all components of a node.
        force, end, displacement: along ``normal``.
        normal: (i,) the unit vector n.
    """

    normal: Floats = field(default_factory=lambda: np.empty(0))

    @classmethod
    def on(
        cls, space: dolfinx.fem.FunctionSpace, facets: Ints, normal: Floats, mass: float = 0.0
    ) -> SlantedPlaten:
        """One on local facets; carries ``mass``, kg."""
        mesh, dim = space.mesh, space.dofmap.index_map_bs
        fdim = mesh.topology.dim - 1
        mesh.topology.create_connectivity(fdim, fdim + 1)
        nodes = np.sort(dolfinx.fem.locate_dofs_topological(space, fdim, np.sort(facets)))
        nodes = nodes[nodes < space.dofmap.index_map.size_local]
        dofs = (nodes[:, None] * dim + np.arange(dim)).reshape(-1).astype(np.int32)
        return cls(dofs, mass=mass, normal=np.asarray(normal, dtype=np.float64))

    def along(self, values: Floats) -> Floats:
        """Components (m,) along n of nodal values (n,), at the platen's nodes."""
        vectors = values[self.dofs].reshape(-1, len(self.normal))
        out: Floats = np.asarray(vectors @ self.normal, dtype=np.float64)
        return out

    def total(self, values: Floats) -> float:
        """This rank's sum of nodal values (n,), such as forces, along n."""
        return float(self.along(values).sum())


@dataclass(slots=True)
class _Eliminated:
    """What is eliminated of one platen.

    Attributes:
        platen: the platen; pivot: (m,) components j; leader: global number of the leading u_j.
    """

    platen: SlantedPlaten
    pivot: Longs
    leader: int

    @property
    def unknowns(self) -> Longs:
        """Local numbers (m,) of the unknowns u_j."""
        dim = len(self.platen.normal)
        return self.platen.dofs[::dim].astype(np.int64) + self.pivot

    @property
    def scale(self) -> Floats:
        """1/n_j (m,)."""
        out: Floats = np.asarray(1.0 / self.platen.normal[self.pivot], dtype=np.float64)
        return out


class SlantedRows:
    """The equations of slanted platens in residual and matrix, for one set of supports."""

    def __init__(self, unknowns: Unknowns, platens: Sequence[SlantedPlaten], held: Ints) -> None:
        """Choose what is eliminated; collective.

        Args:
            unknowns: numbering.
            platens: those that act.
            held: owned local unknowns with a prescribed displacement.

        Raises:
            ValueError: at a node all that a platen could move is prescribed.
        """
        self._unknowns = unknowns
        self._parts = [self._eliminate(platen, held) for platen in platens]
        self._matrices: tuple[PETSc.Mat, PETSc.Mat] | None = None

    def _eliminate(self, platen: SlantedPlaten, held: Ints) -> _Eliminated:
        dim = len(platen.normal)
        free = ~np.isin(platen.dofs, held).reshape(-1, dim)
        weight = np.abs(platen.normal) * free
        pivot = np.argmax(weight, axis=1) if len(weight) else np.empty(0, dtype=np.int64)
        stuck = bool((weight.max(axis=1, initial=0.0) == 0.0).any())
        comm = self._unknowns.comm
        if comm.allreduce(stuck, op=MPI.LOR):
            raise ValueError("all components of a node of an oblique platen are prescribed")
        own = platen.dofs[::dim].astype(np.int64) + pivot + self._unknowns.first
        first = int(own[0]) if len(own) else np.iinfo(np.int64).max
        return _Eliminated(platen, pivot, comm.allreduce(first, op=MPI.MIN))

    # -- vectors ------------------------------------------------------------------------------

    def put(self, values: Floats) -> None:
        """Put prescribed displacements of platens into the owned unknowns (n,), m."""
        for part in self._parts:
            if part.platen.displacement is not None:
                missed = part.platen.displacement - part.platen.along(values)
                values[part.unknowns] += missed * part.scale

    def constrain_residual(self, values: Floats, at: Floats) -> None:
        """Replace the rows of the platens' nodes; collective.

        Args:
            values: (n,), N, out-of-balance forces of the owned unknowns; changed.
            at: (n,), m, the unknowns.
        """
        for part in self._parts:
            platen, row = part.platen, part.unknowns
            force = values[row] * part.scale
            values[platen.dofs] -= np.outer(force, platen.normal).reshape(-1)
            place = platen.along(at)
            if platen.displacement is not None:
                values[row] = place - platen.displacement
                continue
            comm, first = self._unknowns.comm, self._unknowns.first
            leads = row + first == part.leader
            local = np.array([force.sum(), place[leads].sum()])
            total, lead = comm.allreduce(local, op=MPI.SUM)
            values[row] = np.where(leads, total - platen.pull(float(lead)), place - lead)

    # -- matrix -------------------------------------------------------------------------------

    def constrained(self, raw: PETSc.Mat) -> PETSc.Mat:
        """L K + C of a matrix K, a new one; collective."""
        left, rows = self._matrices = self._matrices or self._made_matrices()
        product = left.matMult(raw)
        product.axpy(1.0, rows, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return product

    def _made_matrices(self) -> tuple[PETSc.Mat, PETSc.Mat]:
        """L and C."""
        eliminated = [part.unknowns for part in self._parts]
        plain = np.ones(self._unknowns.owned, dtype=bool)
        plain[np.concatenate(eliminated)] = False
        kept = np.nonzero(plain)[0] + self._unknowns.first
        left: _Entries = [(kept, kept, np.ones(len(kept)))]
        rows: _Entries = []
        for part in self._parts:
            left += self._combined(part)
            rows += self._following(part)
        return self._matrix(left), self._matrix(rows)

    def _combined(self, part: _Eliminated) -> _Entries:
        """Entries of L: −n_k/n_j in the rows k, and 1/n_j in that of the leader."""
        normal, dim = part.platen.normal, len(part.platen.normal)
        column = np.repeat(part.unknowns + self._unknowns.first, dim)
        row = part.platen.dofs.astype(np.int64) + self._unknowns.first
        others = row != column
        share = -np.outer(part.scale, normal).reshape(-1)
        entries = [(row[others], column[others], share[others])]
        if part.platen.displacement is not None:
            return entries
        mine = (part.unknowns + self._unknowns.first, part.scale)
        found = self._unknowns.comm.allgather(mine)
        if self._owns(part.leader):
            columns, scales = (np.concatenate(list(each)) for each in zip(*found, strict=True))
            entries.append((np.full_like(columns, part.leader), columns, scales))
        return entries

    def _following(self, part: _Eliminated) -> _Entries:
        """Entries of C: n·u − n·u_leader, or n·u; in the leader's row the spring's stiffness."""
        platen, first = part.platen, self._unknowns.first
        normal, dim = platen.normal, len(platen.normal)
        row = np.repeat(part.unknowns + first, dim)
        own = platen.dofs.astype(np.int64) + first
        weight = np.tile(normal, len(part.pivot))
        if platen.displacement is not None:
            return [(row, own, weight)]
        lead = part.leader - part.leader % dim + np.arange(dim)
        follows = row != part.leader
        leaders = np.tile(lead, len(part.pivot))
        entries = [
            (row[follows], own[follows], weight[follows]),
            (row[follows], leaders[follows], -weight[follows]),
        ]
        if self._owns(part.leader):
            entries.append((np.full(dim, part.leader), lead, platen.stiffness * normal))
        return entries

    def _owns(self, unknown: int) -> bool:
        return 0 <= unknown - self._unknowns.first < self._unknowns.owned

    def _matrix(self, entries: _Entries) -> PETSc.Mat:
        """A sparse matrix of (rows, columns, values) of owned rows, in global numbers."""
        unknowns = self._unknowns
        row, column, value = (np.concatenate(list(each)) for each in zip(*entries, strict=True))
        order = np.lexsort((column, row))
        counts = np.bincount(row - unknowns.first, minlength=unknowns.owned)
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType)
        size = ((unknowns.owned, unknowns.size), (unknowns.owned, unknowns.size))
        csr = (starts, column[order].astype(PETSc.IntType), value[order])
        made = PETSc.Mat().createAIJ(size, bsize=unknowns.dim, csr=csr, comm=unknowns.comm)
        made.assemble()
        return made
