"""Motion of whole bodies and platens in an explicit run: the table ``motion.csv``."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from app.build.model import Model, body_dofs
from app.case.boundary import COMPONENTS
from app.explicit.stepper import ExplicitStepper
from geometry.surfaces.facets import Floats


class RigidMotionHistory:
    """Centre of mass of each body, and each platen or sprung surface, at every row.

    Attributes:
        columns: names of the table's columns: ``time``; for each body its displacement ``NAME_x``
            and velocity ``NAME_vx`` and so on, m and m/s; for each platen, named after surface and
            direction such as ``top_x``, displacement, velocity ``top_x_v`` and force on it
            ``top_x_force``, N.
        rows: their values.
    """

    def __init__(self, model: Model, stepper: ExplicitStepper) -> None:
        """Find the bodies' unknowns and masses; collective."""
        self._stepper = stepper
        self._problem = model.problem
        self._thickness = model.thickness
        axes = COMPONENTS[: model.problem.dim]
        self._bodies = [body_dofs(model, name) for name in model.case.bodies]
        masses = np.array([stepper.mass[dofs[:, 0]].sum() for dofs in self._bodies])
        self._masses = model.problem.comm.allreduce(masses)
        self._edges = [platen.dofs for platen in model.problem.platens]
        counts = np.array([float(len(dofs)) for dofs in self._edges])
        self._counts = model.problem.comm.allreduce(counts)
        bodies = [f"{name}_{v}{a}" for name in model.case.bodies for v in ("", "v") for a in axes]
        edges = [f"{name}{part}" for name in model.platen_names for part in ("", "_v", "_force")]
        self.columns = ("time", *bodies, *edges)
        self.rows: list[tuple[float, ...]] = []

    def add(self, time: float) -> None:
        """Add the present state at ``time`` (s); collective."""
        x, v, mass = self._stepper.x.array_r, self._stepper.v, self._stepper.mass
        local = [(mass[d] * f[d]).sum(axis=0) for d in self._bodies for f in (x, v)]
        local += [np.array([x[d].sum(), v[d].sum()]) for d in self._edges]
        mine = np.concatenate(local)
        total: Floats = np.empty_like(mine)
        self._problem.comm.Allreduce(mine, total, op=MPI.SUM)
        dim = self._problem.dim
        split = 2 * dim * len(self._bodies)
        bodies = total[:split].reshape(len(self._bodies), -1) / self._masses[:, None]
        edges = total[split:].reshape(-1, 2) / self._counts[:, None]
        row = [time, *bodies.reshape(-1)]
        for platen, (at, speed) in zip(self._problem.platens, edges, strict=True):
            row += [at, speed, platen.pull(at) * self._thickness]
        self.rows.append(tuple(map(float, row)))
