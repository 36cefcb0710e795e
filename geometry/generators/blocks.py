"""The built-in geometry of any number of rectangles, or boxes, each a body of its own.

Their sides lie along the axes. They share no nodes, also where they touch. gmsh meshes them, but
where all are rectangles or boxes of equal cells, which are put together here: gmsh takes longer to
be loaded than a small mesh to be made, and to make a large one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

MAX_CELLS = 10_000_000
"""More cells than this in one body are taken for a mistake in the element size."""

SHORTEST, LONGEST = 1e-15, 1e15  # lengths in m: powers of them are still numbers

MAX_GRADING = 1000.0  # largest ratio of element extents within a block, either way

ROUND_OFF = 1.0 + 1e-9  # 1 mm in steps of 0.1 mm is 10 steps, not 11

CELLS = {"quadrilateral": 2, "triangle": 2, "hexahedron": 3, "tetrahedron": 3}
"""Shapes of cells, and their dimension."""

PER_BOX = {"quadrilateral": 1, "triangle": 2, "hexahedron": 1, "tetrahedron": 6}

SIDES = (("left", "right"), ("bottom", "top"), ("back", "front"))
"""Names of the sides at the low and the high end of each axis."""


@dataclass(frozen=True, slots=True)
class PlacedBlock:
    """A rectangle or box, where it lies and how finely it is meshed: by elements or size.

    ValueError if a value is out of its range, naming block, field and value.
    """

    name: str  # of the body; its sides are surfaces NAME_left, NAME_right, ... (:data:`SIDES`)
    low: Sequence[float]  # (i,), m, its corner of least coordinates
    high: Sequence[float]  # (i,), m, the opposite one
    elements: Sequence[int] | None = None  # (i,) their number along each axis
    size: float | None = None  # m, largest extent of an element at the finest end of each axis
    # (i,) extent of the last element over that of the first, along each axis
    grading: Sequence[float] = ()

    def __post_init__(self) -> None:
        try:
            self._check()
        except ValueError as error:
            raise ValueError(f"{self.name}: {error}") from None

    def _check(self) -> None:
        for axis, extent in zip("xyz", self.extents(), strict=False):
            if not extent > 0.0:
                raise ValueError(f"{axis} must go from a lower to a higher value")
            check_length(f"extent in {axis}", extent)
        if (self.elements is None) == (self.size is None):
            raise ValueError("give either elements or size, not both and not neither")
        for key, given in (("elements", self.elements), ("grading", self.grading or None)):
            if given is not None and len(given) != len(self.low):
                raise ValueError(f"{key} needs {len(self.low)} numbers, found {len(given)}")
        for grading in self.grading:
            check_grading(grading)
        if self.elements is not None:
            if any(int(count) != count or count < 1 for count in self.elements):
                raise ValueError(f"elements = {list(self.elements)}: give whole numbers from 1 on")
            if any(n == 1 and g != 1.0 for n, g in zip(self.elements, self.grading, strict=False)):
                raise ValueError("grading takes two elements or more along its axis")
        if self.size is not None:
            check_length("size", self.size)
            if self.size < max(self.extents()) / MAX_CELLS:
                raise ValueError(f"size = {self.size:g} m is too small for blocks of this extent")
        if math.prod(self.counts()) > MAX_CELLS:
            raise ValueError(f"more than {MAX_CELLS} cells")

    def extents(self) -> list[float]:
        """Extent along each axis, m."""
        return [high - low for low, high in zip(self.low, self.high, strict=True)]

    def counts(self) -> list[int]:
        """Number of elements along each axis."""
        if self.elements is not None:
            return list(self.elements)
        assert self.size is not None
        pairs = zip(self.extents(), self.gradings(), strict=True)
        return [_layers(extent, self.size, grading) for extent, grading in pairs]

    def gradings(self) -> list[float]:
        """Extent of the last element over that of the first, along each axis."""
        return list(self.grading) or [1.0] * len(self.low)

    def progressions(self) -> Iterator[tuple[int, float]]:
        """Number of elements, and ratio of neighbours' extents, along each axis."""
        for count, grading in zip(self.counts(), self.gradings(), strict=True):
            yield count, grading ** (1.0 / (count - 1)) if count > 1 else 1.0


