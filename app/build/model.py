"""From a case to the objects that are solved: mesh, solids, contacts, loads and their programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import dolfinx
import numpy as np
from mpi4py import MPI

import app.case.bodies as case_bodies
import app.case.contact as case_contact
from app.build.boundary_conditions import ON_AXIS, Loads
from app.build.case_notes import highest_pressure, notes_on
from app.build.mesh_notes import (
    large_mesh,
    locking_bodies,
    loose_bodies,
    notes_on_ranks,
    notes_on_surfaces,
    penalty_note,
)
from app.case.boundary import COMPONENTS, solver_of
from app.case.case import Case
from app.case.validation import format_problem
from app.equilibrium.equilibrium import Equilibrium, Ints
from app.errors import InputError
from forms.bodies.kinematics import Section
from forms.bodies.materials import Hencky, Material, MooneyRivlin, NeoHookean, oedometric_modulus
from forms.bodies.solid import DEGREE, Formulation, Solid
from forms.contact.penalty import ContactTerm
from forms.friction.coulomb import CoulombLaw, CoulombParameters, FrictionlessLaw
from forms.friction.friction_map import FrictionMap
from forms.friction.law import FrictionLaw
from forms.friction.stribeck import StribeckLaw
from geometry.meshes.mesh import MeshError, NamedMesh, bodies_sharing_nodes, generate, read
from geometry.surfaces.facets import Floats
from geometry.surfaces.surface import ContactSurface, facet_length

# Degree of the quadrature on slave facets, by the dimension of space.
QUADRATURE_DEGREE = {2: 9, 3: 5}
OVERLAP = 0.01  # depth over facet length up to which bodies only touch at the start
# Default stiffness of stick, in units of G/h (shear modulus of the softer body over the length of a
# slave facet): stiff against the shear of the elements beside it, yet soft enough for the onset of
# slip to spread without a fight.
TANGENTIAL_FACTOR = 10.0
# Default of film_onset_pressure, as a share of the softer body's shear modulus or of the highest
# prescribed pressure, whichever is less: only the rim of a contact feels it.
FILM_ONSET = 0.01


@dataclass(slots=True)
class Model:
    """A case made ready to be solved.

    Attributes:
        case: what was asked for.
        named: mesh with named bodies and surfaces.
        problem: residual and tangent of everything together.
        programs: each sets one load from (time, driven displacement), s and m.
        section: what the mesh stands for.
        thickness: m, of the plane-strain slab, per unit of which the solver works; 1 otherwise.
        notes: what the user should know before the run, one line each.
        film_onset: Pa, pressure at which the film is whole, for each contact (0 without a film).
        platen_names: of the problem's platens, such as "top_x": surface and direction.
    """

    case: Case
    named: NamedMesh
    problem: Equilibrium
    programs: list[Callable[[float, float], None]] = field(default_factory=list)
    section: Section = "plane-strain"
    thickness: float = 1.0
    notes: list[str] = field(default_factory=list)
    film_onset: list[float] = field(default_factory=list)
    platen_names: list[str] = field(default_factory=list)

    def set_loads(self, time: float, driven: float) -> None:
        """Set every prescribed displacement and load to its value at ``time`` (s).

        Args:
            time: s, since the start.
            driven: m, displacement of the driven boundaries so far.
        """
        for program in self.programs:
            program(time, driven)


def build_model(case: Case, comm: MPI.Comm) -> Model:
    """Mesh, forms and loads of a case; collective.

    Raises:
        InputError: the mesh, or a name in the case, does not fit.
    """
    named = make_mesh(case, comm)
    section = case.geometry.section_in(named.mesh.geometry.dim)
    chosen = _formulations(case, named)
    degree = max(DEGREE[formulation] for formulation in chosen.values())
    element = ("Lagrange", degree, (named.mesh.geometry.dim,))
    space = dolfinx.fem.functionspace(named.mesh, element)
    u = dolfinx.fem.Function(space, name="displacement")
    materials = {name: _material(body) for name, body in case.bodies.items()}
    solids = [
        Solid(
            name,
            u,
            named.cells(name),
            materials[name],
            chosen[name],
            body.density or 0.0,
            section,
        )
        for name, body in case.bodies.items()
    ]
    notes = notes_on(case) + list(locking_bodies(named, materials, degree))
    notes += [*large_mesh(case, named), *notes_on_ranks(case, named)]
    contacts = [
        _contact(case, index, named, space, section, materials, notes)
        for index in range(len(case.contact))
    ]
    loads = Loads(named, u, section, case.geometry.slab)
    for boundary in case.boundary:
        loads.add(boundary)
    loads.check_corners()
    notes += loads.notes
    problem = Equilibrium(u, solids, contacts, loads.prescribed, loads.platens, loads.pressures)
    if any(solver_of(stage, case.solver.kind) == "implicit" for stage in case.stage):
        notes += loose_bodies(case, named, section)
    onset = [
        term.law.parameters.film_onset_pressure if isinstance(term.law, FrictionMap) else 0.0
        for term in contacts
    ]
    thickness = case.geometry.slab
    names = loads.platen_names
    return Model(case, named, problem, loads.programs, section, thickness, notes, onset, names)


def body_dofs(model: Model, name: str) -> Ints:
    """Owned local unknowns (n, i) of a body's nodes."""
    space, dim = model.problem.space, model.problem.dim
    nodes = np.unique(space.dofmap.list[model.named.cells(name)])
    nodes = nodes[nodes < space.dofmap.index_map.size_local]
    out: Ints = (nodes[:, None] * dim + np.arange(dim)).astype(np.int32)
    return out


