"""Fields of all bodies as a series of VTU files: deformed places, stress and strain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import dolfinx
import numpy as np

from tribox.app.results.cell_strain import CellStrain
from tribox.app.results.fields import ContactPressureField, StressField
from tribox.app.results.gathered_mesh import GatheredMesh
from tribox.app.results.series import Series
from tribox.app.results.vtu import Cells, pack, with_three_components, write_vtu
from tribox.forms.bodies.point_stress import triaxiality
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.surface import ContactSurface

# Width of each array in the rows that are gathered of the cells; 0: a plain number.
_CELL_ARRAYS = {
    "cauchy_stress": 9,
    "von_mises_stress": 0,
    "pressure": 0,
    "J": 0,
    "max_stretch": 0,
    "log_strain": 9,
}
# Further ones where a body flows.
_OF_FLOW = {"equivalent_plastic_strain": 0, "triaxiality": 0, "thickness_strain": 0}


class FieldSeries:
    """Writes ``fields.pvd`` and ``fields/NNNNNN.vtu`` from the first rank; collective."""

    def __init__(
        self,
        u: dolfinx.fem.Function,
        solids: Sequence[Solid],
        directory: Path,
        surfaces: Sequence[ContactSurface] = (),
        times: Mapping[int, float] | None = None,
    ) -> None:
        """Gather what does not change.

        Args:
            u: displacement, m.
            solids: the bodies; cells carry their numbers.
            directory: where the files go.
            surfaces: of the contact pairs.
            times: s, by step, of the files that are there and kept.
        """
        space = u.function_space
        self._u, self._comm, self._dim = u, space.mesh.comm, space.mesh.geometry.dim
        self._owned = space.dofmap.index_map.size_local
        self._stress = StressField(u, solids)
        self._strain = CellStrain(u, solids[0].section)
        self._arrays = {**_CELL_ARRAYS, **(_OF_FLOW if self._stress.flows else {})}
        self._contact = ContactPressureField(u, surfaces) if surfaces else None
        self._mesh = GatheredMesh(space, np.concatenate([solid.cells for solid in solids]))
        body = self._mesh.cellwise(_numbers(solids, space.mesh)[:, None])
        self.series: Series | None = None
        if self._comm.rank == 0:
            self.series = Series(directory, "fields", times)
            self._cells = Cells.of_one_kind(self._mesh.cells, self._mesh.kind)
            self._body = pack(body[:, 0].astype(np.int32))

    def write(self, step: int, time: float, pressures: Sequence[Floats] = ()) -> None:
        """Write the present state.

        Args:
            step: number of the step.
            time: s.
            pressures: Pa, (v,) at the vertices of each slave surface.
        """
        nodes = self._mesh.nodal(self._at_nodes(pressures))
        cells = self._mesh.cellwise(self._in_cells())
        if self.series is None:
            return
        displacement = with_three_components(nodes[:, : self._dim])
        write_vtu(
            self.series.path(step),
            with_three_components(self._mesh.reference) + displacement,
            self._cells,
            {"displacement": displacement, "contact_pressure": nodes[:, self._dim]},
            {"body": self._body, **_split(cells, self._arrays)},
            time,
            step,
        )
        self.series.add(step, time)

    def _at_nodes(self, pressures: Sequence[Floats]) -> Floats:
        """Displacement, m, and contact pressure, Pa, (n, i + 1) at this rank's own nodes."""
        out = np.zeros((self._owned, self._dim + 1))
        out[:, : self._dim] = self._u.x.array.reshape(-1, self._dim)[: self._owned]
        if self._contact is not None:
            self._contact.update(pressures)
            out[:, self._dim] = self._contact.pressure.x.array[: self._owned]
        return out

    def _in_cells(self) -> Floats:
        """Stress, Pa, and strain (c, k) in this rank's own cells, as the arrays' widths say."""
        self._stress.update()
        strain = self._strain.evaluate()
        own = self._stress.own()
        parts = [*own, strain.J, strain.max_stretch, strain.log_strain]
        if self._stress.flows:
            parts += [self._stress.own_plastic_strain(), triaxiality(own[0])]
            parts.append(np.asarray(np.linalg.eigvalsh(strain.log_strain)[:, 0], dtype=np.float64))
        return np.concatenate([part.reshape(len(strain.J), -1) for part in parts], axis=1)


def _numbers(solids: Sequence[Solid], mesh: dolfinx.mesh.Mesh) -> Floats:
    """Number of the body of each of this rank's own cells (c,)."""
    out = np.zeros(mesh.topology.index_map(mesh.topology.dim).size_local)
    for number, solid in enumerate(solids):
        out[solid.cells] = number
    return out


def _split(rows: Floats, arrays: Mapping[str, int]) -> dict[str, Floats]:
    """The arrays of cells by name, of the widths ``arrays``."""
    out, at = {}, 0
    for name, width in arrays.items():
        out[name] = rows[:, at : at + width] if width else rows[:, at]
        at += width or 1
    return out
