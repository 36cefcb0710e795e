"""The contacts of a case: surfaces, and the stiffnesses that follow from mesh and bodies.

Every default of a `[[contact]]` table is resolved here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.build.boundary_conditions import Loads
from tribox.app.build.case_notes import highest_pressure
from tribox.app.build.pair_at_start import STRAIGHT, PairAtStart
from tribox.app.case.boundary import COMPONENTS
from tribox.app.case.case import Case
from tribox.app.case.contact import DRAWN, Contact
from tribox.app.case.friction import MAP, Friction, OwnLaw
from tribox.app.case.own_code import OwnCodeError
from tribox.app.case.time_tables import TimeTable, value_at
from tribox.app.equilibrium.constraints import component_dofs
from tribox.app.equilibrium.rigid_tool import RigidTool
from tribox.app.equilibrium.slanted import SlantedPlaten
from tribox.app.errors import InputError
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.materials import Material, contact_shear_modulus, oedometric_modulus
from tribox.forms.contact.law_faults import law_fault
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import PressureKind
from tribox.forms.contact.tie import TieTerm
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.forms.friction.factored_law import FactoredLaw
from tribox.forms.friction.law import FrictionLaw
from tribox.forms.parameters import Scales
from tribox.geometry.meshes.mesh import NamedMesh
from tribox.geometry.surfaces.facets import Floats, Ints, Longs
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.surface import QUADRATURE_DEGREE, ContactSurface

STIFFER = 10.0  # G (or hardness) of the slave's body over that of the master's that is pointed out
CHATTER = 10.0  # K h/M above which an explicit run pays for the penalty K
# Penalties in units of the stiffness of the elements beside them (`penalty_factor`). Up to a
# thousand times the default Newton's method converges as ever; from ten thousand times on it needs
# many more iterations, and rounding the coordinates begins to keep the residual above the
# tolerance.
STIFF_PENALTY = 3e4
SOFT_PENALTY = 0.1
STIFF_STICK = 5e3  # K_T h/G from which steps take several times the iterations
SOFT_STICK = 0.1  # K_T h/G below which the elastic slip is longer than the shear of the elements

WHOLE = 0.999  # tied share of a slave's area that counts as all of it


@dataclass(frozen=True, slots=True)
class BuiltContact:
    """One contact made ready."""

    table: Contact  # of the case, with every default resolved
    term: ContactTerm  # its residual, tangent and history
    notes: tuple[str, ...]  # what the user should know, one line each
    # gives the term its friction and fit at (time, driven displacement), s and m; None where they
    # do not change
    program: Callable[[float, float], None] | None = None


@dataclass(frozen=True, slots=True)
class ContactBuilder:
    """Makes the contacts of one case."""

    case: Case  # what was asked for
    named: NamedMesh  # the mesh
    space: dolfinx.fem.FunctionSpace  # of the displacement
    section: Section  # what the mesh stands for
    materials: Mapping[str, Material]  # of the bodies, by name
    # whether laws written in Python are run; without, such a contact has no friction
    runs_code: bool = True
    # that a contact may name as master, by name
    tools: Mapping[str, RigidTool] = field(default_factory=dict)
    loads: Loads | None = None  # what the boundaries hold

    def build(self, index: int) -> BuiltContact:
        """Contact number ``index``; collective; InputError if its surfaces or keys do not fit."""
        asked = self.case.contact[index]
        materials = self._materials(index, asked)
        degree = quadrature_degree(self.named.mesh.geometry.dim, *materials)
        asked = asked.model_copy(update={"quadrature_degree": asked.quadrature_degree or degree})
        surface = self._surface(index, asked)
        softer = min(materials, key=contact_shear_modulus)
        if asked.tied:
            return self._tie(index, asked, surface, softer)
        start, fit = self._start(index, asked, surface)
        length = start.lengths[0]
        table = resolved_contact(asked, softer, length, highest_pressure(self.case))
        law = self._law(index, table)
        modulus = penalty_modulus(softer, table.pressure)
        penalty = _penalty(table, surface, modulus)
        factor = table.penalty_factor or (table.penalty or 0.0) * length / modulus
        ratio = modulus / oedometric_modulus(softer) if self.case.is_explicit else None
        smooth = asked.model_copy(update={"smoothing_angle": STRAIGHT})  # whether asked for or not
        notes = (
            *stiffer_slave(index, asked, self.named.body_of(asked.slave), *materials),
            *start.notes(self.case, self._is_alone(asked), self._smoothing_problem(smooth)),
            *note_on_idle_film(f"contact.{index}", asked),
            *(() if _is_unknown(table) else notes_on_penalty(index, factor, table.pressure, ratio)),
            *note_on_stick(index, table.friction, contact_shear_modulus(softer) / length),
        )
        modulus = contact_modulus(*materials)
        if _is_unknown(table):
            term = self._lubricated(index, table, surface, law, modulus)
        else:
            film = table.acting_film.film() if table.acting_film is not None else 0.0
            term = ContactTerm(surface, law, penalty, film, table.pressure, modulus)
        if fault := law_fault([term]):
            raise InputError(f"contact.{index}.friction: {fault}")
        return BuiltContact(table, term, notes, contact_program(table, term, fit))

    def _start(
        self, index: int, asked: Contact, surface: ContactSurface
    ) -> tuple[PairAtStart, Callable[[float], Floats] | None]:
        """The surfaces at time 0, and their fit; InputError if they face one way, or overlap."""
        at = surface.project(surface.slave.position, self._nodes_at_start(asked, surface))
        start = PairAtStart(f"contact.{index}", asked, surface, at)
        at_once = self.case.acts_in(asked, self.case.stage[0].name)
        tool = self.case.tools.get(asked.master)
        if at_once and not self._folds(asked):
            start.check_facing(tool)
        fit = fit_program(self.case, asked, at)
        if fit is not None:
            at.shift(fit(0.0))
        if at_once:
            start.check_overlap(tool)
        return start, fit

    def _folds(self, asked: Contact) -> bool:
        """Whether a body meets itself, as a hem does whose sides begin as one flat."""
        if asked.master in self.case.tools:
            return False
        return self.named.body_of(asked.slave) == self.named.body_of(asked.master)

    def _is_alone(self, asked: Contact) -> bool:
        """Whether no other surface of the slave's body meets the master."""
        body = self.named.body_of(asked.slave)
        slaves = [one.slave for one in self.case.contact if one.master == asked.master]
        return sum(self.named.body_of(slave) == body for slave in slaves) == 1

    def _smoothing_problem(self, contact: Contact) -> str | None:
        """Why the master cannot be as smooth as the contact asks, if it cannot."""
        degree = self.space.element.basix_element.degree
        return contact.smoothing_problem(self.named.mesh.topology.cell_name(), degree)

    def _lubricated(
        self, index: int, table: Contact, surface: ContactSurface, law: FrictionLaw, modulus: float
    ) -> ContactTerm:
        """A contact whose film is found."""
        place, film = f"contact.{index}.film.model", table.film
        assert film is not None
        if self.case.is_explicit:
            raise InputError(f'{place} = "reynolds" goes with solver.kind = "implicit" only')
        several = sum(table.slave == other.slave for other in self.case.contact) > 1
        if several:
            raise InputError(f'{place} = "reynolds": its slave {table.slave} has another contact')
        dry = [stage.name for stage in self.case.stage if not stage.rate_dependent]
        if film.sigma == 0.0 and dry:
            raise InputError(
                f"contact.{index}.film.sigma = 0: nothing carries load in stage {dry[0]}, which is "
                "not rate_dependent"
            )
        try:
            held = self._held_with(table.master)
            term = LubricatedTerm(surface, law, film.unknown(modulus, table.map), modulus, held)
        except ValueError as error:
            raise InputError(f'{place} = "reynolds": {error}') from None
        if np.isin(surface.vertices.nodes, self._slanted()).any():
            raise InputError(
                f'{place} = "reynolds": its slave {table.slave} ends at a plane of symmetry that '
                "is across no axis; turn the mesh"
            )
        return term

    def _slanted(self) -> Ints:
        """Nodes of this rank on planes of symmetry that are across no axis."""
        constraints = () if self.loads is None else self.loads.constraints
        parts = [one.part for one in constraints if isinstance(one.part, SlantedPlaten)]
        dofs = [part.dofs for part in parts if part.displacement is not None]
        none = np.empty(0, dtype=np.int32)
        return np.concatenate([none, *dofs]) // self.space.dofmap.index_map_bs

    def _held_with(self, master: str) -> list[Longs]:
        """By axis, nodes that stay where they are, along axes in which the master rests there too.

        Surfaces go on as their images, and a film ends, at a plane of symmetry of both sides, not
        where one is merely held; collective.
        """
        if self.loads is None:
            return []
        held, tool = self.loads.held(), self.case.tools.get(master)
        for axis in range(len(held)):
            if tool is not None:
                rests = tool.rests(COMPONENTS[axis])
            else:
                dofs = component_dofs(self.space, self.named.facets(master), axis) // len(held)
                own = self.space.dofmap.index_map.local_to_global(dofs.astype(np.int32))
                here = bool(np.isin(own, held[axis]).any())
                rests = self.space.mesh.comm.allreduce(here, op=MPI.LOR)
            if not rests:
                held[axis] = held[axis][:0]
        return held

    def _tie(
        self, index: int, asked: Contact, surface: ContactSurface, softer: Material
    ) -> BuiltContact:
        """A contact whose surfaces are bonded; collective."""
        modulus = penalty_modulus(softer, "averaged")
        length = surface.facet_length
        table = resolved_contact(asked, softer, length, highest_pressure(self.case))
        try:
            term = TieTerm(surface, _penalty(table, surface, modulus))
        except ValueError as error:
            raise InputError(f"contact.{index}: {error} ({asked.slave}, {asked.master})") from None
        factor = table.penalty_factor or (table.penalty or 0.0) * length / modulus
        ratio = modulus / oedometric_modulus(softer) if self.case.is_explicit else None
        notes = (
            *note_on_tie(f"contact.{index}", asked, term.share),
            *notes_on_penalty(index, factor, ratio=ratio),
        )
        return BuiltContact(table, term, notes)

    def _law(self, index: int, table: Contact) -> FrictionLaw:
        """The law of a resolved `[[contact]]` table at the start; collective."""
        law = self._plain_law(index, table.friction)
        if table.friction_factor == 1.0:
            return law
        return _factored(law, table.friction_factor, 0.0)

    def _plain_law(self, index: int, friction: Friction) -> FrictionLaw:
        """The law without a factor; collective; raises as :meth:`_law` does."""
        law: FrictionLaw = FrictionlessLaw()
        problem: str | None = None
        if self.runs_code or not isinstance(friction, OwnLaw):
            try:
                law = friction.friction_law(dim=self.named.mesh.geometry.dim)
            except OwnCodeError as error:
                problem = f"contact.{index}.friction.{error.key}: {error}"
        # A file may be missing on one rank alone: all raise, or none.
        problem = next((p for p in self.named.mesh.comm.allgather(problem) if p), None)
        if problem is not None:
            raise InputError(problem)
        return law

    def _surface(self, index: int, contact: Contact) -> ContactSurface:
        if (reason := self._smoothing_problem(contact)) is not None:
            raise InputError(f"contact.{index}.smoothing_angle: {reason}")
        slave, tool = self.named.facets(contact.slave), self.tools.get(contact.master)
        quadrature = contact.quadrature_degree or QUADRATURE_DEGREE[self.named.mesh.geometry.dim]
        ring = self.section == "axisymmetric"
        try:
            if tool is not None:
                rigid = tool.surface, tool.nodes, tool.motion
                return ContactSurface.for_tool(self.space, slave, *rigid, quadrature, ring)
            master = self.named.facets(contact.master)
            held = self._held_with(contact.master)
            ends = contact.smoothing_angle, contact.fade_length, held
            return ContactSurface(self.space, slave, master, quadrature, ring, *ends)
        except ValueError as error:
            pair = f"slave {contact.slave}, master {contact.master}"
            raise InputError(f"contact.{index}: {error} ({pair})") from None

    def _nodes_at_start(self, contact: Contact, surface: ContactSurface) -> Floats:
        """Nodes (n, i), m, of the master at time 0, to which a program may have moved a tool."""
        tool, table = self.tools.get(contact.master), self.case.tools.get(contact.master)
        if tool is None or table is None or table.displacement is None:
            return surface.master.position
        if table.displacement_stages and self.case.stage[0].name not in table.displacement_stages:
            return surface.master.position
        programs = (getattr(table.displacement, axis) for axis in COMPONENTS[: surface.dim])
        moved = [p(0.0) if isinstance(p, TimeTable) else 0.0 for p in programs]
        return tool.motion.control_points(np.array(moved), 0.0)

    def _materials(self, index: int, contact: Contact) -> tuple[Material, ...]:
        """Materials of the bodies of slave and master; of the slave alone against a tool."""
        if contact.master in self.tools:
            return (self.materials[self.named.body_of(contact.slave)],)
        owners = [self.named.body_of(name) for name in (contact.slave, contact.master)]
        return self.materials[owners[0]], self.materials[owners[1]]


