"""Deformation at the centre of every cell: volume ratio, stretch and logarithmic strain."""

from __future__ import annotations

from dataclasses import dataclass

import dolfinx
import numpy as np

from tribox.forms.bodies.deformation import Rows, rows_at
from tribox.forms.bodies.kinematics import Section
from tribox.geometry.meshes.places import centre
from tribox.geometry.surfaces.facets import Floats, Ints


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


def strain_of(F: Floats, dim: int) -> Strain:
    """The measures of deformation gradients (c, 3, 3) of a mesh in the plane or in space."""
    return strain_in_plane(F) if dim == 2 else strain_in_space(F)


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
        self._plane = _InPlane(self._rows, self._nodes) if self._dim == 2 else None

    def evaluate(self) -> Strain:
        """The measures at the present displacement."""
        u = self._u.x.array.reshape(-1, self._dim)
        if self._plane is not None:
            return strain_in_plane(self._plane.deformation(u))
        return strain_in_space(self._rows.deformation(u[self._nodes]))


class _InPlane:
    """The deformation gradients of :meth:`Rows.deformation` for all cells of a plane at once.

    Component by component, each in one row of memory: products of matrices as small as 2 × 2 take
    several times as long.
    """

    def __init__(self, rows: Rows, nodes: Ints) -> None:
        self._rows, self._nodes = rows, np.ascontiguousarray(nodes.T)
        self._gradients = np.ascontiguousarray(  # (j, a, c), 1/m, ∂N_a/∂X_j
            np.einsum("cza,czj->jac", rows.slopes, rows.inverse)
        )

    def deformation(self, u: Floats) -> Floats:
        """Deformation gradients (c, 3, 3) of displacements (n, 2), m, of all nodes."""
        moved = [np.ascontiguousarray(u[:, i])[self._nodes] for i in range(2)]
        F = np.zeros((3, 3, self._nodes.shape[1]))
        for i in range(2):
            F[i, :2] = np.einsum("jac,ac->jc", self._gradients, moved[i])
        for i in range(3):
            F[i, i] += 1.0
        rows = self._rows
        if rows.across.any() or rows.on_axis.any():
            radial = np.einsum("ca,ac->c", rows.values, moved[0])
            F[2, 2] += rows.across * radial + rows.on_axis * (F[0, 0] - 1.0)
        return F.transpose(2, 0, 1)


def strain_in_space(F: Floats) -> Strain:
    """The measures of deformation gradients (c, 3, 3)."""
    squares, axes = np.linalg.eigh(F @ F.transpose(0, 2, 1))
    logs = 0.5 * np.log(squares)
    strain = (axes * logs[:, None]) @ axes.transpose(0, 2, 1)
    return Strain(np.linalg.det(F), np.sqrt(squares[:, -1]), strain)


def strain_in_plane(F: Floats) -> Strain:
    """The same where x_3 is a principal direction: F_13 = F_23 = F_31 = F_32 = 0.

    B = F Fᵀ has in the plane the eigenvalues λ² = m ± r, with m = tr B/2 and
    r² = ((B_11 − B_22)/2)² + B_12², and, as (B − m I)² = r² I there,

        ln B = ½ (ln λ_1² + ln λ_2²) I + (ln λ_1² − ln λ_2²)/(2 r) (B − m I).

    The quotient is ln(1 + 2 r/λ_2²)/(2 r), which tends to 1/λ_2²; the smaller eigenvalue is
    (det F)²/λ_1², without cancellation.
    """
    rows = F[:, :2, :2]
    B11, B22 = (rows[:, i, 0] ** 2 + rows[:, i, 1] ** 2 for i in range(2))
    B12 = (rows[:, 0] * rows[:, 1]).sum(axis=1)
    area = rows[:, 0, 0] * rows[:, 1, 1] - rows[:, 0, 1] * rows[:, 1, 0]
    half, r = 0.5 * (B11 - B22), np.hypot(0.5 * (B11 - B22), B12)
    most = 0.5 * (B11 + B22) + r
    least = area**2 / most
    twice = np.maximum(2.0 * r, np.finfo(float).tiny)
    slope = 0.5 * np.log1p(twice / least) / twice
    mean = 0.5 * np.log(np.abs(area))
    out = np.zeros_like(F)
    out[:, 0, 0], out[:, 1, 1] = mean + slope * half, mean - slope * half
    out[:, 0, 1] = out[:, 1, 0] = slope * B12
    out[:, 2, 2] = np.log(np.abs(F[:, 2, 2]))
    stretch = np.maximum(np.sqrt(most), np.abs(F[:, 2, 2]))
    return Strain(area * F[:, 2, 2], stretch, out)
