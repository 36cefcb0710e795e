"""What may surprise once mesh and case are put together: lines for the person who runs it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mpi4py import MPI

import app.case.bodies as case_bodies
from app.case.boundary import COMPONENTS
from app.case.case import Case
from app.case.contact import Contact
from forms.bodies.kinematics import Section
from forms.bodies.materials import Material
from geometry.meshes import metis
from geometry.meshes.mesh import NamedMesh

LOCKING = 50.0  # K/G (Poisson's ratio 0.49) from which linear triangles are said to lock
APART = 2.0  # distance over facet length from which bodies are said to start apart
COARSE = 3.0  # length of slave facets over that of master facets from which they are too coarse
LARGE = 1.0  # extent of a body, m, from which the unit of a mesh that was read is asked for
# Penalties in units of M/h. Up to a thousand times the default Newton's method converges as ever;
# from ten thousand times on it needs many more iterations, and rounding the coordinates begins to
# keep the residual above the tolerance.
STIFF_PENALTY = 3e4
SOFT_PENALTY = 0.1


def notes_on_ranks(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line where contact cannot be shared out evenly among the ranks."""
    wanted = named.mesh.comm.size > 1 and case.solver.partition == "contact"
    if wanted and not metis.is_available():
        yield "METIS (libmetis.so.5) is not installed: slave facets may be on few of the ranks"


def locking_bodies(named: NamedMesh, materials: dict[str, Material], degree: int) -> Iterator[str]:
    """A line on each nearly incompressible body of linear triangles or tetrahedra, which lock."""
    cure = {"triangle": ("triangles", "quadrilateral"), "tetrahedron": ("tetrahedra", "hexahedron")}
    if degree > 1 or named.mesh.topology.cell_name() not in cure:
        return
    plural, other = cure[named.mesh.topology.cell_name()]
    for name, material in materials.items():
        ratio = material.bulk_modulus / material.shear_modulus
        if ratio > LOCKING:
            yield (
                f"body {name}: linear {plural} lock with K/G = {ratio:.3g} and are far too stiff; "
                f'use cell = "{other}" with formulation = "q1-sri", or formulation = "q2"'
            )


def large_mesh(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line on a mesh that was read and may not be in metres; collective."""
    if isinstance(case.geometry, case_bodies.GeneratedGeometry):
        return
    x = named.mesh.geometry.x
    ends = np.concatenate([x.max(axis=0, initial=-np.inf), -x.min(axis=0, initial=np.inf)])
    named.mesh.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
    extent = float(np.max(ends[:3] + ends[3:]))
    if extent > LARGE:
        yield f"mesh {case.geometry.mesh}: {extent:.3g} m long; coordinates are taken as metres"


def loose_bodies(case: Case, named: NamedMesh, section: Section) -> Iterator[str]:
    """A line on each body and direction that only contact holds; collective.

    A platen counts as a support where the bodies touch from the start, as they are meant to then.
    A body of revolution cannot move away from its axis.
    """
    touching = getattr(case.geometry, "gap", 0.0) == 0.0
    held: dict[str, set[str]] = {name: set() for name in named.bodies}
    for boundary in case.boundary:
        found = {part for part, keys in boundary.prescribed() if touching or keys[0] != "platen"}
        held[named.body_of(boundary.surface)] |= found
    needed = ("y",) if section == "axisymmetric" else COMPONENTS[: named.mesh.geometry.dim]
    for name, directions in held.items():
        for direction in needed:
            if direction not in directions:
                yield (
                    f"body {name}: no boundary prescribes a displacement in {direction}; "
                    "only contact holds it there"
                )


def notes_on_surfaces(
    place: str, contact: Contact, lengths: tuple[float, float], distance: float
) -> Iterator[str]:
    """A line on surfaces that are far apart, and on a slave too coarse to see its master.

    Args:
        place: of the contact in the case.
        contact: what the case says.
        lengths: m, mean lengths of slave and master facets.
        distance: m, between the surfaces at the start.
    """
    slave, master = lengths
    if distance > APART * slave:
        where = f"{distance:.3g} m apart" if np.isfinite(distance) else "beside each other"
        yield f"{place}: {contact.slave} and {contact.master} start {where}"
    if slave > COARSE * master:
        yield (
            f"{place}: the facets of the slave {contact.slave} are {slave / master:.2g} times as "
            f"long as those of {contact.master}, whose shape they cannot follow; refine the slave"
        )


def penalty_note(index: int, factor: float) -> str | None:
    """What is said of a penalty that is far from what works; None of others.

    Args:
        index: of the contact.
        factor: K_N h/M.
    """
    if SOFT_PENALTY <= factor <= STIFF_PENALTY:
        return None
    what = (
        "the bodies overlap rather than press on each other"
        if factor < SOFT_PENALTY
        else "Newton's method may fail or need many iterations"
    )
    return (
        f"contact.{index}: the penalty is {factor:.2g} times the stiffness M/h of the elements "
        f"beside it: {what}"
    )
