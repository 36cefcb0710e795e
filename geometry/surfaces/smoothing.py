r"""A smooth surface through the nodes of straight segments or bilinear quadrilaterals.

Axis letters: f facets, a corners of a facet, c control points of a patch, m nodes of its stencil,
n nodes, e directed edges (from a node to a neighbour), i space.

Every facet is replaced by a cubic (bicubic) Hermite patch through the same nodes. The patch is
linear in the positions of the nodes, of its own facet and of those around it, with coefficients
fixed in the reference configuration,

.. math:: C_c = \sum_m E_{cm} y_m, \qquad \bar y(\xi) = \sum_c N_c(\xi) C_c,

so variations, energy and momentum are as exact as with the facets themselves. Tangents at a node
are central differences along its grid lines; at an inner node with another number of edges than
four, the first harmonic of the edges round the node (Loop & Schaefer, ACM Trans. Graph. 27 (2008)
8:1, for Catmull-Clark surfaces). The normal is continuous along chains of segments and over grids
of quadrilaterals, exactly at all nodes and nearly so elsewhere. Sides sharper than the smoothing
angle stay sharp.

At a plane of symmetry the surface goes on as its image (:mod:`tribox.geometry.surfaces.images`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.facets import (
    Bools,
    FacetShape,
    Floats,
    Ints,
    Longs,
    facet_shape,
    unit_normals,
)
from tribox.geometry.surfaces.images import Images

Sparse: TypeAlias = scipy.sparse.csr_matrix


@dataclass(slots=True)
class Patches:
    """Smooth patches, one for each facet."""

    shape: FacetShape  # of the patches, of degree 3
    stencil: Ints  # (f, m) nodes that move each patch
    extraction: Floats  # (f, c, m) control points from the positions of these nodes
    one_sided: Bools  # (f,) whether tangents at an end of the surface are one-sided
    images: Images | None  # of nodes, which are the last ones in ``stencil``; None: there are none


@dataclass(slots=True)
class _Edges:
    """Directed edges and their order round the nodes."""

    ends: Ints  # (e, 2) from, to
    reverse: Longs  # (e,) the same edge the other way
    length: Floats  # (e,), m, reference
    along: Longs  # (f, a, α) edges from each corner of each facet, the first along ξ
    opposite: Longs  # (e,) edge that continues this one backwards beyond the first node; −1: none
    turn: Longs  # (e,) next edge counter-clockwise at the first node, −1 past the last
    valence: Longs  # (e,) number of edges round the first node if it is inside the surface, else 0


def smooth_patches(
    shape: FacetShape,
    facets: Ints,
    nodes: Floats,
    smoothing_angle: float,
    rings: bool = False,
    images: Images | None = None,
) -> Patches:
    """Smooth patches over facets (f, a), ordered for outward normals; ValueError of a shape.

    Of straight segments or bilinear quadrilaterals between ``nodes`` (n, i), m; sides are sharp
    from ``smoothing_angle``, rad, on. ``rings``: see :func:`towards_axis`; ``images``: what
    continues the surface; theirs are the last of the nodes.
    """
    if shape.degree != 1 or shape.cell == "triangle":
        raise ValueError(
            "a smooth master needs first-order displacements on quadrilaterals or hexahedra, "
            f"not facets of degree {shape.degree} on a {shape.cell}"
        )
    own, facets = len(facets), facets if images is None else np.append(facets, images.facets, 0)
    edges = _edges(shape, facets, nodes)
    sharp = _sharp_nodes(shape, facets, nodes, smoothing_angle)
    tangents = _tangents(edges, sharp, len(nodes))
    at_end = np.zeros(len(nodes), dtype=bool)
    at_end[edges.ends[(edges.opposite < 0) & (edges.valence == 0), 0]] = True
    if rings:
        smoothness = towards_axis(facets, nodes)
        chord = _rows(_slopes(edges, len(nodes)), np.arange(len(edges.ends)), edges.length)
        share = scipy.sparse.diags(smoothness[edges.ends[:, 0]])
        tangents = (chord + share @ (tangents - chord)).tocsr()
        at_end &= smoothness > 0.0
    parts = _corner_parts(shape, facets, edges, tangents, sharp, len(nodes))
    stencil, extraction = _patches(facet_shape(shape.cell, 3), parts)
    one_sided: Bools = np.any(at_end[facets], axis=1)
    cubic, first = facet_shape(shape.cell, 3), slice(own)
    return Patches(cubic, stencil[first], extraction[first], one_sided[first], images)


# -- Rings ----------------------------------------------------------------------------------------

AXIS = 1e-9  # of a line's extent, within which a node is on the axis
FACETS_TO_AXIS = 6  # over which smoothness fades


def on_axis(nodes: Floats) -> Bools:
    """Which nodes (n, i), m, of rings are on the axis (n,)."""
    return np.abs(nodes[:, 0]) <= AXIS * np.ptp(nodes, axis=0).max()


def towards_axis(facets: Ints, nodes: Floats) -> Floats:
    r"""Share (n,) of the smooth tangents at the nodes of rings, the rest being chords.

    Uniform pressure on rings of linear facets of the length h asks for the loads
    :math:`2\pi p h^2 (1/6, 1, 2, 3, \ldots)` of the nodes from the axis on. With the shares w_A of
    the nodes in a surface that is exact for parabolas

    .. math:: \sum_{A \le n} \int w_A r\,dr = \tfrac12 (n + \tfrac12)^2 h^2 + \tfrac12 v,

    v being the variance of the step that :math:`\sum w_A` is at n: h²/12 of chords, −h²/12 of
    cubics. So whatever is done near the axis, the nodes there lack half of what the one on it is to
    have, 2πph²/12. Smoothness that grows by k² with the number of facets to the axis spreads that
    over nodes of larger rings: none lacks more than 1/62 of its load.

    Args:
        facets: (f, a) segments; nodes: (n, i), m, reference.
    """
    away = np.full(len(nodes), np.inf)
    away[on_axis(nodes)] = 0.0
    start, end = facets[:, 0], facets[:, 1]
    for _ in range(FACETS_TO_AXIS):
        np.minimum.at(away, end, away[start] + 1.0)
        np.minimum.at(away, start, away[end] + 1.0)
    return np.minimum(away**2 / 31.0, 1.0)


# Corner that lies next to each corner along ξ, and along η.
_ALONG = {"interval": ((1,), (0,)), "quadrilateral": ((1, 2), (0, 3), (3, 0), (2, 1))}
# Corner after and before each corner, counter-clockwise.
_AFTER, _BEFORE = (1, 3, 0, 2), (2, 0, 3, 1)
_MOST = 12  # edges round a node that are looked for


def _edges(shape: FacetShape, facets: Ints, nodes: Floats) -> _Edges:
    """Directed edges of all facets."""
    corners = np.array(_ALONG[shape.cell])
    start = np.broadcast_to(facets[:, :, None], (*facets.shape, shape.directions))
    count = np.int64(len(nodes))
    keys = start * count + facets[:, corners]
    distinct, along = np.unique(keys, return_inverse=True)
    along = along.reshape(keys.shape).astype(np.int64)
    ends = np.stack([distinct // count, distinct % count], axis=1)
    reverse = np.searchsorted(distinct, ends[:, 1] * count + ends[:, 0])
    turn = np.full(len(ends), -1, dtype=np.int64)
    if shape.directions == 2:
        after, before = facets[:, _AFTER], facets[:, _BEFORE]
        first = np.searchsorted(distinct, facets * count + after)
        turn[first] = np.searchsorted(distinct, facets * count + before)
    # Number of edges (e,) round the first node of each, 0 at the end of the surface.
    out = np.zeros(len(turn), dtype=np.int64)
    here: Longs = np.arange(len(turn), dtype=np.int64)
    for step in range(1, _MOST + 1):
        here = np.where(here >= 0, turn[here], -1)
        # Back at the edge that it began with: the node is inside, and has so many.
        out[(here == np.arange(len(turn))) & (out == 0)] = step
    valence = out
    opposite = _across_node(ends[:, 0], turn, valence)
    length = np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1)
    return _Edges(ends.astype(np.int32), reverse, length, along, opposite, turn, valence)


def _across_node(start: Longs, turn: Longs, valence: Longs) -> Longs:
    """Edge (e,) that continues each backwards through its first node, −1 where none does."""
    opposite = np.full(len(turn), -1, dtype=np.int64)
    # Of four edges round a node the next but one goes on straight.
    grid = np.nonzero(valence == 4)[0]
    opposite[grid] = turn[turn[grid]]
    # At the end of the surface: the two outer edges of a node with two facets, or two segments.
    follows = np.zeros(len(turn), dtype=bool)
    follows[turn[turn >= 0]] = True
    count = np.bincount(start)[start]
    segments = not (turn >= 0).any()
    outer = np.nonzero(
        (valence == 0) & ((turn < 0) | ~follows) & (count == (2 if segments else 3))
    )[0]
    order = outer[np.argsort(start[outer], kind="stable")]
    pairs = order[: 2 * (len(order) // 2)].reshape(-1, 2)
    pairs = pairs[start[pairs[:, 0]] == start[pairs[:, 1]]]
    opposite[pairs[:, 0]], opposite[pairs[:, 1]] = pairs[:, 1], pairs[:, 0]
    return opposite


def _sharp_nodes(shape: FacetShape, facets: Ints, nodes: Floats, smoothing_angle: float) -> Bools:
    """Nodes (n,) on a side where the normals of its facets differ by more than the angle (rad)."""
    sharp = np.zeros(len(nodes), dtype=bool)
    shared = shared_sides(shape, facets, nodes)
    sharp[shared.ends[shared.angle > smoothing_angle]] = True
    return sharp


@dataclass(frozen=True, slots=True)
class SharedSides:
    """Sides (in the plane: ends) that two facets share."""

    facets: Longs  # (s, 2) the facets
    ends: Ints  # (s, k) nodes of the side
    # (s,), rad, between the normals in the middles of the facets; of those of higher degree, which
    # are curved, in the middle of the side
    angle: Floats


def shared_sides(shape: FacetShape, facets: Ints, nodes: Floats) -> SharedSides:
    """The sides that two facets (f, a), between nodes (n, i), m, share."""
    sides = [side.nodes for side in shape.sides]
    normal = _side_normals(shape, nodes[facets])
    ends: Ints = np.concatenate([facets[:, list(side)] for side in sides])
    ends.sort(axis=1)
    owner = np.tile(np.arange(len(facets)), len(sides))
    order = np.lexsort(ends.T)
    same = np.all(ends[order[1:]] == ends[order[:-1]], axis=1)
    both = np.stack([order[1:][same], order[:-1][same]], axis=1)
    one, other = normal[both].transpose(1, 0, 2)
    # By the chord between the unit normals: exact for small angles too.
    angle = 2.0 * np.arcsin(0.5 * np.minimum(np.linalg.norm(one - other, axis=1), 2.0))
    return SharedSides(owner[both], ends[both[:, 0]], angle)


def _side_normals(shape: FacetShape, corners: Floats) -> Floats:
    """Unit normals (side·f, i) of facets (f, a, i) that :class:`SharedSides` compares."""
    middle: Floats = shape.points.mean(axis=0)
    curved = shape.degree > 1
    at = np.array([s.origin + 0.5 * s.direction if curved else middle for s in shape.sides])
    tangents = np.einsum("sba,fai->sfbi", shape.first(at), corners)
    return unit_normals(tangents.reshape(-1, *tangents.shape[2:]))


def corner_spacing(
    shape: FacetShape, facets: Ints, nodes: Floats, least: float, most: float
) -> tuple[Floats, Floats]:
    """How far apart the corners of a round surface made of facets are: (f,), m, and angles (f,).

    Facets that meet at less than ``least`` are one: new nodes of a refined mesh lie on the old
    chords. Such a piece is as wide as its area over half the length of its ends, taken across the
    direction in which these are longest. A corner is between the narrower of its two pieces and the
    next: flats beside arcs do not count. Facets without a corner at their own sides have 0.

    Args:
        facets: (f, a) their nodes.
        nodes: (n, i), m.
        least: rad, angle between neighbours up to which they are straight on.
        most: rad, from which on they form an edge that is meant.
    """
    shared = shared_sides(shape, facets, nodes)
    straight = shared.angle <= least
    corner = (shared.angle > least) & (shared.angle < most)
    spacing, angle = np.zeros(len(facets)), np.zeros(len(facets))
    if not corner.any():
        return spacing, angle
    # Loaded only here: a run without corners has no use for it.
    from scipy.sparse.csgraph import connected_components

    size = (len(facets), len(facets))
    graph = scipy.sparse.coo_matrix(
        (np.ones(np.count_nonzero(straight)), tuple(shared.facets[straight].T)), shape=size
    )
    piece = connected_components(graph, directed=False)[1]
    width = _widths(shape, facets, nodes, piece, shared.ends[straight])
    beside = shared.facets[corner]
    apart = width[piece[beside]].min(axis=1)
    for side in beside.T:
        np.maximum.at(spacing, side, apart)
        np.maximum.at(angle, side, shared.angle[corner])
    return spacing, angle


def _widths(shape: FacetShape, facets: Ints, nodes: Floats, piece: Longs, inner: Ints) -> Floats:
    """Widths (p,), m, of pieces of a surface across their longer ends."""
    middle = shape.points[: shape.corners].mean(axis=0)[None]
    tangents = np.einsum("ba,fai->fbi", shape.first(middle)[0], nodes[facets])
    if shape.directions == 1:
        length = np.linalg.norm(tangents[:, 0], axis=1)
        return np.bincount(piece, length).astype(np.float64)
    normal = np.cross(tangents[:, 0], tangents[:, 1])
    area = np.linalg.norm(normal, axis=1) * (0.5 if shape.cell == "triangle" else 1.0)
    normal = unit_normals(tangents)
    ends = np.zeros((int(piece.max()) + 1, 3, 3))
    for side in shape.sides:
        mine = np.sort(facets[:, list(side.nodes)], axis=1)
        number = np.unique(np.concatenate([inner, mine]), axis=0, return_inverse=True)[1]
        is_end = ~np.isin(number[len(inner) :], number[: len(inner)])
        start, end = (nodes[facets[:, node]] for node in side.nodes[:2])
        # Σ |e| ν⊗ν over the ends, ν in the surface and across each: its largest eigenvalue is their
        # length where they are longest, both of them together.
        out = np.cross(end - start, normal) * is_end[:, None]
        length = np.linalg.norm(end - start, axis=1)
        np.add.at(ends, piece, out[:, :, None] * out[:, None] / length[:, None, None])
    return 2.0 * np.bincount(piece, area) / np.linalg.eigvalsh(ends)[:, -1]


def _rows(matrix: Sparse, index: Longs, factor: Floats) -> Sparse:
    """Rows of a matrix times a factor each, zero where the index is −1."""
    factor = np.where(index >= 0, factor, 0.0)
    return (scipy.sparse.diags(factor) @ matrix[np.maximum(index, 0)]).tocsr()


def _slopes(edges: _Edges, count: int) -> Sparse:
    """Slopes (e, n) of the edges."""
    row = np.repeat(np.arange(len(edges.ends)), 2)
    value = (np.array([1.0, -1.0]) / edges.length[:, None]).reshape(-1)
    at = (value, (row, edges.ends[:, ::-1].reshape(-1)))
    return scipy.sparse.csr_matrix(at, shape=(len(edges.ends), count))


def _tangents(edges: _Edges, sharp: Bools, count: int) -> Sparse:
    """Hermite tangents (e, n) at the first node of each edge."""
    size, h, slope = len(edges.ends), edges.length, _slopes(edges, count)
    free = ~sharp[edges.ends[:, 0]]
    everyone = np.arange(size)
    back = np.where(free, edges.opposite, -1)
    central = back >= 0
    beyond = np.where(central, h[back], 1.0)
    here = np.where(central, everyone, -1)
    # Central difference on unequal steps: the slope of the parabola through three nodes times h,
    # with the slope of the edge behind taken from the node, hence the minus.
    out = _rows(slope, here, h * beyond / (h + beyond)) - _rows(slope, back, h * h / (h + beyond))
    star = free & ~central & (edges.valence >= 3)
    turned = np.where(star, everyone, -1)
    valence = np.maximum(edges.valence, 1)
    for step in range(_MOST):
        # First harmonic (2/n) Σ_k cos(2πk/n) s_k of the slopes round the node; with n = 4 it is the
        # central difference.
        part = np.where(step < edges.valence, turned, -1)
        angle = 2.0 * np.pi * step / valence
        out = out + _rows(slope, part, 2.0 * h * np.cos(angle) / valence)
        turned = np.where(turned >= 0, edges.turn[turned], -1)
    shared = central | star
    # One-sided: the parabola that has the other end's tangent, or the chord.
    curved = np.where(~shared & free & shared[edges.reverse], edges.reverse, -1)
    chord = np.where(~shared, everyone, -1)
    factor = np.where(curved >= 0, 2.0 * h, h)
    one_sided = _rows(slope, chord, factor) + _rows(out, curved, np.ones(size))
    return (out + one_sided).tocsr()


def _twists(shape: FacetShape, facets: Ints, edges: _Edges, sharp: Bools, count: int) -> Sparse:
    """Mixed derivatives (f·a, n) at the corners of quadrilaterals, towards the facet's inside."""
    own = np.arange(facets.size)
    a, b = edges.along[..., 0].reshape(-1), edges.along[..., 1].reshape(-1)
    corner = facets.reshape(-1)
    diagonal = facets[:, ::-1].reshape(-1)
    column = np.stack([diagonal, edges.ends[a, 1], edges.ends[b, 1], corner], axis=1)
    area = edges.length[a] * edges.length[b]
    value = np.array([1.0, -1.0, -1.0, 1.0]) / area[:, None]
    twist = scipy.sparse.csr_matrix(
        (value.reshape(-1), (np.repeat(own, 4), column.reshape(-1))), shape=(facets.size, count)
    )
    # Facet corner (f·a,) counter-clockwise of each round its node, −1 past the last.
    along = edges.along
    # A corner's first edge is that along ξ at corners 0 and 3, along η at 1 and 2.
    first = np.stack([along[:, c, k] for c, k in enumerate((0, 1, 1, 0))], axis=1).reshape(-1)
    last = np.stack([along[:, c, k] for c, k in enumerate((1, 0, 0, 1))], axis=1).reshape(-1)
    owner = np.full(len(edges.ends), -1, dtype=np.int64)
    owner[first] = np.arange(facets.size)
    follower = owner[last]
    before = np.full(facets.size, -1, dtype=np.int64)
    before[follower[follower >= 0]] = own[follower >= 0]
    inside = (edges.valence[a] == 4) & ~sharp[corner]
    out = _rows(twist, np.where(sharp[corner], own, -1), area)
    here = np.where(inside, own, -1)
    # Mean over the four facets round a node. From one to the next both directions turn by 90°:
    # ∂_a∂_b becomes ∂_b∂_(−a), of the other sign.
    for sign in (1.0, -1.0, 1.0, -1.0):
        out = out + _rows(twist, here, 0.25 * sign * area)
        here = np.where(here >= 0, follower[here], -1)
    # At the end of the surface: the mean over one or two facets, none over more.
    around = np.bincount(corner, minlength=count)[corner]
    rim = (edges.valence[a] == 0) & ~sharp[corner] & (around <= 2)
    other = np.where(follower >= 0, follower, before)
    out = out + _rows(twist, np.where(rim, own, -1), area / around)
    out = out - _rows(twist, np.where(rim & (around == 2), other, -1), 0.5 * area)
    return out.tocsr()


