"""Internal forces, strain energy and tangent of bodies in space by the loop of ``space_kernel.c``.

First-order hexahedra and tetrahedra of the materials of :mod:`forms.bodies.materials` whose energy
that loop knows. All numbers are those of the forms that DOLFINx compiles, to round-off.
"""

from __future__ import annotations

import ctypes
from typing import Any

import dolfinx
import numpy as np
from numpy.typing import NDArray

from forms.bodies.materials import Hencky, Material, MooneyRivlin, NeoHookean
from forms.bodies.solid import Solid
from forms.native.libraries import library

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

SOURCE = "space_kernel.c"
LANES = 8  # cells that the compiled loop takes at a time
MATERIALS: dict[type, int] = {NeoHookean: 0, MooneyRivlin: 1, Hencky: 2}


class _Work(ctypes.Structure):
    """What a call works on, see ``struct Work`` of the source."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("c", "edge", "u", "excess")),
        *((name, ctypes.c_int64) for name in ("blocks", "lanes_of_last")),
        *((name, ctypes.c_void_p) for name in ("node", "place")),
        *((name, ctypes.c_void_p) for name in ("forces", "total", "values")),
    ]


class SpaceForce:
    """A body's forces, energy and tangent by the compiled loop, ``LANES`` cells at a time."""

    def __init__(
        self,
        code: ctypes.CDLL,
        nodes: Ints,
        position: Floats,
        material: Material,
        reduced: bool,
    ) -> None:
        """Arrange the cells for the loop.

        Args:
            code: the library of ``SOURCE``.
            nodes: (c, a) nodes of each cell, a = 4 for tetrahedra, 8 for hexahedra in DOLFINx's
                order.
            position: (n, i), m, reference position of the nodes.
            material: its strain energy.
            reduced: whether the volumetric part is taken at the centre.
        """
        count, corners = nodes.shape
        self._kind = 2 if corners == 4 else int(reduced)
        self._material = MATERIALS[type(material)]
        self._parameters = np.array(list(material.parameters().values()))
        self._count, self._blocks = count, -(-count // LANES)
        padded = self._padded(nodes).astype(np.int32)
        self._nodes = _in_lanes(padded)
        self._edges = _in_lanes(coefficients(position[padded]).reshape(len(padded), 21))
        self._total = np.zeros(1)
        self._work = _Work(
            c=self._parameters.ctypes.data,
            edge=self._edges.ctypes.data,
            blocks=self._blocks,
            lanes_of_last=count - (self._blocks - 1) * LANES,
            node=self._nodes.ctypes.data,
            total=self._total.ctypes.data,
        )
        self._calls = [code.tribox_space_forces, code.tribox_space_energy]
        self._calls.append(code.tribox_space_tangent)
        for function in self._calls:
            function.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.POINTER(_Work)]
            function.restype = ctypes.c_int

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """See ``BodyForce.add`` of :mod:`forms.bodies.internal_force`."""
        self._work.forces = out.ctypes.data
        return self._call(0, u)

    def energy(self, u: Floats) -> float:
        """This rank's strain energy at ``u`` (m), J; infinite where a cell is inverted."""
        return float(self._total[0] if self._call(1, u) else np.inf)

    def tangent(
        self, u: Floats, places: Ints, values: Floats, excess: Floats | None = None
    ) -> bool:
        """Add the cells' matrices, N/m, to ``values``; False: a cell is inverted.

        Args:
            u: (n i,), m, displacements.
            places: what :meth:`arranged` made of the places in ``values``.
            values: is added to.
            excess: what is added to dW/dJ, Pa, in the geometric part of the volumetric energy at
                the centre, :meth:`arranged` too; None: nothing.
        """
        self._work.place, self._work.values = places.ctypes.data, values.ctypes.data
        self._work.excess = None if excess is None else excess.ctypes.data
        return self._call(2, u)

    def arranged(self, table: NDArray[Any]) -> NDArray[Any]:
        """Rows (c, …) of the cells as the loop takes them.

        For :meth:`tangent` these are places (c, a, i, b), int32: in the values, the first of the
        entries (b, j) in the row (a, i) of a cell's matrix, which the others follow.
        """
        return _in_lanes(self._padded(table.reshape(self._count, -1)))

    def _call(self, which: int, u: Floats) -> bool:
        self._work.u = u.ctypes.data
        return bool(self._calls[which](self._material, self._kind, ctypes.byref(self._work)) == 0)

    def _padded(self, rows: NDArray[Any]) -> NDArray[Any]:
        """The last cell's row is repeated until the last block is full."""
        return np.concatenate([rows, rows[-1:].repeat(self._blocks * LANES - self._count, axis=0)])


def is_in_space(space: dolfinx.fem.FunctionSpace, solid: Solid) -> bool:
    """Whether the compiled loop covers the body's cells, element and material, and is there."""
    mesh = space.mesh
    corners = {"hexahedron": 8, "tetrahedron": 4}.get(mesh.topology.cell_name())
    straight = mesh.geometry.cmap.degree == 1 and space.dofmap.dof_layout.num_dofs == corners
    return straight and type(solid.material) in MATERIALS and library(SOURCE) is not None


def force_in_space(space: dolfinx.fem.FunctionSpace, solid: Solid) -> SpaceForce:
    """The compiled loop over a body's cells, for a body that :func:`is_in_space`."""
    code = library(SOURCE)
    assert code is not None
    nodes = np.asarray(space.dofmap.list)[solid.cells]
    position = space.tabulate_dof_coordinates()
    return SpaceForce(code, nodes, position, solid.material, reduced=len(solid.forms) == 2)


def coefficients(x: Floats) -> Floats:
    """Coefficients (c, 7, i) of ξ, η, ξη, ζ, ξζ, ηζ, ξηζ in the positions (c, a, i) of the nodes.

    The parent cell is [−1, 1]³; tetrahedra have the edges from their first node in the places of
    ξ, η and ζ.
    """
    if x.shape[1] == 4:
        found = np.zeros((len(x), 7, 3))
        found[:, [0, 1, 3]] = x[:, 1:] - x[:, :1]
        return found
    signs = np.array([[(-1.0) ** ((m & ~a).bit_count()) for a in range(8)] for m in range(1, 8)])
    return np.einsum("ma,cai->cmi", signs / 8.0, x - x[:, :1])


def _in_lanes(table: NDArray[Any]) -> NDArray[Any]:
    """Rows (c, k) of the cells as (blocks, k, LANES)."""
    return np.ascontiguousarray(table.reshape(-1, LANES, table.shape[1]).transpose(0, 2, 1))
