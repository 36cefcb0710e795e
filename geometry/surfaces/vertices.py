"""Vertices of a pair's slave facets: averages of point values, the same on every rank.

Axis letters: v vertices, q slave points, k vertices of a slave facet. The linear shape functions
N_A of the vertices serve for facets of any degree: they are never negative, so that the mean of a
gap that is closed everywhere is closed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.geometry.surfaces.facets import Bools, FacetShape, Floats, Longs, facet_shape

# -- Lines of nodes in the plane: their order, which no partition of the mesh changes, and shape ---


STRAIGHT = 1e-7  # distance from a straight line, over the size, that is none: R > 1e6 lengths


def order_by_place(position: Floats) -> Longs:
    """Order of points (q, i), by x first; round-off that depends on the partition has no effect."""
    size = float(np.ptp(position, axis=0).max()) or 1.0
    # The offset moves round numbers away from the points where the rounding changes.
    steps = np.floor((position - position.min(axis=0)) / (1e-8 * size) + 0.3183)
    return np.lexsort(steps.T[::-1])


def chains(facets: Longs) -> Iterator[Longs]:
    """Vertices of each connected piece of a surface in the plane, one after the other.

    Open pieces come first and begin at the end with the smaller number; a closed one begins at its
    smallest number, which is there again at its end.

    Args:
        facets: (f, 2) vertices of the segments.
    """
    beside: dict[int, list[int]] = {}
    for a, b in ((int(a), int(b)) for a, b in facets):
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    ends = sorted(v for v, others in beside.items() if len(others) == 1)
    left = set(beside)
    for start in (*ends, *sorted(beside)):
        if start in left:
            yield np.array(_piece(start, beside, left), dtype=np.int64)


def _piece(start: int, beside: dict[int, list[int]], left: set[int]) -> list[int]:
    """The vertices from one on, as long as there are more; taken out of ``left``."""
    piece, here = [start], start
    left.remove(start)
    while onward := [v for v in sorted(beside[here]) if v in left]:
        here = onward[0]
        left.remove(here)
        piece.append(here)
    if len(piece) > 2 and start in beside[here]:
        piece.append(start)
    return piece


def tangent_angles(place: Floats) -> Floats:
    """Angle (n,), rad, of the tangent at the nodes of a line against x, without jumps of 2π.

    That of the parabola through the node and its neighbours, at an end through the nearest three,
    over the length of the chords: off by the square of their length.

    Args:
        place: (n, i), m, of nodes one after the other.
    """
    steps = np.diff(place, axis=0)
    length = np.linalg.norm(steps, axis=1)
    turned = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    if len(turned) == 1:
        return np.repeat(turned, 2)
    share = length[:-1] / (length[:-1] + length[1:])
    inner = turned[:-1] + share * np.diff(turned)
    first, last = 2.0 * turned[0] - inner[0], 2.0 * turned[-1] - inner[-1]
    out: Floats = np.concatenate([[first], inner, [last]])
    return out


def line_curvatures(place: Floats) -> Floats:
    """Curvature (n,), 1/m, > 0 to the left, at the nodes of a line; at its ends the neighbour's.

    One over the radius of the circle through the node and its two neighbours.

    Args:
        place: (n, i), m, of nodes one after the other.
    """
    if len(place) < 3:
        return np.zeros(len(place))
    a, b = place[1:-1] - place[:-2], place[2:] - place[1:-1]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    sides = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    inner = 2.0 * area / (sides * np.linalg.norm(a + b, axis=1))
    out: Floats = np.concatenate([inner[:1], inner, inner[-1:]])
    return out


def straight_angle(place: Floats, about: float) -> float:
    """Angle, rad, of the straight line nearest to places (n, i), m; the one next to ``about``."""
    apart = place - place.mean(axis=0)
    _, vectors = np.linalg.eigh(apart.T @ apart)
    angle = float(np.arctan2(vectors[1, -1], vectors[0, -1]))
    return angle + np.pi * round((about - angle) / np.pi)


def fitted_circle(place: Floats) -> tuple[float, float]:
    """Radius of the circle nearest to places (n, i) and the root mean square of what is off it, m.

    The sum of squared distances from the circle is least (Gauss and Newton's method from the
    algebraic circle of Kåsa). The radius is infinite where places are straight, or fewer than 3.
    """
    middle = place.mean(axis=0)
    at = place - middle
    size = float(np.sqrt((at**2).sum(axis=1).max(initial=0.0)))
    if len(place) < 3 or size == 0.0:
        return np.inf, 0.0
    at = at / size
    flat = np.linalg.svd(at, compute_uv=False)[-1]
    if flat < STRAIGHT * np.sqrt(len(at)):
        return np.inf, float(flat * size / np.sqrt(len(at)))
    rows = np.column_stack([2.0 * at, np.ones(len(at))])
    centre = np.linalg.lstsq(rows, (at**2).sum(axis=1), rcond=None)[0][:2]
    for _ in range(20):
        apart = at - centre
        distance = np.linalg.norm(apart, axis=1)
        radius = float(distance.mean())
        jacobian = -apart / distance[:, None]
        jacobian -= jacobian.mean(axis=0)
        change = np.linalg.lstsq(jacobian, radius - distance, rcond=None)[0]
        centre = centre + change
        if np.linalg.norm(change) <= 1e-12 * radius:
            break
    distance = np.linalg.norm(at - centre, axis=1)
    off = float(np.sqrt(np.mean((distance - distance.mean()) ** 2)))
    return float(distance.mean()) * size, off * size


def distances_to_line(place: Floats, line: Floats) -> Floats:
    """Shortest distances (n,), m, of places (n, i) from the chords of a line of nodes (m, i)."""
    start, along = line[:-1], np.diff(line, axis=0)
    apart = place[:, None] - start
    share = np.einsum("nmi,mi->nm", apart, along) / np.einsum("mi,mi->m", along, along)
    foot = apart - np.clip(share, 0.0, 1.0)[:, :, None] * along
    out: Floats = np.sqrt(np.einsum("nmi,nmi->nm", foot, foot).min(axis=1))
    return out


# -- Vertices of a pair's slave facets: averages of point values, the same on every rank -----------


@dataclass(frozen=True, slots=True)
class SlaveVertices:
    """The vertices of all slave facets, in an order that does not depend on the ranks.

    Attributes:
        nodes: (v,) global nodes (displacement blocks).
        position: (v, i), m, reference.
        of_point: (q, k) vertices of the facet of each point of this rank.
        shape: (q, k) their linear shape functions there.
        area: (v,) m_A = Σ_q w N_A: m, m² or, of rings, m².
        length: (v,) m: h_A, mean length of the slave facets around.
        shared: (v,) whether points of more than one rank have this vertex.
        comm: of the mesh.
    """

    nodes: Longs
    position: Floats
    of_point: Longs
    shape: Floats
    area: Floats
    length: Floats
    shared: Bools
    comm: MPI.Comm

    @property
    def count(self) -> int:
        """Number of vertices."""
        return len(self.nodes)

    def sums(self, values: Floats) -> Floats:
        """Σ_q N_A f_q (v,) of point values ``values`` (q,), over all ranks; collective."""
        local: Floats = np.bincount(
            self.of_point.reshape(-1),
            (self.shape * values[:, None]).reshape(-1),
            minlength=self.count,
        ).astype(np.float64, copy=False)
        return self.total(local)

    def at_points(self, values: Floats) -> Floats:
        """Σ_A N_A f_A (q,) of vertex values ``values`` (v,)."""
        out: Floats = np.einsum("qk,qk->q", self.shape, values[self.of_point])
        return out

    def on_all_ranks(self, here: bool) -> bool:
        """Whether something holds on all ranks; collective."""
        if self.comm.size == 1:
            return here
        return bool(self.comm.allreduce(here, op=MPI.LAND))

    def total(self, local: Floats) -> Floats:
        """Sum over all ranks of vertex values ``local`` (…, v); collective."""
        if self.comm.size == 1:
            return local
        total = np.empty_like(local)
        self.comm.Allreduce(local, total, op=MPI.SUM)
        return total


def slave_vertices(
    space: dolfinx.fem.FunctionSpace,
    form: FacetShape,
    nodes: Longs,
    xi: Floats,
    weight: Floats,
    size: Floats,
) -> SlaveVertices:
    """Collect the vertices; collective.

    Args:
        space: of the displacement.
        form: shape of the facets; their corners come first.
        nodes: (q, a) global nodes of each point's facet.
        xi: (q, α) reference coordinates of the points on their facets.
        weight: (q,) quadrature weights, of whole rings with axial symmetry.
        size: (q,) m, length of each point's facet.
    """
    comm = space.mesh.comm
    corners = nodes[:, : form.corners]
    mine = np.unique(corners)
    distinct = np.unique(np.concatenate(comm.allgather(mine)))
    place = _positions(space, mine, distinct)
    order = order_by_place(place)
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    present = np.zeros(len(order), dtype=np.int64)
    present[number[np.searchsorted(distinct, mine)]] = 1
    out = SlaveVertices(
        nodes=distinct[order],
        position=place[order],
        of_point=number[np.searchsorted(distinct, corners)],
        shape=facet_shape(form.cell, 1).values(xi),
        area=np.ones(len(order)),
        length=np.ones(len(order)),
        shared=comm.allreduce(present, op=MPI.SUM) > 1,
        comm=comm,
    )
    out.area[:] = out.sums(weight)
    out.length[:] = out.sums(weight * size) / out.area
    return out


def _positions(space: dolfinx.fem.FunctionSpace, mine: Longs, distinct: Longs) -> Floats:
    """Reference positions (v, i) of the ``distinct`` global nodes; collective."""
    index = space.dofmap.index_map
    local = index.global_to_local(mine)
    dim = space.mesh.geometry.dim
    here = space.tabulate_dof_coordinates()[local][:, :dim]
    out = np.empty((len(distinct), dim))
    for numbers, places in space.mesh.comm.allgather((mine, here)):
        out[np.searchsorted(distinct, numbers)] = places
    return out
