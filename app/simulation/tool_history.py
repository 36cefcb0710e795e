"""Motion of rigid tools, and the forces on them: ``tools.csv``.

Forces and moments "on the tool" are those of the bodies that it presses; what drives it is what its
surroundings do to it, so that both add up to zero where no mass is accelerated. Moments are about
the centre of its rotation, where that is now.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from tribox.app.build.model import Model
from tribox.app.case.boundary import COMPONENTS
from tribox.app.simulation.contact_resultants import ContactResultants
from tribox.app.simulation.motion_history import KEYS
from tribox.app.simulation.outside_forces import OutsideForces
from tribox.geometry.surfaces.facets import Floats, Ints


class ToolHistory:
    """Rows of the table.

    Attributes:
        columns: their names; rows: a row for each tool and step.
    """

    def __init__(self, model: Model, held: Ints) -> None:
        """Make ready.

        Args:
            model: what is solved.
            held: owned unknowns of :class:`OutsideForces`, sorted.
        """
        self._model, self._held = model, held
        self._tools, dim = model.problem.tools, model.problem.dim
        axes = COMPONENTS[:dim]
        moments = [f"moment_{axis}" for axis in ("xyz" if dim == 3 else "z")]
        self.columns = (
            *(*KEYS, "tool"),
            *(f"displacement_{axis}" for axis in axes),
            "rotation",
            *(f"velocity_{axis}" for axis in axes),
            "angular_velocity",
            *(f"force_{axis}" for axis in axes),
            *moments,
            *(f"driving_force_{axis}" for axis in axes),
            "driving_moment",
            "power",
            *(f"centre_{axis}" for axis in axes),
        )
        self.rows: list[tuple[int | float | str, ...]] = []

    def add(
        self,
        key: tuple[int, float, str],
        motion: tuple[Floats, Floats],
        outside: OutsideForces,
        pairs: Sequence[ContactResultants],
    ) -> None:
        """Add the rows of a step; collective.

        Args:
            key: number of the step, time in s, name of the stage.
            motion: displacements, m, and velocities, m/s, of the owned unknowns (n,).
            outside: forces of the surroundings.
            pairs: resultants of the contacts.
        """
        if not self._tools:
            return
        contacts = self._model.case.contact
        slots = self._slots(motion, outside)
        for number, tool in enumerate(self._tools):
            moved, speed, drive = slots[number]
            length = tool.motion.length
            mine = [m for m, c in zip(pairs, contacts, strict=True) if c.master == tool.name]
            force, moment = self._pressed(mine)
            drive = drive * self._model.thickness
            if self._model.section == "axisymmetric":
                drive[0] = drive[-1] = 0.0  # what points outwards cancels round the ring
            power = float(drive @ speed)
            drive[-1] *= length
            values = (
                *(*moved[:-1], moved[-1] / length),
                *(*speed[:-1], speed[-1] / length),
                *force,
                *moment,
                *drive,
                power,
                *(tool.motion.centre + moved[:-1]),
            )
            self.rows.append((*key, tool.name, *map(float, values)))

    def fastest(self) -> float:
        """Speed of the fastest tool at the last rows, m/s; of one that turns, at its length."""
        names = [self.columns.index(n) for n in self.columns if n.startswith("velocity_")]
        turning = self.columns.index("angular_velocity")
        speeds = [
            math.hypot(*(float(row[at]) for at in names), float(row[turning]) * tool.motion.length)
            for row, tool in zip(self.rows[-len(self._tools) :], self._tools, strict=True)
        ]
        return max(speeds, default=0.0)

    def last(self) -> dict[str, dict[str, int | float | str]]:
        """The last row of each tool by its name: numbers by column."""
        found = {}
        for row in self.rows[-len(self._tools) :]:
            named = dict(zip(self.columns, row, strict=True))
            found[str(named.pop("tool"))] = named
        return found

    def largest_force(self, stages: Collection[str]) -> float:
        """Largest component of a force on a tool at the rows of some stages, N; 0 without any."""
        columns = [number for number, name in enumerate(self.columns) if name.startswith("force_")]
        rows = [row for row in self.rows if row[KEYS.index("stage")] in stages]
        return max((abs(float(row[at])) for row in rows for at in columns), default=0.0)

    def _slots(self, motion: tuple[Floats, Floats], outside: OutsideForces) -> Floats:
        """Displacement, velocity and drive (t, 3, k) of each tool's slots, m, m/s, N; collective.

        What is prescribed is driven by what holds it, the rest by the loads on it.
        """
        loads = np.sum(outside.loads, axis=0) if outside.loads else np.zeros_like(motion[0])
        out = np.zeros((len(self._tools), 3, self._model.problem.dim + 1))
        springs = [platen.dofs for platen in self._model.problem.platens]
        given = np.concatenate([self._model.problem.constrained_dofs(), *springs])
        for number, tool in enumerate(self._tools):
            for slot in np.nonzero(tool.here)[0]:
                dof = tool.dofs[slot]
                drive = loads[dof]
                if dof in given:
                    drive = outside.held[np.searchsorted(self._held, dof)]
                out[number, :, slot] = motion[0][dof], motion[1][dof], drive
        total = np.empty_like(out)
        self._model.problem.comm.Allreduce(out, total)
        return total

    def _pressed(self, pairs: Sequence[ContactResultants]) -> tuple[Floats, Floats]:
        """Force (i,), N, and moment (1 or 3,), N m, of the bodies on a tool."""
        dim, t = self._model.problem.dim, self._model.thickness
        force, moment = np.zeros(dim), np.zeros(3 if dim == 3 else 1)
        for pair in pairs:
            force -= t * np.array(pair.force)
            moment += t * np.array(pair.tool_moment)
        return force, moment
