"""Measures one contact after a step: how deep, how even, how wide, how well facets follow.

- **evenness**, with the pressure point by point: a straight facet touches a curved master at a few
  points as soon as its sagitta h²/8R exceeds the penetration. Seen are the sagitta itself, the
  range of the gap along a facet less its linear part, which is that of both surfaces as they are
  deformed; the share of open points inside the pressed patch; the scatter of the pressure within
  facets.
- **resolution**: the facets that the rim of the contact crosses, whose length is what its place is
  uncertain by, against the half-width: from the rim to where it is furthest away.

Nothing depends on the number of ranks: a facet's points are on one of them, and what is known of
vertices is summed over all.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from tribox.app.simulation.contact_resultants import over
from tribox.app.simulation.surface_faults import BENT, SHARP, Sunk, deepest_of, waves
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import facet_length_along
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.facets import Bools, Floats, Longs, unit_normals
from tribox.geometry.surfaces.master import MasterFacets
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.smoothing import corner_spacing
from tribox.geometry.surfaces.surface import ContactSurface

NEAR = 1.5  # facets at the rim count that are up to so many half-widths from the middle
CUTS = 4.0  # depth of a facet over its sagitta up to which it cuts into the master, not tilts
WHOLE = 1.0 - 1e-9  # share of a vertex's area that counts as all of it


@dataclass(frozen=True, slots=True)
class PairState:
    """One contact after a step."""

    force: float  # N (N/m), integral of the pressure
    area: float  # m or m², pressed
    deepest: float  # m, largest penetration
    over_facet: float  # the largest over the local facet length
    mean: float  # m, penetration weighted by pressure
    spread: float  # standard deviation of the penetration over the area, over that mean
    # m, from the rim of the contact to where it is furthest away; 0 without a rim: the end of a
    # surface is none
    half_width: float = 0.0
    rim: float = 0.0  # m, mean length of the facets that the rim crosses
    uncertain: float = 0.0  # half the area of all such facets over that of the contact
    # Point by point, 0 where the pressure is averaged:
    open_inside: float = 0.0  # share of open points inside the patch
    scatter: float = 0.0  # of the pressure within facets
    sagitta: float = 0.0  # m, mean over the pressed facets
    # of the pressure from vertex to vertex over its mean, where the master has corners; 0 point by
    # point
    waves: float = 0.0
    corners: float = 0.0  # m, how far these are apart
    # how far the resultant of the pressures is off that along the master's own normals, over it
    astray: float = 0.0
    hidden: Sunk = field(default_factory=Sunk)  # the point that is deepest beyond the mean gaps
    stretched: float = 0.0  # largest da/dA that is pressed

    def is_wider(self, other: PairState) -> bool:
        """Whether more presses, or as much with a rim that is further away, or without one."""
        return (self.area, self.facets) > (other.area, other.facets)

    @property
    def facets(self) -> float:
        """How many facets as long as those at the rim the contact is wide, from there inwards."""
        return self.half_width / self.rim if self.rim > 0.0 else np.inf


class PairProbe:
    """Measures one contact."""

    def __init__(self, term: ContactTerm) -> None:
        self.term, self.surface = term, term.surface
        self._comm = term.surface.vertices.comm
        facet = term.surface.slave.facet
        self._order: Longs = np.argsort(facet, kind="stable")
        count = len(np.unique(facet))
        self._shape = (count, len(facet) // count if count else 1)
        xi = self._by_facet(term.surface.slave.xi)
        linear = np.concatenate([np.ones((*xi.shape[:2], 1)), xi], axis=2)
        self._corners, self._parts = _corner_spacing(self.surface), self.surface.parts
        # Takes values at the points of a facet to what is left of them beside a linear function.
        self._bent = np.eye(xi.shape[1]) - linear @ np.linalg.pinv(linear)

    def _by_facet(self, values: Any) -> Floats:
        """Point values (q, …) as (f, p, …), p being the points of a facet."""
        return values[self._order].reshape(*self._shape, *values.shape[1:])

    def _total(self, *values: float) -> Floats:
        return self._comm.allreduce(np.array(values))

    def measure(self, trial: ContactTrial) -> PairState:
        """The contact at a converged state; collective."""
        weight, pressure = self.surface.slave.weight, trial.pressure
        pressed = pressure > 0.0
        force, area = self._total(float(weight @ pressure), float(weight @ pressed))
        patch = self._pressed_facets(trial)
        depth = self._depths(trial)
        rim = self._rim(trial, patch)
        if trial.nodal_gap is None or trial.nodal_pressure is None:
            uneven = self._unevenness(trial, patch)
            return PairState(float(force), float(area), *depth, *rim, *uneven)
        inside = self._inside(self._inside(patch))
        found = dict(zip(("waves", "corners"), self._waves(trial, inside), strict=True))
        found["astray"] = self._astray(trial)
        largest = float(np.max(trial.area_ratio, where=pressed, initial=0.0))
        found["stretched"] = self._comm.allreduce(largest, op=MPI.MAX)
        hidden = self._hidden(trial, depth[0])
        return PairState(float(force), float(area), *depth, *rim, **found, hidden=hidden)

    def _astray(self, trial: ContactTrial) -> float:
        """How far pressures along the slave's normals are off those along the master's; collective.

        Over sharp corners the slave's normals are taken. Without friction a face can only be
        pressed along its own, but where facets lie on it these are the same, or off it to either
        side in turn.
        """
        at, load = trial.projection, self.surface.slave.weight * trial.pressure
        if self.surface.normals is None:
            return 0.0
        own = unit_normals(at.tangents)
        own *= np.sign(np.einsum("qi,qi->q", own, at.normal))[:, None]
        local = np.concatenate([load @ (at.normal - own), load @ own])
        off, whole = np.split(self._total(*map(float, local)), 2)
        return over(float(np.linalg.norm(off)), float(np.linalg.norm(whole)))

    def _hidden(self, trial: ContactTrial, penetration: float) -> Sunk:
        """The point that is deepest beyond the mean gaps, over its facet; collective.

        The share is of the facet's length, undeformed. Facets that tilt at the rim do not count,
        and of open ones, into which an edge of the master may sink unseen, no more than a length.
        """
        depth, size = -trial.kinematics.gap, self.surface.slave.facet_length
        felt = trial.projection.on_surface & ((trial.pressure > 0.0) | (depth < size))
        depth = self._by_facet(np.where(felt, depth - penetration, 0.0))
        depth = np.where(depth < CUTS * self._bow(trial)[:, None], depth, 0.0).reshape(-1)
        share = depth / size[self._order]
        at, found = int(np.argmax(share)) if len(share) else -1, Sunk()
        if at >= 0 and share[at] > 0.0:
            place = self.surface.slave.position[self._order[at]]
            found = Sunk(float(share[at]), float(depth[at]), tuple(map(float, place)))
        return deepest_of(self._comm, found)

    def _bow(self, trial: ContactTrial) -> Floats:
        """By how much (f,), m, each facet bows away from the master: the gap's nonlinear part."""
        gap = np.where(trial.projection.on_surface, trial.kinematics.gap, 0.0)
        return np.ptp(np.einsum("fpq,fq->fp", self._bent, self._by_facet(gap)), axis=1)

    def _depths(self, trial: ContactTrial) -> tuple[float, float, float, float]:
        """Largest penetration, the largest over facet length, mean and spread; collective."""
        surface, pressure, gap = self.surface, trial.nodal_pressure, trial.nodal_gap
        nodal = gap is not None and pressure is not None  # the same on every rank
        if gap is None or pressure is None:
            pressure, gap = trial.pressure, trial.kinematics.gap
        length = surface.vertices.length if nodal else surface.slave.facet_length
        area = (surface.vertices.area if nodal else surface.slave.weight) * (pressure > 0.0)
        depth = np.where(pressure > 0.0, -gap, 0.0)
        load = area * pressure
        sums = np.array([load @ depth, load.sum(), area.sum(), area @ depth, area @ depth**2])
        moment, force, closed, first, second = sums if nodal else self._total(*sums)
        variance = over(second, closed) - over(first, closed) ** 2
        most = self._comm.allreduce(float(np.max(depth / length, initial=0.0)), op=MPI.MAX)
        deepest = self._comm.allreduce(float(np.max(depth, initial=0.0)), op=MPI.MAX)
        mean = over(moment, force)
        return deepest, most, mean, over(float(np.sqrt(max(variance, 0.0))), mean)

    def _pressed_facets(self, trial: ContactTrial) -> Bools:
        """Points (q,) of the facets that press: all their vertices do, or any of their points."""
        vertices, nodal = self.surface.vertices, trial.nodal_pressure
        if nodal is not None:
            return np.min(nodal[vertices.of_point], axis=1) > 0.0
        count = np.bincount(self.surface.slave.facet, trial.pressure > 0.0)
        return np.greater(count, 0)[self.surface.slave.facet]

    def _waves(self, trial: ContactTrial, inside: Bools) -> tuple[float, float]:
        """Waves of the vertices' pressure over its mean, and how far corners are apart; collective.

        Corners are those of the undeformed master, or where it has none those between its facets,
        which may have bent since.
        """
        if self._parts != self.surface.parts:
            self._corners, self._parts = _corner_spacing(self.surface), self.surface.parts
        if self._corners is None or trial.nodal_pressure is None:
            return 0.0, 0.0
        weight = self.surface.slave.weight * inside
        sums = self._total(
            float(weight @ self._corners[trial.projection.facet]), float(weight.sum())
        )
        spacing = over(sums[0], sums[1])
        return waves(self.surface, trial.nodal_pressure, inside, spacing), spacing

    def _inside(self, patch: Bools) -> Bools:
        """Points (q,) of the facets of a patch all of whose neighbours are in it; collective."""
        return patch & self._whole(patch)[self.surface.vertices.of_point].all(axis=1)

    def _whole(self, patch: Bools) -> Bools:
        """Vertices (v,) all of whose facets are in a patch (q,); collective."""
        vertices = self.surface.vertices
        return vertices.sums(self.surface.slave.weight * patch) >= WHOLE * vertices.area

    def _rim(self, trial: ContactTrial, patch: Bools) -> tuple[float, float, float]:
        """Half-width, m, length of the facets at its rim, m, their share of the area; collective.

        The rim crosses the facets between a vertex that presses and one that does not; point by
        point a vertex presses if something does on all facets around. It is taken in the middle of
        such facets, and the half-width from the vertex or point that is furthest from it.
        """
        surface, vertices = self.surface, self.surface.vertices
        weight, nodal = surface.slave.weight, trial.nodal_pressure
        pressing: Bools = self._whole(patch) if nodal is None else nodal > 0.0
        ends = pressing[vertices.of_point]
        crossed = ends.any(axis=1) & ~ends.all(axis=1)
        if nodal is None:
            crossed = patch & ~ends.all(axis=1)
        if not self._comm.allreduce(bool(crossed.any()), op=MPI.LOR):
            return 0.0, 0.0, 0.0
        rim = cKDTree(vertices.position[~pressing])
        inside = [vertices.position[pressing], surface.slave.position[ends.all(axis=1)]]
        # The place deepest inside tells the widest patch: two patches are not one wide contact.
        places = np.concatenate(inside)
        depth = rim.query(places)[0] if len(places) else np.empty(0)
        deepest = int(np.argmax(depth)) if len(depth) else -1
        mine = (float(depth[deepest]), *places[deepest]) if len(depth) else (0.0,)
        half, *middle = max(self._comm.allgather(mine))
        # The rim around that place alone: other patches may be meshed otherwise.
        near: Bools = np.asarray(crossed)
        if middle:
            apart = np.linalg.norm(surface.slave.position - middle, axis=1)
            near = crossed & (apart < NEAR * half)
        length = np.zeros(len(near))
        length[near] = facet_length_along(surface, near, ends[near].astype(np.float64))[0]
        parts = (near, length, crossed, ends.all(axis=1))
        sums = self._total(*(float(weight @ part) for part in parts))
        # Somewhere within the facets that it crosses, in the mean half-way, the contact ends.
        rim_length, half_crossed = over(sums[1], sums[0]), 0.5 * sums[2]
        half_width = max(half - 0.5 * rim_length, 0.5 * rim_length)
        return half_width, rim_length, over(half_crossed, sums[3] + half_crossed)

    def _unevenness(self, trial: ContactTrial, patch: Bools) -> tuple[float, float, float]:
        """Open share inside the patch, scatter within its facets, mean sagitta, m; collective."""
        weight, pressure = self.surface.slave.weight, trial.pressure
        inside = self._inside(patch)
        # The standard deviation of the pressure about the mean of its own facet.
        area = self._by_facet(weight)
        total = area.sum(axis=1)
        mean = (area * self._by_facet(pressure)).sum(axis=1) / total
        apart = self._by_facet(pressure) - mean[:, None]
        spread = np.sqrt((area * apart**2).sum(axis=1) / total)
        # Pressures count away from the rim alone, where they fall to nothing in any contact; the
        # bow wherever a facet presses.
        some, deep = (area * self._by_facet(part) for part in (patch, inside))
        sums = self._total(
            float(weight @ (inside & (pressure <= 0.0))),
            float(weight @ inside),
            float(deep.sum(axis=1) @ spread),
            float(deep.sum(axis=1) @ mean),
            float(some.sum(axis=1) @ self._bow(trial)),
            float(some.sum()),
        )
        return over(sums[0], sums[1]), over(sums[2], sums[3]), over(sums[4], sums[5])


def _corner_spacing(surface: ContactSurface) -> Floats | None:
    """How far corners are apart (f,), m, of a master that is made of facets; None of others."""
    master, target = surface.master, surface.target
    if not isinstance(master, MasterFacets) or not isinstance(target, FacetSurface):
        return None
    if target.extraction is not None:
        return None
    spacing, _ = corner_spacing(surface.shape, master.facets, master.position, BENT, SHARP)
    return np.where(spacing > 0.0, spacing, master.sizes())
