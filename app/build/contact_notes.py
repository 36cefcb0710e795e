"""What may surprise in a contact once case and mesh are put together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from tribox.app.case.boundary import COMPONENTS
from tribox.app.case.case import Case
from tribox.app.case.contact import Contact
from tribox.app.case.friction import MAP, Friction
from tribox.app.case.time_tables import TimeTable
from tribox.app.case.tools import Tool
from tribox.forms.bodies.materials import Material, contact_shear_modulus
from tribox.forms.contact.pressure import PressureKind
from tribox.geometry.surfaces.body_facets import outward_facets
from tribox.geometry.surfaces.facets import Floats, unit_normals
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.surface import ContactSurface, RigidMaster

ACROSS = 0.9  # component of the normal below which a motion along an axis lets bodies slide
CORNERED = 1.9  # spacing of a master's corners over the length of slave facets that feels them
OFF_FIT = 0.02  # mean gap over interference from which a fit is said to be drawn otherwise
WAVED_FIT = 0.2  # height of a master's chords over interference that sliding over them is felt from
DENTED = 1e-4  # depth over facet length from which bodies are said to press at the start
CHORDS = (
    "; chords of arcs overlap so where their ends do not line up: a drawing of order = 2 keeps arcs"
)
APART = 2.0  # distance over facet length from which bodies are said to start apart
COARSE = 3.0  # length of slave facets over that of master facets from which they are too coarse
ROUND = 0.5  # length of slave facets over the radius of a tool from which they are too coarse
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

ACROSS_FROM = -np.cos(np.radians(80.0))  # cosine of normals below which they oppose each other
WHOLE = 0.999  # tied share of a slave's area that counts as all of it


@dataclass(frozen=True, slots=True)
class Corners:
    """Corners of a round master made of facets, as the slave beside it meets them.

    Attributes:
        ratio: largest distance between corners over the length of the slave's facets beside them; 0
            without corners. degrees: largest angle at which facets meet there. height: m, of arcs
            over the chords between such corners.
    """

    ratio: float
    degrees: float
    height: float


def stiffer_slave(
    index: int, contact: Contact, body: str, slave: Material, master: Material | None = None
) -> Iterator[str]:
    """A line on a slave that is on the stiffer body.

    Args:
        body: name of the slave's body.
        master: material of the other body; None: a tool.
    """
    if master is None:
        return
    if contact_shear_modulus(slave) > STIFFER * contact_shear_modulus(master):
        yield (
            f"contact.{index}: the slave {contact.slave} is on the stiffer body {body}; the "
            "softer body's surface should be the slave"
        )


def notes_on_surfaces(
    place: str,
    contact: Contact,
    surface: ContactSurface,
    at: Projection,
    lengths: tuple[float, float],
    distance: float,
) -> Iterator[str]:
    """A line on surfaces far apart, and on a slave too coarse to see its master; collective.

    Args:
        at: the slave's points on the master.
        lengths: m, mean lengths of slave and master facets where they are near.
        distance: m, between the surfaces at the start.
    """
    if distance > APART * lengths[0]:
        where = f"{distance:.3g} m apart" if np.isfinite(distance) else "beside each other"
        yield f"{place}: {contact.slave} and {contact.master} start {where}"
    ratio = coarseness(surface, at, lengths, distance)
    if ratio > COARSE:
        yield (
            f"{place}: the facets of the slave {contact.slave} are {ratio:.2g} times as long as "
            f"those of {contact.master}{'' if surface.dim == 2 else ' in one direction'}, whose "
            "shape they cannot follow; refine the slave"
        )


def coarseness(
    surface: ContactSurface, at: Projection, lengths: tuple[float, float], distance: float
) -> float:
    """Length of slave facets over that of master facets where it is largest; collective.

    In space long facets may lie across those of the master: of each slave facet the direction
    counts in which it reaches over the most master facets; the mean of all over the master.

    Args:
        at: the slave's points on the master.
        lengths: m, of slave and master where they are near.
        distance: m, between the surfaces at the start.
    """
    master, mean = surface.master, lengths[0] / lengths[1]
    if surface.dim == 2 or isinstance(master, RigidMaster):
        return mean
    over = np.flatnonzero(at.on_surface & (at.gap < distance + surface.slave.facet_length))
    facet, first = np.unique(surface.slave.facet[over], return_index=True)
    _, slave = outward_facets(surface.space, surface.shape, surface.slave.mesh_facet[over[first]])
    below = master.position[master.facets[at.facet[over[first]]]]
    # Of the affine pieces {x: xᵀ M⁻¹ x ≤ 1}; where the facets are not parallel, along the master's.
    across = _moments(surface, slave) @ np.linalg.pinv(_moments(surface, below), rcond=1e-9)
    ratio = np.sqrt(np.linalg.eigvals(across).real.max(axis=1))
    total, count = surface.space.mesh.comm.allreduce(np.array([ratio.sum(), len(facet)]))
    return max(mean, float(total / count)) if count else mean


def _moments(surface: ContactSurface, position: Floats) -> Floats:
    """Second moments (f, i, i), m², of the corners of facets (f, a, i) about their middles."""
    corners = position[:, : surface.shape.corners]
    arm = corners - corners.mean(axis=1, keepdims=True)
    return np.einsum("fai,faj->fij", arm, arm)


def note_on_overlap(
    place: str, contact: Contact, depth: float, length: float, advice: str
) -> Iterator[str]:
    """A line on surfaces that press before anything has moved.

    Args:
        depth: m, of the deepest of the slave's points; length: m, of the slave's facets.
        advice: on chords, or nothing.
    """
    if depth > DENTED * length:
        yield (
            f"{place}: {contact.slave} starts {depth:.2g} m inside {contact.master} and presses "
            "there at once, which counts as no work: leave a gap, or let it come on as a press "
            f'fit (interference = "drawn"){advice}'
        )


def note_on_fit(
    place: str, contact: Contact, surface: ContactSurface, at: Projection
) -> Iterator[str]:
    """A line on a fit whose surfaces, as they are meshed, do not lie on each other; collective.

    A cord that touches its plate along a line is drawn beside it: where one facet is nearer, in its
    own mean, than all are in theirs, its distance counts.

    Args:
        at: the slave's points on the master, undeformed.
    """
    size = _fit_size(contact)
    if size == 0.0:
        return
    near = at.on_surface & (np.abs(at.distance) < max(size, surface.facet_length))
    comm, facet, weight = surface.space.mesh.comm, surface.slave.facet, surface.slave.weight * near
    areas = np.bincount(facet, weight)
    moments = np.bincount(facet, weight * np.where(near, at.distance, 0.0))
    moment, area = comm.allreduce(np.array([moments.sum(), areas.sum()]))
    mean = moment / area if area > 0.0 else 0.0
    own = np.sign(mean) * moments[areas > 0.0] / areas[areas > 0.0]
    nearest = comm.allreduce(float(np.min(own, initial=np.inf)), op=MPI.MIN)
    mean = np.sign(mean) * max(min(abs(mean), nearest), 0.0)
    if abs(mean) > OFF_FIT * size:
        where = "apart" if mean > 0.0 else "inside each other"
        yield (
            f"{place}: {contact.slave} and {contact.master} are not drawn beside each other but in "
            f"the mean {abs(mean):.2g} m {where}, {100.0 * abs(mean) / size:.2g} % of the "
            "interference, which counts from there: chords of arcs do so (finer facets, on both "
            "surfaces at the same places), or the surfaces are drawn so"
        )


def note_on_waved_fit(place: str, contact: Contact, corners: Corners) -> Iterator[str]:
    """A line on a fit whose surfaces ride over each other's corners as they slide."""
    size = _fit_size(contact)
    if corners.height > WAVED_FIT * size > 0.0:
        yield (
            f"{place}: arcs of {contact.master} stand {corners.height:.2g} m over its chords, "
            f"{100.0 * corners.height / size:.0f} % of the interference: forces wave as "
            f"{contact.slave} slides over them; a drawing of order = 2 keeps arcs"
        )


