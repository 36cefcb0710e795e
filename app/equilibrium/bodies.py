"""Forces, strain energy and tangent of all bodies.

Those that a compiled loop covers (:mod:`tribox.forms.bodies.compiled_cells`) go through it, the
others through the forms that DOLFINx compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import dolfinx
import numpy as np
from petsc4py import PETSc

from tribox.app.equilibrium.cell_places import CellPlaces, can_place
from tribox.forms.bodies.compiled_cells import CompiledCells, compiled_cells
from tribox.forms.bodies.solid import Solid
from tribox.geometry.compat import add_matrix
from tribox.geometry.surfaces.facets import Floats


@dataclass(slots=True)
class _Placed:
    """Cells of a body and their places in a matrix of one pattern."""

    pattern: object
    places: CellPlaces
    inside: CompiledCells
    outside: CompiledCells


class Bodies:
    """All bodies at the present displacement.

    Attributes:
        solids: the bodies; cells: the compiled loop of each, None without.
    """

    def __init__(
        self, u: dolfinx.fem.Function, solids: Sequence[Solid], compiled: bool = True
    ) -> None:
        """Choose the compiled loop or the forms for each body.

        Args:
            u: displacement, m, that the forms read.
            solids: the bodies.
            compiled: False for the forms throughout.
        """
        self.solids = list(solids)
        self._u, self._dim = u, u.function_space.dofmap.index_map_bs
        self.cells: list[CompiledCells | None] = [
            compiled_cells(u.function_space, solid) if compiled else None for solid in solids
        ]
        self._placed: dict[int, _Placed] = {}

    def add_forces(self, out: Floats) -> None:
        """Add the nodal forces (n,), N per unit thickness, of this rank's cells.

        Where a material cannot be evaluated they are NaN. Materials that remember must have been
        evaluated before.
        """
        for solid, cells in zip(self.solids, self.cells, strict=True):
            if cells is not None:
                cells.add(self._u.x.array, out, None)
                continue
            for part in solid.forms:
                dolfinx.fem.assemble_vector(out, part.residual)

    def strain_energy(self) -> float:
        """This rank's strain energy, J per unit thickness; not finite where a cell is inverted."""
        return sum(
            solid.strain_energy() if cells is None else cells.energy(self._u.x.array)
            for solid, cells in zip(self.solids, self.cells, strict=True)
        )

    def add_tangent(
        self, A: PETSc.Mat, index: int, pattern: object, carried: bool, unrolled: bool
    ) -> None:
        """Add the tangent of one solid; nothing is communicated.

        Args:
            A: the matrix, with its local to global map.
            index: which of `solids`.
            pattern: what changes with the pattern of ``A`` or with that map.
            carried: whether the volumetric part takes the pressure carried to it last.
            unrolled: whether forms are added by single rows, see :func:`add_matrix`.
        """
        solid, cells = self.solids[index], self.cells[index]
        carrier = solid.carried if carried else None
        if cells is not None and can_place(A):
            excess = None if carrier is None else carrier.excess()
            self._add_cells(A, self._places(A, index, cells, pattern), excess)
            return
        forms = [part.tangent for part in solid.forms]
        for form in forms if carrier is None else [*forms, carrier.tangent]:
            add_matrix(A, form, unrolled=unrolled)

    def _places(self, A: PETSc.Mat, index: int, cells: CompiledCells, pattern: object) -> _Placed:
        """The cells of a body, with their places for a pattern: those found before, if any."""
        known = self._placed.get(index)
        if known is None or known.pattern != pattern:
            places = CellPlaces(A, cells.nodes, self._dim)
            whole = bool(places.inside.all())
            known = _Placed(
                pattern,
                places,
                cells if whole else cells.part(places.inside),
                cells.part(~places.inside),
            )
            self._placed[index] = known
        return known

    def _add_cells(self, A: PETSc.Mat, placed: _Placed, excess: Floats | None) -> None:
        u, places = self._u.x.array, placed.places
        inner = outer = None
        if excess is not None:
            inner, outer = excess[places.inside], excess[~places.inside]
        with places.values(A) as values:
            placed.inside.add_tangent(u, values, places.starts, inner)
        matrices = np.zeros((*places.dense.shape, self._dim))
        placed.outside.add_tangent(u, matrices, places.dense, outer)
        places.add_outside(A, matrices)
