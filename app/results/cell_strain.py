"""Deformation at the centre of every cell: volume ratio, stretch and logarithmic strain."""

from __future__ import annotations

from dataclasses import dataclass

import basix
import dolfinx
import numpy as np

from forms.bodies.kinematics import Section
from geometry.compat import cell_nodes
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
            u: displacement, m, on straight cells.
            section: what the mesh stands for.
        """
        mesh = u.function_space.mesh
        element = u.function_space.element.basix_element
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        centre = basix.geometry(element.cell_type).mean(axis=0)[None]
        linear = basix.create_element(basix.ElementFamily.P, element.cell_type, 1)
        corners = mesh.geometry.x[cell_nodes(mesh)[:owned], : mesh.geometry.dim]
        at_corners = linear.tabulate(1, centre)[:, 0, :, 0]
        self._nodes = u.function_space.dofmap.list[:owned]
        self._u, self._section = u, section
        self._values, *slopes = element.tabulate(1, centre)[:, 0, :, 0]
        self._slopes = np.array(slopes)
        self._inverse = np.linalg.inv(np.einsum("cai,ka->cik", corners, at_corners[1:]))
        self._radius = corners[:, :, 0] @ at_corners[0]

    def deformation_gradient(self) -> Floats:
        """F (c, 3, 3) at the present displacement, the stretch across a plane included."""
        dim = self._u.function_space.mesh.geometry.dim
        moved = self._u.x.array.reshape(-1, dim)[self._nodes]
        F = np.zeros((len(moved), 3, 3))
        F[:] = np.eye(3)
        F[:, :dim, :dim] += (moved.transpose(0, 2, 1) @ self._slopes.T) @ self._inverse
        if self._section == "axisymmetric":
            F[:, 2, 2] += moved[:, :, 0] @ self._values / self._radius
        return F

    def evaluate(self) -> Strain:
        """The measures at the present displacement."""
        F = self.deformation_gradient()
        squares, axes = np.linalg.eigh(F @ F.transpose(0, 2, 1))
        logs = 0.5 * np.log(squares)
        strain = (axes * logs[:, None]) @ axes.transpose(0, 2, 1)
        return Strain(np.linalg.det(F), np.sqrt(squares[:, -1]), strain)
