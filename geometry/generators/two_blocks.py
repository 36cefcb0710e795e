"""The built-in geometry: a rectangular block resting on another.

The lower block's top lies on y = 0 with its left end at x = 0; the upper block's bottom lies on
y = gap. The blocks share no nodes, also when they touch.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

MAX_CELLS = 10_000_000
"""More cells than this in one block are taken for a mistake in the element size."""

SHORTEST, LONGEST = 1e-15, 1e15
"""Lengths in m: powers of them are still numbers."""

MAX_GRADING = 1000.0
"""Largest ratio of element heights within a block, either way."""

ROUND_OFF = 1.0 + 1e-9
"""1 mm in steps of 0.1 mm is 10 steps, not 11."""

CELLS = ("quadrilateral", "triangle")


@dataclass(frozen=True, slots=True)
class Block:
    """One rectangular block and how finely it is meshed.

    Either ``elements`` or ``size`` is given. Element heights form a geometric progression from the
    contact side, which has the height h, to the far side, which has the height ``grading`` * h.

    Attributes:
        width: Extent in x, m.
        height: Extent in y, m.
        elements: Number of elements along x and along y.
        size: Largest element width, and largest element height at the contact side, m.
        grading: Element height at the far side over that at the contact side; above 1 refines
            towards the contact.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    width: float
    height: float
    elements: tuple[int, int] | None = None
    size: float | None = None
    grading: float = 1.0

    def __post_init__(self) -> None:
        for field in ("width", "height"):
            check_length(field, getattr(self, field))
        if not 1.0 / MAX_GRADING <= self.grading <= MAX_GRADING:
            raise ValueError(
                f"grading = {self.grading} is not allowed; from {1.0 / MAX_GRADING} to "
                f"{MAX_GRADING}"
            )
        if (self.elements is None) == (self.size is None):
            raise ValueError("give either elements or size of a block, not both and not none")
        if self.elements is not None:
            _check_counts(self.elements, self.grading)
        if self.size is not None:
            check_positive("size", self.size)
            least = max(self.width, self.height) / MAX_CELLS
            if self.size < least:
                raise ValueError(f"size = {self.size} m is not allowed; at least {least:g} m")
        nx, ny = self.counts()
        if nx * ny > MAX_CELLS:
            raise ValueError(f"a block of {nx} x {ny} cells is not allowed; at most {MAX_CELLS}")

    def counts(self) -> tuple[int, int]:
        """Number of elements along x and along y."""
        if self.elements is not None:
            return self.elements
        assert self.size is not None
        return _ceil(self.width / self.size), self._layers(self.size)

    def ratio(self) -> float:
        """Height of an element over that of its neighbour on the contact side."""
        layers = self.counts()[1]
        return float(self.grading ** (1.0 / (layers - 1))) if layers > 1 else 1.0

    def _layers(self, size: float) -> int:
        """The fewest layers whose height at the contact side is at most ``size``.

        The heights of n layers sum to h (1 + q + ... + q^(n-1)) with q^(n-1) = grading, and this
        sum grows with n, so the count can be bisected.
        """
        if self.grading == 1.0:
            return _ceil(self.height / size)
        low, high = 1, 2
        while self.height / self._layer_sum(high) > size * ROUND_OFF:
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            fits = self.height / self._layer_sum(middle) <= size * ROUND_OFF
            low, high = (low, middle) if fits else (middle, high)
        return high

    def _layer_sum(self, layers: int) -> float:
        """1 + q + ... + q^(layers-1), written without cancellation for q near 1."""
        log_q = math.log(self.grading) / (layers - 1)
        return math.expm1(layers * log_q) / math.expm1(log_q)