def _fit_size(contact: Contact) -> float:
    """Largest interference, m, that is given; 0 without one, or for one that is drawn."""
    fit = contact.interference
    return max(map(abs, fit.values)) if isinstance(fit, TimeTable) else 0.0


def note_on_radius(
    place: str, contact: Contact, surface: ContactSurface, at: Projection, distance: float
) -> Iterator[str]:
    """A line on slave facets too long to follow the tightest rounding of a tool; collective.

    Those count that are near the tool at the start, by half that radius beyond the nearest; where
    nothing is above the tool yet, all.

    Args:
        at: the slave's points on the master.
        distance: m, of the surfaces; infinite where no point is above the tool.
    """
    if not isinstance(surface.master, RigidMaster):
        return
    radius = surface.master.surface.least_radius
    near = at.on_surface & (at.gap < distance + ROUND * radius) | np.isinf(distance)
    local = float(np.max(surface.slave.facet_length, where=near, initial=0.0))
    length = float(surface.space.mesh.comm.allreduce(local, op=MPI.MAX))
    if length > ROUND * radius:
        yield (
            f"{place}: the facets of the slave {contact.slave} are up to {length / radius:.2g} "
            f"times as long as the smallest radius of {contact.master}, {radius:.3g} m, which they "
            "cannot follow; refine the slave where it bends round"
        )