def resolved_contact(contact: Contact, softer: Material, length: float, pressure: float) -> Contact:
    """A `[[contact]]` table with every default filled in.

    By the ``softer`` material, a slave facet's ``length``, m, and the highest ``pressure``, Pa.
    """
    friction, film = contact.friction, contact.film
    if film is not None and film.is_unknown:
        film = film.resolved()
        if contact.map is not None:  # the film's own pressure says where it is
            onset = contact.map.film_onset_pressure
            friction = friction.model_copy(update={"film_onset_pressure": onset})
    friction = friction.resolved(Scales(contact_shear_modulus(softer), length, pressure))
    return contact.model_copy(update={"name": contact.label, "friction": friction, "film": film})


def _is_unknown(contact: Contact) -> bool:
    """Whether the film of a contact is found."""
    return contact.film is not None and contact.film.is_unknown


def quadrature_degree(dim: int, slave: Material, master: Material | None = None) -> int:
    """Default degree of the quadrature on slave facets.

    In the plane five points serve a slave that is much the softer, or meets a tool (no ``master``).
    The nodes of a master that gives as well feel where the points are: six then
    (docs/quadrature.md).
    """
    degree = QUADRATURE_DEGREE[dim]
    rigid = master is None or (
        contact_shear_modulus(master) > STIFFER * contact_shear_modulus(slave)
    )
    return degree if rigid or dim == 3 else degree + 2


