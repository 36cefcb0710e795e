r"""Platens, and planes of symmetry, along no axis.

The displacement of each of their nodes along the unit vector n is one unknown U: n·u = U. At a node
with p of them, the vectors n being the rows of N, as many components J of u that are not prescribed
are eliminated, such that N_J is far from singular,

    u_J = N_J⁻¹ (U − N_K u_K),

which is exact and leaves the other components K as they are. With the out-of-balance forces f the
virtual work then gives, of each node, and of all nodes of a platen together,

    λ = N_J⁻ᵀ f_J,      f_K − N_Kᵀ λ = 0,      Σ λ = F,

F the platen's force along n. These are rows, combinations of the rows of f, that take the place of
the rows of the unknowns K, and of one of J at the platen's leading node; in the rows of J at other
nodes stands n·u = n·u_leader. Where the platen's displacement is given, they all say n·u = U. In
the matrix it is a product from the left, L K + C, so that Newton's method stays quadratic and the
unknowns stay what they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.unknowns import Platen, Unknowns
from tribox.geometry.surfaces.facets import Floats, Ints, Longs

SINGULAR = 1e-6  # part of a unit vector below which nothing is left to eliminate
_Entry = tuple[Longs, Longs, Floats]  # rows, columns and values, in global numbers
_Entries = list[_Entry]


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
        return np.asarray(vectors @ self.normal, dtype=np.float64)

    def total(self, values: Floats) -> float:
        """This rank's sum of nodal values (n,), such as forces, along n."""
        return float(self.along(values).sum())


@dataclass(frozen=True, slots=True)
class NodeGroup:
    """Nodes with the same platens, and the same components prescribed."""

    nodes: Longs  # (m,) local nodes, owned by this rank
    platens: tuple[int, ...]  # numbers (p,) of their platens
    normals: Floats  # N (p, i)
    pivots: Longs  # components J (p,), one for each platen

    @property
    def dofs(self) -> Longs:
        """Local unknowns (m, i) of the nodes."""
        dim = self.normals.shape[1]
        return self.nodes[:, None] * dim + np.arange(dim)

    @property
    def rows(self) -> Longs:
        """Local unknowns u_J (m, p), whose rows hold the platens' equations."""
        return self.nodes[:, None] * self.normals.shape[1] + self.pivots

    @property
    def inverse(self) -> Floats:
        """N_J⁻¹ (p, p)."""
        return np.asarray(np.linalg.inv(self.normals[:, self.pivots]), dtype=np.float64)


