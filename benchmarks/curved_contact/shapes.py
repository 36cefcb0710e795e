"""Meshes of the problems: a round tool above a block, or two round bodies, touching at the origin.

In the plane they are those of :mod:`tribox.geometry.generators.cylinders`, under names of their
own, moved away from an axis of symmetry, upside down, or with facets that grow along the slave's
surface.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tribox.geometry.generators.cylinders import FlatBlock, HalfCylinder, LineContact
from tribox.geometry.generators.sphere_on_block import Body, Drawing, SphereOnBlock
from tribox.geometry.meshes.gmsh_model import Shape, write_msh
from tribox.geometry.surfaces.facets import Floats


@dataclass(frozen=True, slots=True)
class Moved:
    """A built-in shape whose nodes are moved once it is meshed.

    Attributes:
        shape: what is meshed.
        move: new places (n, 3) of nodes at (n, 3), m.
    """

    shape: Shape
    move: Callable[[Floats], Floats]

    def build(self) -> None:
        """Mesh it in the current gmsh model."""
        import gmsh

        self.shape.build()
        tags, places, _ = gmsh.model.mesh.getNodes()
        new = self.move(np.asarray(places).reshape(-1, 3))
        for tag, place in zip(tags, new, strict=True):
            gmsh.model.mesh.setNode(tag, place, [])


def tool_on_rubber(
    path: Path, size: float, tool_size: float, zone: float, tool_zone: float, axis: float = 0.0
) -> None:
    """Write the mesh of a half cylinder of 5 mm, ``tool``, on a block of 10 by 2 mm, ``rubber``.

    All in m: facets, and zones that may touch, of both; ``axis``: both are moved by it in x, away
    from an axis of symmetry.
    """
    tool = HalfCylinder(5e-3, tool_zone, tool_size)
    block = FlatBlock(10e-3, 2e-3, zone, size)
    shape: Shape = LineContact(tool, block, 1.25, upper_name="tool", lower_name="rubber")
    if axis:
        shape = Moved(shape, lambda x: x + np.array([axis, 0.0, 0.0]))
    write_msh(shape, path)


KINKS = (0.0, 1.2, 1.5, 1.8, 3.0)
"""mm, where the top of the lower block may change its slope."""
FACETS = (6, 2, 2, 6)


@dataclass(frozen=True, slots=True)
class Ridge:
    """A block of 10 x 5 cells on a wider one whose top has a ridge, or groove.

    Attributes:
        degrees: slope of its sides; negative: a groove.
    """

    degrees: float

    def build(self) -> None:
        """Mesh it, in mm, in the current gmsh model, and make it m."""
        import gmsh

        geo = gmsh.model.geo
        rise = 0.3 * math.tan(math.radians(self.degrees))
        low = [geo.addPoint(x, -0.5, 0.0) for x in KINKS]
        high = [geo.addPoint(x, rise * (i == 2), 0.0) for i, x in enumerate(KINKS)]
        bottom = [geo.addLine(*low[i : i + 2]) for i in range(4)]
        master = [geo.addLine(*high[i : i + 2]) for i in range(4)]
        sides = [geo.addLine(a, b) for a, b in zip(low, high, strict=True)]
        loops = [[bottom[i], sides[i + 1], -master[i], -sides[i]] for i in range(4)]
        at = ((0.1, 0.0), (1.1, 0.0), (1.1, 0.5), (0.1, 0.5))
        corners = [geo.addPoint(x, y, 0.0) for x, y in at]
        around = [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        areas = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in (*loops, around)]
        divisions = [(bottom, FACETS), (master, FACETS), (sides, [3] * 5), (around, (10, 5, 10, 5))]
        for lines, counts in divisions:
            for curve, count in zip(lines, counts, strict=True):
                geo.mesh.setTransfiniteCurve(curve, count + 1)
        for area in areas:
            geo.mesh.setTransfiniteSurface(area)
            geo.mesh.setRecombine(2, area)
        geo.synchronize()
        groups = {
            (2, "aluminium"): areas[:4],
            (2, "elastomer"): areas[4:],
            (1, "bottom"): bottom,
            (1, "aluminium_contact"): master,
            (1, "elastomer_contact"): around[:1],
            (1, "top"): around[2:3],
        }
        for (dimension, name), tags in groups.items():
            gmsh.model.addPhysicalGroup(dimension, tags, name=name)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.affineTransform([1e-3, 0, 0, 0, 0, 1e-3, 0, 0, 0, 0, 1e-3, 0])


def ridge(path: Path, degrees: float) -> None:
    """Write the mesh of a block above a ridge (negative: groove) of so many degrees."""
    write_msh(Ridge(degrees), path)


@dataclass(frozen=True, slots=True)
class TwoHemispheres:
    """Two like hemispheres, ``tool`` above ``rubber``, in section or in space.

    Attributes:
        upper: the upper one, as the sphere of a sphere on a block.
        lower: the lower one likewise, turned upside down.
    """

    upper: SphereOnBlock
    lower: SphereOnBlock

    def build(self) -> None:
        """Mesh them in the current gmsh model, the lower one first."""
        import gmsh

        tags: dict[str, list[int]] = {}
        dim = self.upper.dim
        for shape, name, far, way in (
            (self.lower, "rubber", "bottom", -1.0),
            (self.upper, "tool", "top", 1.0),
        ):
            drawing = Drawing(_mirrored(shape.bodies()[0], way), shape.part, shape.cell)
            drawing.draw()
            tags[name] = drawing.cells
            tags |= {far if s == "far" else f"{name}_{s}": t for s, t in drawing.named.items()}
        gmsh.model.geo.synchronize()
        for name, found in tags.items():
            gmsh.model.addPhysicalGroup(dim - (name not in ("tool", "rubber")), found, name=name)
        gmsh.model.mesh.generate(dim)


def _mirrored(body: Body, way: float) -> Body:
    """The body in the plane y = 0's mirror if ``way`` is -1."""
    rings = {name: replace(ring, y=way * ring.y) for name, ring in body.rings.items()}
    return replace(body, rings=rings, centre=way * body.centre)


def graded(half: float, ratio: float) -> Callable[[Floats], Floats]:
    """Moves nodes at |x| < ``half`` (m) and y <= 0 so that equal facets grow 1 : ``ratio``."""
    steep = math.acosh(ratio)

    def move(at: Floats) -> Floats:
        inside = (np.abs(at[:, 0]) < half) & (at[:, 1] <= 1e-12)
        out = at.copy()
        share = at[inside, 0] / half
        out[inside, 0] = half * np.sinh(steep * share) / math.sinh(steep)
        return out

    return move
