"""Bodies whose forces, energy and tangent compiled loops compute, several cells at a time.

The loops give what the forms that DOLFINx compiles give, to round-off.
"""

from __future__ import annotations

from typing import Protocol

import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.plane_cells import plane_cells
from tribox.forms.bodies.solid import Solid
from tribox.forms.bodies.space_cells import space_cells
from tribox.geometry.surfaces.facets import Bools, Floats, Ints


class CompiledCells(Protocol):
    """Owned cells of one body.

    Axis letters: c cells, a and b corners, i and j space; n local unknowns, ghosts included.

    Attributes:
        nodes: (c, a) local nodes of each cell, in the order of the loop.
    """

    nodes: Ints

    def part(self, take: Bools) -> CompiledCells:
        """The cells (c,) to ``take`` by themselves."""
        ...

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """See :meth:`tribox.forms.bodies.internal_force.BodyForce.add`.

        Forces of a cell that is turned inside out are NaN where the forms' would be.
        """
        ...

    def energy(self, u: Floats) -> float:
        """Strain energy at ``u`` (n,), J per unit thickness; infinite where a cell is inverted."""
        ...

    def add_tangent(
        self, u: Floats, values: Floats, starts: NDArray[np.int32], excess: Floats | None = None
    ) -> None:
        """Add the element matrices at ``u`` (n,), N/m per unit thickness.

        Args:
            u: m.
            values: of a sparse matrix, changed.
            starts: (c, a, i, b), contiguous, from where on in ``values`` the dim numbers of the
                row (a, i) and the columns (b, j) are.
            excess: (c,), Pa, added to the volumetric pressures of ``q1-sri``
                (:mod:`tribox.forms.bodies.carried_pressure`).
        """
        ...


def compiled_cells(space: dolfinx.fem.FunctionSpace, solid: Solid) -> CompiledCells | None:
    """The loop for this rank's cells of a body, even if there are none; None: no loop covers it.

    All ranks get one, or none does.
    """
    in_space = solid.section == "3D"
    return space_cells(space, solid) if in_space else plane_cells(space, solid)
