"""Meshes of rectangles of equal cells, each a body whose sides are surfaces, as files of gmsh."""

from collections.abc import Mapping
from dataclasses import dataclass

SIDES = ("bottom", "right", "top", "left")


@dataclass(frozen=True, slots=True)
class Rectangle:
    """From (left, bottom) to (right, top), m, in so many cells each way."""

    left: float
    bottom: float
    right: float
    top: float
    cells: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Rectangles:
    """Bodies that share no nodes; the sides of NAME are NAME_bottom, NAME_right and so on."""

    bodies: Mapping[str, Rectangle]

    def build(self) -> None:
        """Mesh them in the current gmsh model."""
        import gmsh

        for name, body in self.bodies.items():
            _draw(gmsh.model, name, body)
        gmsh.model.mesh.generate(2)


def _draw(model, name: str, body: Rectangle) -> None:
    at = (
        *((body.left, body.bottom), (body.right, body.bottom)),
        *((body.right, body.top), (body.left, body.top)),
    )
    corners = [model.geo.addPoint(x, y, 0.0) for x, y in at]
    lines = [model.geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    area = model.geo.addPlaneSurface([model.geo.addCurveLoop(lines)])
    for number, line in enumerate(lines):
        model.geo.mesh.setTransfiniteCurve(line, body.cells[number % 2] + 1)
    model.geo.mesh.setTransfiniteSurface(area)
    model.geo.mesh.setRecombine(2, area)
    model.geo.synchronize()
    model.addPhysicalGroup(2, [area], name=name)
    for side, line in zip(SIDES, lines, strict=True):
        model.addPhysicalGroup(1, [line], name=f"{name}_{side}")
