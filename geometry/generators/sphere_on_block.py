r"""The built-in geometry of Hertz's point contact: a hemisphere on a round block.

The bodies touch at the origin; y is the axis. A half section of each is cut into quadrilaterals,
with cells of equal width under the contact zone that grow towards the far sides:

::

    top ______ corner ____ end           pole ____ near ____________ end
     |   far      \  side  /               |    core  \      rim      |
    core ________ inner   /                |           \              |
     |   box        |flank                base _______ corner _______ foot
    pole __________near

That section is meshed as it is, or the grid is carried round the axis, where the parts next to it
become prisms over squares and the others form rings around them: hexahedra that are well shaped
everywhere. A quarter, a half or the whole of the bodies is meshed so.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from tribox.geometry.generators import two_blocks
from tribox.geometry.generators.blocks import MAX_CELLS, ROUND_OFF, check_length

Part = Literal["axisymmetric", "quarter", "half", "full"]
QUARTERS = {"quarter": 1, "half": 2, "full": 4}
PLANE = {"axisymmetric": (0,), "line": (4, 0)}
"""Directions, in eighths of a turn, that a section in the plane is drawn in."""
ENDS = {4: "left", 0: "right"}


@dataclass(frozen=True, slots=True)
class Ring:
    """Where the points of one name lie; those on the axis have no radius."""

    radius: float  # distance from the axis in the half planes x and z, m
    y: float  # height there, m
    diagonal: float = 0.0  # x and z half way between them, m
    # the surface or curve that the point lies on: "sphere", "circle" (about the axis, in its own
    # plane) or ""
    on: str = ""


@dataclass(frozen=True, slots=True)
class Edge:
    """Cells along the edges between points of two names, growing from the first to the second."""

    count: int
    growth: float = 1.0


@dataclass(frozen=True, slots=True)
class Body:
    """One body's section."""

    rings: dict[str, Ring]  # its points by name
    # quadrilaterals (four names each) of the section, first those next to the axis, which name it
    # first and last
    parts: tuple[tuple[str, str, str, str], ...]
    edges: dict[tuple[str, str], Edge]  # between points of two names
    across: int  # number of cells across half the contact zone, and round an eighth of a turn
    # edges of the section by the surface they belong to
    faces: dict[str, tuple[tuple[str, str], ...]]
    centre: float = math.nan  # height of the sphere's centre, m


