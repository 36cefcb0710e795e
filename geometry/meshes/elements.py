"""Kinds of cells and facets: their corners, sides and second-order nodes, in gmsh's order.

Axis letters: a nodes, i space.
"""

from __future__ import annotations

from dataclasses import dataclass

INTERVAL, TRIANGLE, QUADRILATERAL = "interval", "triangle", "quadrilateral"
TETRAHEDRON, HEXAHEDRON, PRISM = "tetrahedron", "hexahedron", "prism"

DIMENSION = {
    INTERVAL: 1,
    TRIANGLE: 2,
    QUADRILATERAL: 2,
    TETRAHEDRON: 3,
    HEXAHEDRON: 3,
    PRISM: 3,
}
CORNERS = {INTERVAL: 2, TRIANGLE: 3, QUADRILATERAL: 4, TETRAHEDRON: 4, HEXAHEDRON: 8, PRISM: 6}
"""Number of corners of a cell or facet."""

FACETS = {
    TRIANGLE: INTERVAL,
    QUADRILATERAL: INTERVAL,
    TETRAHEDRON: TRIANGLE,
    HEXAHEDRON: QUADRILATERAL,
}
"""Shape of a cell's facets."""

SIDES: dict[str, tuple[tuple[int, ...], ...]] = {
    TRIANGLE: ((0, 1), (1, 2), (2, 0)),
    QUADRILATERAL: ((0, 1), (1, 2), (2, 3), (3, 0)),
    TETRAHEDRON: ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)),
    HEXAHEDRON: (
        (0, 3, 2, 1),
        (4, 5, 6, 7),
        (0, 1, 5, 4),
        (1, 2, 6, 5),
        (2, 3, 7, 6),
        (3, 0, 4, 7),
    ),
    PRISM: ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
}
"""Corners of the facets of a cell, seen from outside counter-clockwise."""

# Corners of cells of extent 1; the middle is at 0, but for simplices.
_CYCLE = ((-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0))
PLACES: dict[str, tuple[tuple[float, ...], ...]] = {
    TRIANGLE: _CYCLE[:3],
    QUADRILATERAL: _CYCLE,
    TETRAHEDRON: ((-0.5,) * 3, (0.5, -0.5, -0.5), (-0.5, 0.5, -0.5), (-0.5, -0.5, 0.5)),
    HEXAHEDRON: tuple((x, y, z) for z in (-0.5, 0.5) for x, y, _ in _CYCLE),
    PRISM: tuple((x, y, z) for z in (-0.5, 0.5) for x, y, _ in _CYCLE[:3]),
}
"""Corners of one undistorted cell of each shape."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of elements that can be read.

    Attributes:
        shape: of it, for instance "triangle".
        order: 1 or 2; of order 2 with all nodes that a product of quadratic functions has.
        nodes: number of its nodes; the corners come first.
    """

    shape: str
    order: int
    nodes: int


KINDS = {
    1: Kind(INTERVAL, 1, 2),
    2: Kind(TRIANGLE, 1, 3),
    3: Kind(QUADRILATERAL, 1, 4),
    4: Kind(TETRAHEDRON, 1, 4),
    5: Kind(HEXAHEDRON, 1, 8),
    6: Kind(PRISM, 1, 6),
    8: Kind(INTERVAL, 2, 3),
    9: Kind(TRIANGLE, 2, 6),
    10: Kind(QUADRILATERAL, 2, 9),
    11: Kind(TETRAHEDRON, 2, 10),
    12: Kind(HEXAHEDRON, 2, 27),
}
"""By gmsh's number."""
NUMBERS = {(kind.shape, kind.order): number for number, kind in KINDS.items()}
INCOMPLETE = frozenset((16, 17, 18, 19))  # of second order without nodes on faces and inside
PYRAMIDS = frozenset((7, 14, 19))


def nodes_of(shape: str, order: int) -> int:
    """Number of nodes of an element."""
    return KINDS[NUMBERS[shape, order]].nodes
