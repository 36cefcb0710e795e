"""Shapes of surface facets: shape functions, their derivatives, and the sides of each shape.

Axis letters: a nodes of a facet, i space, α, β surface directions (one in the plane, two in space),
p any number of places. A facet is ȳ(ξ) = Σ_a N_a(ξ) y_a over its reference domain: the unit
interval, the unit square, or the triangle ξ ≥ 0, η ≥ 0, ξ + η ≤ 1. Nodes are in the order of a
Lagrange element of the same cell: corners first, then edges, then the interior.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import basix
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]
Bools = NDArray[np.bool_]

# Corners of each side, so that they follow the boundary with the domain on the left.
SIDES = {
    "interval": ((0,), (1,)),
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quadrilateral": ((0, 1), (1, 3), (3, 2), (2, 0)),
}


# Largest Σ_a |N_a| over the domain: Lebesgue's constants of equally spaced nodes, on quadrilaterals
# those of both directions multiplied.
_CUBIC = 1.63114
_LEBESGUE = {
    **{(cell, 1): 1.0 for cell in SIDES},
    ("interval", 2): 1.25,
    ("triangle", 2): 5.0 / 3.0,
    ("quadrilateral", 2): 1.25**2,
    ("interval", 3): _CUBIC,
    ("quadrilateral", 3): _CUBIC**2,
}


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One side of a facet: an edge of a face, or an end of a segment."""

    shape: FacetShape | None  # of the edge; None for a point
    nodes: tuple[int, ...]  # the facet's nodes on it, in the order of ``shape``
    origin: Floats  # (α,) where the side begins in the facet's reference domain
    direction: Floats  # (α,) from there to its end; zero for a point


