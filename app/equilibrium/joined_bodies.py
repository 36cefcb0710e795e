"""Bodies that move as one: those that common nodes or ties join."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tribox.app.equilibrium.bonded import bonded_groups
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.pair_bodies import bodies_of
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Ints


@dataclass(frozen=True, slots=True)
class JoinedBodies:
    """Bodies that are supported, or not, together.

    Attributes:
        groups: bodies, those together that share nodes; ties join the groups.
    """

    groups: tuple[tuple[Solid, ...], ...]

    @property
    def solids(self) -> tuple[Solid, ...]:
        """All bodies."""
        return tuple(solid for group in self.groups for solid in group)

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(solid.name for solid in self.solids)

    @property
    def cells(self) -> Ints:
        """Local cells of all of them."""
        return np.concatenate([solid.cells for solid in self.solids])


def joined_bodies(problem: Equilibrium, tied: Sequence[bool] | None = None) -> list[JoinedBodies]:
    """All bodies, in the order of the first of each; the same on all ranks; collective.

    Args:
        problem: the equilibrium.
        tied: of each contact, whether it is a tie that counts (between two bodies: nothing is tied
            to a tool); None: those that act at present.
    """
    if tied is None:
        tied = [term.tied and term.active for term in problem.contacts]
    groups = bonded_groups(problem)
    number = {solid.name: at for at, group in enumerate(groups) for solid in group}
    of = list(range(len(groups)))
    for term, counts in zip(problem.contacts, tied, strict=True):
        if counts:
            pair = bodies_of(problem, term)
            first, second = sorted(of[number[one.name]] for one in (pair.slave, pair.master))
            of = [first if one == second else one for one in of]
    return [
        JoinedBodies(
            tuple(tuple(group) for at, group in enumerate(groups) if of[at] == first),
        )
        for first in dict.fromkeys(of)
    ]
