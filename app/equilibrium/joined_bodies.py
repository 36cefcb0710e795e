"""Bodies that move as one: those that common nodes or ties join."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tribox.app.equilibrium.bonded import bonded_groups
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.pair_bodies import bodies_of
from tribox.app.equilibrium.rigid_tool import RigidTool
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs


@dataclass(frozen=True, slots=True)
class Grip:
    """A surface that is tied to a tool.

    Attributes:
        tool: that grips; nodes: owned local nodes of the surface.
    """

    tool: RigidTool
    nodes: Ints

    def resisted(self, problem: Equilibrium, moved: Floats, free: Bools) -> Floats:
        """What is left of motions (n, i, r) of the nodes when the tool has followed; collective.

        Args:
            problem: the equilibrium.
            moved: see above.
            free: (k,) slots of the tool that nothing holds.
        """
        place = problem.space.tabulate_dof_coordinates()[self.nodes, : problem.dim]
        points = self.tool.surface.shares(place)
        carried = np.einsum("na,aik->nik", points, self.tool.motion.tangent(0.0))
        rows, own = place.size, int(np.count_nonzero(free))
        follow = carried[:, :, : len(free)][:, :, free].reshape(rows, own)
        flat = moved.reshape(rows, moved.shape[2])
        sums = problem.comm.allreduce(follow.T @ np.concatenate([follow, flat], axis=1))
        out = flat - follow @ (np.linalg.pinv(sums[:, :own]) @ sums[:, own:])
        left: Floats = out.reshape(moved.shape)
        return left


@dataclass(frozen=True, slots=True)
class JoinedBodies:
    """Bodies that are supported, or not, together.

    Attributes:
        groups: bodies, those together that share nodes; ties join the groups.
        grips: contacts that tie one of them to a tool.
    """

    groups: tuple[tuple[Solid, ...], ...]
    grips: tuple[Grip, ...] = ()

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
        tied: of each contact, whether it is a tie that counts; None: those that act at present.
    """
    if tied is None:
        tied = [term.tied and term.active for term in problem.contacts]
    groups = bonded_groups(problem)
    number = {solid.name: at for at, group in enumerate(groups) for solid in group}
    of, grips = list(range(len(groups))), []
    for term, counts in zip(problem.contacts, tied, strict=True):
        if counts:
            pair = bodies_of(problem, term)
            if isinstance(pair.master, RigidTool):
                grip = Grip(pair.master, _owned(problem, term.surface.slave.nodes))
                grips.append((number[pair.slave.name], grip))
                continue
            first, second = sorted(of[number[one.name]] for one in (pair.slave, pair.master))
            of = [first if one == second else one for one in of]
    return [
        JoinedBodies(
            tuple(tuple(group) for at, group in enumerate(groups) if of[at] == first),
            tuple(grip for at, grip in grips if of[at] == first),
        )
        for first in dict.fromkeys(of)
    ]


def _owned(problem: Equilibrium, nodes: Longs) -> Ints:
    """Owned local nodes, each once, of the global ``nodes``, that any rank names; collective."""
    first, last = problem.space.dofmap.index_map.local_range
    every = np.unique(np.concatenate(problem.comm.allgather(np.unique(nodes))))
    return (every[(every >= first) & (every < last)] - first).astype(np.int32)
