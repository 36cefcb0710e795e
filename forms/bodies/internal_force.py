"""Internal forces and strain energy of all bodies.

Bodies that a compiled loop covers (:mod:`tribox.forms.bodies.compiled_cells`) go through it; all
others through the forms that DOLFINx compiled. Both give the same numbers to round-off.
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
from tribox.forms.bodies.solid import CompiledForms, Solid
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
    """A body's forces by DOLFINx's generated kernels."""

    def __init__(self, solid: Solid, u: dolfinx.fem.Function, looped: bool = False) -> None:
        """Use the forms of ``solid``, which read the displacement from ``u``.

        ``looped``: only those at points that remember, beside a compiled loop.
        """
        self._u, self._solid, self._looped = u, solid, looped
        self._residuals = [part.residual for part in self._forms]
        self._constants = [packed_constants(form) for form in self._residuals]

    @property
    def _forms(self) -> Sequence[CompiledForms]:
        return self._solid.point_forms if self._looped else self._solid.forms

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
            return self._solid.point_energy() if self._looped else self._solid.strain_energy()

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


class InternalForce:
    """Internal forces of all bodies on the nodes of this rank, ghosts included.

    Attributes:
        parts: one for each body, and one more for points that remember beside a compiled loop;
            compiled: whether all is done by compiled loops.
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
            if cells is None or solid.point_forms:
                self.compiled = False
                self.parts.append(GeneratedForce(solid, u, looped=cells is not None))

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
