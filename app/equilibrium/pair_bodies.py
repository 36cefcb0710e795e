"""Which bodies a contact is between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.rigid_tool import RigidTool
from tribox.forms.bodies.contact_stiffness import contact_shear_modulus
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.penalty import ContactTerm
from tribox.geometry.surfaces.facets import Longs


@dataclass(frozen=True, slots=True)
class PairBodies:
    """The bodies of one contact.

    Attributes:
        slave, master: the bodies whose surfaces they are; a master may be a tool.
    """

    slave: Solid
    master: Solid | RigidTool

    @property
    def softer(self) -> Solid:
        """The body that bends and bulges more easily, whose stiffness the penalty is one of."""
        if isinstance(self.master, RigidTool):
            return self.slave
        return min(self.slave, self.master, key=lambda solid: contact_shear_modulus(solid.material))


def bodies_of(problem: Equilibrium, term: ContactTerm) -> PairBodies:
    """The bodies that a contact's surfaces belong to; collective."""
    owners = [_nodes_of(problem, solid) for solid in problem.solids]
    surface = term.surface

    def owner(nodes: Longs) -> Solid:
        counts = np.array([np.count_nonzero(np.isin(nodes, mine)) for mine in owners])
        return problem.solids[int(np.argmax(problem.comm.allreduce(counts)))]

    slave = owner(np.unique(surface.slave.nodes))
    tools = [t for t in problem.tools if np.array_equal(t.nodes, surface.own_master)]
    return PairBodies(slave, tools[0] if tools else owner(np.unique(surface.own_master)))


def _nodes_of(problem: Equilibrium, solid: Solid) -> Longs:
    """Global nodes of this rank's cells of a solid."""
    dofmap = problem.space.dofmap
    local = np.unique(dofmap.list[solid.cells]).astype(np.int32)
    nodes: Longs = dofmap.index_map.local_to_global(local).astype(np.int64)
    return nodes