def check_length(field: str, value: float) -> None:
    """Raise a ValueError for a length (m) that cannot be calculated with; names the field."""
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{field} = {value} is not allowed; it must be finite and > 0")
    if not SHORTEST <= value <= LONGEST:
        raise ValueError(
            f"{field} = {value} m is not allowed; it must be from {SHORTEST:g} to {LONGEST:g} m"
        )


def check_grading(value: float) -> None:
    """Raise a ValueError for a ratio of element extents that no mesh can have."""
    if not 1.0 / MAX_GRADING <= value <= MAX_GRADING:
        allowed = f"from {1.0 / MAX_GRADING} to {MAX_GRADING}"
        raise ValueError(f"grading = {value:g} is not allowed; it must be {allowed}")


def _layers(extent: float, size: float, grading: float) -> int:
    """Fewest elements, graded by ``grading``, of which the smallest is at most ``size``."""
    ratio = max(grading, 1.0 / grading)
    if ratio == 1.0:
        return max(1, math.ceil(extent / (size * ROUND_OFF)))
    # The smallest of n is extent/(1 + q + ... + q^(n-1)) with q^(n-1) = ratio, and this sum grows
    # with n: the count can be bisected. With one element there is no progression.
    low, high = 1, 2
    while extent / _sum(high, ratio) > size * ROUND_OFF:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        fits = extent / _sum(middle, ratio) <= size * ROUND_OFF
        low, high = (low, middle) if fits else (middle, high)
    return high


def _sum(count: int, ratio: float) -> float:
    """1 + q + ... + q^(count-1), written without cancellation for q near 1."""
    log_q = math.log(ratio) / (count - 1)
    return math.expm1(count * log_q) / math.expm1(log_q)


FIT = 0.05  # share of their extent by which blocks may overlap, as those of a press fit do


@dataclass(frozen=True, slots=True)
class RegularMesh:
    """A mesh of quadrilaterals, or of hexahedra."""

    cell: str  # shape of the cells
    position: npt.NDArray[np.float64]  # (n, 3), m
    # tag and nodes (c, 4) or (c, 8) of the cells of each
    bodies: Mapping[str, tuple[int, npt.NDArray[np.int64]]]
    # tag and nodes (f, 2) or (f, 4) of the facets of each
    surfaces: Mapping[str, tuple[int, npt.NDArray[np.int64]]]


