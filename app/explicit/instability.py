"""What ends an explicit run: an inverted element, or more energy than was ever supplied."""

from __future__ import annotations

import numpy as np

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.places import place_of_largest, place_text
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.forms.bodies.materials import oedometric_modulus
from tribox.geometry.surfaces.facets import Floats


class ExplicitError(Exception):
    """The motion cannot be followed any further.

    Attributes:
        reason: what happened; place: where, m, undeformed; time: when, s since the start.
    """

    def __init__(self, reason: str, place: tuple[float, ...], time: float) -> None:
        """Say what happened, where and when."""
        super().__init__(f"{reason} at {place_text(place)}, undeformed")
        self.reason, self.place, self.time = reason, place, time


def folded(problem: Equilibrium, time: float) -> ExplicitError:
    """The error for an element that is inside out; collective."""
    u = problem.u.x.array
    cells = np.asarray(problem.space.dofmap.list)[
        np.concatenate([solid.cells for solid in problem.solids])
    ]
    reference = problem.space.tabulate_dof_coordinates()[:, : problem.dim]
    current = reference + u.reshape(-1, problem.dim)
    with np.errstate(invalid="ignore", over="ignore"):
        ratio = (_corner_jacobians(current[cells]) / _corner_jacobians(reference[cells])).min(0)
    ratio = np.where(np.isfinite(ratio), ratio, -np.inf)
    mine: tuple[float, tuple[float, ...]] = (np.inf, ())
    if len(cells):
        at = int(np.argmin(ratio))
        mine = (float(ratio[at]), tuple(map(float, reference[cells[at]].mean(axis=0))))
    place = min(problem.comm.allgather(mine))[1]
    return ExplicitError("an element has been turned inside out", place, time)


def _corner_jacobians(x: Floats) -> Floats:
    """Determinants (b, c) of the edges at each corner b of cells with corners (c, a, i)."""
    dim = x.shape[2]
    if x.shape[1] == dim + 1:
        corners = [(0, list(range(1, dim + 1)))]
    else:  # tensor order: neighbours differ in one bit
        corners = [(a, [a ^ (1 << k) for k in range(dim)]) for a in range(1 << dim)]
    return np.stack([np.linalg.det(x[:, others] - x[:, a : a + 1]) for a, others in corners])


class EnergyWatch:
    """Holds the stored energy against all that was ever supplied.

    Supports, loads and the start supply energy; dissipation only takes. So the strain, kinetic and
    interface energy together can never exceed the supply, but for errors of the integration.
    """

    def __init__(self, problem: Equilibrium, limit: float, stored: float) -> None:
        """Begin with the energy that is stored at the start.

        Args:
            problem: names the place where the energy grows.
            limit: stored over supplied energy above which the motion counts as unstable.
            stored: J/m, of all ranks.
        """
        self._problem, self._limit = problem, limit
        self._supplied = stored
        self._work = 0.0
        # Energy that rounding errors may hold, J/m: far below any of interest.
        stiffest = max(oedometric_modulus(solid.material) for solid in problem.solids)
        self._roundoff = 1e6 * problem.roundoff**2 / stiffest

    def snapshot(self) -> Snapshot:
        """What was supplied so far."""
        return {"supplied": self._supplied, "work": self._work, "roundoff": self._roundoff}

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._supplied, self._work = kept["supplied"], kept["work"]
        self._roundoff = kept["roundoff"]

    def check(self, stored: float, work: float, time: float, moving: Floats) -> None:
        """Compare; collective.

        Args:
            stored: J/m, strain, interface and kinetic energy of all ranks.
            work: J/m, of supports and loads since the start, of all ranks.
            time: s, since the start.
            moving: (n,), J/m, m v² of the owned unknowns.

        Raises:
            ExplicitError: there is more energy than was supplied.
        """
        self._supplied += max(work - self._work, 0.0)
        self._work = work
        if not np.isfinite(stored):
            raise folded(self._problem, time)
        if not stored <= self._limit * self._supplied + self._roundoff:
            raise ExplicitError(
                f"the energy runs away ({stored:.3g} J/m stored, {self._supplied:.3g} J/m ever "
                "supplied), fastest",
                place_of_largest(np.nan_to_num(moving, nan=np.inf), self._problem.space),
                time,
            )
