"""The bodies that their supports leave free to move as a whole, in any direction or by turning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.constraints import Platen
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.joined_bodies import JoinedBodies, joined_bodies
from tribox.app.equilibrium.slanted import SlantedPlaten
from tribox.app.equilibrium.supports import body_nodes, free_slots, sprung_dofs
from tribox.forms.bodies.loads import Foundation
from tribox.geometry.surfaces.facets import Floats, Ints

SINGULAR = 1e-9  # least over largest eigenvalue of what supports do to rigid motions of a free body


@dataclass(frozen=True, slots=True)
class FreeBody:
    """A body, or several that are joined, with a rigid motion that no support prevents.

    Attributes:
        joined: the bodies; nodes: local nodes that this rank owns.
        extent: m, its largest along an axis.
    """

    joined: JoinedBodies
    nodes: Ints
    extent: float

    @property
    def name(self) -> str:
        """The name, or the names of joined bodies."""
        return " and ".join(self.joined.names)


def free_bodies(problem: Equilibrium) -> list[FreeBody]:
    """The bodies that the constraints at hand leave free, undeformed; collective.

    Bodies that common nodes or ties join are one, with what supports any of them. A platen under a
    given force keeps its surface from turning, springs and foundations hold, as do tools that a
    surface is tied to.
    """
    return [body for one in joined_bodies(problem) if (body := _free(problem, one)) is not None]


def supports_at_hand(problem: Equilibrium) -> tuple[object, ...]:
    """What :func:`free_bodies` depends on, and stages change; the same on all ranks."""
    ties = tuple(term.active for term in problem.contacts if term.tied)
    beds = tuple(load.acts for load in problem.loads if isinstance(load, Foundation))
    return problem.constraints.controls, ties, beds


def _free(problem: Equilibrium, joined: JoinedBodies) -> FreeBody | None:
    nodes = body_nodes(problem, joined.cells)
    modes, extent = motions_of(problem, nodes, joined.solids[0].section == "axisymmetric")
    mine = nodes[:, None] * problem.dim + np.arange(problem.dim)
    beds = [load.held for load in problem.loads if isinstance(load, Foundation) and load.acts]
    resisted = np.isin(mine, np.concatenate([problem.constrained_dofs(), *beds]))
    gram = problem.comm.allreduce(np.einsum("nai,nbi,ni->ab", modes, modes, resisted))
    for platen in problem.platens:
        oblique = isinstance(platen, SlantedPlaten)
        if platen.acts and (oblique or platen.displacement is None):
            gram = gram + _as_one(problem, platen, modes, mine)
    for grip in joined.grips:
        moved = modes.transpose(0, 2, 1)[np.searchsorted(nodes, grip.nodes)]
        free = free_slots(problem, grip.tool, sprung_dofs(problem))
        left = grip.resisted(problem, moved, free)
        gram = gram + problem.comm.allreduce(np.einsum("nia,nib->ab", left, left))
    return None if leave_none(problem, gram, nodes) else FreeBody(joined, nodes, extent)


def motions_of(
    problem: Equilibrium, nodes: Ints, axisymmetric: bool = False
) -> tuple[Floats, float]:
    """Rigid motions of a body in the measure of its extent; collective.

    Args:
        problem: the equilibrium.
        nodes: (n,) local ones of the body that this rank owns.
        axisymmetric: whether it is a body of revolution.

    Returns:
        The motions (n, r, i), and the body's largest extent along an axis, m.
    """
    at = problem.space.tabulate_dof_coordinates()[nodes, : problem.dim]
    ends = np.stack([at.max(axis=0, initial=-np.inf), -at.min(axis=0, initial=np.inf)])
    problem.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
    extent, middle = float(ends.sum(axis=0).max()), 0.5 * (ends[0] - ends[1])
    return rigid_motions((at - middle) / extent, axisymmetric), extent


def leave_none(problem: Equilibrium, gram: Floats, nodes: Ints) -> bool:
    """Whether supports leave no motion of a body free; collective.

    Args:
        problem: the equilibrium.
        gram: (r, r), what the supports do to the motions, summed over all ranks.
        nodes: local ones of the body that this rank owns.
    """
    values = np.linalg.eigvalsh(gram)
    count = problem.comm.allreduce(len(nodes))
    return bool(values[0] > SINGULAR * max(values[-1], 1.0 / max(count, 1)))


def rigid_motions(place: Floats, axisymmetric: bool = False) -> Floats:
    """Small rigid motions (n, r, i) of places (n, i): along the axes, then about them.

    A body of revolution moves along its axis only.
    """
    count, dim = place.shape
    along = np.broadcast_to(np.eye(dim), (count, dim, dim))
    if axisymmetric:
        return along[:, 1:2]
    if dim == 2:
        about: Floats = np.stack([-place[:, 1], place[:, 0]], axis=1)[:, None]
    else:
        about = np.asarray(np.cross(np.eye(3)[None], place[:, None]), dtype=np.float64)
    return np.concatenate([along, about], axis=1)


def _as_one(problem: Equilibrium, platen: Platen, modes: Floats, mine: Ints) -> Floats:
    """What a platen does (r, r) to the motions of a body: its nodes move alike; collective."""
    here = np.isin(mine, platen.dofs)
    rows: Floats = modes.transpose(0, 2, 1)[here]
    if isinstance(platen, SlantedPlaten):
        rows = modes[here.all(axis=1)] @ platen.normal
    local = np.concatenate([rows.sum(axis=0), [len(rows)]])
    total = problem.comm.allreduce(local)
    mean = total[:-1] / max(total[-1], 1.0)
    fixed = platen.stiffness > 0.0 or platen.displacement is not None
    apart = rows if fixed else rows - mean
    out: Floats = problem.comm.allreduce(apart.T @ apart)
    return out
