"""Internal forces and strain energy of all bodies, for explicit steps.

Bodies of first-order cells and most materials of :mod:`forms.bodies.materials` go through the
compiled loops of ``plane_kernel.c`` and ``space_kernel.c``; all others through the forms that
DOLFINx compiled for the implicit solution. Both give the same numbers to round-off.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import dolfinx
import numpy as np
from numpy.typing import NDArray

from forms.bodies.materials import Hencky, Material, MooneyRivlin, NeoHookean
from forms.bodies.solid import Solid
from forms.bodies.space_force import force_in_space, is_in_space
from forms.native.libraries import library
from geometry.compat import packed_constants

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

SOURCE = "plane_kernel.c"
LANES = 8  # cells that the compiled loop takes at a time
_KINDS: dict[type, int] = {NeoHookean: 0, MooneyRivlin: 1, Hencky: 2}
_POINTER = ctypes.c_void_p
_SIGNATURE: list[Any] = [ctypes.c_int, ctypes.c_int, _POINTER, ctypes.c_int64, ctypes.c_int]
_SIGNATURE += [_POINTER] * 4


class BodyForce(Protocol):
    """Internal force of one body."""

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """Add the nodal forces at the displacements ``u`` to ``out``; False: a cell is inverted.

        ``dt`` is the time step, s; None: material points that remember do not flow on.
        """
        ...

    def energy(self, u: Floats) -> float:
        """This rank's strain energy at ``u``, J per unit thickness."""
        ...


class GeneratedForce:
    """A body's forces by DOLFINx's generated kernels."""

    def __init__(self, solid: Solid, u: dolfinx.fem.Function) -> None:
        """Use the forms of ``solid``, which read the displacement from ``u``."""
        self._u, self._solid = u, solid
        self._residuals = [part.residual for part in solid.forms]
        self._constants = [packed_constants(form) for form in self._residuals]

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """See ``BodyForce.add``; the logarithm of J ≤ 0 makes the forces NaN."""
        with self._at(u):
            if dt is None:
                self._solid.evaluate_elastic()
            else:
                self._solid.evaluate(dt)
            for form, constants in zip(self._residuals, self._constants, strict=True):
                dolfinx.fem.assemble_vector(out, form, constants=constants)
        return bool(np.isfinite(out.sum()))

    def energy(self, u: Floats) -> float:
        """See ``BodyForce.energy``."""
        with self._at(u):
            return self._solid.strain_energy()

    @contextmanager
    def _at(self, u: Floats) -> Iterator[None]:
        """Within a ``with`` block the forms read ``u``, afterwards the displacement as it was."""
        values = self._u.x.array
        if u.ctypes.data == values.ctypes.data:
            yield
            return
        before = values.copy()
        values[:] = u
        try:
            yield
        finally:
            values[:] = before


