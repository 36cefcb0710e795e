"""Facets of masters that catch slaves or make their pressures wave, in words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from tribox.app.case.contact import Contact
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.unknowns import place_text
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.body_facets import outward_facets
from tribox.geometry.surfaces.facets import Bools, FacetShape, Floats, Ints, unit_normals
from tribox.geometry.surfaces.master import MasterFacets
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.smoothing import shared_sides
from tribox.geometry.surfaces.surface import ContactSurface

Findings = Iterator[tuple[str, str]]  # what is wrong, and what to do about it

ON_EDGE = 1e-6  # reference distance from the edge of a facet below which a point is on it
# Angles, rad, between neighbouring facets of a deformed master that a slave catches on: less is
# flat, more is an edge that is meant.
BENT, CLEARLY_BENT, SHARP = 1e-3, 0.01, 0.35
FACING = 0.2  # cosine from which on normals face each other
SAME = 1e-6  # of the size of a surface, below which two places are the same
SMOOTH = 'smoothing_angle = "30 deg"'
SOFTER = "a tenth of the penalty (penalty_factor; the run tells what a soft one costs)"


def names_of(contacts: Sequence[Contact], index: int) -> tuple[str, str]:
    """Slave and master of a contact by name; by their parts where the names are not known."""
    if index >= len(contacts):
        return "the slave", "the master"
    return contacts[index].slave, contacts[index].master


# -- facets ---------------------------------------------------------------------------------------


def rests_on_edges(problem: Equilibrium, contacts: Sequence[Contact]) -> Findings:
    """Pressed points on edges of the master, where its normal jumps, and the residual with it."""
    for index, term, trial in problem.sliding(problem.trials):
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
    """Facets of a bent master that catch a slave, or may if the residual is largest elsewhere."""
    worst = np.array(problem.worst_place())
    for index, term, trial in problem.sliding(problem.trials):
        angle, here = bend(problem, term, trial), _is_on(term.surface, worst)
        if angle > (BENT if here else CLEARLY_BENT):
            slave, master = names_of(contacts, index)
            yield (
                f"contact.{index}: {slave} {'catches' if here else 'may catch'} on the facets of "
                f"{master}, which meet at up to {np.degrees(angle):.2g} degrees where it presses",
                f"{SMOOTH} for contact.{index}{_needs(problem)}, or {SOFTER}",
            )


def _is_on(surface: ContactSurface, place: Floats) -> bool:
    """Whether a place is a vertex of the slave or a node of a master of facets; collective."""
    if not isinstance(surface.master, MasterFacets):
        return False
    nodes = np.concatenate([surface.vertices.position, surface.master.position])
    here = bool(np.linalg.norm(nodes - place, axis=1).min() <= SAME * surface.master.extent)
    return bool(surface.space.mesh.comm.allreduce(here, op=MPI.LOR))


def bend(problem: Equilibrium, term: ContactTerm, trial: ContactTrial) -> float:
    """Largest angle, rad, between pressed facets of a master, 0 of a smooth one; collective."""
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
    # Sharper ones are corners that are meant, on which nothing is to slide.
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


# -- edges in facets ------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Sunk:
    """How far a vertex of the master is inside a slave facet, or a point of one in the master."""

    share: float = 0.0  # of the depth beyond the penetration in the facet's size
    depth: float = 0.0  # m
    place: tuple[float, ...] = ()  # of the vertex or point, m, undeformed


def deepest_of(comm: MPI.Comm, mine: Sunk) -> Sunk:
    """The one of all ranks with the largest share; collective."""
    return max(comm.allgather(mine), key=lambda one: (one.share, one.place))


class SunkVertices:
    """Finds the vertices of a meshed master that are inside the slave's facets.

    The pressure answers to the mean gap around a vertex of the slave, or to that of its points:
    an edge of the master between them is in neither.
    """

    def __init__(self, surface: ContactSurface) -> None:
        self._surface = surface
        of_facet = np.unique(surface.slave.facet, return_index=True)[1]
        local, position = outward_facets(
            surface.space, surface.shape, surface.slave.mesh_facet[of_facet]
        )
        index = surface.space.dofmap.index_map
        nodes = index.local_to_global(local.reshape(-1).astype(np.int32)).reshape(local.shape)
        rows = np.searchsorted(surface.nodes[: surface.first_master], nodes)
        pieces, dim = _pieces(surface.shape), surface.dim
        self._rows = rows[:, pieces].reshape(-1, dim)  # of the pair's nodes
        self._reference = position[:, pieces].reshape(-1, dim, dim)

    @classmethod
    def of(cls, term: ContactTerm) -> SunkVertices | None:
        """Those of a contact; None of a tie, of a tool, and of curved facets in space."""
        surface = term.surface
        curved = surface.dim == 3 and surface.shape.degree > 1
        meshed = isinstance(surface.master, MasterFacets)
        return cls(surface) if meshed and not curved and not term.tied else None

    def deepest(self, values: Floats, penetration: float, offset: Floats | None = None) -> Sunk:
        """The vertex deepest over a facet's length beyond ``penetration``, m; collective.

        At displacements (m, i), m; ``offset``: (q,), m, by which a fit's master is felt further
        back.
        """
        surface, master = self._surface, self._surface.master
        assert isinstance(master, MasterFacets)
        back = 0.0
        if offset is not None:
            mine = float(np.max(offset, initial=-math.inf))
            back = surface.space.mesh.comm.allreduce(mine, op=MPI.MAX)
        place = surface.master_positions(values)
        corners = master.facets[:, : master.shape.corners]
        outward = _vertex_normals(master, place)
        vertices = np.unique(corners)
        slave = self._reference + values[self._rows]
        sides = slave - np.roll(slave, 1, axis=1)
        sizes = np.linalg.norm(sides, axis=2).max(axis=1)
        found = Sunk()
        if len(slave):
            # A vertex inside a piece is nearer to its middle than its longest side.
            near = cKDTree(place[vertices]).query_ball_point(slave.mean(axis=1), sizes)
            counts = np.fromiter(map(len, near), np.int64, len(near))
            piece = np.repeat(np.arange(len(slave)), counts)
            vertex = vertices[np.fromiter(chain.from_iterable(near), np.int64, counts.sum())]
            places = place[vertex], outward[vertex], master.position[vertex]
            found = _deepest(slave[piece], *places, back, penetration)
        return deepest_of(surface.vertices.comm, found)


def _deepest(
    pieces: Floats,
    places: Floats,
    outward: Floats,
    undeformed: Floats,
    back: float,
    penetration: float,
) -> Sunk:
    """The deepest of places (n, i), m, each beside a piece (n, i, i) of the slave.

    Those count whose normal ``outward`` (n, i) faces the piece, and which are behind it and not
    beside it, set ``back``, m, from it.
    """
    along = pieces[:, 1:] - pieces[:, :1]
    normal = unit_normals(along)
    apart = places - pieces[:, 0]
    depth = -np.einsum("ni,ni->n", normal, apart) - back
    metric = np.einsum("nai,nbi->nab", along, along)
    # The shortest side: an edge along facets much longer than wide sinks by their width.
    sides = pieces - np.roll(pieces, 1, axis=1)
    size = np.linalg.norm(sides, axis=2).min(axis=1)
    right = np.einsum("nai,ni->na", along, apart)
    # Barycentric coordinates of the foot on the piece, from normal equations: it lies inside where
    # none is negative and their sum is at most 1.
    share = np.linalg.solve(metric, right[..., None])[..., 0]
    inside = np.all(share >= 0.0, axis=1) & (share.sum(axis=1) <= 1.0)
    facing = np.einsum("ni,ni->n", normal, outward) < -FACING
    over = np.where(inside & facing & (depth > penetration), (depth - penetration) / size, 0.0)
    if not over.any():
        return Sunk()
    at = int(np.argmax(over))
    return Sunk(float(over[at]), float(depth[at]), tuple(map(float, undeformed[at])))


def _pieces(shape: FacetShape) -> Ints:
    """Nodes (p, i) of the straight or flat pieces of a facet, turning as it does."""
    if shape.directions == 2:
        parts = [[0, 1, 2]] if shape.corners == 3 else [[0, 1, 2], [3, 2, 1]]
        return np.array(parts, dtype=np.int32)
    order = np.argsort(shape.points[:, 0])
    return np.stack([order[:-1], order[1:]], axis=1).astype(np.int32)


def _vertex_normals(master: MasterFacets, place: Floats) -> Floats:
    """Mean normals (n, i), of any length, of the facets around nodes at ``place`` (n, i), m."""
    shape = master.shape
    middle = np.mean(shape.points[: shape.corners], axis=0)
    tangents = np.einsum("ba,fai->fbi", shape.first(middle[None])[0], place[master.facets])
    normals, total = unit_normals(tangents), np.zeros_like(place)
    for corner in range(shape.corners):
        np.add.at(total, master.facets[:, corner], normals)
    return total


# -- Pressures that go up and down from point to point or vertex to vertex, and what smooths them
#
# Point by point, a facet touches with a few of its points where the penetration is less than its
# sagitta: the penalty is too large for it. Averaged over vertices, the pressure waves where the
# corners of a faceted master are further apart than they.

WAVES = 0.05  # share of the mean pressure from which on pressures off a smooth curve are told
FEWEST = 6  # vertices within a contact below which nothing can be said
REACH = 2.5  # facets of the slave, at least, over which a curve is fitted to either side
AMID = 0.07  # of that way, between a vertex and the middle of those that a curve is fitted to
MARGIN = 8.0  # mean penetration over sagitta that leaves facets touched all over
COSTLY = 1.5  # of what is allowed: a combed contact is deeper for the same force than a smooth one


def waves(surface: ContactSurface, pressure: Floats, inside: Bools, spacing: float) -> float:
    """How far pressures (v,), Pa, are off a smooth curve, over their mean; collective.

    The curve is a parabola (in space a paraboloid) fitted to the vertices around each: as far as
    the next corner of the master to either side, so that it passes through the waves that corners
    ``spacing``, m, apart make. Of the distances a quantile is taken that as many reach as lie
    beside corners, so that single peaks, as at corners of the slave, do not count. ``inside``: (q,)
    points amid pressed facets.
    """
    vertices, weight = surface.vertices, surface.slave.weight
    amid = vertices.sums(weight * inside) >= (1.0 - 1e-9) * vertices.area
    if np.count_nonzero(amid) < FEWEST:
        return 0.0
    place, size = vertices.position[amid], float(vertices.length[amid].mean())
    off, fitted = off_curve(place, pressure[amid], max(REACH * size, spacing))
    if not fitted.any():
        return 0.0
    # Share of the vertices beside corners: the quantile that they reach.
    beside = 0.75 * size / max(spacing, 2.0 * size)
    return float(np.quantile(np.abs(off[fitted]), 1.0 - beside) / np.mean(pressure[amid]))


def off_curve(place: Floats, values: Floats, reach: float) -> tuple[Floats, Bools]:
    """Values (n,) at places (n, i) less the parabolas through those around, and where there is one.

    Places at the end of all have others to one side only, and get none.
    """
    dim = place.shape[1]
    tree = cKDTree(place)
    most = int(max(tree.query_ball_point(place, reach, return_length=True)))
    distance, near = tree.query(place, most, distance_upper_bound=reach * (1.0 + 1e-9))
    there = np.isfinite(distance.reshape(len(place), most))
    near = np.where(there, near.reshape(len(place), most), np.arange(len(place))[:, None])
    arm = (place[near] - place[:, None]) / reach * there[..., None]
    middle = arm.sum(axis=1) / there.sum(axis=1)[:, None]
    # Along the surface: all but the direction in which the places are spread the least.
    across = np.linalg.eigh(np.einsum("nki,nkj->nij", arm, arm))[1][:, :, 1:]
    along = np.einsum("nki,nia->nka", arm, across)
    first, second = np.triu_indices(dim - 1)
    terms = [np.ones_like(along[..., :1]), along, along[..., first] * along[..., second]]
    basis = np.concatenate(terms, axis=2) * there[..., None]
    of_values = np.linalg.pinv(basis)[:, 0]  # to the curve's value at the place itself
    fitted = (np.linalg.norm(middle, axis=1) < AMID) & (there.sum(axis=1) > 1.5 * basis.shape[2])
    out: Floats = values - np.einsum("nk,nk->n", of_values, values[near])
    return out, fitted


def waves_text(index: int, share: float, spacing: float) -> str:
    """The warning of pressures off a smooth curve over corners ``spacing`` (m) apart."""
    return (
        f"contact.{index}: combed pressures: from vertex to vertex they are off a smooth curve by "
        f"{100.0 * share:.2g} % of their mean, over corners between the master's facets, "
        f'{spacing:.3g} m apart; smooth the master (smoothing_angle = "30 deg"), or make its '
        "facets as short as those of the slave"
    )


def softer_factor(factor: float, mean: float, sagitta: float, cost: float) -> float | None:
    """A penalty factor with which facets touch all over; None where it would cost too much.

    By the mean penetration, which goes as 1/K, and facets' ``sagitta``, m; of one digit.
    """
    if sagitta <= 0.0 or mean <= 0.0:
        return None
    wanted = factor * min(mean / (MARGIN * sagitta), 0.1)
    digit = 10.0 ** math.floor(math.log10(wanted))
    wanted = float(f"{digit * math.floor(wanted / digit):.1g}")
    return wanted if cost * factor / wanted <= COSTLY else None
