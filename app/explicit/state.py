"""The state of an explicit run: displacements at whole steps, velocities at half steps."""

from __future__ import annotations

import dolfinx

from tribox.geometry.surfaces.exchange import NodalVector
from tribox.geometry.surfaces.facets import Floats


class ExplicitState:
    """Nodal vectors and the time that they belong to.

    Attributes:
        u: m, displacements at the last whole step, in the memory of the problem's function.
        v: m/s, velocities at the last half step; a: m/s², accelerations at the last whole step.
        time: s, since the start; steps: so far; last_dt: s, length of the last step, 0 where the
            velocities are those of the last whole step (at the start and after a rest).
    """

    def __init__(
        self,
        u: dolfinx.fem.Function,
        displacement: Floats | None = None,
        velocity: Floats | None = None,
    ) -> None:
        """Take over a state; collective.

        Args:
            u: displacement.
            displacement: (n,), m, of the owned unknowns; None: what ``u`` holds.
            velocity: (n,), m/s, of the owned unknowns; None: rest.
        """
        space = u.function_space
        self.u = NodalVector(space, u.x)
        self.v, self.a = NodalVector(space), NodalVector(space)
        if displacement is not None:
            self.u.owned[:] = displacement
        if velocity is not None:
            self.v.owned[:] = velocity
        self.time, self.steps, self.last_dt = 0.0, 0, 0.0
