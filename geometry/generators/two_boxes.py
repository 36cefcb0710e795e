"""The built-in geometry in space: a box resting on another, meshed by gmsh.

x runs to the right, y upwards and z towards the viewer. The lower box's top lies on y = 0 with its
left back corner at x = z = 0; the upper box's bottom lies on y = gap. The boxes share no nodes,
also when they touch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tribox.geometry.generators.two_blocks import (
    MAX_CELLS,
    ROUND_OFF,
    Block,
    Drawn,
    check_gap,
    check_length,
    check_pair,
    mesh_pair,
)

CELLS = ("hexahedron", "tetrahedron")


@dataclass(frozen=True, slots=True)
class Box:
    """One box and how finely it is meshed.

    Either ``elements`` or ``size`` is given. Element heights form a geometric progression from the
    contact side to the far side.

    Attributes:
        width: Extent in x, m.
        height: Extent in y, m.
        depth: Extent in z, m.
        elements: Number of elements along x, y and z.
        size: Largest element extent in x and z, and in y at the contact side, m.
        grading: Element height at the far side over that at the contact side.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    width: float
    height: float
    depth: float
    elements: tuple[int, int, int] | None = None
    size: float | None = None
    grading: float = 1.0

    def __post_init__(self) -> None:
        check_length("depth", self.depth)
        if self.elements is not None and (
            len(self.elements) != 3 or any(int(n) != n or n < 1 for n in self.elements)
        ):
            raise ValueError(
                f"elements = {list(self.elements)} is not allowed; give three integers >= 1"
            )
        if self.elements is not None and max(self.elements) > MAX_CELLS:
            raise ValueError(f"elements: at most {MAX_CELLS} cells are allowed")
        self.face()
        count = math.prod(self.counts())
        if count > MAX_CELLS:
            raise ValueError(f"a box of {count} cells is not allowed; at most {MAX_CELLS}")

    def face(self) -> Block:
        """The front side, in the plane of x and y."""
        elements = None if self.elements is None else self.elements[:2]
        return Block(self.width, self.height, elements, self.size, self.grading)

    def counts(self) -> tuple[int, int, int]:
        """Number of elements along x, y and z."""
        if self.elements is not None:
            return self.elements
        assert self.size is not None
        return *self.face().counts(), max(1, math.ceil(self.depth / (self.size * ROUND_OFF)))


@dataclass(frozen=True, slots=True)
class TwoBoxes:
    """A box on a box.

    Attributes:
        upper: The box above (an elastomer, if not named otherwise).
        lower: The box below (aluminium, if not named otherwise).
        offset: x and z of the upper box's left back corner, m; by default the boxes are centred.
        gap: Distance between the boxes, m; 0 lets them touch exactly.
        cell: "hexahedron" (a regular grid) or "tetrahedron" (the same grid, its cells cut).
        upper_name: Name of the upper body and first part of its surfaces' names.
        lower_name: Name of the lower body and first part of its surfaces' names.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    upper: Box
    lower: Box
    offset: tuple[float, float] | None = None
    gap: float = 0.0
    cell: str = "hexahedron"
    upper_name: str = "elastomer"
    lower_name: str = "aluminium"

    def __post_init__(self) -> None:
        check_gap(self.gap)
        extents = ((self.upper.width, self.lower.width), (self.upper.depth, self.lower.depth))
        for axis, at, (above, below) in zip("xz", self.corner(), extents, strict=True):
            if not -above < at < below:
                raise ValueError(
                    f"offset = {at} m in {axis} is not allowed; between {-above} and {below} m the "
                    "boxes overlap"
                )
        check_pair(self.cell, CELLS, (self.upper_name, self.lower_name))

    def cells(self) -> int:
        """Number of cells of both boxes."""
        total = sum(math.prod(box.counts()) for box in (self.upper, self.lower))
        return total * (6 if self.cell == "tetrahedron" else 1)

    def corner(self) -> tuple[float, float]:
        """Positions x and z of the upper box's left back corner, m."""
        if self.offset is None:
            x, z = self.lower.width - self.upper.width, self.lower.depth - self.upper.depth
            return 0.5 * x, 0.5 * z
        return self.offset

    def build(self) -> None:
        """Draw and mesh the boxes in the current gmsh model.

        The physical groups are the two bodies and, with U and L for their names, the faces
        ``U_contact``, ``L_contact``, ``top`` (of U), ``bottom`` (of L), and ``U_left``,
        ``U_right``, ``U_front``, ``U_back`` and those of L.
        """
        x, z = self.corner()
        upper = _draw(self.upper, (x, self.gap, z), 1.0, self.cell)
        lower = _draw(self.lower, (0.0, 0.0, 0.0), -1.0, self.cell)
        mesh_pair(3, (self.upper_name, self.lower_name), (upper, lower))


# Corners are numbered by x + 2 y + 4 z, each 0 or 1, y counted away from the contact.
_EDGES = {
    0: ((0, 1), (2, 3), (4, 5), (6, 7)),
    1: ((0, 2), (1, 3), (4, 6), (5, 7)),
    2: ((0, 4), (1, 5), (2, 6), (3, 7)),
}
_SIDES = {
    "contact": (0, 1, 5, 4),
    "far": (2, 3, 7, 6),
    "left": (0, 2, 6, 4),
    "right": (1, 3, 7, 5),
    "back": (0, 1, 3, 2),
    "front": (4, 5, 7, 6),
}


def _draw(box: Box, at: tuple[float, float, float], upwards: float, cell: str) -> Drawn:
    """One box with its contact side's left back corner at a point; its volume and its sides."""
    import gmsh

    geo = gmsh.model.geo
    extent = (box.width, upwards * box.height, box.depth)
    points = [
        geo.addPoint(*(at[i] + extent[i] * (corner >> i & 1) for i in range(3)))
        for corner in range(8)
    ]
    edges: dict[tuple[int, int], int] = {}
    for axis, count in enumerate(box.counts()):
        for a, b in _EDGES[axis]:
            edges[a, b] = curve = geo.addLine(points[a], points[b])
            edges[b, a] = -curve
            ratio = box.face().ratio() if axis == 1 else 1.0
            geo.mesh.setTransfiniteCurve(curve, count + 1, "Progression", ratio)
    sides = {}
    for name, loop in _SIDES.items():
        curves = [edges[loop[i], loop[(i + 1) % 4]] for i in range(4)]
        sides[name] = geo.addPlaneSurface([geo.addCurveLoop(curves)])
        geo.mesh.setTransfiniteSurface(sides[name])
        if cell == "hexahedron":
            geo.mesh.setRecombine(2, sides[name])
    volume = geo.addVolume([geo.addSurfaceLoop(list(sides.values()))])
    geo.mesh.setTransfiniteVolume(volume)
    order = ("contact", "far", "left", "right", "front", "back")
    return [volume], {name: [sides[name]] for name in order}