def node_groups(platens: Sequence[SlantedPlaten], held: Ints, dim: int) -> list[NodeGroup]:
    """All nodes of platens, those together that are alike.

    Raises:
        ValueError: at a node there is nothing left that a platen could move.
    """
    moved = [platen.dofs[::dim] // dim for platen in platens]
    nodes = np.unique(np.concatenate(moved))
    if not len(nodes):
        return []
    # On which platens a node is, and which of its components are free: nodes with the same answers
    # have the same equations, and all of them are eliminated at once.
    on = np.stack([np.isin(nodes * dim, platen.dofs) for platen in platens], axis=1)
    free = ~np.isin(nodes[:, None] * dim + np.arange(dim), held)
    kinds, kind = np.unique(np.concatenate([on, free], axis=1), axis=0, return_inverse=True)
    groups = []
    for number, row in enumerate(kinds):
        here = tuple(int(at) for at in np.flatnonzero(row[: len(platens)]))
        normals = np.stack([platens[at].normal for at in here])
        pivots = _pivots(normals * row[len(platens) :])
        mine = nodes[np.reshape(kind, -1) == number].astype(np.int64)
        groups.append(NodeGroup(mine, here, normals, pivots))
    return groups


def _pivots(normals: Floats) -> Longs:
    """Components (p,) to eliminate for normals (p, i), which are 0 where they must not be."""
    chosen: list[int] = []
    left = normals.copy()
    for row in range(len(left)):
        # Gaussian elimination with column pivoting: N_J stays regular, and as far from singular as
        # the largest entries left make it.
        component = int(np.argmax(np.abs(left[row])))
        if abs(left[row, component]) < SINGULAR:
            raise ValueError("all that an oblique platen could move at a node is prescribed")
        chosen.append(component)
        share = left[row + 1 :, component] / left[row, component]
        left[row + 1 :] -= np.outer(share, left[row])
        left[row + 1 :, component] = 0.0
    return np.array(chosen, dtype=np.int64)


class SlantedRows:
    """The equations of slanted platens in residual and matrix, for one set of supports."""

    def __init__(self, unknowns: Unknowns, platens: Sequence[SlantedPlaten], held: Ints) -> None:
        """Choose what is eliminated; collective.

        Raises:
            ValueError: see :func:`node_groups`.
        """
        self._unknowns, self._platens = unknowns, list(platens)
        self._groups = node_groups(platens, held, unknowns.dim)
        none = np.iinfo(np.int64).max
        # The first of a platen's rows on all ranks leads, whichever rank it is on.
        leaders = np.full(len(platens), none)
        for group in self._groups:
            first = group.rows.min(axis=0, initial=none - unknowns.first) + unknowns.first
            at = list(group.platens)
            leaders[at] = np.minimum(leaders[at], first)
        unknowns.comm.Allreduce(MPI.IN_PLACE, leaders, op=MPI.MIN)
        self._leaders = [int(leader) for leader in leaders]
        self._matrices: tuple[PETSc.Mat, PETSc.Mat] | None = None

    # -- vectors ------------------------------------------------------------------------------

    def put(self, values: Floats) -> None:
        """Put prescribed displacements of platens into the owned unknowns (n,), m."""
        for group in self._groups:
            missed = np.zeros(group.rows.shape)
            for column, number in enumerate(group.platens):
                platen = self._platens[number]
                if platen.displacement is not None:
                    missed[:, column] = platen.displacement - values[group.dofs] @ platen.normal
            # Into the eliminated components alone: u_J gets N_J⁻¹ times what n·u misses U by.
            values[group.rows] += missed @ group.inverse.T

    def constrain_residual(self, values: Floats, at: Floats) -> None:
        """Replace the rows of the platens' nodes; collective.

        Args:
            values: (n,), N, out-of-balance forces of the owned unknowns; changed.
            at: (n,), m, the unknowns.
        """
        count, first = len(self._platens), self._unknowns.first
        sums = np.zeros((2, count))  # forces, and the leaders' places
        for group in self._groups:
            # λ = N_J⁻ᵀ f_J as rows: λᵀ = f_Jᵀ N_J⁻¹; then f − Nᵀ λ, which is zero in the components
            # J.
            forces = values[group.rows] @ group.inverse
            values[group.dofs] -= forces @ group.normals
            values[group.rows] = at[group.dofs] @ group.normals.T
            for column, number in enumerate(group.platens):
                row = group.rows[:, column]
                leads = row + first == self._leaders[number]
                sums[0, number] += forces[:, column].sum()
                sums[1, number] += values[row[leads]].sum()
        total, lead = self._unknowns.comm.allreduce(sums)
        for group in self._groups:
            for column, number in enumerate(group.platens):
                platen, row = self._platens[number], group.rows[:, column]
                if platen.displacement is not None:
                    values[row] -= platen.displacement
                    continue
                left = total[number] - platen.pull(float(lead[number]))
                leads = row + first == self._leaders[number]
                values[row] = np.where(leads, left, values[row] - lead[number])

    # -- matrix -------------------------------------------------------------------------------

    def constrained(self, raw: PETSc.Mat) -> PETSc.Mat:
        """L K + C of a matrix K, a new one; collective."""
        left, rows = self._matrices = self._matrices or self._made_matrices()
        product = left.matMult(raw)
        product.axpy(1.0, rows, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return product

    def _made_matrices(self) -> tuple[PETSc.Mat, PETSc.Mat]:
        """L and C; collective."""
        plain = np.ones(self._unknowns.owned, dtype=bool)
        for group in self._groups:
            plain[group.rows] = False
        kept = np.nonzero(plain)[0] + self._unknowns.first
        left: _Entries = [(kept, kept, np.ones(len(kept)))]
        rows: _Entries = []
        for group in self._groups:
            left.append(self._combined(group))
        for number in range(len(self._platens)):
            left += self._balance(number)
            rows += self._following(number)
        return _sparse(self._unknowns, left), _sparse(self._unknowns, rows)

    def _combined(self, group: NodeGroup) -> _Entry:
        """Entries of L in the rows K of a group: −N_Kᵀ N_J⁻ᵀ in the columns J."""
        dim, first = self._unknowns.dim, self._unknowns.first
        # What is left of a node's forces across the platens: f_K − N_Kᵀ λ, with λ from the rows J.
        others = np.setdiff1d(np.arange(dim), group.pivots)
        share = -(group.inverse @ group.normals[:, others]).T  # (k, p)
        row = np.repeat(group.dofs[:, others], len(group.pivots), axis=1) + first
        column = np.tile(group.rows, (1, len(others))) + first
        return row.reshape(-1), column.reshape(-1), np.tile(share.reshape(-1), len(group.nodes))

    def _balance(self, number: int) -> _Entries:
        """Entries of L in the row of a platen's leader: N_J⁻ᵀ of all nodes; collective."""
        if self._platens[number].displacement is not None:
            return []
        parts = self._with(number)
        # One row balances the forces of a whole platen, whichever ranks its nodes are on.
        columns = [group.rows.reshape(-1) + self._unknowns.first for group, _ in parts]
        values = [np.tile(group.inverse[:, at], len(group.nodes)) for group, at in parts]
        none = np.empty(0, dtype=np.int64), np.empty(0)
        mine = np.concatenate([*columns, none[0]]), np.concatenate([*values, none[1]])
        found = self._unknowns.comm.allgather(mine)
        leader = self._leaders[number]
        if not self._owns(leader):
            return []
        column, value = (np.concatenate(list(each)) for each in zip(*found, strict=True))
        return [(np.full_like(column, leader), column, value)]

    def _following(self, number: int) -> _Entries:
        """Entries of C: n·u − n·u_leader, or n·u; in the leader's row the spring's stiffness."""
        platen, first, dim = self._platens[number], self._unknowns.first, self._unknowns.dim
        leader, entries = self._leaders[number], list[_Entry]()
        lead = leader - leader % dim + np.arange(dim)
        for group, at in self._with(number):
            row = np.repeat(group.rows[:, at] + first, dim)
            own = group.dofs.reshape(-1) + first
            weight = np.tile(platen.normal, len(group.nodes))
            if platen.displacement is not None:
                entries.append((row, own, weight))
                continue
            # A platen moves as one: all of its nodes but the leader take the leader's n·u.
            follows = row != leader
            leaders = np.tile(lead, len(group.nodes))
            entries.append((row[follows], own[follows], weight[follows]))
            entries.append((row[follows], leaders[follows], -weight[follows]))
        if platen.displacement is None and self._owns(leader):
            entries.append((np.full(dim, leader), lead, platen.stiffness * platen.normal))
        return entries

    def _with(self, number: int) -> list[tuple[NodeGroup, int]]:
        """The groups with a platen, and where it stands among those of the group."""
        return [(g, g.platens.index(number)) for g in self._groups if number in g.platens]

    def _owns(self, unknown: int) -> bool:
        return 0 <= unknown - self._unknowns.first < self._unknowns.owned


def room_of(unknowns: Unknowns, platens: Sequence[SlantedPlaten], raw: PETSc.Mat) -> PETSc.Mat:
    """A matrix of zeros wherever L K + C can have any, whatever acts; collective.

    Args:
        raw: K.
    """
    dim, first = unknowns.dim, unknowns.first
    owned = np.arange(unknowns.owned, dtype=np.int64)
    block = np.repeat(owned // dim * dim, dim).reshape(-1, dim) + np.arange(dim)
    mix: _Entries = [
        (np.repeat(owned, dim) + first, block.reshape(-1) + first, np.ones(block.size))
    ]
    follow: _Entries = []
    for platen in platens:
        lead = int(platen.all_dofs[0]) + np.arange(dim)
        mine = platen.dofs.astype(np.int64) + first
        follow.append((np.repeat(mine, dim), np.tile(lead, len(mine)), np.ones(dim * len(mine))))
        if 0 <= lead[0] - first < unknowns.owned:
            others = platen.all_dofs[dim:]
            row = np.repeat(lead, len(others))
            mix.append((row, np.tile(others, dim), np.ones(len(row))))
    left, extra = _sparse(unknowns, mix), _sparse(unknowns, follow)
    room = left.matMult(raw)
    room.axpy(1.0, extra, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    left.destroy()
    extra.destroy()
    room.zeroEntries()
    return room


def _sparse(unknowns: Unknowns, entries: _Entries) -> PETSc.Mat:
    """A sparse matrix of (rows, columns, values) of owned rows, in global numbers."""
    none = np.empty(0, dtype=np.int64)
    entries = [*entries, (none, none, np.empty(0))]
    row, column, value = (np.concatenate(list(each)) for each in zip(*entries, strict=True))
    # An entry given twice counts once more, in a matrix for room as in any other.
    pairs, at = np.unique(row * unknowns.size + column, return_inverse=True)
    value = np.bincount(np.reshape(at, -1), value, minlength=len(pairs))
    row, column = pairs // unknowns.size, pairs % unknowns.size
    counts = np.bincount(row - unknowns.first, minlength=unknowns.owned)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType)
    size = ((unknowns.owned, unknowns.size), (unknowns.owned, unknowns.size))
    csr = (starts, column.astype(PETSc.IntType), value)
    made = PETSc.Mat().createAIJ(size, bsize=unknowns.dim, csr=csr, comm=unknowns.comm)
    made.assemble()
    return made
