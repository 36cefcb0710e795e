"""Values of material points at other places of their cells, and as tensors.

Stress and plastic strain are known at the quadrature points alone. Elsewhere in a cell they are
taken from the linear function of the reference coordinates that fits the cell's points best: the
function through them where there are no more of them than it has coefficients, and their mean at
the centre.

Axis letters: k places, c cells, q quadrature points of a cell, p components.
"""

from __future__ import annotations

from typing import Protocol

import basix
import numpy as np

from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.point_state import Floats
from tribox.forms.bodies.point_stress import StressAt
from tribox.geometry.surfaces.facets import Ints


class PointBody(Protocol):
    """A body whose material points remember, as far as values at other places need it."""

    cell: str
    full_degree: int
    cells: Ints

    @property
    def material(self) -> Material:
        """Its moduli."""
        ...

    def point_stress(self) -> Floats:
        """Cauchy stress (c, q, 3, 3), Pa, that the forms take from the points."""
        ...

    def plastic_strain(self) -> Floats:
        """Equivalent plastic strain (c, q) at the points."""
        ...


def as_tensors(rows: Floats) -> Floats:
    """Tensors (k, 3, 3) from components (k, p): 11, 12, 21, 22, 33; in space all, row by row."""
    if rows.shape[1] == 9:
        return rows.reshape(-1, 3, 3)
    out = np.zeros((len(rows), 3, 3))
    out[:, :2, :2] = rows[:, :4].reshape(-1, 2, 2)
    out[:, 2, 2] = rows[:, 4]
    return out


def fit_weights(kind: str, degree: int, xi: Floats) -> Floats:
    """Shares (k, q) of a cell's quadrature points in the values at places of it.

    Args:
        kind: of the cells.
        degree: of the quadrature.
        xi: (k, α) reference coordinates.
    """
    points, _ = basix.make_quadrature(basix.CellType[kind], degree)
    centre = points.mean(axis=0)

    def linear(at: Floats) -> Floats:
        return np.column_stack([np.ones(len(at)), at - centre])

    return np.asarray(linear(xi) @ np.linalg.pinv(linear(points)))


class PointValues:
    """Stress and equivalent plastic strain of a body at places of its cells."""

    def __init__(
        self, solid: PointBody, cells: Ints, xi: Floats | None, beside: StressAt | None = None
    ) -> None:
        """Find the shares of the quadrature points.

        Args:
            solid: the body.
            cells: (k,) as :meth:`tribox.forms.bodies.solid.Solid.stress_at` takes them.
            xi: (k, α), likewise.
            beside: what gives the stress that the points' own is added to.
        """
        self._solid, self._beside = solid, beside
        self._rows = np.searchsorted(solid.cells, cells)
        self._share: Floats | None = None
        if xi is not None:
            share = fit_weights(solid.cell, solid.full_degree, xi)
            self._share = np.broadcast_to(share, (len(cells), share.shape[1]))

    def cauchy(self, F: Floats, volumetric: Floats | None = None) -> Floats:
        """Cauchy stress (k, 3, 3), Pa.

        Args:
            F: (k, 3, 3), of what is beside the points: they have their own.
            volumetric: (k, 3, 3) those that the volumetric energy is taken at, with selective
                reduced integration.
        """
        found = self._at_places(self._solid.point_stress())
        if self._beside is not None:
            return found + self._beside.cauchy(F, volumetric)
        if volumetric is not None:
            found = found + _volumetric_stress(self._solid.material, volumetric)
        return found

    def plastic_strain(self) -> Floats:
        """Equivalent plastic strain (k,), not negative."""
        return np.maximum(self._at_places(self._solid.plastic_strain()), 0.0)

    def _at_places(self, values: Floats) -> Floats:
        """Values (k, …) from those (c, q, …) of the points."""
        if self._share is None:
            return np.ascontiguousarray(values.swapaxes(0, 1)).reshape(-1, *values.shape[2:])
        return np.asarray(np.einsum("kq,kq...->k...", self._share, values[self._rows]))


def _volumetric_stress(material: Material, F: Floats) -> Floats:
    """Stress K ln J/J I (k, 3, 3), Pa, of the volumetric energy K/2 (ln J)²."""
    J = np.linalg.det(F)
    return np.asarray((material.bulk_modulus * np.log(J) / J)[:, None, None] * np.eye(3))
