r"""Built-in geometries of Hertz's line contact: a half cylinder on a block, or on another one.

The bodies touch at the origin. Each is made of four transfinite faces: a box under the contact zone
with cells of equal width, and three faces around it whose cells grow towards the far sides.

::

    end ________ corner _____________ corner ________ end
       \  side     \        far        /     side  /
        \           \ inner_____inner /           /
         \___________|      box      |___________/
            flank   near __________ near   flank
                       contact
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tribox.geometry.generators.blocks import MAX_CELLS, ROUND_OFF, check_length
from tribox.geometry.generators.two_blocks import (
    CELLS,
    Drawn,
    check_growth,
    check_pair,
    layers,
    mesh_pair,
)

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Outline:
    """The right half of a body, as (x, depth) in m with the depth counted from the apex inwards.

    Attributes:
        near: End of the contact zone on the surface.
        inner: Corner of the box under the contact zone.
        end: Where the surface ends.
        corner: Corner of the far side to which the box's corner is joined.
        centre: Of the surface's arc; None where the surface is flat.
    """

    near: Point
    inner: Point
    end: Point
    corner: Point
    centre: Point | None

    def flank(self) -> float:
        """Length of the surface from the contact zone to its end, m."""
        if self.centre is None:
            return self.end[0] - self.near[0]
        radius = self.centre[1]
        return radius * (math.asin(self.end[0] / radius) - math.asin(self.near[0] / radius))

    def depth(self) -> float:
        """Length of the box's sides from the contact inwards, m."""
        return math.dist(self.near, self.inner)


@dataclass(frozen=True, slots=True)
class HalfCylinder:
    """A cylinder cut in half: round towards the contact, its flat side the far side.

    Attributes:
        radius: m.
        contact_width: Extent in x of the contact zone, m; the surface outside it never touches.
        contact_size: Largest width of a cell in the contact zone, and height on its surface, m.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    radius: float
    contact_width: float
    contact_size: float

    def __post_init__(self) -> None:
        check_length("radius", self.radius)
        _check_zone(self.contact_width, self.contact_size, "radius", self.radius)

    def outline(self) -> Outline:
        """Its shape; the box is 0.4 as deep as wide, and narrower on its far side.

        So the cells at its corners keep their shape also where the zone is as wide as the radius.
        """
        half, radius = 0.5 * self.contact_width, self.radius
        # R - sqrt(R^2 - x^2) without cancellation
        rise = half**2 / (radius + math.sqrt(radius**2 - half**2))
        return Outline(
            near=(half, rise),
            inner=(0.8 * half, rise + 0.8 * half),
            end=(radius, radius),
            corner=(0.6 * radius, radius),
            centre=(0.0, radius),
        )


@dataclass(frozen=True, slots=True)
class FlatBlock:
    """A rectangular block, touched in the middle of one side.

    Attributes:
        width: Extent in x, m.
        height: Extent in y, m.
        contact_width: Extent in x of the contact zone, m; the surface outside it never touches.
        contact_size: Largest width of a cell in the contact zone, and height on its surface, m.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    width: float
    height: float
    contact_width: float
    contact_size: float

    def __post_init__(self) -> None:
        check_length("width", self.width)
        check_length("height", self.height)
        _check_zone(self.contact_width, self.contact_size, "width", self.width)

    def outline(self) -> Outline:
        """Its shape; the box is half as deep as it is wide, at most half as deep as the block."""
        half = 0.5 * self.contact_width
        return Outline(
            near=(half, 0.0),
            inner=(half, min(half, 0.5 * self.height)),
            end=(0.5 * self.width, 0.0),
            corner=(0.5 * self.width, self.height),
            centre=None,
        )


Body = HalfCylinder | FlatBlock