def initial_velocity(model: Model) -> Floats:
    """Velocity of the owned unknowns, m/s, as the bodies of the case say."""
    velocity = np.zeros(model.problem.owned)
    for name, body in model.case.bodies.items():
        if body.velocity is not None:
            components = [getattr(body.velocity, c) for c in COMPONENTS[: model.problem.dim]]
            velocity[body_dofs(model, name)] = components
    return velocity


def make_mesh(case: Case, comm: MPI.Comm) -> NamedMesh:
    """The case's mesh, generated or read, with every name the case uses; collective.

    Raises:
        InputError: no such file, body or surface, or bodies that are glued together.
    """
    geometry = case.geometry
    shared = case.solver.partition == "contact"
    contacts = [(contact.slave, contact.master) for contact in case.contact] if shared else []
    try:
        if isinstance(geometry, case_bodies.GeneratedGeometry):
            return generate(geometry.shape(), comm, contacts)
        named = read(Path(geometry.mesh), comm, contacts)
        try:
            _check_names(case, named)
            _check_section(case, named)
        except MeshError as error:
            raise MeshError(f"{error} (mesh {geometry.mesh})") from None
        glued = bodies_sharing_nodes(named)
    except MeshError as error:
        raise InputError(str(error)) from None
    if glued:
        first, second = glued[0]
        raise InputError(
            f'{geometry.mesh}: bodies "{first}" and "{second}" share nodes, so they cannot slide; '
            "mesh them apart (no common points between the bodies)"
        )
    _check_owners(case, named)
    return named


def _check_names(case: Case, named: NamedMesh) -> None:
    place = ""
    try:
        for name in case.bodies:
            place = f"bodies.{name}: "
            named.body_tag(name)
        for index, contact in enumerate(case.contact):
            for key in ("slave", "master"):
                place = f"contact.{index}.{key}: "
                named.surface_tag(getattr(contact, key))
        for index, boundary in enumerate(case.boundary):
            place = f"boundary.{index}.surface: "
            named.surface_tag(boundary.surface)
    except MeshError as error:
        raise MeshError(f"{place}{error}") from None
    for name in named.bodies:
        if name not in case.bodies:
            raise MeshError(f'the mesh has a body "{name}", the case has no [bodies.{name}]')


def _check_owners(case: Case, named: NamedMesh) -> None:
    """See that every surface in use lies on one body; collective."""
    pairs = [(contact.slave, contact.master) for contact in case.contact]
    used = [name for pair in pairs for name in pair] + [part.surface for part in case.boundary]
    for surface in dict.fromkeys(used):
        try:
            named.body_of(surface)
        except MeshError as error:
            raise InputError(str(error)) from None


def _check_section(case: Case, named: NamedMesh) -> None:
    """See that what the case says of a mesh in the plane, or in space, goes with this mesh."""
    try:
        section = case.geometry.section_in(named.mesh.geometry.dim)
    except ValueError as error:
        raise MeshError(f"geometry.{error}") from None
    for index, boundary in enumerate(case.boundary):
        for problem in boundary.section_problems(section, ("boundary", index)):
            raise MeshError(format_problem(problem))
    for name, body in case.bodies.items():
        if body.velocity is not None:
            for problem in body.velocity.section_problems(section, ("bodies", name, "velocity")):
                raise MeshError(format_problem(problem))
    if section == "axisymmetric":
        x = named.mesh.geometry.x[:, 0]
        low, high = float(x.min(initial=0.0)), float(x.max(initial=0.0))
        low = named.mesh.comm.allreduce(low, op=MPI.MIN)
        if low < -ON_AXIS * named.mesh.comm.allreduce(high, op=MPI.MAX):
            raise MeshError(
                f'geometry.section = "axisymmetric": the mesh reaches x = {low:g} m; x is the '
                "distance from the axis of symmetry and must be >= 0 m"
            )


def _formulations(case: Case, named: NamedMesh) -> dict[str, Formulation]:
    """The formulation of each body.

    Raises:
        InputError: one does not go with the elements or with another body's.
    """
    cell = named.mesh.topology.cell_name()
    for name, reason in case_bodies.formulation_problems(case.bodies, cell):
        raise InputError(f"bodies.{name}.formulation: {reason}")
    return case_bodies.formulations(case.bodies, cell)


