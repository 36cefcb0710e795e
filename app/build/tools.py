"""The tools of a case: their shapes, their unknowns, and the programs that move them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.build.tool_shapes import tool_surface
from tribox.app.case.boundary import COMPONENTS, DRIVEN
from tribox.app.case.case import Case
from tribox.app.case.time_tables import TimeTable
from tribox.app.case.tools import AnyTool, CylinderTool, Tool, ToolRotation
from tribox.app.equilibrium.constraints import Prescribed
from tribox.app.equilibrium.nodal_load import NodalLoad
from tribox.app.equilibrium.rigid_tool import RigidTool, reference_dofs
from tribox.app.errors import InputError
from tribox.forms.bodies.kinematics import Section
from tribox.geometry.meshes.mesh import NamedMesh
from tribox.geometry.surfaces.facets import Floats, Ints
from tribox.geometry.surfaces.rigid_motion import RigidMotion

Program = Callable[[float, float], float]
"""Value of a slot's displacement (m) or force (N) at (time, driven displacement)."""


@dataclass(slots=True)
class Tools:
    """The tools of a case and what moves them.

    Attributes:
        members: for the equilibrium, in the order of the case.
        prescribed, nodal_loads: likewise.
        programs: each sets one of them from (time, driven displacement), s and m.
    """

    members: list[RigidTool] = field(default_factory=list)
    prescribed: list[Prescribed] = field(default_factory=list)
    nodal_loads: list[NodalLoad] = field(default_factory=list)
    programs: list[Callable[[float, float], None]] = field(default_factory=list)

    def by_name(self) -> dict[str, RigidTool]:
        """The members by their names."""
        return {tool.name: tool for tool in self.members}


def make_tools(
    case: Case, named: NamedMesh, space: dolfinx.fem.FunctionSpace, section: Section
) -> Tools:
    """The tools of a case; collective.

    Args:
        case: what was asked for.
        named: the mesh, with a carrier cell for each tool.
        space: of the displacement.
        section: what the mesh stands for.

    Raises:
        InputError: a shape cannot be made.
    """
    tools = Tools()
    box = extent(named)
    for name, table in case.tools.items():
        _add(tools, name, table, space, named, box, case.geometry.slab)
    return tools


def extent(named: NamedMesh) -> Floats:
    """Least and largest coordinates (2, i), m, of the mesh; collective."""
    x, comm = named.mesh.geometry.x[:, : named.mesh.geometry.dim], named.mesh.comm
    ends = np.stack([x.min(axis=0, initial=np.inf), -x.max(axis=0, initial=-np.inf)])
    comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MIN)
    return ends * [[1.0], [-1.0]]


def _add(
    tools: Tools,
    name: str,
    table: AnyTool,
    space: dolfinx.fem.FunctionSpace,
    named: NamedMesh,
    box: Floats,
    thickness: float,
) -> None:
    """Add one tool; collective."""
    try:
        surface = tool_surface(table, box, named.mesh.comm)
    except ValueError as error:
        raise InputError(f"tools.{name}: {error}") from None
    dim, rotation = space.dofmap.index_map_bs, table.rotation
    length = float(np.linalg.norm(box[1] - box[0]))
    motion = _motion(table, surface.control_points, length)
    nodes, dofs, here, rest = reference_dofs(space, named.carrier(name))
    tools.prescribed.append(Prescribed(rest))
    free = np.zeros(dim + 1, dtype=bool)
    for slot in range(dim + 1):
        mine = dofs[[slot]][here[[slot]]]
        if slot < dim:
            program, load = _component(table, COMPONENTS[slot]), _force(table, COMPONENTS[slot])
            share = 1.0 / thickness
        else:
            program, load = _angle(rotation, length), None if rotation is None else rotation.moment
            share = 1.0 / (length * thickness)
        free[slot] = load is not None
        if load is not None:
            _drive(tools, mine, share, load)
        else:
            _prescribe(tools, mine, program)
    moment = None if rotation is None else rotation.moment
    tools.members.append(
        RigidTool(
            name=name,
            surface=surface,
            motion=motion,
            nodes=nodes,
            dofs=dofs,
            here=here,
            free=free,
            idle=moment is not None and not any(moment.values),
            mass=np.asarray(_masses(table, dim, length) / thickness, dtype=np.float64),
        )
    )


def _motion(table: Tool, points: Floats, length: float) -> RigidMotion:
    """How the control points (a, i), m, follow the tool, whose angle is multiplied by ``length``.

    A tool that does not turn takes the middle of its control points for its centre.
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
    return RigidMotion(centre, points, length, axis)


def _masses(table: Tool, dim: int, length: float) -> Floats:
    """Mass of each slot (k,), kg: the moment of inertia goes with the angle times a length."""
    inertia = None if table.rotation is None else table.rotation.inertia
    masses = [table.mass or 0.0] * dim + [(inertia or 0.0) / length**2]
    return np.array(masses, dtype=np.float64)


def _component(table: Tool, component: str) -> Program:
    """Displacement of a component; 0 where nothing is given."""
    moved = getattr(table.displacement, component, None)
    speed = getattr(table.velocity, component, None)
    if table.displacement is not None and moved == DRIVEN:
        share = table.displacement.driven_share(component)
        return lambda time, driven: share * driven
    if isinstance(moved, TimeTable):
        return lambda time, driven: moved(time)
    if isinstance(speed, TimeTable):
        return lambda time, driven: speed.integral(time)
    return lambda time, driven: 0.0


def _angle(rotation: ToolRotation | None, length: float) -> Program:
    """Angle times length; 0 where nothing is given."""
    if rotation is not None and rotation.angle is not None:
        angle = rotation.angle
        return lambda time, driven: length * angle(time)
    if rotation is not None and rotation.rate is not None:
        rate = rotation.rate
        return lambda time, driven: length * rate.integral(time)
    return lambda time, driven: 0.0


def _force(table: Tool, component: str) -> TimeTable | None:
    force: TimeTable | None = getattr(table.force, component, None)
    return force


def _prescribe(tools: Tools, dofs: Ints, value: Program) -> None:
    part = Prescribed(dofs)
    tools.prescribed.append(part)

    def program(time: float, driven: float) -> None:
        part.value = value(time, driven)

    tools.programs.append(program)


def _drive(tools: Tools, dofs: Ints, share: float, load: TimeTable) -> None:
    part = NodalLoad(dofs, share)
    tools.nodal_loads.append(part)

    def program(time: float, driven: float) -> None:
        part.factor = load(time)

    tools.programs.append(program)


def notes_on_tools(case: Case) -> Iterator[str]:
    """A line on each tool that nothing touches."""
    masters = {contact.master for contact in case.contact}
    for name in case.tools:
        if name not in masters:
            yield f"tools.{name}: is in no contact; a contact names it as master"