def contact_modulus(*bodies: Material) -> float:
    """E*, Pa, of two bodies: 1/E* = Σ (1 − ν)/2G, with G/M = (1 − 2ν)/2(1 − ν)."""
    compliance = 0.0
    for body in bodies:
        # 1 − G/M = 1/2(1 − ν)
        ratio = body.shear_modulus / oedometric_modulus(body)
        compliance += 1.0 / (4.0 * body.shear_modulus * (1.0 - ratio))
    return 1.0 / compliance


def penalty_modulus(softer: Material, pressure: PressureKind) -> float:
    """Modulus, Pa, that the penalty of a pair is a multiple of, over the length of a facet.

    What a soft penalty costs is the approach of the bodies: for bodies that bend and bulge into
    each other it goes with the shear modulus G; a layer that cannot give sideways answers with the
    oedometric modulus M. Both count, where the pressure is "averaged", as max(10 G, M/10). Point by
    point ("pointwise") it is M.
    """
    modulus, shear = oedometric_modulus(softer), contact_shear_modulus(softer)
    # A body that flows: it bears its hardness, of which M says nothing.
    if shear < softer.shear_modulus:
        return 10.0 * shear
    if pressure == "pointwise":
        return modulus
    return max(10.0 * shear, 0.1 * modulus)


