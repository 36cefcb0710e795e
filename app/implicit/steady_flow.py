"""Metal that flows through tools at rest, as in drawing.

What passes a tool at rest moves at each place as what was there a step ago, not as it did itself.
The increments of the last steps are therefore taken at the places, not at the nodes, and their
mean over two steps evens out that nodes pass an edge of the tool one by one. Axis letters: n
nodes of the body, p points, c cells, a nodes of a cell, k cells near a point.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.forms.bodies.solid import Solid
from tribox.geometry.meshes.places import (
    centre,
    clipped,
    excess,
    places_from_centre,
    shape_functions,
)
from tribox.geometry.surfaces.facets import Floats

STEPS = 2  # of which the increments are averaged
NEAR = 6  # cells, by their middles, among which a point's is looked for


class SteadyFlow:
    """A body's nodes, and how they move on if its flow is steady in space.

    Attributes:
        nodes: (n,) local numbers of its nodes.
    """

    def __init__(self, problem: Equilibrium, solid: Solid) -> None:
        """Find the nodes of ``solid``, all of which this rank has."""
        space, self._kind = problem.space, solid.cell
        self._degree: int = space.element.basix_element.degree
        rows = space.dofmap.list[solid.cells]
        self.nodes, cells = np.unique(rows, return_inverse=True)
        self._cells = cells.reshape(rows.shape)
        self._places: Floats = space.tabulate_dof_coordinates()[self.nodes][:, : problem.dim]
        self._count = np.bincount(self._cells.ravel())

    def onwards(self, path: Sequence[tuple[float, Floats]], at: float) -> Floats:
        """Displacements (n, i), m, at the parameter ``at`` of a path of states, the last first.

        Args:
            path: parameter and displacements (nodes, i), m, of two states at least.
        """
        steps = list(zip(path[1:], path[:-1], strict=True))[:STEPS]
        last, here = path[0]
        places = self._places + here[self.nodes]
        moved = [
            self.carried(
                self._places + before[self.nodes],
                (at - last) / (end - begin) * (after - before)[self.nodes],
                places,
            )
            for (begin, before), (end, after) in steps
        ]
        return here[self.nodes] + sum(moved) / len(moved)

    def carried(self, places: Floats, values: Floats, at: Floats) -> Floats:
        """``values`` (n, i) of nodes at ``places`` (n, i), m, interpolated at points (p, i), m.

        Of second order, also with first-order cells: half of what the slope at each node adds up to
        is added to its value. Points outside get what the body has beside them.
        """
        x = places[self._cells]
        table = shape_functions(self._kind, self._degree, 1, centre(self._kind))[:, 0]
        edges = np.einsum("za,cai->ciz", table[1:], x)
        inverse = np.linalg.inv(edges)
        middle = np.einsum("a,cai->ci", table[0], x)
        near = cKDTree(middle).query(at, k=min(NEAR, len(x)))[1].reshape(len(at), -1)
        away = at[:, None] - middle[near]
        xi = centre(self._kind) + np.einsum("pkzi,pki->pkz", inverse[near], away)
        outside = excess(self._kind, xi.reshape(-1, xi.shape[-1])).reshape(near.shape)
        cell = near[np.arange(len(at)), outside.argmin(axis=1)]
        xi = places_from_centre(self._kind, self._degree, x[cell], at)
        weights = shape_functions(self._kind, self._degree, 0, clipped(self._kind, xi))[0]
        found = values[self._cells[cell]]
        if self._degree == 1:
            slopes = self._slopes(np.einsum("za,czi->cai", table[1:], inverse), values)
            foot = np.einsum("pa,pai->pi", weights, x[cell])
            from_node = foot[:, None] - x[cell]
            found = found + 0.5 * np.einsum("paij,paj->pai", slopes[self._cells[cell]], from_node)
        return np.einsum("pa,pai->pi", weights, found)

    def _slopes(self, gradients: Floats, values: Floats) -> Floats:
        """Slopes (n, i, j) at the nodes: means of those in the cells (c, a, j) around them."""
        in_cells = np.einsum("caj,cai->cij", gradients, values[self._cells])
        sums = np.zeros((len(self.nodes), *in_cells.shape[1:]))
        np.add.at(sums, self._cells.ravel(), np.repeat(in_cells, self._cells.shape[1], axis=0))
        return sums / self._count[:, None, None]


def steady_flows(problem: Equilibrium) -> list[SteadyFlow]:
    """Of the bodies that flow in the plane; none on several ranks, each of which knows a part."""
    if problem.comm.size > 1 or problem.dim == 3:
        return []
    return [SteadyFlow(problem, solid) for solid in problem.solids if solid.flows]