@dataclass(frozen=True, slots=True)
class Blocks:
    """Rectangles or boxes that do not overlap by more than a press fit does.

    Raises:
        ValueError: If blocks overlap so, or do not go with the cells; if sides do not meet.
    """

    blocks: tuple[PlacedBlock, ...]  # with different names
    cell: str = "quadrilateral"  # shape of all cells, see :data:`CELLS`
    # names of points and edges, each with the names of the sides that meet there
    groups: Mapping[str, Sequence[str]] = field(default_factory=dict)
    # other names of sides, by those that they would have
    renamed: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.cell not in CELLS:
            raise ValueError(f"cell = {self.cell!r} is not allowed; choose from {', '.join(CELLS)}")
        dim = CELLS[self.cell]
        for block in self.blocks:
            if len(block.low) != dim:
                found = "in space" if len(block.low) == 3 else "in the plane"
                raise ValueError(f"{block.name}: a block {found} does not go with {self.cell}s")
        for one, other in itertools.combinations(self.blocks, 2):
            if _overlap(one, other):
                raise ValueError(
                    f"{one.name} and {other.name} overlap; they may touch, or for a press fit "
                    f"overlap by {FIT:g} of their extent"
                )
        for name in self.groups:
            self._corners(name)

    def _corners(self, group: str) -> tuple[PlacedBlock, list[int]]:
        """The block of a group and its corners there, numbered as by :func:`_draw`."""
        sides, dim = self.groups[group], CELLS[self.cell]
        names = {
            f"{block.name}_{side}": (block, axis, end)
            for block in self.blocks
            for axis, pair in enumerate(SIDES[:dim])
            for end, side in enumerate(pair)
        }
        for side in sides:
            if side not in names:
                known = ", ".join(names)
                raise ValueError(f"group {group}: no such side: {side}; there are {known}")
        found = [names[side] for side in sides]
        axes = [axis for _, axis, _ in found]
        one_block = len({block.name for block, _, _ in found}) == 1
        if not one_block or len(set(axes)) < len(axes) or not 2 <= len(axes) <= dim:
            many = "two" if dim == 2 else "two or three"
            given = " and ".join(sides) or "no sides"
            raise ValueError(
                f"group {group}: {given} do not meet; give {many} sides of one block that do"
            )
        # Bit k of a corner's number is its end of axis k: sides of one block meet in the corners
        # whose bits are the ends of all of them.
        corners = [
            corner
            for corner in range(2**dim)
            if all(corner >> axis & 1 == end for _, axis, end in found)
        ]
        return found[0][0], corners

    def cells(self) -> int:
        """Number of cells of all blocks."""
        return PER_BOX[self.cell] * sum(math.prod(block.counts()) for block in self.blocks)

    def name_of(self, block: PlacedBlock, side: str) -> str:
        """The name of a block's side."""
        name = f"{block.name}_{side}"
        return self.renamed.get(name, name)

    def regular(self) -> RegularMesh | None:
        """The mesh that gmsh would make, without it; None unless all are of equal cells.

        Those are rectangles and boxes. Places are exact; those of gmsh, which integrates the
        distances along a side, are so to 1e-12 of it, or 1e-9 where cells are graded.
        """
        graded = any(g != 1.0 for block in self.blocks for g in block.gradings())
        if graded or self.groups or self.cell not in ("quadrilateral", "hexahedron"):
            return None
        positions, bodies, first = [], {}, 0
        surfaces: dict[str, tuple[int, npt.NDArray[np.int64]]] = {}
        for tag, block in enumerate(self.blocks, start=1):
            ends = zip(block.low, block.high, block.counts(), strict=True)
            along = [np.linspace(low, high, count + 1) for low, high, count in ends]
            grid = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, len(along))
            positions.append(np.pad(grid, ((0, 0), (0, 3 - len(along)))))
            nodes = first + np.arange(len(grid), dtype=np.int64).reshape([len(x) for x in along])
            first += nodes.size
            bodies[block.name] = tag, _elements(nodes)
            for axis, pair in enumerate(SIDES[: len(along)]):
                for end, side in zip((0, -1), pair, strict=True):
                    # Tags of surfaces go on from those of the bodies: no number means two things.
                    number = len(self.blocks) + len(surfaces) + 1
                    facets = _elements(np.take(nodes, end, axis=axis))
                    surfaces[self.name_of(block, side)] = number, facets
        return RegularMesh(self.cell, np.concatenate(positions), bodies, surfaces)

    def build(self) -> None:
        """Draw and mesh the blocks in the current gmsh model; names: see :class:`PlacedBlock`."""
        import gmsh

        dim = CELLS[self.cell]
        drawn = [(block, _draw(block, self.cell)) for block in self.blocks]
        gmsh.model.geo.synchronize()
        # Tags of surfaces go on from those of the bodies: no number means two things.
        tags = itertools.count(1)
        for block, one in drawn:
            gmsh.model.addPhysicalGroup(dim, [one.body], next(tags), block.name)
        for block, one in drawn:
            for side, entity in one.sides.items():
                gmsh.model.addPhysicalGroup(
                    dim - 1, [entity], next(tags), self.name_of(block, side)
                )
        parts = {block.name: one for block, one in drawn}
        for name in self.groups:
            block, corners = self._corners(name)
            one = parts[block.name]
            entity = one.points[corners[0]] if len(corners) == 1 else abs(one.edges[tuple(corners)])
            gmsh.model.addPhysicalGroup(len(corners) - 1, [entity], next(tags), name)
        gmsh.model.mesh.generate(dim)


