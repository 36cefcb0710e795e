"""What a way to solve linear systems with the tangent offers to :class:`LinearSolver`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from tribox.app.equilibrium.snapshot import Snapshot

LEFT = 1e-3
"""Share of the forces that a solve may leave out of balance where nothing else is said."""
CLOSEST = 1e-8
"""Share of the forces that no linear solve has to get below, where a way says nothing else."""


class LinearWay(Protocol):
    """Solves with the tangent, and keeps what serves more than one of them.

    Attributes:
        direct: whether a solve with the matrix at hand is cheap beside a new matrix.
        part: what setting up is called where seconds are counted.
    """

    direct: bool
    part: str

    @property
    def closest(self) -> float:
        """Share of the forces that no solve has to get below, unless the tolerance is tight."""
        ...

    def kinds(self) -> str:
        """PETSc's names of the solver, for messages."""
        ...

    def renew(self) -> None:
        """Forget all that was made for earlier matrices; collective."""
        ...

    def set_up(self, widened: bool) -> bool:
        """Factorise the matrix, or make its preconditioner; collective.

        Returns whether nothing of what was made for earlier matrices is in use.
        """
        ...

    def aim(self, share: float, on_path: bool = False) -> None:
        """Let the next solves leave at most this share of the forces, if they are iterative."""
        ...

    def snapshot(self) -> Snapshot:
        """What later solves depend on, beside the matrices that it was set up with."""
        ...

    def restore(self, kept: Snapshot, set_up: Callable[[], None]) -> None:
        """Go on from what :meth:`snapshot` has seen; collective."""
        ...


def petsc_kinds(ksp: str, pc: str) -> str:
    """How messages name a kind of solver and a kind of preconditioner."""
    return f'ksp_type "{ksp}" and pc_type "{pc}"'
