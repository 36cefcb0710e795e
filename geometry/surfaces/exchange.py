"""Values at the nodes of a contact pair, fetched from and returned to whichever rank owns them."""

from __future__ import annotations

import dolfinx
import numpy as np
from petsc4py import PETSc

from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.surface import ContactSurface


class NodalVector:
    """A vector of unknowns that numpy, DOLFINx and PETSc share in memory.

    Attributes:
        array: local unknowns, those of ghosts last; owned: the part that this rank owns.
        vec: the owned part, as a global vector.
    """

    def __init__(
        self, space: dolfinx.fem.FunctionSpace, shared: dolfinx.la.Vector | None = None
    ) -> None:
        """Make a vector of zeros, or wrap an existing one; collective."""
        index, dim = space.dofmap.index_map, space.dofmap.index_map_bs
        self._la = dolfinx.la.vector(index, dim) if shared is None else shared
        self.array: Floats = self._la.array
        self.owned = self.array[: index.size_local * dim]
        comm = space.mesh.comm
        self.vec = PETSc.Vec().createWithArray(
            self.owned, size=(len(self.owned), None), bsize=dim, comm=comm
        )
        self._alone = comm.size == 1

    def update_ghosts(self) -> None:
        """Bring the ghosts up to date; collective."""
        if not self._alone:
            self._la.scatter_forward()

    def collect_ghosts(self) -> None:
        """Add what this rank put on ghosts to the owners' values; collective."""
        if not self._alone:
            self._la.scatter_reverse(dolfinx.la.InsertMode.add)


class SurfaceExchange:
    """Moves nodal values between the bodies and one contact pair.

    The pair's nodes are those of the slave facets of this rank, then all master nodes.

    Attributes:
        nodes: (m,) global nodes; slave_rows: (q, a) rows of the slave points' nodes in them;
            first_master: row of the first master node.
    """

    def __init__(self, surface: ContactSurface) -> None:
        """Find the nodes of ``surface``."""
        self.nodes, self.slave_rows = surface.nodes, surface.slave_rows
        self.first_master = surface.first_master
        self.dim = surface.dim
        self._alone = surface.space.mesh.comm.size == 1
        self._scatter: PETSc.Scatter | None = None
        self._here: PETSc.Vec | None = None

    def gather(self, vector: NodalVector, out: Floats) -> None:
        """Put the values at the nodes into ``out`` (m, i); collective."""
        if self._alone:
            values = vector.owned.reshape(-1, self.dim)
            np.take(values, self.nodes, axis=0, out=out, mode="clip")
            return
        scatter, here = self._set_up(vector)
        scatter.scatter(vector.vec, here, addv=False, mode=PETSc.ScatterMode.FORWARD)
        out[:] = here.array_r.reshape(out.shape)

    def add(self, values: Floats, vector: NodalVector) -> None:
        """Add ``values`` (m, i) at the nodes to ``vector``, those of all ranks; collective."""
        if self._alone:
            vector.owned.reshape(-1, self.dim)[self.nodes] += values
            return
        scatter, here = self._set_up(vector)
        here.array[:] = values.reshape(-1)
        scatter.scatter(here, vector.vec, addv=True, mode=PETSc.ScatterMode.REVERSE)

    def _set_up(self, vector: NodalVector) -> tuple[PETSc.Scatter, PETSc.Vec]:
        if self._scatter is None or self._here is None:
            index = PETSc.IS().createBlock(
                self.dim, self.nodes.astype(PETSc.IntType), comm=PETSc.COMM_SELF
            )
            self._here = PETSc.Vec().createSeq(self.dim * len(self.nodes))
            self._scatter = PETSc.Scatter().create(vector.vec, index, self._here, None)
        return self._scatter, self._here