def _elements(nodes: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Nodes (e, a) of the elements between those of a grid of one, two or three axes.

    In gmsh's order: round the lower face, then round the upper one.
    """
    found = np.stack([nodes[:-1], nodes[1:]], axis=-1)
    for axis in range(1, nodes.ndim):
        low, high = (np.delete(found, end, axis) for end in (-1, 0))
        # Back along the second axis, so that four nodes go round; the third one only lifts them.
        found = np.concatenate([low, high[..., ::-1] if axis == 1 else high], axis=-1)
    return found.reshape(-1, found.shape[-1])


def _overlap(one: PlacedBlock, other: PlacedBlock) -> bool:
    ends = zip(one.low, one.high, other.low, other.high, strict=True)
    return all(min(b, d) - max(a, c) > FIT * min(b - a, d - c) for a, b, c, d in ends)


@dataclass(frozen=True, slots=True)
class _Drawn:
    """Entities of a block: its own, those of its sides, its corners, its edges by their ends."""

    body: int
    sides: dict[str, int]
    points: list[int]
    edges: dict[tuple[int, ...], int]


def _draw(block: PlacedBlock, cell: str) -> _Drawn:
    """Draw a block; corners are numbered by x + 2 y + 4 z, each 0 or 1."""
    import gmsh

    geo, dim = gmsh.model.geo, len(block.low)
    ends = (block.low, block.high)
    points = []
    for corner in range(2**dim):
        at = [ends[corner >> i & 1][i] for i in range(dim)]
        points.append(geo.addPoint(*at, *[0.0] * (3 - dim)))
    edges: dict[tuple[int, ...], int] = {}
    for axis, (count, ratio) in enumerate(block.progressions()):
        for a in range(2**dim):
            if not a >> axis & 1:
                b = a | 1 << axis
                edges[a, b] = curve = geo.addLine(points[a], points[b])
                edges[b, a] = -curve
                geo.mesh.setTransfiniteCurve(curve, count + 1, "Progression", ratio)
    if dim == 2:
        face = _face(edges, (0, 1, 3, 2), cell)
        sides = {(0, 0): (0, 2), (0, 1): (1, 3), (1, 0): (0, 1), (1, 1): (2, 3)}
        lines = {SIDES[axis][end]: edges[pair] for (axis, end), pair in sides.items()}
        return _Drawn(face, lines, points, edges)
    return _Drawn(*_box(edges, cell), points, edges)


def _face(edges: dict[tuple[int, ...], int], loop: Sequence[int], cell: str) -> int:
    """A face with the corners of a loop."""
    import gmsh

    geo = gmsh.model.geo
    curves = [edges[loop[i], loop[(i + 1) % 4]] for i in range(4)]
    face: int = geo.addPlaneSurface([geo.addCurveLoop(curves)])
    if cell == "triangle":
        geo.mesh.setTransfiniteSurface(face, "AlternateLeft")
    else:
        geo.mesh.setTransfiniteSurface(face)
    if cell in ("quadrilateral", "hexahedron"):
        geo.mesh.setRecombine(2, face)
    return face


def _box(edges: dict[tuple[int, ...], int], cell: str) -> tuple[int, dict[str, int]]:
    """The volume of a box and its six sides."""
    import gmsh

    geo, sides = gmsh.model.geo, {}
    for axis, end in itertools.product(range(3), range(2)):
        first, second = (1 << other for other in range(3) if other != axis)
        start = end << axis
        loop = (start, start | first, start | first | second, start | second)
        sides[SIDES[axis][end]] = _face(edges, loop, cell)
    volume: int = geo.addVolume([geo.addSurfaceLoop(list(sides.values()))])
    geo.mesh.setTransfiniteVolume(volume)
    return volume, sides