@dataclass(frozen=True, slots=True)
class LineContact:
    """Two bodies that touch along the line x = y = 0.

    Attributes:
        upper: The body above (an elastomer, if not named otherwise).
        lower: The body below (aluminium, if not named otherwise).
        growth: Size of a cell over that of its neighbour on the contact side, outside the contact
            zone along the surface and everywhere inwards.
        cell: "quadrilateral", or "triangle" (the same grid, each cell cut in two).
        upper_name: Name of the upper body and first part of its surfaces' names.
        lower_name: Name of the lower body and first part of its surfaces' names.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    upper: Body
    lower: Body
    growth: float = 1.15
    cell: str = "quadrilateral"
    upper_name: str = "elastomer"
    lower_name: str = "aluminium"

    def __post_init__(self) -> None:
        check_growth(self.growth)
        check_pair(self.cell, CELLS[2], (self.upper_name, self.lower_name))
        for body in (self.upper, self.lower):
            if (cells := self._cells(body)) > MAX_CELLS:
                raise ValueError(
                    f"contact_size = {body.contact_size} m and growth = {self.growth} make a body "
                    f"of {cells} cells; at most {MAX_CELLS} are allowed"
                )

    def cells(self) -> int:
        """Number of cells of both bodies."""
        total = self._cells(self.upper) + self._cells(self.lower)
        return total * (2 if self.cell == "triangle" else 1)

    def _cells(self, body: Body) -> int:
        """Number of quadrilaterals of one body."""
        across, deep, out = counts(body, self.growth)
        return across * deep + (across + 2 * deep) * out

    def build(self) -> None:
        """Draw and mesh both bodies in the current gmsh model.

        The physical groups are the two bodies and, with U and L for their names, the curves
        ``U_contact`` and ``L_contact`` (the contact zones), ``top`` (of U), ``bottom`` (of L),
        ``U_left``, ``U_right``, ``L_left`` and ``L_right``: of a half cylinder the flat side and
        the arcs beside its contact zone, of a block its far side and its ends.
        """
        upper = _draw(self.upper, 1.0, self.growth, self.cell)
        lower = _draw(self.lower, -1.0, self.growth, self.cell)
        mesh_pair(2, (self.upper_name, self.lower_name), (upper, lower))


def counts(body: Body, growth: float) -> tuple[int, int, int]:
    """Cells across the contact zone (even: a node on the apex), down its box, and outwards."""
    outline, size = body.outline(), body.contact_size
    across = 2 * max(1, math.ceil(0.5 * body.contact_width / (size * ROUND_OFF)))
    return across, layers(outline.depth(), size, growth), layers(outline.flank(), size, growth)


def _draw(body: Body, upwards: float, growth: float, cell: str) -> Drawn:
    """One body, extending from the origin in the direction +1 or -1 of y: its faces and sides."""
    import gmsh

    geo = gmsh.model.geo
    shape = body.outline()
    across, deep, out = counts(body, growth)

    def points(right: Point) -> tuple[int, int]:
        """The mirror image of a point, and the point."""
        x, y = right
        return geo.addPoint(-x, upwards * y, 0.0), geo.addPoint(x, upwards * y, 0.0)

    near, inner, end, corner = (
        points(p) for p in (shape.near, shape.inner, shape.end, shape.corner)
    )
    middle = geo.addPoint(0.0, upwards * shape.centre[1], 0.0) if shape.centre else None

    def surface(a: int, b: int) -> int:
        return geo.addLine(a, b) if middle is None else geo.addCircleArc(a, middle, b)

    # In two halves: gmsh spaces nodes to six digits or so, and one must lie on the apex.
    apex = geo.addPoint(0.0, 0.0, 0.0)
    contact = [surface(near[0], apex), surface(apex, near[1])]
    roof, far = geo.addLine(*inner), geo.addLine(*corner)
    walls = [geo.addLine(near[i], inner[i]) for i in (0, 1)]
    flanks = [surface(near[i], end[i]) for i in (0, 1)]
    spokes = [geo.addLine(inner[i], corner[i]) for i in (0, 1)]
    sides = [geo.addLine(end[i], corner[i]) for i in (0, 1)]
    for curve in contact:
        geo.mesh.setTransfiniteCurve(curve, across // 2 + 1)
    for curve in (roof, far):
        geo.mesh.setTransfiniteCurve(curve, across + 1)
    for curve in walls:
        geo.mesh.setTransfiniteCurve(curve, deep + 1, "Progression", growth)
    for curve in sides:
        geo.mesh.setTransfiniteCurve(curve, deep + 1)
    for curve in (*flanks, *spokes):
        geo.mesh.setTransfiniteCurve(curve, out + 1, "Progression", growth)
    loops = [[*contact, walls[1], -roof, -walls[0]], [roof, spokes[1], -far, -spokes[0]]]
    loops += [[flanks[i], sides[i], -spokes[i], -walls[i]] for i in (0, 1)]
    faces = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
    corners = [[*near, *inner[::-1]], [], [], []]  # those of faces with four curves are clear
    for face, at in zip(faces, corners, strict=True):
        geo.mesh.setTransfiniteSurface(face, "AlternateLeft", at)
        if cell == "quadrilateral":
            geo.mesh.setRecombine(2, face)
    ends, more = (sides, []) if middle is None else (flanks, sides)
    named = {"contact": contact, "far": [far, *more], "left": ends[:1], "right": ends[1:]}
    return faces, named


def _check_zone(width: float, size: float, field: str, limit: float) -> None:
    """The contact zone must be part of the surface, and its cells smaller than it."""
    check_length("contact_width", width)
    check_length("contact_size", size)
    if width >= limit:
        raise ValueError(
            f"contact_width = {width} m is not allowed; it must be < {field} = {limit} m"
        )
    if 2.0 * size > width * ROUND_OFF:
        raise ValueError(
            f"contact_size = {size} m is not allowed; at most half of contact_width = {width} m"
        )
    if width / size > MAX_CELLS:
        raise ValueError(
            f"contact_size = {size} m is not allowed; at least {width / MAX_CELLS:g} m"
        )
