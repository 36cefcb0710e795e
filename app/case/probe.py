"""The `[[probe]]` tables of a case file: what is followed through the history, and where."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, create_model

from tribox.app.case.contact import Contact
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Model, Name, Place, Points, Problem, Text, nearest, size_problems

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section

Kind = Literal["point", "line", "contact", "surface", "body"]
_Length = Annotated[float, Quantity("m")]
Point = tuple[_Length, ...]
_Way = Annotated[float, Quantity("m", ge=0.0)]
_Piece = tuple[_Way, _Way]


if TYPE_CHECKING:
    _NamesFrom = Model
else:
    # A field called "from" cannot be written as an attribute.
    _NamesFrom = create_model(
        "_NamesFrom",
        __base__=Model,
        **{"from": (Point, Field(description="first point, [x, y] or [x, y, z], undeformed"))},
    )


class ProbeLine(_NamesFrom):
    """Points at equal distances on a straight line in the undeformed mesh."""

    to: Point
    """last point, [x, y] or [x, y, z], undeformed"""
    points: Points
    """number of points, the ends included; at least 2"""

    @property
    def start(self) -> Point:
        """The first point, m."""
        return getattr(self, "from")

    def problems(self, place: Place) -> Iterator[Problem]:
        """No line, or no number of points to divide it by."""
        if self.points < 2:
            yield Problem((*place, "points"), "must be at least 2; give point for one", self.points)
        if self.start == self.to:
            yield Problem((*place, "to"), "must differ from from", list(self.to))


class Probe(Model):
    """One thing that is followed: a point, a line, a body, or the contact of a pair."""

    name: Name
    """what the tables call it; each probe its own"""
    point: Point | None = None
    """one place, [x, y] or [x, y, z], undeformed"""
    at: Literal["interpolated", "node"] = "interpolated"
    """ "interpolated": the material point at this place; "node": the nearest node of the
    displacement, reported where it is; with point only"""
    line: ProbeLine | None = None
    """points on a line, undeformed"""
    body: Text | None = None
    """alone: averages, extremes and energy of this body; with point or line: the body they lie in,
    needed where two bodies touch"""
    contact: Text | None = None
    """name of a contact pair, along whose slave surface values are"""
    points: Points | None = None
    """number of points at equal distances along the slave surface, in the plane; default: its
    vertices; with contact only"""

    surface: Text | None = None
    """named surface, in the plane: the line of its nodes, with angle, radius and thickness"""
    opposite: Text | None = None
    """named surface on the other side of the sheet, which the thickness is the distance to; with
    surface only"""
    straight: tuple[_Piece, _Piece] | None = None
    """two pieces [[from, to], [from, to]] of the line, by undeformed arc length from its left end,
    between whose directions the angle is; default: between the tangents at its ends; with surface
    only"""
    bend: _Piece | None = None
    """piece [from, to] of the line, by undeformed arc length, that the circle is fitted to;
    default: that between the straight pieces, or all; with surface only"""

    @property
    def kind(self) -> Kind:
        """What is followed."""
        if self.surface is not None:
            return "surface"
        if self.point is not None:
            return "point"
        if self.line is not None:
            return "line"
        return "body" if self.contact is None else "contact"

    def problems(
        self, place: Place, bodies: Sequence[str], pairs: Sequence[str]
    ) -> Iterator[Problem]:
        """Keys that do not fit together, and names that nothing has."""
        kinds = ("point", "line", "contact", "surface")
        given = [key for key in kinds if getattr(self, key) is not None]
        if len(given) > 1:
            reason = f"give one of point, line, contact and surface, found {', '.join(given)}"
            yield Problem(place, reason)
        elif not given and self.body is None:
            yield Problem(place, "follows nothing; give point, line, body, contact or surface")
        yield from self._surface_problems(place)
        if self.line is not None:
            yield from self.line.problems((*place, "line"))
        if self.point is None and self.at == "node":
            yield Problem((*place, "at"), "goes with point only", self.at)
        if self.contact is None and self.points is not None:
            yield Problem((*place, "points"), "goes with contact only", self.points)
        if self.points is not None and self.points < 2:
            yield Problem((*place, "points"), "must be at least 2", self.points)
        for key in ("contact", "surface"):
            if getattr(self, key) is not None and self.body is not None:
                yield Problem((*place, "body"), f"does not go with {key}", self.body)
        yield from _unknown("body", self.body, bodies, place)
        yield from _unknown("contact", self.contact, pairs, place)

    def _surface_problems(self, place: Place) -> Iterator[Problem]:
        """Keys of a named line, and pieces of it that are none."""
        for key in ("opposite", "straight", "bend"):
            if self.surface is None and getattr(self, key) is not None:
                yield Problem((*place, key), "goes with surface only")
        if self.opposite is not None and self.opposite == self.surface:
            yield Problem((*place, "opposite"), "must differ from surface", self.opposite)
        pieces = [("bend", self.bend)] if self.bend is not None else []
        pieces += [("straight", piece) for piece in self.straight or ()]
        for key, (start, end) in pieces:
            if start >= end:
                yield Problem((*place, key), "must go from a smaller to a larger arc length")
                return
        if self.straight is not None and self.straight[0][1] > self.straight[1][0]:
            yield Problem((*place, "straight"), "the second piece must begin behind the first")

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with what the mesh stands for."""
        dim = 3 if section == "3D" else 2
        if dim == 3 and self.surface is not None:
            reason = "goes with meshes in the plane; in space follow points and lines"
            yield Problem((*place, "surface"), reason, self.surface)
        places: list[tuple[Place, Point]] = []
        if self.point is not None:
            places.append((("point",), self.point))
        if self.line is not None:
            places += [(("line", "from"), self.line.start), (("line", "to"), self.line.to)]
        for keys, point in places:
            yield from size_problems(point, dim, (*place, *keys), "coordinates")
        if dim == 3 and self.points is not None:
            reason = "goes with meshes in the plane; in space the values are at the vertices"
            yield Problem((*place, "points"), reason, self.points)


def probe_problems(
    probes: Sequence[Probe],
    bodies: Mapping[str, object],
    contacts: Sequence[Contact],
    place: Place,
    section: Section | None = None,
) -> Iterator[Problem]:
    """Mistakes in the probes: each by itself, together, and with the mesh if known."""
    names: dict[str, int] = {}
    pairs = [contact.label for contact in contacts]
    for index, probe in enumerate(probes):
        here = (*place, index)
        yield from probe.problems(here, list(bodies), pairs)
        if section is not None:
            yield from probe.section_problems(section, here)
        first = names.setdefault(probe.name, index)
        if first != index:
            yield Problem((*here, "name"), f"is what probe.{first} is called already", probe.name)


def _unknown(key: str, name: str | None, known: Sequence[str], place: Place) -> Iterator[Problem]:
    if name is not None and name not in known:
        kind = "contact pair" if key == "contact" else key
        yield Problem((*place, key), f"no such {kind}; {nearest(name, known)}", name)