def note_on_idle_film(place: str, contact: Contact) -> Iterator[str]:
    """A line on a film that the friction law has no use for."""
    if contact.given_film is not None and contact.acting_film is None:
        yield f'{place}: film has no effect with law = "{contact.friction.law}"'


def note_on_tie(place: str, contact: Contact, share: float) -> Iterator[str]:
    """A line on a slave that is tied in part only.

    Args:
        share: of the slave's area that is tied.
    """
    if share < WHOLE:
        yield (
            f"{place}: {contact.slave} is tied to {contact.master} over {100.0 * share:.3g} % of "
            "its area: the rest has nothing beside it"
        )


def note_on_corners(place: str, contact: Contact, corners: Corners) -> Iterator[str]:
    """A line on a faceted master whose corners a finer slave feels."""
    if corners.ratio > CORNERED:
        yield (
            f"{place}: corners of {contact.master}, of up to {corners.degrees:.2g} degrees, are up "
            f"to {corners.ratio:.2g} facets of the slave {contact.slave} apart: each corner "
            'presses with a peak of its own; set smoothing_angle = "30 deg", and leave a small gap '
            "at the start, as a smooth master bulges; or draw the master with shorter facets "
            "(dividing its cells keeps the corners)"
        )


def note_on_sliding(
    place: str, contact: Contact, corners: Corners, unable: str | None
) -> Iterator[str]:
    """A line on a round master in space whose facets a slave slides over.

    Args:
        unable: why the master cannot be smooth; None: it can.
    """
    if 0.0 < corners.ratio <= CORNERED:
        cure = 'set smoothing_angle = "30 deg"'
        if unable is not None:
            cure = f"smoothing_angle {unable}; or draw {contact.master} with shorter facets"
        yield (
            f"{place}: {contact.slave} slides on {contact.master}, which is round and whose facets "
            f"meet at {corners.degrees:.2g} degrees: the slave catches on their edges, forces "
            f"wave, and steps may fail; {cure}"
        )


def slides(case: Case, normal: Floats) -> bool:
    """Whether boundaries move bodies across the mean normal (i,) of a contact, or turn them."""
    flat = np.abs(normal) <= ACROSS * np.linalg.norm(normal)
    for one in case.boundary:
        if one.rotation is not None or any(one.driven_keys()):
            return True
        for table in (one.displacement, one.velocity):
            for axis in np.nonzero(flat)[0]:
                program = getattr(table, COMPONENTS[axis], None)
                if isinstance(program, TimeTable) and any(program.values):
                    return True
    return False


def notes_on_penalty(
    index: int, factor: float, ratio: float, explicit: bool, pressure: PressureKind = "averaged"
) -> Iterator[str]:
    """Lines on a penalty that is far from what works, or that shortens explicit steps.

    Args:
        pressure: "averaged" or "pointwise".
    """
    # Rounding may lift a penalty of just this size above it.
    if explicit and factor * ratio > (1.0 + 1e-9) * CHATTER:
        yield (
            f"contact.{index}: a penalty of penalty_factor = {factor:.4g}, {factor * ratio:.3g} "
            "times the oedometric modulus over the length of a facet, shortens explicit steps, and "
            "its dashpots take what the nodes at the surface bring to an impact; "
            f"{1.0 / ratio:.2g} to {3.0 / ratio:.2g} is stiff enough for most"
        )
    note = penalty_note(index, factor, pressure)
    if note is not None:
        yield note


