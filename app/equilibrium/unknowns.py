"""The numbering of the unknowns."""

from __future__ import annotations

import dolfinx
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.geometry.surfaces.facets import Longs


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
