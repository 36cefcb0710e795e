"""From a case to the objects that are solved: mesh, solids, contacts, loads and their programs."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import dolfinx
import numpy as np
from mpi4py import MPI

import app.case_bodies as case_bodies
import app.case_contact as case_contact
from app.advice import highest_pressure, notes_on
from app.case import Case
from app.case_boundary import DRIVEN, Boundary
from app.diagnosis import penalty_note
from app.equilibrium import Equilibrium, Ints, Platen, Prescribed, component_dofs
from app.errors import InputError
from app.quantity_tables import TimeTable
from forms.contact import ContactTerm
from forms.coulomb import CoulombLaw, CoulombParameters, FrictionlessLaw
from forms.friction import FrictionLaw
from forms.friction_map import FrictionMap
from forms.loads import FollowerPressure, mean_normal, reference_area
from forms.materials import Hencky, Material, MooneyRivlin, NeoHookean, oedometric_modulus
from forms.solids import Solid
from forms.stribeck import StribeckLaw
from geometry.mesh import MeshError, NamedMesh, bodies_sharing_nodes, generate, read
from geometry.surface import ContactSurface, integration_facets

COMPONENTS = ("x", "y")
LOCKING = 50.0  # K/G (Poisson's ratio 0.49) from which linear triangles are said to lock
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
        thickness: m, of the plane-strain slab; the solver works per unit thickness.
        notes: what the user should know before the run, one line each.
        film_onset: Pa, pressure at which the film is whole, for each contact (0 without a film).
    """

    case: Case
    named: NamedMesh
    problem: Equilibrium
    programs: list[Callable[[float, float], None]] = field(default_factory=list)
    thickness: float = 1.0
    notes: list[str] = field(default_factory=list)
    film_onset: list[float] = field(default_factory=list)

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
    space = dolfinx.fem.functionspace(named.mesh, ("Lagrange", 1, (named.mesh.geometry.dim,)))
    u = dolfinx.fem.Function(space, name="displacement")
    materials = {name: _material(body) for name, body in case.bodies.items()}
    solids = [
        Solid(
            name,
            u,
            named.cells(name),
            materials[name],
            _formulation(name, body, named),
            body.density or 0.0,
        )
        for name, body in case.bodies.items()
    ]
    notes = notes_on(case) + list(_locking_bodies(named, materials))
    contacts = [
        _contact(case, index, named, space, materials, notes) for index in range(len(case.contact))
    ]
    thickness = case.geometry.thickness
    loads = _Loads(named, u, thickness)
    for boundary in case.boundary:
        loads.add(boundary)
    loads.check_corners()
    problem = Equilibrium(u, solids, contacts, loads.prescribed, loads.platens, loads.pressures)
    notes += _loose_bodies(case, named)
    onset = [
        term.law.parameters.film_onset_pressure if isinstance(term.law, FrictionMap) else 0.0
        for term in contacts
    ]
    return Model(case, named, problem, loads.programs, thickness, notes, onset)


def _locking_bodies(named: NamedMesh, materials: dict[str, Material]) -> Iterator[str]:
    """A line on each nearly incompressible body of linear triangles, which lock."""
    if named.mesh.topology.cell_name() != "triangle":
        return
    for name, material in materials.items():
        ratio = material.bulk_modulus / material.shear_modulus
        if ratio > LOCKING:
            yield (
                f"body {name}: linear triangles lock with K/G = {ratio:.3g} and are far too stiff; "
                'use cell = "quadrilateral" with formulation = "q1-sri"'
            )


