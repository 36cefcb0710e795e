"""Fields of all bodies as a series of VTU files: deformed places, stress and strain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.app.results.cell_strain import CellStrain
from tribox.app.results.fields import ContactPressureField, StressField
from tribox.app.results.gathered_mesh import GatheredMesh
from tribox.app.results.series import Series
from tribox.app.results.vtu import Cells, pack, with_three_components, write_vtu
from tribox.forms.bodies.point_stress import triaxiality
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Floats, Ints
from tribox.geometry.surfaces.surface import ContactSurface

Singles = NDArray[np.float32]


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
        self._contact = ContactPressureField(u, surfaces) if surfaces else None
        self._mesh = GatheredMesh(space, np.concatenate([solid.cells for solid in solids]))
        body = self._mesh.cellwise(_numbers(solids, space.mesh))
        self.series: Series | None = None
        if self._comm.rank == 0:
            self.series = Series(directory, "fields", times)
            self._cells = Cells.of_one_kind(self._mesh.cells, self._mesh.kind)
            self._body = pack(body, lasting=True)

    def write(self, step: int, time: float, pressures: Sequence[Floats] = ()) -> None:
        """Write the present state.

        Args:
            step: number of the step.
            time: s.
            pressures: Pa, (v,) at the vertices of each slave surface.
        """
        nodes = self._mesh.nodal(self._at_nodes(pressures))
        cells = {name: self._mesh.cellwise(own) for name, own in self._in_cells().items()}
        if self.series is None:
            return
        displacement = with_three_components(nodes[:, : self._dim])
        write_vtu(
            self.series.path(step),
            with_three_components(self._mesh.reference) + displacement,
            self._cells,
            {"displacement": displacement, "contact_pressure": nodes[:, self._dim]},
            {"body": self._body, **cells},
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

    def _in_cells(self) -> dict[str, Floats | Singles]:
        """Stress, Pa, and strain (c,) or (c, 9) in this rank's own cells, by name.

        In single precision, 7 digits, but for what is near 1 and of interest for its difference
        from 1.
        """
        self._stress.update()
        strain = self._strain.evaluate()
        stress, mises, pressure = self._stress.own()
        out: dict[str, Floats | Singles] = {
            "cauchy_stress": _single(stress),
            "von_mises_stress": _single(mises),
            "pressure": _single(pressure),
            "J": strain.J,
            "max_stretch": strain.max_stretch,
            "log_strain": _single(strain.log_strain),
        }
        if self._stress.flows:
            thickness = np.linalg.eigvalsh(strain.log_strain)[:, 0]
            out |= {
                "equivalent_plastic_strain": _single(self._stress.own_plastic_strain()),
                "triaxiality": _single(triaxiality(stress)),
                "thickness_strain": _single(thickness),
            }
        return out


def _single(values: NDArray[np.floating[Any]]) -> Singles:
    """Values (c, …) in single precision, tensors as rows of nine."""
    return values.reshape(len(values), *([9] if values.ndim > 1 else [])).astype(np.float32)


def _numbers(solids: Sequence[Solid], mesh: dolfinx.mesh.Mesh) -> Ints:
    """Number of the body of each of this rank's own cells (c,)."""
    out = np.zeros(mesh.topology.index_map(mesh.topology.dim).size_local, dtype=np.int32)
    for number, solid in enumerate(solids):
        out[solid.cells] = number
    return out
