"""What a way to solve linear systems with the tangent offers to :class:`LinearSolver`."""

from __future__ import annotations

from typing import Protocol

from app.equilibrium.snapshot import Snapshot


class LinearWay(Protocol):
    """Solves with the tangent, and keeps what serves more than one of them.

    Attributes:
        direct: whether a solve with the matrix at hand is cheap beside a new matrix.
        part: what setting up is called where seconds are counted.
    """

    direct: bool
    part: str

    def worn(self, widened: bool) -> bool:
        """Whether all must be made anew for the next matrix.

        Args:
            widened: whether its pattern has changed.
        """
        ...

    def renew(self) -> None:
        """Forget all that was made for earlier matrices; collective."""
        ...

    def set_up(self) -> None:
        """Factorise the matrix, or make its preconditioner; collective."""
        ...

    def snapshot(self) -> Snapshot:
        """What later solves depend on, beside the matrices that it was set up with."""
        ...

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen, the matrices being set up again."""
        ...
