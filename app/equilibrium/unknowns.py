"""The unknowns: their numbering and places, and what is prescribed of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.geometry.meshes.blocks import Block
from tribox.geometry.surfaces.facets import Floats, Ints, Longs


@dataclass(slots=True)
class Prescribed:
    """Displacement components held at given values.

    Attributes:
        dofs: local scalar unknowns, owned by this rank.
        value: their displacement, m: one for all, or one for each.
        acts: whether they are held at present; if not, they are free.
    """

    dofs: Ints
    value: float | Floats = 0.0
    acts: bool = True

    @classmethod
    def on(
        cls, u: dolfinx.fem.Function, facets: Ints, component: int, value: float = 0.0
    ) -> Prescribed:
        """One displacement component (0 is x) of all nodes on local facets."""
        return cls(component_dofs(u.function_space, facets, component), value)

    def total(self, values: Floats) -> float:
        """This rank's sum of nodal values (n,), such as forces, at these unknowns."""
        return float(values[self.dofs].sum())

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
        acts: whether there is a platen at present; if not, the surface is free.
        all_dofs: global unknowns of the surface on all ranks, sorted; the first leads.
    """

    dofs: Ints
    force: float = 0.0
    stiffness: float = 0.0
    end: float = 0.0
    mass: float = 0.0
    displacement: float | None = None
    acts: bool = True
    all_dofs: Longs = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    @property
    def loaded(self) -> bool:
        """Whether its force or spring acts at present, and no displacement is given."""
        return self.acts and self.displacement is None

    def pull(self, displacement: float) -> float:
        """Total force on the edge displaced by ``displacement`` (m), N per unit thickness."""
        if not self.acts:
            return 0.0
        return self.force + self.stiffness * (self.end - displacement)

    def total(self, values: Floats) -> float:
        """This rank's sum of nodal values (n,), such as forces, along the platen's direction."""
        return float(values[self.dofs].sum())

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


# -- Forces on single unknowns: point forces, driven tools, reactions that are being given up ----


@dataclass(slots=True)
class NodalLoad:
    """Dead forces on unknowns: a factor, the same on all ranks, times what each unknown has."""

    dofs: Ints  # local scalar unknowns, owned by this rank, each at most once
    # (c,) or one for all, N (in plane strain per unit thickness) for a factor of one, along the
    # coordinate axes
    shares: Floats | float = 1.0
    factor: float = 0.0  # the present factor; set it before assembling
    takes_over: bool = False  # whether they begin as what has balanced the bodies so far

    def add_to(self, forces: Floats) -> None:
        """Add the forces to those of the owned unknowns, ghosts after them or not."""
        forces[self.dofs] += self.factor * self.shares


# -- The numbering of the unknowns ---------------------------------------------------------------


def _fix_rounding() -> None:
    """Have PETSc add up several products one by one, unless the user has said otherwise.

    Together, by BLAS, they are rounded as vectors happen to lie in memory; a run that is resumed
    would not give the same bits.
    """
    options = PETSc.Options()
    for name in ("vec_mdot_use_gemv", "vec_maxpy_use_gemv"):
        if not options.hasName(name):
            options[name] = False
            options.getBool(name)  # or PETSc says at the end that nobody has asked for it


_NONE: Ints = np.empty(0, dtype=np.int32)


class Unknowns:
    """The numbering of the unknowns: displacement components of nodes, rank by rank.

    Attributes:
        space: displacement space, with room for the blocks; comm: of its mesh; dim: unknowns per
            node.
        blocks: the unknowns beside the displacement; beside: (b,) owned local unknowns of their
            nodes, of which padding: (p,) are left over; beside_nodes: the global nodes.
        fields: the blocks with residuals that are no forces.
        owned: number of unknowns on this rank; size: on all ranks.
        first: global number of this rank's first unknown.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace, blocks: Sequence[Block] = ()) -> None:
        """Read the numbering of a space that was made with these blocks."""
        _fix_rounding()
        index_map = space.dofmap.index_map
        self.space, self.comm = space, space.mesh.comm
        self.dim, self.blocks = space.dofmap.index_map_bs, list(blocks)
        self.owned = index_map.size_local * self.dim
        self.first = index_map.local_range[0] * self.dim
        self.size = index_map.size_global * self.dim
        self.fields = [block for block in self.blocks if block.reference is not None]
        self.padding: Ints = np.concatenate([_NONE, *(block.padding for block in self.blocks)])
        beside = [part for block in self.blocks for part in (block.dofs, block.padding)]
        self.beside: Ints = np.concatenate([_NONE, *beside])
        self.beside_nodes: Longs = (self.beside[:: self.dim].astype(np.int64) + self.first) // (
            self.dim
        )

    def new_vector(self) -> PETSc.Vec:
        """A global vector of unknowns, m, holding zeros."""
        vec = PETSc.Vec().createMPI((self.owned, None), bsize=self.dim, comm=self.comm)
        vec.set(0.0)
        return vec

    def node_places(self) -> Floats:
        """Undeformed places (n, i), m, of the owned nodes; collective.

        Those beside the mesh count as its middle.
        """
        box = box_of(self.comm, self.space.mesh.geometry.x[:, : self.dim])
        out: Floats = self.space.tabulate_dof_coordinates()[: self.owned // self.dim, : self.dim]
        out[self.beside // self.dim] = box.mean(axis=0)
        return out

    def of_nodes(self, nodes: Longs) -> NDArray[np.int32]:
        """Global scalar unknowns (…, i) of global nodes (…)."""
        return (nodes[..., None] * self.dim + np.arange(self.dim)).astype(PETSc.IntType)


# -- Places in the undeformed bodies, found and put into words -------------------------------------


def box_of(comm: MPI.Comm, x: Floats) -> Floats:
    """Least and largest coordinates (2, i) of all ranks' places (n, i); collective."""
    # The least as the largest of the negative: one reduction for both.
    ends = np.stack([-x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
    comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
    return ends * [[-1.0], [1.0]]


def place_text(place: Iterable[float]) -> str:
    """Coordinates as they are read: what is round-off beside the others is zero."""
    values = np.array(list(place))
    values[np.abs(values) < 1e-12 * np.max(np.abs(values), initial=0.0)] = 0.0
    return "(" + ", ".join(f"{value:.4g}" for value in values) + ") m"


def place_of_largest(values: Floats, space: dolfinx.fem.FunctionSpace) -> tuple[float, ...]:
    """Where the largest of ``values`` on all ranks is, m, undeformed; collective.

    Args:
        values: (n,) one number for each owned unknown, >= 0.
    """
    dim = space.dofmap.index_map_bs
    mine: tuple[float, tuple[float, ...]] = (-1.0, ())
    if len(values):
        at = int(np.argmax(values))
        where = space.tabulate_dof_coordinates()[at // dim, :dim]
        mine = (float(values[at]), tuple(map(float, where)))
    return max(space.mesh.comm.allgather(mine))[1]
