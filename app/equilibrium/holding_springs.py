"""Springs that hold bodies with nothing else to hold them, while a solution is sought."""

from __future__ import annotations

from dataclasses import dataclass

from tribox.geometry.surfaces.facets import Floats


@dataclass(frozen=True, slots=True)
class HoldingSprings:
    """A spring to a fixed place at every node of a body, in the directions in which it is loose.

    Attributes:
        stiffness: (n,), N/m, of the owned unknowns.
        place: (n,), m, where they carry no force.
        weak: whether they are part of the solution, of bodies that carry nothing: forces are to be
            compared with the largest of the run then.
    """

    stiffness: Floats
    place: Floats
    weak: bool = False

    def force(self, at: Floats) -> Floats:
        """Residual (n,), N, of the owned unknowns (n,), m."""
        out: Floats = self.stiffness * (at - self.place)
        return out