def _penalty(contact: Contact, surface: ContactSurface, modulus: float) -> float | Floats:
    """Penalty of the pair, Pa/m: as given, or of each vertex or point from its own facets."""
    if contact.penalty is not None:
        return contact.penalty
    averaged = contact.pressure == "averaged"
    length = surface.vertices.length if averaged else surface.slave.facet_length
    return np.asarray((contact.penalty_factor or 0.0) * modulus / length, dtype=np.float64)


def _factored(law: FrictionLaw, factor: float | TimeTable, time: float) -> FactoredLaw:
    """A law with the factor of a time, s."""
    largest = max(factor.values) if isinstance(factor, TimeTable) else factor
    return FactoredLaw(law, value_at(factor, time), largest)


def fit_program(case: Case, contact: Contact, at: Projection) -> Callable[[float], Floats] | None:
    """Of a press fit the offset (q,), m, of the gaps at a time, s; None without one.

    Surfaces that are larger by δ(t) than they are drawn feel the gap g − δ(t). Those that are drawn
    with an overlap o = ⟨−g⟩ at the start feel g + o (1 − s), s being the share of the stage that is
    over: none of it at first, and at last all.

    Args:
        at: the slave's points on the master, undeformed.
    """
    fit = contact.interference
    if fit is None:
        return None
    drawn = np.where(at.on_surface, np.maximum(-at.gap, 0.0), 0.0)
    if contact.comes_on:
        when = case.fit_time(contact)
        assert when is not None, "checked with the case"
        full = 1.0 if not isinstance(fit, TimeTable) else fit.values[0]
        ramp = TimeTable(when, (0.0, full))
        if fit == DRAWN:
            return lambda time: drawn * (1.0 - ramp(time))
        fit = ramp
    assert isinstance(fit, TimeTable)
    size = fit
    return lambda time: np.full(len(drawn), -size(time))


