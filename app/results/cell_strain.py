"""Deformation at the centre of every cell: volume ratio, stretch and logarithmic strain."""

from __future__ import annotations

from dataclasses import dataclass

import dolfinx
import numpy as np

from forms.bodies.deformation import rows_at
from forms.bodies.kinematics import Section
from geometry.meshes.places import centre
from geometry.surfaces.facets import Floats


@dataclass(frozen=True, slots=True)
class Strain:
    """Measures of the deformation of each cell.

    Attributes:
        J: (c,) volume ratio det F.
        max_stretch: (c,) largest principal stretch.
        log_strain: (c, 3, 3) ln V = ½ ln(F Fᵀ), along the axes of the deformed body.
    """

    J: Floats
    max_stretch: Floats
    log_strain: Floats


class CellStrain:
    """Evaluates the deformation gradient F at the centres of this rank's own cells."""

    def __init__(self, u: dolfinx.fem.Function, section: Section) -> None:
        """Tabulate the shape functions.

        Args:
            u: displacement, m.
            section: what the mesh stands for.
        """
        space, topology = u.function_space, u.function_space.mesh.topology
        owned = np.arange(topology.index_map(topology.dim).size_local, dtype=np.int32)
        self._rows = rows_at(space, section, owned, centre(topology.cell_name()))
        self._nodes = space.dofmap.list[owned]
        self._u, self._dim = u, space.mesh.geometry.dim

    def evaluate(self) -> Strain:
        """The measures at the present displacement."""
        F = self._rows.deformation(self._u.x.array.reshape(-1, self._dim)[self._nodes])
        squares, axes = np.linalg.eigh(F @ F.transpose(0, 2, 1))
        logs = 0.5 * np.log(squares)
        strain = (axes * logs[:, None]) @ axes.transpose(0, 2, 1)
        return Strain(np.linalg.det(F), np.sqrt(squares[:, -1]), strain)
