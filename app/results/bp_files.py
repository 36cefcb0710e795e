"""Fields by ADIOS2: displacement and contact pressure at nodes, stress in the cells.

Each rank writes its own part. ParaView reads the files by its reader "ADIOS2VTX".
"""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.results.fields import ContactPressureField, StressField
from tribox.forms.bodies.solid import Solid
from tribox.geometry.compat import cell_submesh
from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.surface import ContactSurface

SHARE, MARGIN = 4, 1 << 20  # of what is written, with the mesh at first; bytes


class BpWriter:
    """Writes ``fields.bp`` and ``stress.bp``, by ADIOS2; collective."""

    def __init__(
        self,
        u: dolfinx.fem.Function,
        solids: Sequence[Solid],
        directory: Path,
        surfaces: Sequence[ContactSurface] = (),
        times: Mapping[int, float] | None = None,
    ) -> None:
        """Open the files.

        Args:
            u: displacement, m.
            solids: the bodies.
            directory: where the files go.
            surfaces: of the contact pairs.
            times: s, by step, of what is there and kept, of a run that goes on. These files cannot
                be added to: others follow, named after the step.
        """
        ending = "" if times is None else f"_after_{max(times, default=0):06d}"
        self._stress = StressField(u, solids)
        self._contact = ContactPressureField(u, surfaces) if surfaces else None
        nodes = [u, self._contact.pressure] if self._contact else [u]
        comm = u.function_space.mesh.comm
        cells = [self._stress.stress, self._stress.von_mises, self._stress.pressure]
        if self._stress.flows:
            cells.append(self._stress.plastic_strain)
        self._bodies = _BodiesAlone(u.function_space.mesh, solids)
        nodes, cells = map(self._bodies.copies, (nodes, cells))
        self._directory, self._comm = directory, comm
        self._arrays = [function.x.array for function in (*nodes, *cells)]
        # The default engine writes garbage from a rank without cells; BP4 does not.
        self._writers = [
            dolfinx.io.VTXWriter(comm, directory / name, functions, engine="BP4")
            for name, functions in (
                (f"fields{ending}.bp", nodes),
                (f"stress{ending}.bp", cells),
            )
        ]

    def write(self, time: float, pressures: Sequence[Floats] = ()) -> None:
        """Write the present state at ``time`` (s).

        Args:
            time: s.
            pressures: Pa, (v,) at the vertices of each slave surface.

        Raises:
            OSError: the files cannot be written.
        """
        self._stress.update()
        if self._contact is not None:
            self._contact.update(pressures)
        self._bodies.update()
        self._see_room()
        for writer in self._writers:
            with _errors_of_the_system(self._comm.size):
                writer.write(time)

    def _see_room(self) -> None:
        """See that there is room, for a rank that fails in ADIOS2 leaves the others waiting there.

        Raises:
            OSError: there is not, on all ranks.
        """
        local = sum(array.nbytes for array in self._arrays)
        needed = SHARE * self._comm.allreduce(local, op=MPI.SUM) + MARGIN
        try:
            free = shutil.disk_usage(self._directory).free
        except OSError:
            free = -1
        free = self._comm.allreduce(free, op=MPI.MIN)
        if free < needed:
            number = errno.ENOENT if free < 0 else errno.ENOSPC
            raise OSError(number, os.strerror(number))

    def close(self) -> None:
        """Finish the files.

        Raises:
            OSError: as of :meth:`write`.
        """
        for writer in self._writers:
            with _errors_of_the_system(self._comm.size):
                writer.close()


class _BodiesAlone:
    """Functions on the bodies' cells alone, where the mesh has carrier cells beside them."""

    def __init__(self, mesh: dolfinx.mesh.Mesh, solids: Sequence[Solid]) -> None:
        """Make a mesh of the bodies if there is need; collective."""
        self._copies: list[tuple[dolfinx.fem.Function, dolfinx.fem.Function]] = []
        self._mesh: dolfinx.mesh.Mesh | None = None
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        cells = np.unique(np.concatenate([solid.cells for solid in solids])) if solids else None
        count = owned if cells is None else len(cells)
        if mesh.comm.allreduce(count < owned, op=MPI.LOR):
            assert cells is not None
            self._mesh, self._cells = cell_submesh(mesh, cells.astype(np.int32))

    def copies(self, functions: Sequence[dolfinx.fem.Function]) -> list[dolfinx.fem.Function]:
        """Functions that :meth:`update` keeps equal to these; these themselves without need."""
        if self._mesh is None:
            return list(functions)
        out = []
        for function in functions:
            element = function.function_space.ufl_element()
            space = dolfinx.fem.functionspace(self._mesh, element)
            out.append(dolfinx.fem.Function(space, name=function.name))
            self._copies.append((function, out[-1]))
        return out

    def update(self) -> None:
        """Copy the values."""
        for whole, part in self._copies:
            rows, there = (f.function_space.dofmap for f in (whole, part))
            values = whole.x.array.reshape(-1, rows.index_map_bs)
            part.x.array.reshape(-1, rows.index_map_bs)[there.list] = values[rows.list[self._cells]]


@contextmanager
def _errors_of_the_system(ranks: int) -> Iterator[None]:
    """Context that makes an error that ADIOS2 has had in writing what Python would make of it.

    Of several ranks it is left as it is: the others still wait in ADIOS2, so the run must be ended.
    """
    try:
        yield
    except RuntimeError as error:
        if ranks > 1:
            raise
        found = re.search(r"errno = (\d+)", str(error))
        number = int(found[1]) if found else errno.EIO
        raise OSError(number, f"{os.strerror(number)}, ADIOS2") from None