def contact_program(
    table: Contact, term: ContactTerm, fit: Callable[[float], Floats] | None = None
) -> Callable[[float, float], None] | None:
    """What renews a term's friction and fit at (time, driven), s and m; None where they stay."""
    friction, factor = table.friction, table.friction_factor
    if not friction.changes and not isinstance(factor, TimeTable) and fit is None:
        return None

    def program(time: float, driven: float) -> None:
        law = term.law
        plain = law.law if isinstance(law, FactoredLaw) else law
        if friction.changes:
            plain = friction.friction_law(time)
        new = _factored(plain, factor, time) if isinstance(law, FactoredLaw) else plain
        term.renew(law=new, offset=None if fit is None else fit(time))

    return program


# -- Notes on a table: the stiffnesses of contact and stick, its film, its tie ---------------------


def stiffer_slave(
    index: int, contact: Contact, body: str, slave: Material, master: Material | None = None
) -> Iterator[str]:
    """A line on a slave that is on the stiffer body, named ``body``; ``master`` None: a tool."""
    if master is None:
        return
    if contact_shear_modulus(slave) > STIFFER * contact_shear_modulus(master):
        yield (
            f"contact.{index}: the slave {contact.slave} is on the stiffer body {body}; the "
            "softer body's surface should be the slave"
        )


def note_on_idle_film(place: str, contact: Contact) -> Iterator[str]:
    """A line on a film that the friction law has no use for."""
    if contact.given_film is not None and contact.acting_film is None:
        yield f'{place}: film has no effect with law = "{contact.friction.law}"'


def note_on_tie(place: str, contact: Contact, share: float) -> Iterator[str]:
    """A line on a slave that is tied in part only; ``share``: of the slave's area that is tied."""
    if share < WHOLE:
        yield (
            f"{place}: {contact.slave} is tied to {contact.master} over {100.0 * share:.3g} % of "
            "its area: the rest has nothing beside it"
        )


def notes_on_penalty(
    index: int, factor: float, pressure: PressureKind = "averaged", ratio: float | None = None
) -> Iterator[str]:
    """Lines on a penalty that is far from what works, or that shortens explicit steps.

    ``ratio``: of the modulus of that ``pressure`` to the oedometric one, of explicit runs.
    """
    # Rounding may lift a penalty of just this size above it.
    if ratio is not None and factor * ratio > (1.0 + 1e-9) * CHATTER:
        yield (
            f"contact.{index}: a penalty of penalty_factor = {factor:.4g}, {factor * ratio:.3g} "
            "times the oedometric modulus over the length of a facet, shortens explicit steps, and "
            "its dashpots take what the nodes at the surface bring to an impact; "
            f"{1.0 / ratio:.2g} to {3.0 / ratio:.2g} is stiff enough for most"
        )
    if not SOFT_PENALTY <= factor <= STIFF_PENALTY:
        what = (
            "the bodies overlap rather than press on each other"
            if factor < SOFT_PENALTY
            else "Newton's method may fail or need many iterations"
        )
        modulus = "M" if pressure == "pointwise" else "max(10 G, M/10)"
        yield (
            f"contact.{index}: the penalty is {factor:.2g} times the stiffness {modulus}/h of the "
            f"softer body's elements beside it: {what}"
        )


def note_on_stick(index: int, friction: Friction, stiffness: float) -> Iterator[str]:
    """A line on dry friction that sticks far more softly, or stiffly, than the bodies shear.

    ``stiffness``: Pa/m, G/h of the softer body; a resolved case keeps the K_T of its old mesh.
    """
    # The friction map's K_T is that of its asperities, not a penalty.
    if friction.law != MAP and (K_T := getattr(friction, "K_T", None)) is not None:
        factor = K_T / stiffness
        if factor < SOFT_STICK:
            yield (
                f"contact.{index}: K_T is {factor:.2g} times the stiffness G/h of the elements "
                "beside it: points move a good way before they slip (leave K_T out for 10 G/h)"
            )
        elif factor > STIFF_STICK:
            yield (
                f"contact.{index}: K_T is {factor:.2g} times the stiffness G/h of the elements "
                "beside it, which takes many iterations for nothing: 100 G/h leaves next to no "
                "elastic slip (leave K_T out for 10 G/h)"
            )