def _corner_parts(
    shape: FacetShape, facets: Ints, edges: _Edges, tangents: Sparse, sharp: Bools, count: int
) -> list[dict[tuple[int, ...], Sparse]]:
    """For each corner: (f, n) position (0, 0), tangents (1, 0), (0, 1) and twist (1, 1)."""
    parts: list[dict[tuple[int, ...], Sparse]] = []
    every = np.arange(len(facets))
    twist = _twists(shape, facets, edges, sharp, count) if shape.directions == 2 else None
    for corner in range(shape.corners):
        at = (np.ones(len(facets)), (every, facets[:, corner]))
        position = scipy.sparse.csr_matrix(at, shape=(len(facets), count))
        along = [tangents[edges.along[:, corner, k]] for k in range(shape.directions)]
        if twist is None:
            parts.append({(0,): position, (1,): along[0]})
        else:
            own = twist[every * shape.corners + corner]
            parts.append({(0, 0): position, (1, 0): along[0], (0, 1): along[1], (1, 1): own})
    return parts


def _patches(shape: FacetShape, parts: list[dict[tuple[int, ...], Sparse]]) -> tuple[Ints, Floats]:
    """Stencils and extraction: the Hermite patch at the nodes of the cubic Lagrange facet."""
    used = scipy.sparse.csr_matrix(parts[0][next(iter(parts[0]))].shape)
    for corner in parts:
        for part in corner.values():
            used = used + abs(part)
    used.sort_indices()
    facets, width = used.shape[0], int(np.diff(used.indptr).max())
    stencil = np.repeat(used.indices[used.indptr[:-1]][:, None], width, axis=1).astype(np.int32)
    row = np.repeat(np.arange(facets), np.diff(used.indptr))
    column = np.arange(used.nnz) - np.repeat(used.indptr[:-1], np.diff(used.indptr))
    stencil[row, column] = used.indices
    keys = row.astype(np.int64) * used.shape[1] + used.indices
    extraction = np.zeros((facets, shape.count, width))
    for control, xi in enumerate(shape.points):
        for place, pieces in zip(shape.points[: shape.corners], parts, strict=True):
            s = np.abs(xi - place)  # from this corner towards the others
            for orders, part in pieces.items():
                entries = part.tocoo()
                at = np.searchsorted(
                    keys, entries.row.astype(np.int64) * used.shape[1] + entries.col
                )
                weight = np.prod([_hermite(order, t) for order, t in zip(orders, s, strict=True)])
                np.add.at(extraction, (row[at], control, column[at]), weight * entries.data)
    return stencil, extraction


def _hermite(order: int, t: float) -> float:
    """Hermite cubic with value one (order 0) or slope one (order 1) at t = 0."""
    return (1.0 + 2.0 * t) * (1.0 - t) ** 2 if order == 0 else t * (1.0 - t) ** 2