@dataclass(frozen=True, slots=True, eq=False)
class FacetShape:
    """A Lagrange facet."""

    cell: str  # "interval", "triangle" or "quadrilateral"
    degree: int  # 1, 2 or 3
    points: Floats  # (a, α) reference coordinates of the nodes
    corners: int  # number of corner nodes; they come first
    sides: tuple[Side, ...]  # of the facet
    # (corners, α, α) from each corner along its sides in the reference domain, the first along the
    # side that begins there
    corner_directions: Floats
    _powers: Ints = field(repr=False)
    _coefficients: Floats = field(repr=False)

    @property
    def count(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @property
    def directions(self) -> int:
        """Number of surface directions α."""
        return int(self.points.shape[1])

    @property
    def is_flat(self) -> bool:
        """Whether all second derivatives vanish: straight segments and plane triangles."""
        return self.degree == 1 and self.cell != "quadrilateral"

    @property
    def lebesgue(self) -> float:
        """Bound on Σ_a |N_a|: how much further than its nodes a facet can lie or move."""
        return _LEBESGUE[self.cell, self.degree]

    @property
    def polynomials(self) -> tuple[Ints, Floats]:
        """Powers (m, α) of the monomials Π_α (ξ^α)^m, and the shape functions' (m, a) in them."""
        return self._powers, self._coefficients

    def values(self, xi: Floats) -> Floats:
        """Shape functions (p, a) at the reference coordinates ``xi`` (p, α)."""
        if self.count == 2:
            return np.concatenate([1.0 - xi, xi], axis=-1)
        return self._monomials(xi, ()) @ self._coefficients

    def first(self, xi: Floats) -> Floats:
        """First derivatives (p, α, a) at ``xi`` (p, α)."""
        out = np.empty((*xi.shape, self.count))
        if self.count == 2:
            out[..., 0] = -1.0
            out[..., 1] = 1.0
            return out
        for alpha in range(self.directions):  # one or two
            out[..., alpha, :] = self._monomials(xi, (alpha,)) @ self._coefficients
        return out

    def second(self, xi: Floats) -> Floats:
        """Second derivatives (p, α, β, a) at ``xi`` (p, α)."""
        size = self.directions
        out = np.zeros((*xi.shape[:-1], size, size, self.count))
        if self.is_flat:
            return out
        for alpha in range(size):
            for beta in range(size):
                out[..., alpha, beta, :] = self._monomials(xi, (alpha, beta)) @ self._coefficients
        return out

    def excess(self, xi: Floats) -> Floats:
        """How far (p,) each of ``xi`` (p, α) lies outside the reference domain; ≤ 0 inside."""
        least: Floats = np.max(-xi, axis=-1)
        if self.cell == "triangle":
            return np.maximum(least, np.sum(xi, axis=-1) - 1.0)
        return np.maximum(least, np.max(xi, axis=-1) - 1.0)

    def _monomials(self, xi: Floats, derivatives: tuple[int, ...]) -> Floats:
        """Monomials (p, m), differentiated for each direction in ``derivatives``."""
        return _monomials(xi, self._powers, derivatives)


def _monomials(xi: Floats, powers: Ints, derivatives: tuple[int, ...]) -> Floats:
    """Products Π_α d/dξ^α… (ξ^α)^m of the (m, α) ``powers`` at ``xi`` (p, α): (p, m)."""
    out = np.ones((*xi.shape[:-1], len(powers)))
    for alpha in range(powers.shape[1]):
        x = xi[..., alpha]
        order = derivatives.count(alpha)
        columns = [_power(x, m, order) for m in range(int(powers.max()) + 1)]
        out *= np.stack([columns[m] for m in powers[:, alpha]], axis=-1)
    return out


def _power(x: Floats, exponent: int, order: int) -> Floats:
    """The derivative of a given order of x to an exponent."""
    factor = 1.0
    for k in range(order):
        factor *= exponent - k
    out = np.full_like(x, factor)
    for _ in range(max(exponent - order, 0)):
        out *= x
    return out


@lru_cache
def facet_shape(cell: str, degree: int) -> FacetShape:
    """The Lagrange facet of degree 1, 2, or 3 on a cell; ValueError if there is none."""
    if cell not in SIDES or (cell, degree) not in _LEBESGUE:
        raise ValueError(f"no facets of degree {degree} on a {cell}")
    element = basix.create_element(
        basix.ElementFamily.P, basix.CellType[cell], degree, basix.LagrangeVariant.equispaced
    )
    points = np.asarray(element.points, dtype=np.float64)
    grid = np.stack(np.meshgrid(*[np.arange(degree + 1)] * points.shape[1]), axis=-1)
    powers = grid.reshape(-1, points.shape[1]).astype(np.int32)
    if cell == "triangle":
        powers = powers[powers.sum(axis=1) <= degree]
    corners = {"interval": 2, "triangle": 3, "quadrilateral": 4}[cell]
    # Vandermonde's matrix: N_a(ξ_b) = δ_ab.
    coefficients: Floats = np.linalg.inv(_monomials(points, powers, ())).astype(np.float64)
    return FacetShape(
        cell=cell,
        degree=degree,
        points=points,
        corners=corners,
        sides=tuple(_side(points, ends, degree) for ends in SIDES[cell]),
        corner_directions=_corner_directions(points[:corners], SIDES[cell]),
        _powers=powers,
        _coefficients=coefficients,
    )


def _side(points: Floats, ends: tuple[int, ...], degree: int) -> Side:
    """The side between two corners, or a point."""
    if len(ends) == 1:
        return Side(None, ends, points[ends[0]], np.zeros(points.shape[1]))
    start, direction = points[ends[0]], points[ends[1]] - points[ends[0]]
    edge = facet_shape("interval", degree)
    apart = np.linalg.norm(points[:, None] - start - edge.points * direction, axis=2)
    return Side(edge, tuple(map(int, np.argmin(apart, axis=0))), start, direction)


def _corner_directions(corners: Floats, sides: tuple[tuple[int, ...], ...]) -> Floats:
    """Reference directions (corners, α, α) from each corner along the sides that meet there."""
    if corners.shape[1] == 1:
        return np.array([[[1.0]], [[-1.0]]])
    out = np.empty((len(corners), 2, 2))
    for start, end in sides:
        out[start, 0] = corners[end] - corners[start]
        out[end, 1] = corners[start] - corners[end]
    return out


def unit_normals(tangents: Floats) -> Floats:
    """Unit normals (…, i) of tangents (…, α, i): τ turned left by 90°, or τ_1 × τ_2."""
    normal: Floats
    if tangents.shape[-2] == 1:
        tau = tangents[..., 0, :]
        normal = np.stack([-tau[..., 1], tau[..., 0]], axis=-1)
    else:
        normal = np.cross(tangents[..., 0, :], tangents[..., 1, :]).astype(np.float64)
    return normal / np.linalg.norm(normal, axis=-1)[..., None]


def measure(tangents: Floats) -> Floats:
    """Length (q,) of one tangent, or area of the parallelogram of two, (q, α, i)."""
    if tangents.shape[1] == 1:
        return np.linalg.norm(tangents[:, 0], axis=1)
    (x, y, z), (u, v, w) = tangents.transpose(1, 2, 0)
    return np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2)


