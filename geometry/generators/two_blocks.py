"""The built-in geometry of a block resting on another, and what all pairs of bodies share.

The lower block's top lies on y = 0 with its left end at x = 0 (and its back at z = 0); the upper
block's bottom lies on y = gap. The blocks share no nodes, also when they touch.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from tribox.geometry.generators.blocks import (
    LONGEST,
    ROUND_OFF,
    Blocks,
    PlacedBlock,
    RegularMesh,
    check_grading,
)

CELLS = {2: ("quadrilateral", "triangle"), 3: ("hexahedron", "tetrahedron")}
"""Shapes of cells in the plane and in space; the first is the usual one."""


@dataclass(frozen=True, slots=True)
class Block:
    """A rectangle and how finely it is meshed; either ``elements`` or ``size`` is given.

    Attributes:
        width: Extent in x, m.
        height: Extent in y, m.
        elements: Number of elements along x and along y.
        size: Largest element width, and height of the least high elements, m.
        grading: Element height at the far side over that at the contact side, in a geometric
            progression; above 1 refines towards the contact.
    """

    width: float
    height: float
    elements: tuple[int, ...] | None = None
    size: float | None = None
    grading: float = 1.0

    @property
    def extents(self) -> tuple[float, ...]:
        """Along each axis, m."""
        return self.width, self.height


@dataclass(frozen=True, slots=True)
class Box:
    """The same in space, with an extent ``depth`` in z, m."""

    width: float
    height: float
    depth: float
    elements: tuple[int, ...] | None = None
    size: float | None = None
    grading: float = 1.0

    @property
    def extents(self) -> tuple[float, ...]:
        """Along each axis, m."""
        return self.width, self.height, self.depth


@dataclass(frozen=True, slots=True)
class TwoBlocks:
    """A block on a block, or a box on a box.

    Attributes:
        upper: The block above (an elastomer, if not named otherwise).
        lower: The block below (aluminium, if not named otherwise).
        offset: x of the upper block's left side, of a box x and z of its left back corner, m; by
            default the blocks are centred.
        gap: Distance between the blocks, m; 0 lets them touch exactly.
        cell: Of :data:`CELLS`; None: the usual one. Triangles are quadrilaterals cut by a diagonal
            of alternating direction.
        upper_name: Name of the upper body and first part of its surfaces' names.
        lower_name: Name of the lower body and first part of its surfaces' names.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    upper: Block | Box
    lower: Block | Box
    offset: float | tuple[float, float] | None = None
    gap: float = 0.0
    cell: str | None = None
    upper_name: str = "elastomer"
    lower_name: str = "aluminium"

    def __post_init__(self) -> None:
        check_gap(self.gap)
        extents = zip(self.upper.extents[::2], self.lower.extents[::2], strict=True)
        for axis, at, (above, below) in zip("xz", self._corner(), extents, strict=False):
            if not -above < at < below:
                raise ValueError(
                    f"offset = {at} m in {axis} is not allowed; between {-above} and {below} m the "
                    "blocks overlap"
                )
        for block in (self.upper, self.lower):
            check_grading(block.grading)
        check_pair(self._cell, CELLS[self.dim], (self.upper_name, self.lower_name))
        self.blocks()

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return len(self.upper.extents)

    @property
    def _cell(self) -> str:
        return self.cell or CELLS[self.dim][0]

    def _corner(self) -> Sequence[float]:
        """Position x, in space x and z, of the upper block's left back corner, m."""
        if self.offset is None:
            pairs = zip(self.upper.extents[::2], self.lower.extents[::2], strict=True)
            return [0.5 * (below - above) for above, below in pairs]
        return [self.offset] if isinstance(self.offset, float | int) else self.offset

    def blocks(self) -> Blocks:
        """Where both lie, and what their sides are called.

        With U and L for their names, those that touch are ``U_contact`` and ``L_contact``, those
        opposite ``top`` (of U) and ``bottom`` (of L).
        """
        (x, *z), growth = self._corner(), 1.0 / self.lower.grading
        upper, lower = self.upper_name, self.lower_name
        return Blocks(
            (
                _placed(self.upper, upper, [x, self.gap, *z], self.upper.grading),
                _placed(self.lower, lower, [0.0, -self.lower.height, 0.0], growth),
            ),
            self._cell,
            renamed={
                f"{upper}_bottom": f"{upper}_contact", f"{upper}_top": "top",
                f"{lower}_top": f"{lower}_contact", f"{lower}_bottom": "bottom",
            },
        )  # fmt: skip

    def cells(self) -> int:
        """Number of cells of both blocks."""
        return self.blocks().cells()

    def regular(self) -> RegularMesh | None:
        """See :meth:`Blocks.regular`."""
        return self.blocks().regular()

    def build(self) -> None:
        """Draw and mesh the blocks in the current gmsh model."""
        self.blocks().build()


def _placed(block: Block | Box, name: str, low: list[float], upwards: float) -> PlacedBlock:
    """A block at its corner of least coordinates, its elements growing upwards by a factor."""
    high = [a + extent for a, extent in zip(low, block.extents, strict=False)]
    grading = [1.0, upwards, 1.0][: len(high)]
    return PlacedBlock(name, low[: len(high)], high, block.elements, block.size, grading)


# -- What the generators of curved bodies on others share with it ----------------------------------


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
    """Name and mesh two bodies, upper first; far sides are ``top``, ``bottom``, else NAME_side."""
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


MAX_GROWTH = 2.0  # largest size of a cell over that of its neighbour on the contact side


def check_growth(growth: float) -> None:
    """Raise a ValueError for a growth of cells that is none, or too large."""
    if not 1.0 <= growth <= MAX_GROWTH:
        raise ValueError(f"growth = {growth} is not allowed; from 1 (equal cells) to {MAX_GROWTH}")


def check_gap(value: float) -> None:
    """Raise a ValueError for a distance (m) that two bodies cannot have."""
    if not 0.0 <= value <= LONGEST:
        raise ValueError(f"gap = {value} m is not allowed; it must be >= 0 and at most {LONGEST:g}")