@dataclass(frozen=True, slots=True)
class TwoBlocks:
    """A block on a block.

    Attributes:
        upper: The block above (an elastomer, if not named otherwise).
        lower: The block below (aluminium, if not named otherwise).
        offset: x of the upper block's left side, m; by default the blocks are centred.
        gap: Distance between the blocks, m; 0 lets them touch exactly.
        cell: "quadrilateral" (a regular grid) or "triangle" (the same grid, each cell cut by a
            diagonal of alternating direction).
        upper_name: Name of the upper body and first part of its surfaces' names.
        lower_name: Name of the lower body and first part of its surfaces' names.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    upper: Block
    lower: Block
    offset: float | None = None
    gap: float = 0.0
    cell: str = "quadrilateral"
    upper_name: str = "elastomer"
    lower_name: str = "aluminium"

    def __post_init__(self) -> None:
        check_gap(self.gap)
        left, low, high = self.left(), -self.upper.width, self.lower.width
        if not low < left < high:
            raise ValueError(
                f"offset = {left} m is not allowed; between {low} and {high} m the blocks overlap"
            )
        check_pair(self.cell, CELLS, (self.upper_name, self.lower_name))

    def cells(self) -> int:
        """Number of cells of both blocks."""
        total = sum(math.prod(block.counts()) for block in (self.upper, self.lower))
        return total * (2 if self.cell == "triangle" else 1)

    def left(self) -> float:
        """Position x of the upper block's left side, m."""
        if self.offset is None:
            return 0.5 * (self.lower.width - self.upper.width)
        return self.offset

    def regular(self) -> RegularMesh | None:
        """The mesh that :meth:`build` has gmsh make, without it; None unless cells are equal.

        The order of all numbers is the same. Places are exact; those of gmsh, which integrates
        the distances along a side, are so to 1e-12 of it, or 1e-9 where cells are graded.
        """
        graded = self.upper.ratio() != 1.0 or self.lower.ratio() != 1.0
        if graded or self.cell != "quadrilateral":
            return None
        names = ((self.upper_name, "top"), (self.lower_name, "bottom"))
        corners = ((self.left(), self.gap, self.upper.height), (0.0, 0.0, -self.lower.height))
        return regular_mesh(
            [
                Rectangle(
                    name,
                    [far if side == "far" else f"{name}_{side}" for side in SIDES],
                    np.linspace(x, x + block.width, block.counts()[0] + 1, dtype=np.float64),
                    np.linspace(y, y + height, block.counts()[1] + 1, dtype=np.float64),
                )
                for block, (name, far), (x, y, height) in zip(
                    (self.upper, self.lower), names, corners, strict=True
                )
            ]
        )

    def build(self) -> None:
        """Draw and mesh the blocks in the current gmsh model.

        The physical groups are the two bodies and, with U and L for their names, the curves
        ``U_contact``, ``L_contact``, ``top`` (of U), ``bottom`` (of L), ``U_left``, ``U_right``,
        ``L_left`` and ``L_right``.
        """
        upper = _draw(self.upper, self.left(), self.gap, self.upper.height, self.cell)
        lower = _draw(self.lower, 0.0, 0.0, -self.lower.height, self.cell)
        mesh_pair(2, (self.upper_name, self.lower_name), (upper, lower))


def _draw(block: Block, x: float, y: float, height: float, cell: str) -> Drawn:
    """One block with its contact side on ``y``, extending by the signed ``height`` in y.

    Side curves run away from the contact, as the progression of the element heights does.
    """
    import gmsh

    geo = gmsh.model.geo
    corners = [(x, y), (x + block.width, y), (x + block.width, y + height), (x, y + height)]
    p = [geo.addPoint(px, py, 0.0) for px, py in corners]
    near, far = geo.addLine(p[0], p[1]), geo.addLine(p[3], p[2])
    left, right = geo.addLine(p[0], p[3]), geo.addLine(p[1], p[2])
    loop = [near, right, -far, -left] if height > 0 else [left, far, -right, -near]
    face = geo.addPlaneSurface([geo.addCurveLoop(loop)])
    nx, ny = block.counts()
    for curve in (near, far):
        geo.mesh.setTransfiniteCurve(curve, nx + 1)
    for curve in (left, right):
        geo.mesh.setTransfiniteCurve(curve, ny + 1, "Progression", block.ratio())
    geo.mesh.setTransfiniteSurface(face, "AlternateLeft")
    if cell == "quadrilateral":
        geo.mesh.setRecombine(2, face)
    return [face], {"contact": [near], "far": [far], "left": [left], "right": [right]}


