"""Closest points on facets, by the source ``closest_points.c``.

Inside a facet the distance to x is stationary where τ_α·(x − ȳ(ξ)) = 0. Where that has no solution
in the reference domain, the closest point lies on one of the sides, which are facets of one
dimension less, and so on down to the corners.

Axis letters: q slave points, p pairs of a point and a facet, f facets, a nodes of a facet, i space,
α surface directions.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.geometry.native.compiler import library, packed, require_size, start_of
from tribox.geometry.surfaces.facets import FacetShape, Floats, Ints, Longs, facet_shape

SOURCE = "closest_points.c"
INTERIOR = -1  # entity of a closest point inside a facet; sides count from 0
CORNER = 8  # entity of a corner: this plus its number
SEAM = 1e-11  # reference distance past a seam up to which a point belongs to the facet itself


def _fields(longs: str, pointers: str, doubles: str = "", more: str = "") -> list[tuple[str, Any]]:
    kinds = ((longs, ctypes.c_int64), (pointers, ctypes.c_void_p), (doubles, ctypes.c_double))
    return [
        (name, kind) for names, kind in (*kinds, (more, ctypes.c_void_p)) for name in names.split()
    ]


class _Shape(ctypes.Structure):
    """``Shape`` of the C source, like the next ones field by field in the same order."""

    _fields_ = (
        *_fields(
            "directions triangle degree nodes samples",
            "powers hull sampled sample side_nodes side_origin side_direction",
        ),
        *_fields("edge_samples", "edge_powers edge_sampled edge_sample"),
    )


class _Surface(ctypes.Structure):
    _fields_ = (("shape", ctypes.c_void_p), *_fields("facets stamp", "controls made"))


class _Task(ctypes.Structure):
    _fields_ = _fields(
        "count",
        "points start facet alone kept beyond",
        "limit tie overrun",
        "bound tried found xi entity",
    )


class _Geometry(ctypes.Structure):
    _fields_ = _fields("count", "points facet xi foot tangents normal curvature gap")


@dataclass(slots=True)
class Candidates:
    """Facets among which the closest of each point is."""

    # (q + 1,) where the facets of each point begin in ``facet`` (p,) and ``beyond`` (p,), m: what
    # their distance exceeded the least one by when they were found
    start: Longs
    facet: Ints
    beyond: Floats
    limit: float  # m; facets beyond it need not be looked at
    # (q,) the only facet of points far away, −1 for all others; None: there are none
    alone: Ints | None = None


class CompiledFacets:
    """All facets of one surface."""

    def __init__(self, shape: FacetShape, facets: int) -> None:
        self.shape, self._code = shape, library(SOURCE)
        sizes = _sizes(self._code)
        # Zeros that no one touches take no memory; nor are they written before a facet is needed.
        self._made = np.zeros((facets, sizes["facet"] // 8))
        self._tried = sizes["closest"] // 8
        self._form, self._arrays = _form(shape)
        self._controls: Floats | None = None  # of the last call
        self._surface = _Surface(
            ctypes.addressof(self._form), facets, 0, None, start_of(self._made)
        )

    def closest(
        self,
        points: Floats,
        controls: Floats,
        among: Candidates,
        tie: float,
        kept: tuple[Ints, float] | None = None,
    ) -> tuple[Ints, Floats, Ints]:
        """Facets (q,), ξ (q, α) and entities (q,) of the closest points to (q, i), m.

        Of facets within ``tie``, m, the first, one that holds the point inside before others.
        ``controls``: (f, a, i), m; ``among``: facets to choose from; ``kept``: (q,) facets that
        points stay on whose stationary point is no more than so much, in ξ, past an edge.
        """
        count = len(points)
        facet, entity = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
        xi = np.empty((count, self.shape.directions))
        keep, past = (None, 0.0) if kept is None else (packed(kept[0], np.int32), kept[1])
        inputs = (packed(points), among.start, among.facet, among.alone, keep, among.beyond)
        scratch = self._scratch(among.start)
        outputs = map(start_of, (*scratch, facet, xi, entity))
        task = _Task(count, *map(start_of, inputs), among.limit, tie, past, *outputs)
        self._call("tribox_closest_points", controls, ctypes.byref(task))
        return facet, xi, entity

    def beyond(self, points: Floats, controls: Floats, start: Longs, facet: Ints) -> Floats:
        """What distances (p,) of facets exceed the least of their point's (q, i) by at least, m.

        ``controls``: (f, a, i), m; ``start``: (q + 1,), where points begin in ``facet`` (p,).
        """
        out = np.zeros(len(facet))
        points, facet = packed(points), packed(facet, np.int32)
        scratch = self._scratch(start)
        inputs = (points, start, facet, None, None, None)
        task = _Task(len(points), *map(start_of, inputs), 0.0, 0.0, 0.0, *map(start_of, scratch))
        self._call("tribox_beyond", controls, ctypes.byref(task), start_of(out))
        return out

    def _scratch(self, start: Longs) -> tuple[Floats, Floats]:
        """Room for a bound and a result of each facet of the longest list."""
        longest = int(np.diff(start).max(initial=1))
        return np.empty(longest), np.empty((longest, self._tried))

    def distances(self, points: Floats, controls: Floats, point: Ints, facet: Ints) -> Floats:
        """Distances (p,), m, of pairs of a point and a facet; arguments as in :meth:`closest`."""
        out = np.empty(len(point))
        points, point, facet = packed(points), packed(point, np.int32), packed(facet, np.int32)
        pairs = map(start_of, (points, point, facet))
        count = ctypes.c_int64(len(point))
        self._call("tribox_distances", controls, *pairs, count, start_of(out))
        return out

    def geometry(
        self, points: Floats, controls: Floats, facet: Ints, xi: Floats
    ) -> tuple[Floats, Floats, Floats, Floats, Floats | None]:
        """Positions (q, i), tangents (q, α, i), unit normals (q, i), gaps (q,), curvatures.

        At ``xi`` (q, α) of facets (q,) with controls (f, a, i), m; gaps of points (q, i), m.
        """
        count, directions = xi.shape
        normal, gap, bend = np.empty(points.shape), np.empty(count), None
        if not self.shape.is_flat:
            bend = np.empty((count, directions, directions, directions + 1))
        foot, tangents = self._evaluate(controls, facet, xi, packed(points), (normal, bend, gap))
        return foot, tangents, normal, gap, bend

    def places(self, controls: Floats, facet: Ints, xi: Floats) -> tuple[Floats, Floats]:
        """Positions (q, i) and tangents (q, α, i) alone, see :meth:`geometry`."""
        return self._evaluate(controls, facet, xi, None, (None, None, None))

    def _evaluate(
        self,
        controls: Floats,
        facet: Ints,
        xi: Floats,
        points: Floats | None,
        more: tuple[Floats | None, Floats | None, Floats | None],
    ) -> tuple[Floats, Floats]:
        count, directions = xi.shape
        foot = np.empty((count, directions + 1))
        tangents = np.empty((count, directions, directions + 1))
        facet, xi = packed(facet, np.int32), packed(xi)
        task = _Geometry(count, *map(start_of, (points, facet, xi, foot, tangents, *more)))
        self._call("tribox_places", controls, ctypes.byref(task))
        return foot, tangents

    def _call(self, name: str, controls: Floats, *arguments: Any) -> None:
        """Call a function of the library on the facets as they are now.

        What it makes of them is kept for the next call with the same array, if nobody can write it.
        """
        if controls is not self._controls or controls.flags.writeable:
            self._controls = controls
            self._packed = packed(controls)
            self._surface.stamp += 1
            self._surface.controls = start_of(self._packed)
        function = getattr(self._code, name)
        function.restype = None
        function(ctypes.byref(self._surface), *arguments)


def _sizes(code: ctypes.CDLL) -> dict[str, int]:
    """Bytes of a facet and of a result, once all structures were found to be of one size."""
    sizes = (ctypes.c_int64 * 6)()
    code.tribox_closest_sizes.restype = None
    code.tribox_closest_sizes(sizes)
    for theirs, ours in zip(sizes, (_Shape, _Surface, _Task, _Geometry), strict=False):
        require_size(theirs, ours, SOURCE)
    return {"facet": sizes[4], "closest": sizes[5]}


@lru_cache
def samples(shape: FacetShape) -> Floats:
    """Samples (s, α) to begin at, two intervals along each side, four on shapes of higher degree.

    The middle of a flat facet, where one step leads to the stationary point.
    """
    if shape.is_flat:
        return shape.points[: shape.corners].mean(axis=0)[None]
    steps = np.linspace(0.0, 1.0, min(2 * shape.degree, 4) + 1)
    grid = np.stack(np.meshgrid(*[steps] * shape.directions), axis=-1)
    xi = grid.reshape(-1, shape.directions)
    return xi[shape.excess(xi) <= SEAM]


@lru_cache
def _form(shape: FacetShape) -> tuple[_Shape, list[NDArray[Any]]]:
    """The structure of a shape, and the arrays it points at."""
    sides = shape.sides if shape.directions == 2 else ()
    edge = facet_shape("interval", shape.degree)
    lattice, along = samples(shape), samples(edge)
    arrays: list[NDArray[Any]] = [
        _powers(shape),
        _hull(shape),
        shape.values(lattice),
        lattice,
        np.array([side.nodes for side in sides], dtype=np.int32),
        np.array([side.origin for side in sides]),
        np.array([side.direction for side in sides]),
        _powers(edge),
        edge.values(along),
        along,
    ]
    arrays = [np.ascontiguousarray(array) for array in arrays]
    sizes = (shape.directions, shape.cell == "triangle", shape.degree, shape.count, len(lattice))
    at = list(map(start_of, arrays))
    return _Shape(*sizes, *at[:7], len(along), *at[7:]), arrays


def _powers(shape: FacetShape) -> Floats:
    """Coefficients (k, a) of the products of powers j, the faster, and k of ξ, from the nodes.

    Those of higher degree of ξ − ½: about the middle of a facet they are far less sensitive to
    rounding, while straight facets are exact at their first corner.
    """
    middle = 0.0 if shape.degree == 1 else 0.5
    width = shape.degree + 1
    powers = shape.polynomials[0]
    products = np.prod((shape.points[:, None] - middle) ** powers, axis=2)
    out = np.zeros((width**shape.directions, shape.count))
    out[powers @ (width ** np.arange(shape.directions))] = np.linalg.inv(products)
    return out


def _hull(shape: FacetShape) -> Floats:
    """Control points (b, a) of the Bernstein polynomials, whose hull holds the facet."""
    d, xi = shape.degree, shape.points
    if shape.cell == "triangle":
        # Barycentric: ξ, η and 1 − ξ − η.
        third = 1.0 - xi.sum(axis=1)
        values = [
            comb(d, j) * comb(d - j, k) * xi[:, 0] ** j * xi[:, 1] ** k * third ** (d - j - k)
            for j in range(d + 1)
            for k in range(d + 1 - j)
        ]
    else:
        one = [[comb(d, j) * x**j * (1.0 - x) ** (d - j) for j in range(d + 1)] for x in xi.T]
        values = one[0] if len(one) == 1 else [a * b for a in one[0] for b in one[1]]
    return np.linalg.inv(np.stack(values, axis=1)).astype(np.float64)
