r"""Built-in geometries of Hertz's line contact: a half cylinder on a block, or on another one.

The bodies touch at the origin. Each half is the section of a body of revolution, see
`sphere_on_block`: a box under the contact zone with cells of equal width, and faces around it whose
cells grow towards the far sides.

::

    end ________ corner _____________ corner ________ end
       \  side     \        far        /     side  /
        \           \ inner_____inner /           /
         \___________|      box      |___________/
            flank   near __________ near   flank
                       contact
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from tribox.geometry.generators import sphere_on_block
from tribox.geometry.generators.blocks import MAX_CELLS, ROUND_OFF, check_length
from tribox.geometry.generators.two_blocks import CELLS, check_growth, check_pair, layers, mesh_pair


@dataclass(frozen=True, slots=True)
class HalfCylinder:
    """A cylinder cut in half: round towards the contact, its flat side the far side.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    radius: float  # m
    contact_width: float  # extent in x of the contact zone, m; the surface outside it never touches
    contact_size: float  # largest width of a cell in the contact zone, and height on its surface, m

    def __post_init__(self) -> None:
        check_length("radius", self.radius)
        _check_zone(self.contact_width, self.contact_size, "radius", self.radius)

    def section(self, growth: float) -> sphere_on_block.Body:
        """Half of it, upwards."""
        return sphere_on_block.round_section(
            self.radius, self.contact_width, self.contact_size, growth
        )


@dataclass(frozen=True, slots=True)
class FlatBlock:
    """A rectangular block, touched in the middle of one side.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    width: float  # extent in x, m
    height: float  # extent in y, m
    contact_width: float  # extent in x of the contact zone, m; outside it never touches
    contact_size: float  # largest width of a cell there, and height on its surface, m

    def __post_init__(self) -> None:
        check_length("width", self.width)
        check_length("height", self.height)
        _check_zone(self.contact_width, self.contact_size, "width", self.width)

    def section(self, growth: float) -> sphere_on_block.Body:
        """Half of it, upwards; the box is half as deep as it is wide, or as the block is high."""
        half, end, far = 0.5 * self.contact_width, 0.5 * self.width, self.height
        box, size = min(half, 0.5 * far), self.contact_size
        places = {"pole": (0.0, 0.0), "core": (0.0, box), "top": (0.0, far), "near": (half, 0.0),
                  "inner": (half, box), "corner": (end, far), "end": (end, 0.0)}  # fmt: skip
        body = sphere_on_block.boxed_section(
            {name: sphere_on_block.Ring(*place) for name, place in places.items()},
            layers(box, size, growth), layers(end - half, size, growth), size, growth,
        )  # fmt: skip
        faces: dict[str, tuple[tuple[str, str], ...]] = {
            "contact": (("pole", "near"),),
            "far": (("top", "corner"),),
            "side": (("end", "corner"),),
        }
        return replace(body, faces=faces)


Shape = HalfCylinder | FlatBlock


@dataclass(frozen=True, slots=True)
class LineContact:
    """Two bodies that touch along the line x = y = 0.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    upper: Shape  # the body above (an elastomer, if not named otherwise)
    lower: Shape  # the body below (aluminium, if not named otherwise)
    # size of a cell over that of its neighbour on the contact side, outside the contact zone along
    # the surface and everywhere inwards
    growth: float = 1.15
    # "quadrilateral", or "triangle" (the same grid, each cell cut in two)
    cell: str = "quadrilateral"
    upper_name: str = "elastomer"  # name of the upper body and first part of its surfaces' names
    lower_name: str = "aluminium"  # name of the lower body and first part of its surfaces' names

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

    def _cells(self, body: Shape) -> int:
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
        upper, lower = (
            sphere_on_block.Drawing(body.section(self.growth), "line", self.cell, upwards).draw()
            for body, upwards in ((self.upper, 1.0), (self.lower, -1.0))
        )
        mesh_pair(2, (self.upper_name, self.lower_name), (upper, lower))


def counts(body: Shape, growth: float) -> tuple[int, int, int]:
    """Cells across the contact zone (even: a node on the apex), down its box, and outwards."""
    section = body.section(growth)
    edges = section.edges
    return 2 * section.across, edges["near", "inner"].count, edges["near", "end"].count


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
