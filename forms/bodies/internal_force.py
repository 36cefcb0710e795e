"""Internal forces and strain energy of all bodies.

Strain energies that a compiled loop covers (:mod:`tribox.forms.bodies.compiled_cells`) go through
it; all others through the forms that DOLFINx compiled. Both give the same numbers to round-off.
Points that remember have a loop of their own (:mod:`tribox.forms.bodies.point_cells`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.compiled_cells import compiled_cells
from tribox.forms.bodies.solid import Solid
from tribox.geometry.compat import packed_constants

Floats = NDArray[np.float64]


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
    """A body's forces by DOLFINx's generated kernels, but for those of points that remember."""

    def __init__(self, solid: Solid, u: dolfinx.fem.Function) -> None:
        """Use the forms of ``solid``, which read the displacement from ``u``."""
        self._u, self._solid = u, solid
        self._residuals = [part.residual for part in solid.forms]
        self._constants = [packed_constants(form) for form in self._residuals]

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """See ``BodyForce.add``; the logarithm of J ≤ 0 makes the forces NaN."""
        with _at(self._u, u):
            for form, constants in zip(self._residuals, self._constants, strict=True):
                dolfinx.fem.assemble_vector(out, form, constants=constants)
        # One sum is enough: a NaN anywhere makes it NaN.
        return bool(np.isfinite(out.sum()))

    def energy(self, u: Floats) -> float:
        """See ``BodyForce.energy``."""
        with _at(self._u, u):
            return self._solid.form_energy()


class PointForce:
    """The forces of a body's points that remember."""

    def __init__(self, solid: Solid, u: dolfinx.fem.Function) -> None:
        """Of the points of ``solid``, which read the displacement from ``u``."""
        self._u, self._solid = u, solid

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """See ``BodyForce.add``; where points cannot be evaluated the forces are NaN."""
        solid = self._solid
        with _at(self._u, u):
            valid = solid.evaluate_elastic() if dt is None else solid.evaluate(dt)
            solid.add_point_forces(out)
        return valid

    def energy(self, u: Floats) -> float:
        """See ``BodyForce.energy``."""
        with _at(self._u, u):
            return self._solid.point_energy()


@contextmanager
def _at(function: dolfinx.fem.Function, u: Floats) -> Iterator[None]:
    """Within a ``with`` block the displacement is ``u`` (n,), m, afterwards what it was."""
    values = function.x.array
    if u.ctypes.data == values.ctypes.data:
        yield
        return
    before = values.copy()
    values[:] = u
    try:
        yield
    finally:
        values[:] = before


class InternalForce:
    """Internal forces of all bodies on the nodes of this rank, ghosts included.

    Attributes:
        parts: one for each body's strain energy, and one for its points that remember;
            compiled: whether strain energies go by compiled loops.
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
        self.compiled = True
        for solid in solids:
            cells = compiled_cells(u.function_space, solid) if compiled else None
            if cells is not None:
                self.parts.append(cells)
            elif solid.forms:
                self.compiled = False
                self.parts.append(GeneratedForce(solid, u))
            if solid.remembers:
                self.parts.append(PointForce(solid, u))

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