def solve_small(matrix: Floats, right: Floats) -> Floats:
    """Solutions (p, α) of p systems of one or two equations, (p, α, α) and (p, α)."""
    if matrix.shape[-1] == 1:
        return right / matrix[..., 0]
    a, b, c, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1]
    over = 1.0 / _determinant(matrix)
    x, y = right[:, 0], right[:, 1]
    out = np.empty_like(right)
    out[:, 0] = (d * x - b * y) * over
    out[:, 1] = (a * y - c * x) * over
    return out


def _determinant(matrix: Floats) -> Floats:
    """Determinants (p,) of matrices (p, 2, 2)."""
    return matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]


# -- Lines of nodes in the plane: their order, which no partition of the mesh changes, and shape ---

STRAIGHT = 1e-7  # distance from a straight line, over the size, that is none: R > 1e6 lengths


def order_by_place(position: Floats) -> Longs:
    """Order of points (q, i), by x first; round-off that depends on the partition has no effect."""
    size = float(np.ptp(position, axis=0).max()) or 1.0
    # The offset moves round numbers away from the points where the rounding changes.
    steps = np.floor((position - position.min(axis=0)) / (1e-8 * size) + 0.3183)
    return np.lexsort(steps.T[::-1])


def chains(facets: Longs) -> Iterator[Longs]:
    """Vertices of each connected piece of segments (f, 2), one after the other.

    Open pieces come first and begin at the end with the smaller number; a closed one begins at its
    smallest number, which is there again at its end.
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
    """Angle (n,), rad, of tangents at a line's nodes (n, i), m, against x, without jumps of 2π.

    That of the parabola through the node and its neighbours, at an end through the nearest three,
    over the length of the chords: off by the square of their length.
    """
    steps = np.diff(place, axis=0)
    length = np.linalg.norm(steps, axis=1)
    turned = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    if len(turned) == 1:
        return np.repeat(turned, 2)
    # The parabola's tangent at a node: chords weighted by the length of the other one.
    share = length[:-1] / (length[:-1] + length[1:])
    inner = turned[:-1] + share * np.diff(turned)
    # A parabola's chord lies between the tangents at its ends.
    first, last = 2.0 * turned[0] - inner[0], 2.0 * turned[-1] - inner[-1]
    return np.concatenate([[first], inner, [last]])


def line_curvatures(place: Floats) -> Floats:
    """Curvature (n,), 1/m, > 0 to the left, at a line's nodes (n, i), m; at ends the neighbour's.

    One over the radius of the circle through the node and its two neighbours.
    """
    if len(place) < 3:
        return np.zeros(len(place))
    a, b = place[1:-1] - place[:-2], place[2:] - place[1:-1]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    sides = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    # κ = 4 A/(a b c) of the circumscribed circle; `area` is 2 A.
    inner = 2.0 * area / (sides * np.linalg.norm(a + b, axis=1))
    return np.concatenate([inner[:1], inner, inner[-1:]])


def straight_angle(place: Floats, about: float) -> float:
    """Angle, rad, of the straight line nearest to places (n, i), m; the one next to ``about``."""
    apart = place - place.mean(axis=0)
    # The eigenvector of the largest spread; either way along it is right, the nearer to `about` is
    # meant.
    _, vectors = np.linalg.eigh(apart.T @ apart)
    angle = float(np.arctan2(vectors[1, -1], vectors[0, -1]))
    return angle + np.pi * round((about - angle) / np.pi)


def fitted_circle(place: Floats) -> tuple[float, float]:
    """Radius of the circle nearest to places (n, i) and the root mean square of what is off it, m.

    The sum of squared distances from the circle is least (Gauss and Newton's method from the
    algebraic circle of Kåsa). The radius is infinite where places are straight, or fewer than 3.
    """
    at = place - place.mean(axis=0)
    size = float(np.sqrt((at**2).sum(axis=1).max(initial=0.0)))
    if len(place) < 3 or size == 0.0:
        return np.inf, 0.0
    at = at / size
    flat = np.linalg.svd(at, compute_uv=False)[-1]
    if flat < STRAIGHT * np.sqrt(len(at)):
        return np.inf, float(flat * size / np.sqrt(len(at)))
    # Kåsa: |x|² = 2 c·x + (R² − |c|²) is linear in c.
    rows = np.column_stack([2.0 * at, np.ones(len(at))])
    centre = np.linalg.lstsq(rows, (at**2).sum(axis=1), rcond=None)[0][:2]
    for _ in range(20):
        apart = at - centre
        distance = np.linalg.norm(apart, axis=1)
        radius = float(distance.mean())
        # Residuals d_k − d̄ with the radius eliminated as the mean distance d̄: its slope, the mean
        # of the rows, comes off each row.
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
    return np.sqrt(np.einsum("nmi,nmi->nm", foot, foot).min(axis=1))