def _ceil(value: float) -> int:
    """The next integer up, but for round-off."""
    return max(1, math.ceil(value / ROUND_OFF))


Drawn = tuple[list[int], dict[str, list[int]]]
"""gmsh's numbers of what a body is made of, and of what each of its sides is made of."""


def check_pair(cell: str, cells: Sequence[str], names: tuple[str, str]) -> None:
    """Raise a ValueError for a shape of cells that there is not, or names of bodies alike."""
    if cell not in cells:
        raise ValueError(f"cell = {cell!r} is not allowed; choose from {', '.join(cells)}")
    if names[0] == names[1] or not all(names):
        upper, lower = names
        raise ValueError(
            f"the bodies are named {upper!r} and {lower!r}; they need two different names"
        )


def mesh_pair(dim: int, names: tuple[str, str], drawn: tuple[Drawn, Drawn]) -> None:
    """Name and mesh two bodies, the upper one first, in the current gmsh model.

    Their far sides are ``top`` and ``bottom``, the others NAME_side.
    """
    import gmsh

    gmsh.model.geo.synchronize()
    tags = itertools.count(1)  # those of sides go on from those of bodies: none means two things
    for name, (body, _) in zip(names, drawn, strict=True):
        gmsh.model.addPhysicalGroup(dim, body, next(tags), name)
    for name, far, (_, sides) in zip(names, ("top", "bottom"), drawn, strict=True):
        for side, parts in sides.items():
            group = far if side == "far" else f"{name}_{side}"
            gmsh.model.addPhysicalGroup(dim - 1, parts, next(tags), group)
    gmsh.model.mesh.generate(dim)


def layers(length: float, size: float, growth: float) -> int:
    """The fewest cells over a length, the first at most ``size`` and each ``growth`` the last."""
    cells = length / (size * ROUND_OFF)
    if growth > 1.0:
        cells = math.log1p(cells * (growth - 1.0)) / math.log(growth)
    return max(1, math.ceil(cells))


MAX_GROWTH = 2.0
"""Largest size of a cell over that of its neighbour on the contact side."""


def check_growth(growth: float) -> None:
    """Raise a ValueError for a growth of cells that is none, or too large."""
    if not 1.0 <= growth <= MAX_GROWTH:
        raise ValueError(f"growth = {growth} is not allowed; from 1 (equal cells) to {MAX_GROWTH}")


def check_positive(field: str, value: float) -> None:
    """Raise a ValueError for a number that is not finite and above zero; names the field."""
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{field} = {value} is not allowed; it must be finite and > 0")


def check_length(field: str, value: float) -> None:
    """Raise a ValueError for a length (m) that cannot be calculated with; names the field."""
    check_positive(field, value)
    if not SHORTEST <= value <= LONGEST:
        raise ValueError(
            f"{field} = {value} m is not allowed; it must be from {SHORTEST:g} to {LONGEST:g} m"
        )


def check_gap(value: float) -> None:
    """Raise a ValueError for a distance (m) that two bodies cannot have."""
    if not 0.0 <= value <= LONGEST:
        raise ValueError(f"gap = {value} m is not allowed; it must be >= 0 and at most {LONGEST:g}")


def _check_counts(elements: tuple[int, int], grading: float) -> None:
    if len(elements) != 2 or any(int(n) != n or n < 1 for n in elements):
        raise ValueError(f"elements = {list(elements)} is not allowed; give two integers >= 1")
    if max(elements) > MAX_CELLS:
        raise ValueError(f"elements: at most {MAX_CELLS} cells are allowed")
    if elements[1] == 1 and grading != 1.0:
        raise ValueError(
            f"grading = {grading} is not allowed with one element in y; it takes two or more"
        )


# -- Meshes of equal rectangles as arrays, numbered as gmsh numbers them, but made without it ------
#
# Loading gmsh takes longer than a small mesh does. Nodes: first the corners of all blocks, then the
# nodes along their sides, side by side, then those inside.

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