def note_on_stick(index: int, friction: Friction, stiffness: float) -> Iterator[str]:
    """A line on dry friction that sticks far more softly, or stiffly, than the bodies shear.

    The default is found from the mesh and the bodies; a resolved case that is run with a finer mesh
    or a stiffer body keeps the value it had.

    Args:
        stiffness: Pa/m, G/h of the softer body beside the contact.
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


def penalty_note(index: int, factor: float, pressure: PressureKind = "averaged") -> str | None:
    """A line on a penalty far from those that work; None for others.

    Args:
        pressure: "averaged" or "pointwise", which compare with other moduli.
    """
    if SOFT_PENALTY <= factor <= STIFF_PENALTY:
        return None
    what = (
        "the bodies overlap rather than press on each other"
        if factor < SOFT_PENALTY
        else "Newton's method may fail or need many iterations"
    )
    modulus = "M" if pressure == "pointwise" else "max(10 G, M/10)"
    return (
        f"contact.{index}: the penalty is {factor:.2g} times the stiffness {modulus}/h of the "
        f"softer body's elements beside it: {what}"
    )


# -- Whether a slave and its master face each other at the start, and what to do if they do not ----

SAME = 0.5  # cosine of the angle between outward normals from which they point the same way

TURN = {
    "plane": "its normal points out of it, towards the body",
    "polyline": "going along it, the body is on the left",
    "circle": "inside = true is for a body inside it",
    "cylinder": "inside = true is for a body inside it",
    "sphere": "inside = true is for a body inside it",
    "mesh": "turned_over = true turns it over",
}
"""How each shape of a tool says on which side the body is."""


def faces_away(surface: ContactSurface, at: Projection) -> bool:
    """Whether the slave looks the way its master looks where they are nearest to each other.

    They then never press on each other, unless one is turned over first. Collective.

    Args:
        at: the slave's points on the master.
    """
    # Surfaces that face each other have outward normals against one another, a cosine near −1. At
    # the master's ends the normal is the way to the point, whatever side that is on.
    cosine = np.einsum("qi,qi->q", _outward(surface), at.normal)
    comm, beside = surface.space.mesh.comm, at.on_surface & ~at.clamped
    apart = np.abs(at.gap)
    nearest = comm.allreduce(float(np.min(apart, where=beside, initial=np.inf)), op=MPI.MIN)
    beside &= apart <= nearest + surface.facet_length
    counts = np.array([np.count_nonzero(beside), np.count_nonzero(beside & (cosine < SAME))])
    all_beside, facing = comm.allreduce(counts, op=MPI.SUM)
    return bool(all_beside > 0 and facing == 0)


def _outward(surface: ContactSurface) -> Floats:
    """Outward normals (q, i) of the slave's facets at their middles, undeformed."""
    shape = surface.shape
    _, position = outward_facets(surface.space, shape, surface.slave.mesh_facet)
    middle = np.mean(shape.points[: shape.corners], axis=0)
    tangents = np.einsum("ba,qai->qbi", shape.first(middle[None])[0], position)
    return unit_normals(tangents)


def facing_problem(slave: str, master: str, tool: Tool | None) -> str:
    """What is wrong with surfaces that face the same way."""
    hint = "" if tool is None else f", or {master} is the wrong way round: {TURN[tool.shape]}"
    return (
        f"{slave} and {master} face the same way, so they cannot press on each other; another "
        f"surface is the slave{hint}"
    )


def note_on_facing(
    place: str, contact: Contact, surface: ContactSurface, at: Projection
) -> Iterator[str]:
    """A line on surfaces that can press on each other only if one of them turns; collective.

    No facet of the one has a normal that is opposed to that of a facet of the other, wherever they
    are: bodies that are moved without a turn do not press there.

    Args:
        at: the slave's points on the master.
    """
    comm, slave = surface.space.mesh.comm, _outward(surface)
    cosine = np.einsum("qi,qi->q", slave, at.normal)
    beside = at.on_surface & ~at.clamped
    if comm.allreduce(float(np.min(cosine, where=beside, initial=1.0)), op=MPI.MIN) < ACROSS_FROM:
        return
    normals = np.concatenate(comm.allgather(np.unique(_master_normals(surface), axis=0)))
    apart = cKDTree(normals).query(-slave)[0] if len(slave) else np.full(1, 2.0)
    # Of unit vectors d apart the cosine is 1 − d²/2; of one of them and the other's opposite, less.
    least = 0.5 * comm.allreduce(float(np.min(apart)), op=MPI.MIN) ** 2 - 1.0
    if least > ACROSS_FROM:
        degrees = np.degrees(np.arccos(np.clip(least, -1.0, 1.0)))
        yield (
            f"{place}: no facet of {contact.slave} faces {contact.master}: outward normals are up "
            f"to {degrees:.3g} degrees apart (180 where surfaces meet), so they press only once "
            "one has turned; if none is to turn, name other surfaces (tribox mesh shows all)"
        )


def _master_normals(surface: ContactSurface) -> Floats:
    """Outward normals (n, i) of the undeformed master; of one of facets, those this rank knows."""
    master, slave = surface.master, surface.slave.position
    if not len(slave):
        return np.empty((0, surface.dim))
    if isinstance(master, RigidMaster):
        outline = master.surface.outline(np.stack([slave.min(axis=0), slave.max(axis=0)]))
        corners = outline.points[outline.cells]
    else:
        corners = master.position[master.facets[:, : master.shape.corners]]
    with np.errstate(invalid="ignore"):  # triangles at the pole of a ball
        normals = unit_normals(corners[:, 1 : surface.dim] - corners[:, :1])
    return normals[np.isfinite(normals).all(axis=1)]
