"""The tools of a case: their shapes, their unknowns, and the programs that move them."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import assert_never

import numpy as np
from mpi4py import MPI

from tribox.app.build.boundary_conditions import Loads
from tribox.app.build.load_programs import Acts, MovedOn, Program, ReachedForce, of_drive, of_time
from tribox.app.case.boundary import COMPONENTS, DRIVEN, Spring
from tribox.app.case.case import Case
from tribox.app.case.time_tables import TimeTable
from tribox.app.case.tools import (
    AnyTool,
    CircleTool,
    CylinderTool,
    MeshTool,
    PlaneTool,
    PolylineTool,
    RoundTool,
    SphereTool,
    Tool,
)
from tribox.app.equilibrium.constraints import Platen, Prescribed
from tribox.app.equilibrium.rigid_tool import RigidTool, Stop
from tribox.app.equilibrium.unknowns import NodalLoad, box_of
from tribox.app.errors import InputError
from tribox.geometry.meshes.blocks import Block
from tribox.geometry.meshes.mesh import NamedMesh
from tribox.geometry.surfaces.facets import Floats, Ints
from tribox.geometry.surfaces.rigid import RigidMotion, RigidSurface
from tribox.geometry.surfaces.rigid_mesh import MeshSurface
from tribox.geometry.surfaces.rigid_polyline import Polyline
from tribox.geometry.surfaces.rigid_shapes import Circle, Cylinder, Plane, Sphere

# -- From a `[tools.NAME]` table to the rigid surface that it describes ----------------------------

# Facets by meshio's names: dimension of space, and the place of each of a Lagrange element's nodes
# among those of gmsh.
_ORDER = {
    "line": (2, (0, 1)),
    "line3": (2, (0, 1, 2)),
    "triangle": (3, (0, 1, 2)),
    "triangle6": (3, (0, 1, 2, 4, 5, 3)),
    "quad": (3, (0, 1, 3, 2)),
    "quad9": (3, (0, 1, 3, 2, 4, 7, 5, 6, 8)),
}
# The same of facets that run the other way round: ξ reversed, or ξ and η exchanged.
_TURNED = {
    "line": (1, 0),
    "line3": (1, 0, 2),
    "triangle": (0, 2, 1),
    "triangle6": (0, 2, 1, 3, 5, 4),
    "quad": (0, 2, 1, 3),
    "quad9": (0, 2, 1, 3, 5, 4, 7, 6, 8),
}
_CLOSE = 1e-9  # z of nodes over the extent of a mesh in the plane that is rounding


def tool_surface(table: AnyTool, box: Floats, comm: MPI.Comm) -> RigidSurface:
    """The surface of a tool; collective.

    Args:
        box: (2, i), m, least and largest coordinates of the mesh.

    Raises:
        ValueError: there is no such surface, on all ranks.
    """
    match table:
        case PlaneTool():
            return _plane(table, box)
        case CircleTool():
            return Circle(np.array(table.centre), table.radius, table.inside)
        case SphereTool():
            return Sphere(np.array(table.centre), table.radius, table.inside)
        case CylinderTool():
            axis = np.array(table.axis)
            return Cylinder(np.array(table.centre), axis, table.radius, table.inside)
        case PolylineTool():
            radius = table.fillet_radius
            fillets = radius if isinstance(radius, float) else np.array(radius)
            return Polyline(np.array(table.points), fillets, table.closed, table.continued)
        case MeshTool():
            dim = box.shape[1]
            nodes, facets = _on_first(lambda: facets_of(table, dim), comm)
            return MeshSurface(nodes, facets, table.smoothing_angle)
        case _:
            assert_never(table)


def _plane(table: PlaneTool, box: Floats) -> Plane:
    """A plane with its point moved to where it is next to the mesh."""
    normal = np.array(table.normal) / np.linalg.norm(table.normal)
    middle, point = box.mean(axis=0), np.array(table.point)
    near = middle - ((middle - point) @ normal) * normal
    return Plane(near, normal, float(np.linalg.norm(box[1] - box[0])))


def _on_first(read: Callable[[], tuple[Floats, Ints]], comm: MPI.Comm) -> tuple[Floats, Ints]:
    """What the first rank reads, or its error on all; collective."""
    found: tuple[Floats, Ints] | str = ""
    if comm.rank == 0:
        try:
            found = read()
        except ValueError as error:
            found = str(error)
    found = comm.bcast(found)
    if isinstance(found, str):
        raise ValueError(found)
    return found


def facets_of(table: MeshTool, dim: int) -> tuple[Floats, Ints]:
    """Nodes (n, i), m, and facets (f, a) in a mesh file; ValueError if it has none."""
    import meshio

    where = f"file = {str(table.file)!r}"
    try:
        mesh = meshio.gmsh.read(table.file)
    except Exception as error:  # meshio fails on damaged files in many ways
        raise ValueError(f"{where}: is no gmsh file ({type(error).__name__}: {error})") from None
    groups = {name: int(tag) for name, (tag, d) in mesh.field_data.items() if d == dim - 1}
    if table.surface not in groups:
        near = difflib.get_close_matches(table.surface, groups, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"there are: {', '.join(groups) or 'none'}"
        raise ValueError(f"{where}: no group of facets named {table.surface!r}; {hint}")
    tags = mesh.cell_data.get("gmsh:physical", [])
    parts = [
        (block.type, np.asarray(block.data)[np.asarray(tag) == groups[table.surface]])
        for block, tag in zip(mesh.cells, tags, strict=False)
        if _ORDER.get(block.type, (0, ()))[0] == dim
    ]
    kinds = {kind for kind, cells in parts if len(cells)}
    if len(kinds) != 1:
        raise ValueError(
            f"{where}: the facets of {table.surface!r} must be of one kind, found "
            f"{', '.join(sorted(kinds)) or 'none'}"
        )
    kind = kinds.pop()
    cells = np.concatenate([cells for name, cells in parts if name == kind])
    facets = cells[:, _ORDER[kind][1]]
    if table.turned_over:
        facets = facets[:, _TURNED[kind]]
    points = table.scale * np.asarray(mesh.points, dtype=np.float64)
    used = points[np.unique(facets)]
    if dim == 2 and np.abs(used[:, 2:]).max(initial=0.0) > _CLOSE * np.ptp(used, axis=0).max():
        raise ValueError(f"{where}: {table.surface!r} does not lie in the plane z = 0")
    return points[:, :dim], facets.astype(np.int32)


# -- The tools of a case: their shapes, their unknowns, and the programs that move them ------------


@dataclass(slots=True)
class Tools:
    """The tools of a case and what moves them."""

    case: Case  # what was asked for
    loads: Loads  # they know the stage, and remember earlier ones
    # for the equilibrium, in the order of the case
    members: list[RigidTool] = field(default_factory=list)
    prescribed: list[Prescribed] = field(default_factory=list)  # likewise
    platens: list[Platen] = field(default_factory=list)  # likewise
    nodal_loads: list[NodalLoad] = field(default_factory=list)  # likewise
    # each sets one of them from (time, driven displacement), s and m
    programs: list[Callable[[float, float], None]] = field(default_factory=list)


def blocks_of_tools(case: Case, named: NamedMesh) -> dict[str, Block]:
    """The unknowns of each tool: the components of its displacement, and its angle."""
    dim, comm = named.mesh.geometry.dim, named.mesh.comm
    return {name: Block.of_numbers(f"tool {name}", dim + 1, comm) for name in case.tools}


def make_tools(case: Case, named: NamedMesh, blocks: Mapping[str, Block], loads: Loads) -> Tools:
    """The tools of a case; collective; InputError if a shape cannot be made."""
    tools = Tools(case, loads)
    box = extent(named)
    for name, table in case.tools.items():
        _add(tools, name, table, blocks[name], named, box)
    return tools


def extent(named: NamedMesh) -> Floats:
    """Least and largest coordinates (2, i), m, of the mesh; collective."""
    return box_of(named.mesh.comm, named.mesh.geometry.x[:, : named.mesh.geometry.dim])


def _add(
    tools: Tools, name: str, table: AnyTool, block: Block, named: NamedMesh, box: Floats
) -> None:
    """Add one tool; collective."""
    try:
        surface = tool_surface(table, box, named.mesh.comm)
    except ValueError as error:
        raise InputError(f"tools.{name}: {error}") from None
    thickness = tools.case.geometry.slab
    dim, rotation = named.mesh.geometry.dim, table.rotation
    motion = _motion(table, surface.control_points, box)
    length = motion.length
    free = np.zeros(dim + 1, dtype=bool)
    for slot in range(dim + 1):
        mine = block.dofs[slot : slot + 1]
        if slot < dim and table.spring is not None and table.spring.direction == COMPONENTS[slot]:
            _draw(tools, mine, table.spring, thickness)
            free[slot] = True
            continue
        part = Prescribed(mine)
        tools.prescribed.append(part)
        if slot < dim:
            how = _component(table, COMPONENTS[slot], 1.0 / thickness)
        else:
            how = _angle(table, length, 1.0 / (length * thickness))
        free[slot] = how.is_loaded
        _move(tools, name, part, how)
    moment = None if rotation is None else rotation.moment
    inertia = None if table.rotation is None else table.rotation.inertia
    # The moment of inertia goes with the angle times a length.
    masses = [table.mass or 0.0] * dim + [(inertia or 0.0) / length**2]
    tools.members.append(
        RigidTool(
            name=name,
            surface=surface,
            motion=motion,
            block=block,
            free=free,
            idle=moment is not None and not any(moment.values),
            mass=np.asarray(np.array(masses) / thickness, dtype=np.float64),
            stop=_stop(table, dim, float(np.linalg.norm(box[1] - box[0])) * thickness),
        )
    )


GIVES_WAY = 1e-6  # how far a stop gives way under the largest force, over the size of the mesh


def _stop(table: Tool, dim: int, size: float) -> Stop | None:
    """Blocks that stop a tool; ``size``: m, of the mesh, times the thickness of the forces."""
    if table.stop is None:
        return None
    low, high = np.full(dim + 1, -np.inf), np.full(dim + 1, np.inf)
    stiffness = np.zeros(dim + 1)
    for slot, component in enumerate(COMPONENTS[:dim]):
        place = getattr(table.stop, component)
        if place is not None:
            force: TimeTable = getattr(table.force, component)
            side = high if max(force.values) > 0.0 else low
            side[slot] = place
            stiffness[slot] = max(map(abs, force.values)) / (GIVES_WAY * size)
    return Stop(low, high, stiffness)


@dataclass(frozen=True, slots=True)
class _Slot:
    """What moves one component, or the angle, of a tool."""

    value: Program  # displacement, m, where it is prescribed
    load: TimeTable | None = None  # N (of the angle N m), None: nothing drives it
    share: float = 1.0  # of the load, in the slot's unit and per unit thickness
    given: tuple[str, ...] = ()  # stages in which the displacement is given and not the force
    # m/s, if it is that which is given and goes on from where the tool is
    speed: TimeTable | None = None
    holds: bool = False  # whether the force reached in these stages is held after them

    @property
    def is_loaded(self) -> bool:
        """Whether a load moves it in some stage."""
        return self.load is not None or self.holds


def _move(tools: Tools, name: str, part: Prescribed, how: _Slot) -> None:
    """Let one unknown follow what its tool is given, stage by stage.

    Where the tool touches nothing, what a load drives stays where it is: nothing would hold it.
    """
    if not how.is_loaded:

        def follow(time: float, driven: float) -> None:
            part.value = how.value(time, driven)

        tools.programs.append(follow)
        return
    load, loads = NodalLoad(part.dofs, how.share), tools.loads
    # What the displacement led to goes over the pieces of the first step in which the load comes.
    given_up = NodalLoad(part.dofs, takes_over=True)
    tools.nodal_loads += [load, given_up]
    kept = MovedOn(part, TimeTable.constant(0.0), _stays(tools.case, name, how))
    moved = MovedOn(part, how.speed or TimeTable.constant(0.0), lambda stage: stage in how.given)
    reached = ReachedForce(part, how.given, f"tool {name}" if how.holds else "")
    loads.remembering += [kept, moved, reached]
    first = tools.case.stage[0].name
    part.acts = first in how.given or kept.acts(first)

    def program(time: float, driven: float) -> None:
        load.factor, given_up.factor, given = 0.0, 0.0, loads.stage in how.given
        part.acts = given or kept.acts(loads.stage)
        if given:
            part.value = how.value(time, driven) if how.speed is None else moved.value(time, driven)
        elif part.acts:
            part.value = kept.value(time, driven)
        elif reached.force is not None and how.holds:
            load.factor = reached.force / how.share
        elif how.load is not None:
            load.factor = how.load(time)
        if not part.acts and reached.force is not None and loads.stage == reached.since:
            given_up.factor = (1.0 - loads.share) * reached.force

    tools.programs.append(program)


def _draw(tools: Tools, dofs: Ints, spring: Spring, thickness: float) -> None:
    """Let a spring draw one unknown: it moves as one surface of a body would."""
    platen, end = Platen(dofs, stiffness=spring.stiffness / thickness), spring.end
    tools.platens.append(platen)

    def program(time: float, driven: float) -> None:
        platen.end = end(time) if isinstance(end, TimeTable) else driven

    tools.programs.append(program)


def _stays(case: Case, name: str, how: _Slot) -> Acts:
    """In which stages a load does not move a tool, as it touches nothing, or there is none yet."""
    names = [stage.name for stage in case.stage]
    # Those after the first of the stages in which its displacement is given.
    known = names if how.load is not None else names[min(map(names.index, how.given)) + 1 :]
    mine = [contact for contact in case.contact if contact.master == name]
    touches = {s for s in known if any(case.acts_in(contact, s) for contact in mine)}
    free = touches - set(how.given)
    return lambda stage: stage not in free


def _motion(table: Tool, points: Floats, box: Floats) -> RigidMotion:
    """How the control points (a, i), m, follow the tool; its centre is by default their middle.

    The angle is multiplied by the size of ``box`` (2, i), m, or the longest arm, as a moment.
    """
    dim, rotation = points.shape[1], table.rotation
    centre: Floats = np.asarray(getattr(table, "centre", points.mean(axis=0)), dtype=np.float64)
    axis: Floats | None = None if dim == 2 else np.array([0.0, 0.0, 1.0])
    if rotation is not None and rotation.centre is not None:
        centre = np.asarray(rotation.centre, dtype=np.float64)
    if dim == 3 and rotation is not None and rotation.axis is not None:
        axis = np.asarray(rotation.axis, dtype=np.float64)
    elif dim == 3 and isinstance(table, CylinderTool):
        axis = np.asarray(table.axis, dtype=np.float64)
    ways = np.stack([box[1] - box[0], np.abs(box - centre).max(axis=0)])
    return RigidMotion(centre, points, float(np.linalg.norm(ways, axis=1).max()), axis)


def _component(table: Tool, component: str, share: float) -> _Slot:
    """What moves a component; it stays at 0 where nothing is given."""
    moved = getattr(table.displacement, component, None)
    speed: TimeTable | None = getattr(table.velocity, component, None)
    force: TimeTable | None = getattr(table.force, component, None)
    value = of_drive(0.0)
    if table.displacement is not None and moved == DRIVEN:
        value = of_drive(table.displacement.driven_share(component))
    elif isinstance(moved, TimeTable):
        value = of_time(moved)
    elif speed is not None:
        value = of_time(speed.integral)
    if table.is_switched(component):
        holds = component in table.hold_force
        return _Slot(value, force, share, table.displacement_stages, speed, holds)
    return _Slot(value, force, share)


def _angle(table: Tool, length: float, share: float) -> _Slot:
    """What moves the angle, times a length (m)."""
    rotation = table.rotation
    if rotation is not None and rotation.rim is not None and isinstance(table, RoundTool):
        rim, turned = rotation.rim, length / table.radius
        if isinstance(rim, TimeTable):
            return _Slot(of_time(lambda time: turned * rim(time)))
        return _Slot(of_drive(-turned if rotation.clockwise else turned))
    if rotation is not None and rotation.angle is not None:
        angle = rotation.angle
        return _Slot(of_time(lambda time: length * angle(time)))
    if rotation is not None and rotation.rate is not None:
        rate = rotation.rate
        return _Slot(of_time(lambda time: length * rate.integral(time)))
    moment = None if rotation is None else rotation.moment
    return _Slot(of_drive(0.0), moment, share)


def notes_on_tools(case: Case) -> Iterator[str]:
    """A line on each tool that nothing touches."""
    masters = {contact.master for contact in case.contact}
    for name in case.tools:
        if name not in masters:
            yield f"tools.{name}: is in no contact; a contact names it as master"
