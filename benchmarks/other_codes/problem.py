"""The problem that all codes solve: two boxes of hexahedra, pressed together and slid.

Millimetres, newtons, megapascals. Uses the standard library only, so that every code's own Python
can read it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True)
class Box:
    """A box of equal hexahedra.

    Attributes:
        corner: smallest x, y and z, mm; y points up.
        size: extents in x, y and z, mm.
        counts: elements along x, y and z.
    """

    corner: tuple[float, float, float]
    size: tuple[float, float, float]
    counts: tuple[int, int, int]

    def coordinates(self, axis: int) -> list[float]:
        """Places of the nodes along an axis, mm."""
        start, length, count = self.corner[axis], self.size[axis], self.counts[axis]
        return [start + length * i / count for i in range(count + 1)]

    def nodes(self) -> Iterator[tuple[float, float, float]]:
        """Nodes, x fastest, then y."""
        for z in self.coordinates(2):
            for y in self.coordinates(1):
                for x in self.coordinates(0):
                    yield x, y, z

    def node(self, i: int, j: int, k: int) -> int:
        """Number of a node, from 0, by its place along x, y and z."""
        across, up = self.counts[0] + 1, self.counts[1] + 1
        return i + across * (j + up * k)

    def cells(self) -> Iterator[tuple[int, ...]]:
        """Nodes of the elements: four of the side of smallest z, going round, then the others."""
        corners = ((0, 0), (1, 0), (1, 1), (0, 1))
        for k in range(self.counts[2]):
            for j in range(self.counts[1]):
                for i in range(self.counts[0]):
                    yield tuple(self.node(i + a, j + b, k + c) for c in (0, 1) for a, b in corners)

    def layer(self, j: int) -> list[int]:
        """Numbers of the nodes at one height."""
        return [
            self.node(i, j, k) for k in range(self.counts[2] + 1) for i in range(self.counts[0] + 1)
        ]


@dataclass(frozen=True, slots=True)
class Problem:
    """Two boxes, what they are made of, and how they move.

    Attributes:
        upper: the soft box, whose lower side is the slave; lower: the stiff one.
        soft, stiff: Young's modulus, MPa, and Poisson's ratio.
        friction: coefficient of Coulomb friction.
        penalty: MPa/mm, of the pressure to the penetration.
        stick: MPa/mm, of the friction stress to the slip that is elastic.
        pressed, slid: way of the upper box's top downwards and then along x, mm.
        press_steps, slide_steps: equal steps of each.
        tolerance: of the residual, relative to the forces.
    """

    upper: Box
    lower: Box
    soft: tuple[float, float] = (5.0, 0.45)
    stiff: tuple[float, float] = (70e3, 0.33)
    friction: float = 0.2
    penalty: float = 1000.0
    stick: float = 200.0
    pressed: float = 0.05
    slid: float = 0.3
    press_steps: int = 5
    slide_steps: int = 15
    tolerance: float = 1e-8

    @property
    def dofs(self) -> int:
        """Displacements of all nodes, those prescribed included."""
        return 3 * sum((x + 1) * (y + 1) * (z + 1) for x, y, z in self.counts)

    @property
    def counts(self) -> tuple[tuple[int, int, int], ...]:
        """Elements of both boxes."""
        return self.upper.counts, self.lower.counts

    def steps(self) -> Iterator[tuple[float, float]]:
        """Displacement of the top along x and y at the end of each step, mm."""
        for step in range(1, self.press_steps + 1):
            yield 0.0, -self.pressed * step / self.press_steps
        for step in range(1, self.slide_steps + 1):
            yield self.slid * step / self.slide_steps, -self.pressed

    def figures(self) -> dict[str, object]:
        """All numbers, for another process."""
        return asdict(self) | {"steps": list(self.steps())}


def shear_and_lame(material: tuple[float, float]) -> tuple[float, float]:
    """Shear modulus G and Lamé's Λ, MPa, from Young's modulus and Poisson's ratio."""
    E, nu = material
    return E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))


def press_and_slide(level: int = 12) -> Problem:
    """The problem with ``level`` elements along the upper box; 12: 9 381 displacements."""
    below, height = round(17 * level / 12), round(5 * level / 12)
    upper = Box((0.5, 0.5, 0.5), (1.0, 0.5, 1.0), (level, level // 2, level))
    lower = Box((0.0, 0.0, 0.0), (2.0, 0.5, 2.0), (below, height, below))
    return Problem(upper, lower)