@dataclass(frozen=True, slots=True)
class SphereOnBlock:
    """A hemisphere, round side down, on a round block; the bodies touch at the origin.

    Raises:
        ValueError: If a value is out of its range; the message names field, value and range.
    """

    radius: float  # of the sphere, m
    block_radius: float  # of the block, m
    block_height: float  # of the block, m
    contact_width: float  # width of the contact zone of equal cells around the origin, m
    contact_size: float  # largest width of a cell in the contact zone, and height on its surface, m
    growth: float = 1.15  # size of a cell over that of its neighbour on the contact side elsewhere
    # "axisymmetric" (the half section x >= 0), "quarter" (x, z >= 0), "half" (z >= 0) or "full"
    part: Part = "axisymmetric"
    # "quadrilateral" or "triangle" of the section, else "hexahedron" or "tetrahedron"
    cell: str = "quadrilateral"
    upper_name: str = "elastomer"  # name of the hemisphere and first part of its surfaces' names
    lower_name: str = "aluminium"  # name of the block and first part of its surfaces' names

    def __post_init__(self) -> None:
        for name in ("radius", "block_radius", "block_height", "contact_width", "contact_size"):
            check_length(name, getattr(self, name))
        limit = min(self.radius, self.block_radius)
        if self.contact_width > limit * ROUND_OFF:
            raise ValueError(
                f"contact_width = {self.contact_width} m is not allowed; at most the smaller "
                f"radius, {limit} m"
            )
        if 2.0 * self.contact_size > self.contact_width * ROUND_OFF:
            raise ValueError(
                f"contact_size = {self.contact_size} m is not allowed; at most half of "
                f"contact_width = {self.contact_width} m"
            )
        two_blocks.check_growth(self.growth)
        if self.part not in get_args(Part):
            raise ValueError(
                f"part = {self.part!r} is not allowed; choose from {', '.join(get_args(Part))}"
            )
        two_blocks.check_pair(
            self.cell, two_blocks.CELLS[self.dim], (self.upper_name, self.lower_name)
        )
        if (cells := max(self.cells_of(body) for body in self.bodies())) > MAX_CELLS:
            raise ValueError(
                f"contact_size = {self.contact_size} m and growth = {self.growth} make a body of "
                f"{cells:.3g} cells; at most {MAX_CELLS} are allowed"
            )

    @property
    def dim(self) -> int:
        """Dimension of the mesh."""
        return 2 if self.part == "axisymmetric" else 3

    def bodies(self) -> tuple[Body, Body]:
        """The hemisphere and the block."""
        return (
            round_section(self.radius, self.contact_width, self.contact_size, self.growth),
            self._block(),
        )

    def cells(self) -> int:
        """Number of cells of both bodies; of tetrahedra, which gmsh places, about."""
        total = sum(self.cells_of(body) for body in self.bodies())
        return int(total) * {"triangle": 2, "tetrahedron": 6}.get(self.cell, 1)

    def cells_of(self, body: Body) -> float:
        """Number of quadrilaterals or hexahedra of one body."""
        total = 0.0
        for a, b, c, _ in body.parts:
            deep = _edge(body, b, c).count
            if body.rings[a].radius == 0.0:
                total += deep * body.across ** (self.dim - 1)
            else:
                around = 2 * body.across if self.dim == 3 else 1
                total += deep * _edge(body, a, b).count * around
        return total * QUARTERS.get(self.part, 1)

    def _block(self) -> Body:
        R, H, half = self.block_radius, self.block_height, 0.5 * self.contact_width
        # A square prism below the zone, wider at its foot, and around it parts that go over into
        # the circle: wedges that meet on the axis would end in degenerate cells there.
        across = max(1, math.ceil(half / (self.contact_size * ROUND_OFF)))
        deep = Edge(two_blocks.layers(H, self.contact_size, self.growth), self.growth)
        out = two_blocks.layers(R - half, self.contact_size, self.growth)
        return Body(
            rings={
                "pole": Ring(0.0, 0.0),
                "base": Ring(0.0, -H),
                "near": Ring(half, 0.0, half),
                "corner": Ring(0.6 * R, -H, 0.45 * R),
                "end": Ring(R, 0.0, R * math.sqrt(0.5), on="circle"),
                "foot": Ring(R, -H, R * math.sqrt(0.5), on="circle"),
            },
            parts=(("pole", "near", "corner", "base"), ("near", "end", "foot", "corner")),
            edges={
                ("near", "corner"): deep,
                ("pole", "base"): deep,
                ("end", "foot"): deep,
                ("near", "end"): Edge(out, self.growth),
                ("corner", "foot"): Edge(out),
            },
            across=across,
            faces={
                "contact": (("pole", "near"), ("near", "end")),
                "far": (("base", "corner"), ("corner", "foot")),
                "side": (("end", "foot"),),
            },
        )

    def build(self) -> None:
        """Draw and mesh both bodies in the current gmsh model.

        The physical groups are the two bodies and, with U and L for their names, the surfaces
        ``U_contact`` (the contact zone), ``L_contact`` (the whole upper side), ``top`` (the flat
        side of U), ``bottom`` (of L), ``U_side`` and ``L_side`` (their other round sides),
        and where the bodies are cut ``U_symmetry_x`` and ``L_symmetry_x`` (the plane x = 0) and
        ``U_symmetry_z`` and ``L_symmetry_z`` (z = 0).
        """
        upper, lower = (Drawing(body, self.part, self.cell).draw() for body in self.bodies())
        two_blocks.mesh_pair(self.dim, (self.upper_name, self.lower_name), (upper, lower))


def round_section(radius: float, width: float, size: float, growth: float) -> Body:
    """Half the section of a hemisphere, or of a half cylinder, under which the contact lies.

    The box is .4 as deep as the zone is wide, and narrower on its far side: so the cells at its
    corners keep their shape also where the zone is as wide as the radius.
    """
    half = 0.5 * width
    # R - sqrt(R^2 - x^2) without cancellation
    rise = half**2 / (radius + math.sqrt(radius**2 - half**2))
    inner, flank = rise + 0.8 * half, radius * (0.5 * math.pi - math.asin(half / radius))
    body = boxed_section(
        {
            "pole": Ring(0.0, 0.0, on="sphere"),
            "core": Ring(0.0, inner),
            "top": Ring(0.0, radius),
            "near": Ring(half, rise, half, on="sphere"),
            "inner": Ring(0.8 * half, inner, 0.8 * half),
            "corner": Ring(0.6 * radius, radius, 0.45 * radius),
            "end": Ring(radius, radius, radius * math.sqrt(0.5), on="sphere"),
        },
        two_blocks.layers(math.hypot(0.2 * half, 0.8 * half), size, growth),
        two_blocks.layers(flank, size, growth),
        size,
        growth,
    )
    faces = {
        "contact": (("pole", "near"),),
        "far": (("top", "corner"), ("corner", "end")),
        "side": (("near", "end"),),
    }
    return replace(body, faces=faces, centre=radius)


