"""What each load gives by itself: for tables of forces, and for explicit steps."""

from __future__ import annotations

from collections.abc import Sequence

import dolfinx
import numpy as np

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.forms.bodies.loads import Foundation
from tribox.geometry.surfaces.facets import Floats


def load_residuals(problem: Equilibrium, out: Sequence[Floats] = ()) -> list[Floats]:
    """Residuals of the loads with forms, then of those at nodes, at the present displacement.

    Args:
        problem: the equilibrium.
        out: of an earlier call, overwritten; empty: new arrays.

    Returns:
        Of each load (n,), N per unit thickness, this rank's part at its local unknowns.
    """
    number = len(problem.loads) + len(problem.nodal_loads)
    arrays = list(out) or [np.zeros(len(problem.u.x.array)) for _ in range(number)]
    split = len(problem.loads)
    for values, load in zip(arrays[:split], problem.loads, strict=True):
        values[:] = 0.0
        if load.acts:
            dolfinx.fem.assemble_vector(values, load.residual)
    for values, nodal in zip(arrays[split:], problem.nodal_loads, strict=True):
        values[:] = 0.0
        nodal.add_to(values)
        values *= -1.0
    return arrays


def foundation_springs(problem: Equilibrium) -> Floats:
    """Stiffness (n,) of elastic foundations at the owned unknowns, N/m, from above.

    The integrals of products of shape functions are taken for those of single ones at the diagonal,
    which is more for first-order surfaces, and the larger of both stiffnesses in every
    direction, also where it does not act yet.
    """
    out = np.zeros(problem.owned)
    for load in problem.loads:
        if isinstance(load, Foundation):
            out += load.strongest * np.abs(load.shares)
    return out
