"""Facets of masters that catch slaves, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from mpi4py import MPI

from tribox.app.case.contact import Contact
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.places import place_text
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.smoothing import shared_sides
from tribox.geometry.surfaces.surface import ContactSurface, MasterFacets

Findings = Iterator[tuple[str, str]]  # what is wrong, and what to do about it

ON_EDGE = 1e-6  # reference distance from the edge of a facet below which a point is on it
# Angles, rad, between neighbouring facets of a deformed master that a slave catches on: less is
# flat, more is an edge that is meant.
BENT, CLEARLY_BENT, SHARP = 1e-3, 0.01, 0.35
SAME = 1e-6  # of the size of a surface, below which two places are the same
SMOOTH = 'smoothing_angle = "30 deg"'


def names_of(contacts: Sequence[Contact], index: int) -> tuple[str, str]:
    """Slave and master of a contact by name; by their parts where the names are not known."""
    if index >= len(contacts):
        return "the slave", "the master"
    return contacts[index].slave, contacts[index].master


# -- facets ---------------------------------------------------------------------------------------


def rests_on_edges(problem: Equilibrium, contacts: Sequence[Contact]) -> Findings:
    """Pressed points on edges of the master, where its normal jumps, and the residual with it.

    Args:
        problem: at the state evaluated last.
        contacts: of the case, for the names.
    """
    for index, (term, trial) in enumerate(zip(problem.contacts, problem.trials, strict=True)):
        if term.tied:
            continue
        target, at = term.surface.target, trial.projection
        edge = (target.excess(at.facet, at.xi) > -ON_EDGE) & (trial.pressure > 0.0)
        where = _one_place(problem.comm, term.surface.slave.position[edge])
        if where is not None:
            slave, master = names_of(contacts, index)
            yield (
                f"contact.{index}: points of {slave}, such as that at {where}, rest on edges "
                f"between facets of {master}, where the normal jumps and the residual may not "
                "fall further",
                f"{SMOOTH} for that contact (quadrilaterals, hexahedra), meshes whose nodes do not "
                "line up, or a larger solver.tolerance",
            )


def _one_place(comm: MPI.Comm, places: Floats) -> str | None:
    """The first of all ranks' places (n, i) in x, in words; None without any; collective."""
    mine = tuple(places[np.lexsort(places.T[::-1])][0]) if len(places) else None
    found = [place for place in comm.allgather(mine) if place is not None]
    return place_text(min(found)) if found else None


def catches(problem: Equilibrium, contacts: Sequence[Contact]) -> Findings:
    """Facets of a bent master that catch a slave, or may where the residual is largest elsewhere.

    Args:
        problem: at the state evaluated last.
        contacts: of the case, for the names.
    """
    worst = np.array(problem.worst_place())
    for index, (term, trial) in enumerate(zip(problem.contacts, problem.trials, strict=True)):
        if term.tied:
            continue
        angle, here = bend(problem, term, trial), _is_on(term.surface, worst)
        if angle > (BENT if here else CLEARLY_BENT):
            slave, master = names_of(contacts, index)
            yield (
                f"contact.{index}: {slave} {'catches' if here else 'may catch'} on the facets of "
                f"{master}, which meet at up to {np.degrees(angle):.2g} degrees where it presses",
                f"{SMOOTH} for contact.{index}{_needs(problem)}",
            )


def _is_on(surface: ContactSurface, place: Floats) -> bool:
    """Whether an undeformed place is a vertex of the slave or a node of a master of facets."""
    if not isinstance(surface.master, MasterFacets):
        return False
    nodes = np.concatenate([surface.vertices.position, surface.master.position])
    near = SAME * float(np.ptp(nodes, axis=0).max())
    return bool(np.linalg.norm(nodes - place, axis=1).min() <= near)


def bend(problem: Equilibrium, term: ContactTerm, trial: ContactTrial) -> float:
    """Largest angle, rad, at which facets of a faceted master meet where it is pressed; collective.

    0 of a smooth master.
    """
    surface = term.surface
    target, master = surface.target, surface.master
    smooth = not isinstance(target, FacetSurface) or target.extraction is not None
    if smooth or not isinstance(master, MasterFacets):
        return 0.0
    x = problem.new_vector()
    x.array[:] = problem.u.x.array[: problem.owned]
    position = surface.master_positions(surface.gather(x))
    x.destroy()
    shared = shared_sides(master.shape, master.facets, position)
    round_ones = np.where(shared.angle < SHARP, shared.angle, 0.0)
    angle = np.zeros(len(master.facets))
    for facets in shared.facets.T:
        np.maximum.at(angle, facets, round_ones)
    here = float(np.max(angle[trial.projection.facet], where=trial.pressure > 0.0, initial=0.0))
    return float(problem.comm.allreduce(here, op=MPI.MAX))


def _needs(problem: Equilibrium) -> str:
    """What a mesh must be like for a smooth master, where it is not."""
    space = problem.space
    cell, degree = space.mesh.topology.cell_name(), space.element.basix_element.degree
    if cell in ("quadrilateral", "hexahedron") and degree == 1:
        return ""
    return " on a mesh of first-order quadrilaterals or hexahedra"