def boxed_section(rings: dict[str, Ring], deep: int, out: int, size: float, growth: float) -> Body:
    """A section with a box under the contact, ``deep`` cells, and two parts round it, ``out``."""
    return Body(
        rings,
        parts=(
            ("pole", "near", "inner", "core"),
            ("core", "inner", "corner", "top"),
            ("near", "end", "corner", "inner"),
        ),
        edges={
            ("near", "inner"): Edge(deep, growth),
            ("pole", "core"): Edge(deep, growth),
            ("end", "corner"): Edge(deep),
            ("near", "end"): Edge(out, growth),
            ("inner", "corner"): Edge(out, growth),
            ("core", "top"): Edge(out, growth),
        },
        across=max(1, math.ceil(rings["near"].radius / (size * ROUND_OFF))),
        faces={},
    )


Corner = tuple[str, int]
"""A point: the name of its ring and its direction, in eighths of a turn from x towards z."""


@dataclass(slots=True)
class Drawing:
    """One body in the current gmsh model; points, curves and faces are made once each."""

    body: Body  # the body that is drawn
    part: Part | Literal["line"]  # how much of it; "line": its section and the mirror image of that
    cell: str  # shape of the cells
    upwards: float = 1.0  # 1 or -1: which way from the contact it lies
    # tags of the faces (of the section) or volumes made
    cells: list[int] = field(default_factory=list)
    # tags of the curves or faces of each side
    named: dict[str, list[int]] = field(default_factory=dict)
    _points: dict[Corner, int] = field(default_factory=dict)
    _curves: dict[tuple[Corner, Corner], int] = field(default_factory=dict)
    _faces: dict[frozenset[Corner], int] = field(default_factory=dict)
    _middles: dict[float, int] = field(default_factory=dict)

    def draw(self) -> two_blocks.Drawn:
        """Make all entities and record their names."""
        for way in PLANE.get(self.part, ()):
            for names in self.body.parts:
                self.cells.append(self._face([(name, way) for name in names]))
            for side, edges in self.body.faces.items():
                name = ENDS[way] if (self.part, side) == ("line", "side") else side
                found = [abs(self._curve((a, way), (b, way))) for a, b in edges]
                self.named.setdefault(name, []).extend(found)
        if self.part in PLANE:
            return self.cells, self.named
        for quarter in range(QUARTERS[self.part]):
            for names in self.body.parts:
                for bottom, top in self._blocks(names, 2 * quarter):
                    self._volume(bottom, top)
            for side, edges in self.body.faces.items():
                found = [self._face(loop) for e in edges for loop in self._sheets(e, 2 * quarter)]
                self.named.setdefault(side, []).extend(found)
        if self.part == "quarter":
            self.named["symmetry_x"] = self._cut(2)
        if self.part != "full":
            ends = self._cut(0) + (self._cut(4) if self.part == "half" else [])
            self.named["symmetry_z"] = ends
        return self.cells, self.named

    def _cut(self, direction: int) -> list[int]:
        """The faces in a half plane through the axis."""
        return [self._face([(n, direction) for n in names]) for names in self.body.parts]

    def _blocks(
        self, names: tuple[str, str, str, str], first: int
    ) -> Iterator[tuple[list[Corner], list[Corner]]]:
        """The hexahedra, as bottom and top, that a part of the section makes in one quarter."""
        a, b, c, d = names
        if self.body.rings[a].radius == 0.0:
            yield (
                [(a, 0), *((b, first + i) for i in range(3))],
                [(d, 0), *((c, first + i) for i in range(3))],
            )
        else:
            for i in (first, first + 1):
                yield [(n, i) for n in names], [(n, i + 1) for n in names]

    def _sheets(self, edge: tuple[str, str], first: int) -> Iterator[list[Corner]]:
        """The faces that an edge of the section makes in one quarter."""
        a, b = edge
        if self.body.rings[a].radius == 0.0:
            yield [(a, 0), *((b, first + i) for i in range(3))]
        else:
            for i in (first, first + 1):
                yield [(a, i), (b, i), (b, i + 1), (a, i + 1)]

    def _same(self, corner: Corner) -> Corner:
        """The name of a point; points on the axis have one name for all directions."""
        name, direction = corner
        return (name, 0) if self.body.rings[name].radius == 0.0 else (name, direction % 8)

    def _point(self, corner: Corner) -> int:
        import gmsh

        if corner not in self._points:
            name, direction = corner
            ring = self.body.rings[name]
            quarter, between = divmod(direction, 2)
            x, z = (ring.diagonal, ring.diagonal) if between else (ring.radius, 0.0)
            y = self.upwards * ring.y
            if between and ring.on == "sphere":
                R, square = self.body.centre, 2.0 * ring.diagonal**2
                # R − √(R² − x² − z²) without cancellation
                y = square / (R + math.sqrt(max(R**2 - square, 0.0)))
            # Quarter turns without rounding: all parts have the same coordinates but for the sign.
            for _ in range(quarter):
                x, z = -z, x
            self._points[corner] = gmsh.model.geo.addPoint(x, y, z)
        return self._points[corner]

    def _middle(self, y: float) -> int:
        """The centre, on the axis, of arcs at a height."""
        import gmsh

        if y not in self._middles:
            self._middles[y] = gmsh.model.geo.addPoint(0.0, self.upwards * y, 0.0)
        return self._middles[y]

    def _curve(self, start: Corner, end: Corner) -> int:
        """The curve between two points; negative where it was drawn the other way round."""
        import gmsh

        a, b = self._same(start), self._same(end)
        if (b, a) in self._curves:
            return -self._curves[b, a]
        if (a, b) not in self._curves:
            rings = self.body.rings[a[0]], self.body.rings[b[0]]
            ends = self._point(a), self._point(b)
            geo = gmsh.model.geo
            if rings[0].on == rings[1].on == "sphere":
                curve = geo.addCircleArc(ends[0], self._middle(self.body.centre), ends[1])
            elif a[0] == b[0] and rings[0].on == "circle":
                curve = geo.addCircleArc(ends[0], self._middle(rings[0].y), ends[1])
            else:
                curve = geo.addLine(*ends)
            edge = _edge(self.body, a[0], b[0])
            towards = 1.0 if (a[0], b[0]) in self.body.edges else -1.0
            geo.mesh.setTransfiniteCurve(curve, edge.count + 1, "Progression", edge.growth**towards)
            self._curves[a, b] = curve
        return self._curves[a, b]

    def _face(self, corners: list[Corner]) -> int:
        """The face of four points that go round it."""
        import gmsh

        geo = gmsh.model.geo
        key = frozenset(map(self._same, corners))
        if key not in self._faces:
            loop = [self._curve(corners[i], corners[(i + 1) % 4]) for i in range(4)]
            wire = geo.addCurveLoop(loop)
            if self.part in PLANE:
                face = geo.addPlaneSurface([wire])
            elif all(self.body.rings[name].on == "sphere" for name, _ in corners):
                # Without its centre gmsh fills the loop by a patch that is no sphere inside.
                face = geo.addSurfaceFilling([wire], sphereCenterTag=self._middle(self.body.centre))
            else:
                face = geo.addSurfaceFilling([wire])
            if self.cell != "tetrahedron":
                at = [self._point(self._same(corner)) for corner in corners]
                geo.mesh.setTransfiniteSurface(face, "AlternateLeft", at)
            if self.cell in ("quadrilateral", "hexahedron"):
                geo.mesh.setRecombine(2, face)
            self._faces[key] = face
        return self._faces[key]

    def _volume(self, bottom: list[Corner], top: list[Corner]) -> None:
        import gmsh

        geo = gmsh.model.geo
        faces = [self._face(bottom), self._face(top)]
        for i in range(4):
            j = (i + 1) % 4
            faces.append(self._face([bottom[i], bottom[j], top[j], top[i]]))
        volume = geo.addVolume([geo.addSurfaceLoop(faces)])
        if self.cell == "hexahedron":
            geo.mesh.setTransfiniteVolume(volume)
        self.cells.append(volume)


def _edge(body: Body, a: str, b: str) -> Edge:
    """The cells along an edge; those across the zone and around the axis are equal."""
    return body.edges.get((a, b)) or body.edges.get((b, a)) or Edge(body.across)