SIDES = ("contact", "far", "left", "right")
"""Sides of a rectangle in the order of their numbers; contact: row 0, left: column 0."""


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A block of equal rectangular cells.

    Attributes:
        name: of the body; sides: names of the surfaces on :data:`SIDES`.
        x: (i,), m, of its columns of nodes, rising; y: (j,), m, of its rows, away from the contact.
    """

    name: str
    sides: Sequence[str]
    x: Floats
    y: Floats

    @property
    def rises(self) -> bool:
        """Whether it lies above the contact; its cells then go up column by column, else by row."""
        return bool(self.y[-1] > self.y[0])


@dataclass(frozen=True, slots=True)
class RegularMesh:
    """A mesh of quadrilaterals in the plane.

    Attributes:
        position: (n, 3), m; bodies: tag and nodes (c, 4) of the cells of each.
        surfaces: tag and nodes (f, 2) of the facets of each.
    """

    position: Floats
    bodies: Mapping[str, tuple[int, Ints]]
    surfaces: Mapping[str, tuple[int, Ints]]


def regular_mesh(blocks: Sequence[Rectangle]) -> RegularMesh:
    """The mesh of blocks that share no nodes."""
    tables = _numbered(blocks)
    position = np.zeros((sum(table.size for table in tables), 3))
    for block, table in zip(blocks, tables, strict=True):
        position[table, 0], position[table, 1] = block.x[:, None], block.y[None, :]
    named = list(zip(blocks, tables, strict=True))
    bodies = {b.name: (tag, _cells(b, t)) for tag, (b, t) in enumerate(named, start=1)}
    facets = [(name, side) for b, t in named for name, side in zip(b.sides, _along(t), strict=True)]
    # Tags of surfaces go on from those of the bodies: no number means two things.
    surfaces = {
        name: (tag, np.stack([side[:-1], side[1:]], axis=1))
        for tag, (name, side) in enumerate(facets, start=len(blocks) + 1)
    }
    return RegularMesh(position, bodies, surfaces)


def _along(table: Ints) -> Iterator[Ints]:
    """The nodes of each side, from column or row 0 on."""
    yield from (table[:, 0], table[:, -1], table[0], table[-1])


def _numbered(blocks: Sequence[Rectangle]) -> list[Ints]:
    """The number of the node in each column and row (i, j) of each block."""
    tables: list[Ints] = [
        np.empty((len(block.x), len(block.y)), dtype=np.int64) for block in blocks
    ]
    count = 0
    for table in tables:
        table[[0, -1, -1, 0], [0, 0, -1, -1]] = count + np.arange(4)
        count += 4
    for table in tables:
        for side in _along(table):  # views of the table
            inner = side[1:-1]
            inner[:] = count + np.arange(len(inner))
            count += len(inner)
    for block, table in zip(blocks, tables, strict=True):
        inside = table[1:-1, 1:-1] if block.rises else table[1:-1, 1:-1].T
        inside[...] = count + np.arange(inside.size).reshape(inside.shape)
        count += inside.size
    return tables


def _cells(block: Rectangle, table: Ints) -> Ints:
    """Corners (c, 4) of the cells, counter-clockwise from the node nearest to row and column 0."""
    low, right = table[:-1, :-1], table[1:, :-1]
    opposite, left = table[1:, 1:], table[:-1, 1:]
    if block.rises:
        return np.stack([low, right, opposite, left], axis=-1).reshape(-1, 4)
    return np.stack([low.T, left.T, opposite.T, right.T], axis=-1).reshape(-1, 4)


# -- The built-in geometry in space: a box resting on another, meshed by gmsh ----------------------
#
# x runs to the right, y upwards and z towards the viewer. The lower box's top lies on y = 0 with
# its left back corner at x = z = 0; the upper box's bottom lies on y = gap. The boxes share no
# nodes, also when they touch.


BOX_CELLS = ("hexahedron", "tetrahedron")


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
        check_pair(self.cell, BOX_CELLS, (self.upper_name, self.lower_name))

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
        upper = _draw_box(self.upper, (x, self.gap, z), 1.0, self.cell)
        lower = _draw_box(self.lower, (0.0, 0.0, 0.0), -1.0, self.cell)
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


def _draw_box(box: Box, at: tuple[float, float, float], upwards: float, cell: str) -> Drawn:
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
