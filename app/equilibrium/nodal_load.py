"""Forces on single unknowns: point forces, driven tools, reactions that are being given up."""

from __future__ import annotations

from dataclasses import dataclass

from tribox.geometry.surfaces.facets import Floats, Ints


@dataclass(slots=True)
class NodalLoad:
    """Dead forces on unknowns: a factor, the same on all ranks, times what each unknown has.

    Attributes:
        dofs: local scalar unknowns, owned by this rank, each at most once.
        shares: (c,) or one for all, N (in plane strain per unit thickness) for a factor of one,
            along the coordinate axes.
        factor: the present factor; set it before assembling.
    """

    dofs: Ints
    shares: Floats | float = 1.0
    factor: float = 0.0

    def add_to(self, forces: Floats) -> None:
        """Add the forces to those of the owned unknowns, ghosts after them or not."""
        forces[self.dofs] += self.factor * self.shares