def _material(body: case_bodies.Body) -> Material:
    if isinstance(body, case_bodies.MooneyRivlinBody):
        return MooneyRivlin(body.C10, body.C01, body.K)
    kind = Hencky if isinstance(body, case_bodies.HenckyBody) else NeoHookean
    return kind(body.shear_modulus, body.bulk_modulus)


def _contact(
    case: Case,
    index: int,
    named: NamedMesh,
    space: dolfinx.fem.FunctionSpace,
    section: Section,
    materials: dict[str, Material],
    notes: list[str],
) -> ContactTerm:
    contact = case.contact[index]
    slave, master = named.facets(contact.slave), named.facets(contact.master)
    reason = contact.smoothing_problem(
        named.mesh.topology.cell_name(), space.element.basix_element.degree
    )
    if reason is not None:
        raise InputError(f"contact.{index}.smoothing_angle: {reason}")
    try:
        surface = ContactSurface(
            space,
            slave,
            master,
            contact.quadrature_degree or QUADRATURE_DEGREE[named.mesh.geometry.dim],
            section == "axisymmetric",
            contact.smoothing_angle,
        )
    except ValueError as error:
        raise InputError(f"contact.{index}: {error}") from None
    owners = [named.body_of(name) for name in (contact.slave, contact.master)]
    if oedometric_modulus(materials[owners[0]]) > 10.0 * oedometric_modulus(materials[owners[1]]):
        notes.append(
            f"contact.{index}: the slave {contact.slave} is on the stiffer body {owners[0]}; the "
            "softer body's surface should be the slave"
        )
    if owners[0] == owners[1]:
        raise InputError(
            f'contact.{index}: slave "{contact.slave}" and master "{contact.master}" are both on '
            f"body {owners[0]}; contact is between two bodies"
        )
    bodies = [materials[owner] for owner in owners]
    softer = min(bodies, key=oedometric_modulus)
    length = surface.facet_length
    stiffness = oedometric_modulus(softer) / length
    distance = _checked_distance(f"contact.{index}", contact, surface, length)
    notes += notes_on_surfaces(
        f"contact.{index}", contact, (length, facet_length(named.mesh, master)), distance
    )
    penalty = contact.penalty or (contact.penalty_factor or 0.0) * stiffness
    note = penalty_note(index, penalty / stiffness)
    if note is not None:
        notes.append(note)
    tangential = TANGENTIAL_FACTOR * softer.shear_modulus / length
    # A pressure that the case prescribes says better than the body what is small.
    scale = min(softer.shear_modulus, highest_pressure(case) or np.inf)
    law = _law(contact.friction, tangential, FILM_ONSET * scale)
    return ContactTerm(surface, law, penalty, contact.film.film() if contact.film else 0.0)


def _checked_distance(
    place: str, contact: case_contact.Contact, surface: ContactSurface, length: float
) -> float:
    """Refuse surfaces that overlap, or face away from each other, before anything has moved.

    Args:
        place: of the contact in the case.
        contact: what the case says.
        surface: its surfaces.
        length: m, mean length of a slave facet.

    Returns:
        Their distance, m; infinite if no slave point is above the master.
    """
    points, nodes = surface.slave.position, surface.master.position
    at = surface.project(points, nodes)
    local = float(np.max(-at.gap, where=at.on_surface, initial=0.0))
    depth = surface.space.mesh.comm.allreduce(local, op=MPI.MAX)
    if depth > OVERLAP * length:
        smooth = (
            "; a smooth master bulges beyond its facets where flats and arcs meet: leave a gap, or "
            "lower smoothing_angle"
        )
        raise InputError(
            f"{place}: {contact.slave} starts {depth:.3g} m inside {contact.master} (or faces away "
            "from it); the bodies may touch at the start, not overlap"
            + (smooth if contact.smoothing_angle is not None else "")
        )
    nearest = float(np.min(np.abs(at.gap), where=at.on_surface, initial=np.inf))
    return float(surface.space.mesh.comm.allreduce(nearest, op=MPI.MIN))


def _law(friction: case_contact.Friction, stiffness: float, onset: float) -> FrictionLaw:
    """The friction law, with the defaults that depend on the bodies.

    Args:
        friction: what the case says.
        stiffness: Pa/m, of the elastic slip.
        onset: Pa, pressure at which the film is whole.
    """
    if isinstance(friction, case_contact.FrictionMap):
        parameters = friction.parameters()
        if friction.film_onset_pressure is None:
            parameters = replace(parameters, film_onset_pressure=onset)
        return FrictionMap(parameters)
    if isinstance(friction, case_contact.Coulomb):
        return CoulombLaw(CoulombParameters(mu=friction.mu, K_T=friction.K_T or stiffness))
    if isinstance(friction, case_contact.Stribeck):
        return StribeckLaw(friction.parameters(stiffness))
    if isinstance(friction, case_contact.OwnLaw):
        return friction.friction_law()
    return FrictionlessLaw()