def _loose_bodies(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line on each body and direction that only contact holds; collective.

    A platen counts as a support where the bodies touch from the start, as they are meant to then.
    """
    touching = getattr(case.geometry, "gap", 0.0) == 0.0
    held: dict[str, set[str]] = {name: set() for name in named.bodies}
    for boundary in case.boundary:
        found = {part for part, keys in boundary.prescribed() if touching or keys[0] != "platen"}
        held[_body_of(named, boundary.surface)] |= found
    for name, directions in held.items():
        for direction in COMPONENTS:
            if direction not in directions:
                yield (
                    f"body {name}: no boundary prescribes a displacement in {direction}; "
                    "only contact holds it there"
                )


def make_mesh(case: Case, comm: MPI.Comm) -> NamedMesh:
    """The case's mesh, generated or read, with every name the case uses; collective.

    Raises:
        InputError: no such file, body or surface, or bodies that are glued together.
    """
    geometry = case.geometry
    try:
        if isinstance(geometry, case_bodies.GeneratedGeometry):
            return generate(geometry.shape(), comm)
        named = read(Path(geometry.mesh), comm)
        if named.mesh.geometry.dim != 2 or named.mesh.topology.dim != 2:
            raise MeshError(f"{geometry.mesh}: a plane mesh (z = 0) is needed, this one is in 3D")
        try:
            _check_names(case, named)
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


def _formulation(name: str, body: case_bodies.Body, named: NamedMesh) -> case_bodies.Formulation:
    try:
        return body.formulation_for(named.mesh.topology.cell_name())
    except ValueError as error:
        raise InputError(f"bodies.{name}.formulation: {error}") from None


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
    materials: dict[str, Material],
    notes: list[str],
) -> ContactTerm:
    contact = case.contact[index]
    slave, master = named.facets(contact.slave), named.facets(contact.master)
    try:
        surface = ContactSurface(space, slave, master, contact.quadrature_degree)
    except ValueError as error:
        raise InputError(f"contact.{index}: {error}") from None
    owners = [_body_of(named, name) for name in (contact.slave, contact.master)]
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
    local = np.array([surface.slave.weight.sum(), len(np.unique(surface.slave.facet))])
    length, count = named.mesh.comm.allreduce(local)
    stiffness = oedometric_modulus(softer) * count / length
    _check_overlap(f"contact.{index}", contact, surface, length / count)
    penalty = contact.penalty or (contact.penalty_factor or 0.0) * stiffness
    note = penalty_note(index, penalty / stiffness)
    if note is not None:
        notes.append(note)
    tangential = TANGENTIAL_FACTOR * softer.shear_modulus * count / length
    # A pressure that the case prescribes says better than the body what is small.
    scale = min(softer.shear_modulus, highest_pressure(case) or np.inf)
    law = _law(contact.friction, tangential, FILM_ONSET * scale)
    return ContactTerm(surface, law, penalty, contact.film.film() if contact.film else 0.0)


def _check_overlap(
    place: str, contact: case_contact.Contact, surface: ContactSurface, length: float
) -> None:
    """Refuse surfaces that overlap, or face away from each other, before anything has moved.

    Args:
        place: of the contact in the case.
        contact: what the case says.
        surface: its surfaces.
        length: m, mean length of a slave facet.
    """
    points, nodes = surface.slave.position, surface.master.position
    at = surface.polyline.project(points, nodes, surface.polyline.candidates(points, nodes))
    local = float(np.max(-at.gap, where=at.on_surface, initial=0.0))
    depth = surface.space.mesh.comm.allreduce(local, op=MPI.MAX)
    if depth > OVERLAP * length:
        raise InputError(
            f"{place}: {contact.slave} starts {depth:.3g} m inside {contact.master} (or faces away "
            "from it); the bodies may touch at the start, not overlap"
        )


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


def _body_of(named: NamedMesh, surface: str) -> str:
    """The body that a surface belongs to; collective."""
    mesh = named.mesh
    pairs = integration_facets(mesh, named.facets(surface)).reshape(-1, 2)
    tags = {
        int(tag) for tag in named.cell_tags.values[np.isin(named.cell_tags.indices, pairs[:, 0])]
    }
    found = set().union(*mesh.comm.allgather(tags))
    names = [name for name, tag in named.bodies.items() if tag in found]
    if len(names) != 1:
        raise InputError(f'surface "{surface}" must lie on one body; it lies on {sorted(names)}')
    return names[0]


@dataclass(frozen=True, slots=True)
class _Hold:
    """What decides a displacement component of a surface: equal sources agree at shared nodes."""

    surface: str
    component: int
    source: object
    dofs: Ints


class _Loads:
    """Collects what the boundaries prescribe, and the programs that move it."""

    def __init__(self, named: NamedMesh, u: dolfinx.fem.Function, thickness: float) -> None:
        self.named, self.u, self.thickness = named, u, thickness
        self.prescribed: list[Prescribed] = []
        self.platens: list[Platen] = []
        self.pressures: list[FollowerPressure] = []
        self.programs: list[Callable[[float, float], None]] = []
        self._holds: list[_Hold] = []

    def add(self, boundary: Boundary) -> None:
        """Add one boundary."""
        facets = self.named.facets(boundary.surface)
        for component, value, source in _components(boundary):
            self._prescribe(boundary.surface, facets, component, value, source)
        if boundary.platen is not None:
            self._platen(boundary, facets)
        if boundary.pressure is not None:
            load = FollowerPressure(self.u, facets)
            self.pressures.append(load)
            table = boundary.pressure
            self.programs.append(lambda time, driven: load.set(table(time)))

    def _prescribe(
        self,
        surface: str,
        facets: Ints,
        component: int,
        value: Callable[[float, float], float],
        source: object,
    ) -> None:
        held = Prescribed(component_dofs(self.u.function_space, facets, component))
        self.prescribed.append(held)
        self._holds.append(_Hold(surface, component, source, held.dofs))

        def program(time: float, driven: float) -> None:
            held.value = value(time, driven)

        self.programs.append(program)

    def check_corners(self) -> None:
        """See that surfaces which share nodes do not prescribe different things there; collective.

        Raises:
            InputError: two boundaries disagree at a shared node.
        """
        mine = [
            f'"{a.surface}" and "{b.surface}" share a node and both decide its displacement in '
            f"{COMPONENTS[a.component]}, each in its own way; let one of them leave it out"
            for a, b in itertools.combinations(self._holds, 2)
            if a.component == b.component
            and a.source != b.source
            and np.intersect1d(a.dofs, b.dofs).size
        ]
        problems = sorted(set(itertools.chain(*self.named.mesh.comm.allgather(mine))))
        if problems:
            raise InputError(f"boundary: {problems[0]}")

    def _platen(self, boundary: Boundary, facets: Ints) -> None:
        assert boundary.platen is not None
        component = COMPONENTS.index(boundary.platen.direction)
        mesh = self.named.mesh
        platen = Platen(component_dofs(self.u.function_space, facets, component))
        self.platens.append(platen)
        self._holds.append(_Hold(boundary.surface, component, object(), platen.dofs))
        outward = mean_normal(mesh, facets, component)
        if abs(outward) < 1e-6:
            raise InputError(
                f'boundary "{boundary.surface}": platen.direction = "{boundary.platen.direction}" '
                "is tangential to the surface; a platen presses along its normal"
            )
        inward = -float(np.sign(outward))
        if boundary.platen.pressure is not None:
            table, scale = boundary.platen.pressure, inward * reference_area(mesh, facets)
        else:
            assert boundary.platen.force is not None
            table, scale = boundary.platen.force, inward / self.thickness

        def program(time: float, driven: float) -> None:
            platen.force = scale * table(time)

        self.programs.append(program)


def _components(
    boundary: Boundary,
) -> Iterator[tuple[int, Callable[[float, float], float], object]]:
    """Prescribed components, their value at (time, driven displacement), and what says so."""
    for index, name in enumerate(COMPONENTS):
        moved = getattr(boundary.displacement, name, None)
        if moved == DRIVEN:
            yield index, lambda time, driven: driven, DRIVEN
        elif isinstance(moved, TimeTable):
            yield index, _of_time(moved.__call__), moved
        speed = getattr(boundary.velocity, name, None)
        if isinstance(speed, TimeTable):
            yield index, _of_time(speed.integral), ("velocity", speed)


def _of_time(value: Callable[[float], float]) -> Callable[[float, float], float]:
    return lambda time, driven: value(time)