class CompiledForce:
    """A body's forces by the compiled loop over plane cells, ``LANES`` at a time."""

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
            nodes: (c, a) nodes of each cell, a = 3 for triangles, 4 for quadrilaterals in
                DOLFINx's order.
            position: (n, i), m, reference position of the nodes.
            material: its strain energy.
            reduced: whether the volumetric part is taken at the centre.
        """
        count, corners = nodes.shape
        self._kind = 2 if corners == 3 else int(reduced)
        self._material = _KINDS[type(material)]
        self._parameters = np.array(list(material.parameters().values()))
        self._blocks = -(-count // LANES)
        self._last = count - (self._blocks - 1) * LANES
        four, edges = _right_handed(nodes, position, self._blocks * LANES)
        self._nodes, self._edges = _in_lanes(four), _in_lanes(edges)
        self._forces, self._energy = code.tribox_plane_forces, code.tribox_plane_energy
        for function in (self._forces, self._energy):
            function.argtypes, function.restype = _SIGNATURE, ctypes.c_int
        self._result = np.zeros(1)
        self._arguments = (
            self._material,
            self._kind,
            self._parameters.ctypes.data,
            self._blocks,
            self._last,
            self._nodes.ctypes.data,
            self._edges.ctypes.data,
        )

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """See ``BodyForce.add``."""
        return self._forces(*self._arguments, u.ctypes.data, out.ctypes.data) == 0

    def energy(self, u: Floats) -> float:
        """See ``BodyForce.energy``; infinite where a cell is inverted."""
        bad = self._energy(*self._arguments, u.ctypes.data, self._result.ctypes.data)
        return float(np.inf if bad else self._result[0])


def _right_handed(nodes: Ints, position: Floats, rows: int) -> tuple[Ints, Floats]:
    """Four nodes (rows, 4) of each cell and its edges (rows, 6), m, as the loop takes them.

    Triangles repeat their third node; the last cell is repeated up to the number of ``rows``.
    """
    count, corners = nodes.shape
    padded = np.concatenate([nodes, nodes[-1:].repeat(rows - count, axis=0)])
    four = padded[:, [0, 1, 2, 3 if corners == 4 else 2]].astype(np.int32)
    x = position[four]
    along, up = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
    turned = along[:, 0] * up[:, 1] - along[:, 1] * up[:, 0] < 0.0
    four[turned, 1:3] = four[turned, 2:0:-1]
    x = position[four]
    edges = [x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 2] - x[:, 1] + x[:, 0]]
    return four, np.stack(edges, axis=1).reshape(rows, 6)


def _in_lanes(table: NDArray[Any]) -> NDArray[Any]:
    """Rows (c, k) of the cells as (blocks, k, LANES)."""
    return np.ascontiguousarray(table.reshape(-1, LANES, table.shape[1]).transpose(0, 2, 1))


class InternalForce:
    """Internal forces of all bodies on the nodes of this rank, ghosts included.

    Attributes:
        parts: one for each body with cells on this rank; compiled: whether all use the fast loop.
    """

    def __init__(
        self, u: dolfinx.fem.Function, solids: Sequence[Solid], compiled: bool = True
    ) -> None:
        """Choose the compiled loop or the generated kernels for each body.

        Args:
            u: displacement, m; read by the forms of bodies without a compiled loop.
            solids: the bodies.
            compiled: False for the generated kernels throughout.
        """
        self.parts: list[BodyForce] = []
        code = library(SOURCE) if compiled else None
        self.compiled = True
        for solid in solids:
            if code is not None and _is_plane(u.function_space, solid):
                if len(solid.cells):
                    self.parts.append(_compiled(code, u.function_space, solid))
            elif compiled and is_in_space(u.function_space, solid):
                if len(solid.cells):
                    self.parts.append(force_in_space(u.function_space, solid))
            else:
                self.compiled = False
                self.parts.append(GeneratedForce(solid, u))

    def evaluate(self, u: Floats, out: Floats, dt: float | None = math.inf) -> bool:
        """Put the internal forces at ``u`` (m) into ``out`` (N per unit thickness).

        Args:
            u: local unknowns, ghosts included.
            out: of the same shape; ghosts get this rank's share.
            dt: s, time step, infinite where rates do not count; None: forces of bodies that do not
                flow on, for their elastic stiffness.

        Returns:
            False where a cell of this rank is turned inside out.
        """
        out[:] = 0.0
        valid = True
        for part in self.parts:
            valid &= part.add(u, out, dt)
        return valid

    def energy(self, u: Floats) -> float:
        """This rank's strain energy at ``u``, J per unit thickness."""
        return sum(part.energy(u) for part in self.parts)


def _is_plane(space: dolfinx.fem.FunctionSpace, solid: Solid) -> bool:
    """Whether the compiled loop covers the body's cells, element and material."""
    mesh = space.mesh
    plane = solid.section == "plane-strain"
    corners = mesh.topology.cell_type in (
        dolfinx.mesh.CellType.quadrilateral,
        dolfinx.mesh.CellType.triangle,
    )
    linear = space.dofmap.dof_layout.num_dofs == (
        4 if mesh.topology.cell_type == dolfinx.mesh.CellType.quadrilateral else 3
    )
    return plane and corners and linear and type(solid.material) in _KINDS


def _compiled(code: ctypes.CDLL, space: dolfinx.fem.FunctionSpace, solid: Solid) -> CompiledForce:
    position = space.tabulate_dof_coordinates()[:, :2]
    nodes = np.asarray(space.dofmap.list)[solid.cells]
    return CompiledForce(code, nodes, position, solid.material, reduced=len(solid.forms) == 2)
