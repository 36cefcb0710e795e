"""Field output for ParaView: displacement at the nodes, Cauchy stress in the cells."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import dolfinx
import numpy as np

from forms.bodies.solid import Solid
from geometry.compat import interpolation_points


class StressField:
    """Cauchy stress at the centre of every cell.

    Attributes:
        stress: (3, 3) per cell, Pa; von_mises: Pa; pressure: −tr σ/3, Pa.
    """

    def __init__(self, u: dolfinx.fem.Function, solids: Sequence[Solid]) -> None:
        """Compile the stress of each body, or take it from the cache."""
        mesh = u.function_space.mesh
        tensors = dolfinx.fem.functionspace(mesh, ("DG", 0, (3, 3)))
        scalars = dolfinx.fem.functionspace(mesh, ("DG", 0))
        self.stress = dolfinx.fem.Function(tensors, name="cauchy_stress")
        self.von_mises = dolfinx.fem.Function(scalars, name="von_mises_stress")
        self.pressure = dolfinx.fem.Function(scalars, name="pressure")
        points = interpolation_points(tensors)
        self._parts = [
            (dolfinx.fem.Expression(solid.cauchy_stress(), points), solid.cells) for solid in solids
        ]

    def update(self) -> None:
        """Evaluate at the present displacement; collective."""
        for expression, cells in self._parts:
            self.stress.interpolate(expression, cells0=cells)
        self.stress.x.scatter_forward()
        sigma = self.stress.x.array.reshape(-1, 3, 3)
        pressure = -np.einsum("cii->c", sigma) / 3.0
        deviator = sigma + pressure[:, None, None] * np.eye(3)
        self.pressure.x.array[:] = pressure
        self.von_mises.x.array[:] = np.sqrt(1.5 * np.einsum("cij,cij->c", deviator, deviator))


class FieldWriter:
    """Writes ``fields.bp`` and ``stress.bp``, as ParaView reads them; collective."""

    def __init__(self, u: dolfinx.fem.Function, solids: Sequence[Solid], directory: Path) -> None:
        """Open the files.

        Args:
            u: displacement, m.
            solids: the bodies.
            directory: where the files go.
        """
        self._stress = StressField(u, solids)
        comm = u.function_space.mesh.comm
        cells = [self._stress.stress, self._stress.von_mises, self._stress.pressure]
        # The default engine writes garbage from a rank without cells; BP4 does not.
        self._writers = [
            dolfinx.io.VTXWriter(comm, directory / name, functions, engine="BP4")
            for name, functions in (("fields.bp", [u]), ("stress.bp", cells))
        ]

    def write(self, time: float) -> None:
        """Write the present state at ``time`` (s)."""
        self._stress.update()
        for writer in self._writers:
            writer.write(time)

    def close(self) -> None:
        """Finish the files."""
        for writer in self._writers:
            writer.close()
