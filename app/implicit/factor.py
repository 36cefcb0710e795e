"""Matrices factorised directly, and what any way to solve with the tangent offers.

MUMPS, and CHOLMOD for matrices that are symmetric and positive: its substitutions take two thirds
of the time (102 400 unknowns in the plane: 15.6 and 23.5 ms). It works on one rank only.
"""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.snapshot import Snapshot
from tribox.geometry.surfaces.facets import Floats

LEFT = 1e-3  # share of the forces that a solve may leave out of balance where nothing else is said
CLOSEST = 1e-8
"""Share of the forces that no linear solve has to get below, where a way says nothing else."""


class LinearWay:
    """Solves with the tangent, and keeps what serves more than one of them.

    Attributes:
        direct: whether a solve with the matrix at hand is cheap beside a new matrix.
    """

    direct: bool

    @property
    def part(self) -> str:
        """What setting up is called where seconds are counted."""
        raise NotImplementedError

    @property
    def closest(self) -> float:
        """Share of the forces that no solve has to get below, unless the tolerance is tight."""
        return CLOSEST

    def kinds(self) -> str:
        """PETSc's names of the solver, for messages."""
        raise NotImplementedError

    def renew(self) -> None:
        """Forget all that was made for earlier matrices; collective."""
        raise NotImplementedError

    def set_up(self, widened: bool) -> None:
        """Factorise the matrix, or make its preconditioner; collective.

        Args:
            widened: whether its pattern is another than that of the last one.
        """
        raise NotImplementedError

    def aim(self, share: float, on_path: bool = False) -> None:
        """Let the next solves leave at most this share of the forces, if they are iterative."""

    def snapshot(self) -> Snapshot:
        """What later solves depend on, beside the matrices that it was set up with."""
        return {}

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen; the matrix is set up after this."""


class Effort(NamedTuple):
    """What solves by iterations took that was more than it should have been.

    Attributes:
        most: iterations of the longest solve; 0: none took longer than factorisations would.
        turned: whether systems are factorised for it.
        stiff: unknowns of stiff bodies that are factorised as their multigrid did not converge.
    """

    most: int = 0
    turned: bool = False
    stiff: int = 0


NO_EFFORT = Effort()


def petsc_kinds(ksp: str, pc: str) -> str:
    """How messages name a kind of solver and a kind of preconditioner."""
    return f'ksp_type "{ksp}" and pc_type "{pc}"'


# -- A matrix factorised directly ------------------------------------------------------------------


DIRECT: dict[str, str | float | bool] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}


def positive_solver(comm: PETSc.Comm) -> str:
    """PETSc's name of the solver for symmetric and positive matrices."""
    at_hand = any(PETSc.Sys.hasExternalPackage(name) for name in ("cholmod", "suitesparse"))
    if comm.getSize() == 1 and at_hand:
        return str(PETSc.Mat.SolverType.CHOLMOD)
    return str(PETSc.Mat.SolverType.MUMPS)


BYTES = 500.0
"""Of the factors of n unknowns in space, over n^(4/3) (nested dissection): 1070 MiB were measured
of 117 045 unknowns and a symmetric half; MUMPS takes a fifth more to work in."""
ROOM = 0.7  # share of the memory that is free which factors may take


def factors_fit(comm: MPI.Comm, size: int) -> bool:
    """Whether the factors of so many unknowns in space fit into memory; collective."""
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    wanted = BYTES * size ** (4.0 / 3.0) * node.size / comm.size
    fits = wanted <= ROOM * free_memory()
    node.Free()
    return bool(comm.allreduce(fits, op=MPI.LAND))


def free_memory() -> float:
    """Bytes that this machine, or the group of processes with a limit of its own, has left."""
    found = [math.inf]
    with suppress(OSError, StopIteration, ValueError):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        found.append(1024.0 * next(int(x.split()[1]) for x in lines if x.startswith("MemAvail")))
    with suppress(OSError, ValueError):
        limit, used = (
            int(Path(f"/sys/fs/cgroup/memory.{name}").read_text(encoding="ascii"))
            for name in ("max", "current")
        )
        found.append(float(limit - used))
    return min(found)


class Factor:
    """The factorisation of a matrix whose values may change.

    The analysis is made once, from the matrix as it is first; each change of its values is followed
    by a numeric factorisation.

    Attributes:
        solution: the last one.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        prefix: str,
        symmetric: bool = False,
        solver: str = PETSc.Mat.SolverType.MUMPS,
    ) -> None:
        """Prepare to factorise ``matrix``; collective.

        Args:
            solver: PETSc's name of the solver.
        """
        self._matrix, self._solver = matrix, solver
        self._ksp = PETSc.KSP().create(matrix.comm)
        self._ksp.setOptionsPrefix(prefix)
        self._ksp.setType(PETSc.KSP.Type.PREONLY)
        kind = PETSc.PC.Type.CHOLESKY if symmetric else PETSc.PC.Type.LU
        pc = self._ksp.getPC()
        pc.setType(kind)
        pc.setFactorSolverType(solver)
        if symmetric:
            matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._ksp.setOperators(matrix)
        self.solution, self._rhs = matrix.createVecs()

    def make(self, _widened: bool = False) -> bool:
        """Factorise the matrix as it is now; returns whether it could be done; collective."""
        self._ksp.setOperators(self._matrix)
        try:
            self._ksp.setUp()
            works = int(self._ksp.getPC().getFailedReason()) == PETSc.PC.FailedReason.NOERROR
        except PETSc.Error:
            if self._solver != PETSc.Mat.SolverType.CHOLMOD:
                raise  # MUMPS does so for options that it cannot take only
            works = False  # CHOLMOD also for a matrix that is not positive
        if not works:
            self._ksp.reset()  # or PETSc would say of the next that it worked, and do nothing
        return works

    def solve(self, rhs: Floats) -> Floats:
        """The solution (n,) for a right-hand side (n,), owned rows each; collective."""
        self._rhs.array[:] = rhs
        self._ksp.solve(self._rhs, self.solution)
        return self.solution.array_r

    @property
    def matrix(self) -> PETSc.Mat:
        """The matrix, which :meth:`destroy` leaves to its owner."""
        return self._matrix

    def destroy(self) -> None:
        """Give the memory back; collective."""
        self._ksp.destroy()


class CoupledFactor(LinearWay):
    """A new factorisation for each matrix; its analysis is kept while the pattern stays."""

    direct, part = True, "factorisation"

    def __init__(self, ksp: PETSc.KSP, matrix: PETSc.Mat) -> None:
        """Solve by ``ksp``, whatever its options are, with ``matrix``."""
        self._ksp, self._matrix = ksp, matrix

    def kinds(self) -> str:
        return petsc_kinds(self._ksp.getType(), self._ksp.getPC().getType())

    def renew(self) -> None:
        self._ksp.reset()

    def set_up(self, widened: bool) -> None:
        # PETSc exchanges the matrix's inside on an addition with another pattern and does not see
        # by itself that the factorisation's analysis is out of date.
        if widened:
            self.renew()
        self._ksp.setOperators(self._matrix)
        self._ksp.setUp()
