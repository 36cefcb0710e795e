r"""Pressure of rough surfaces with a film between them: asperities in the place of the penalty.

At each vertex of the slave the gap between the mean planes gives the pressure of the asperities
(:mod:`tribox.forms.film.roughness`). It is averaged, and the pressure spread, with the dual
functions ψ of the linear N_A (B. Wohlmuth, SIAM J. Numer. Anal. 38, 2000),

.. math:: \int \psi_A N_B\, dA = \delta_{AB} \int N_A\, dA

so that the body feels the pressure of a vertex there. With N_A themselves pressure and gap are
averages over the neighbours: before the edge of a contact, where the gap bends most, the gap is too
large by l²g''/12, and of 35 facets in the contact this alone makes friction in the mixed regime 7 %
too high.

A facet is a chord of the surface that it stands for, and the gap over it a parabola where a tool is
round: ψ_A takes from the gap of the vertex κ (l_1³ + l_2³)/(12 (l_1 + l_2)) between facets of l_1
and l_2, with the curvature κ of one surface relative to the other. The gap is therefore averaged
with the ψ'_A of the span of N and N_1 N_2, which finds that of each vertex whatever κ is, and
changes with it. A surface that stretches by linear functions moves both means alike.

Axis letters: q points, v vertices, f facets, k vertices of a facet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.state import ContactMode, NormalContact
from tribox.forms.film.places import FilmPlaces
from tribox.forms.film.roughness import Asperities, RoughGap
from tribox.forms.friction.film_rheology import FilmRheology
from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.surface import ContactSurface

_WHOLE = 0.999  # share of a facet that must have the master below it


@dataclass(frozen=True, slots=True)
class FilmModel:
    """What a film and its surfaces are made of."""

    rough: RoughGap  # roughness
    asperities: Asperities  # what they carry
    rheology: FilmRheology  # of the oil
    # "contact": the asperities rub by the law, the film by its viscosity; "map": the law is a map
    # with films, which is given p_a and h_T
    share: Literal["contact", "map"]
    oil: float  # m, θh of the oil on the slave; infinite: flooded
    reach: float  # m, gap beyond which oil is only kept
    steady: bool  # whether each step is the steady state of its speed
    scale: float  # Pa, of the order of the pressures
    cells: int = 1  # of the film per facet of the slave


class AsperityPressure(AveragedPressure):
    """Pressure of the asperities from the mean gaps of the vertices.

    Attributes:
        model: of the film; places: of it, on all ranks; facet_of: (q,) numbers of the points'
            facets there; whole: (f,), m², their areas.
        shape: (q, k), ψ' of the gaps; spread: (q, k), ψ of the pressures.
    """

    def __init__(self, surface: ContactSurface, model: FilmModel) -> None:
        """Take the surface; where a penalty is asked for, the stiffness of the closed gap.

        Raises:
            ValueError: too few points on a facet.
        """
        stiffness = -float(model.asperities.pressure(np.array([0.0]))[1][0])
        super().__init__(surface, max(stiffness, model.scale / model.reach))
        self.model = model
        facets, self.facet_of = _facets(surface)
        self.places = FilmPlaces(facets, surface.vertices.count, model.cells)
        enough = np.bincount(self.facet_of)[self.facet_of].min(initial=3) >= 3
        if not self.vertices.on_all_ranks(bool(enough)):
            raise ValueError("it needs three points on a facet, a quadrature_degree of 4 or more")
        shape, weight = self.vertices.shape, surface.slave.weight
        self.whole = self.facet_sums(weight)
        self.spread = dual(shape, weight, self.facet_of)
        self.shape = dual(shape, weight, self.facet_of, bent=True)

    def facet_sums(self, values: Floats) -> Floats:
        """Σ_q f_q (…, f) of point values ``values`` (…, q), over all ranks; collective."""
        count = len(self.places.facets)
        local: Floats = np.zeros((*values.shape[:-1], count))
        for at in np.ndindex(values.shape[:-1]):
            local[at] = np.bincount(self.facet_of, values[at], count)
        return self.vertices.total(local)

    def covered(self, at: Projection) -> Bools:
        """Facets (f,) that have the master below all of them; collective."""
        on = np.where(at.on_surface, 1.0 if at.share is None else at.share, 0.0)
        return self.facet_sums(self.surface.slave.weight * on) > _WHOLE * self.whole

    def gaps(self, at: Projection, shape: Floats | None = None) -> tuple[Floats, Floats]:
        """Gaps (v,), m, at the vertices, and the area (v,), m², of their mean; collective.

        It is that of the facets around that have the master below all of them; infinite gaps where
        there is none.

        Args:
            at: projections of all points.
            shape: (q, k), functions to average with; None: ψ'.
        """
        vertices, whole = self.vertices, self.covered(at)[self.facet_of]
        weight = np.where(whole, self.surface.slave.weight, 0.0)
        area = vertices.sums(weight)
        summed = vertices.sums(
            weight * np.where(whole, at.gap, 0.0), self.shape if shape is None else shape
        )
        some = area > 0.0
        gap = np.where(some, summed / np.where(some, area, 1.0), np.inf)
        return gap, np.where(some, area, vertices.area)

    def evaluate(
        self, at: Projection, mode: ContactMode, least_depth: float = 0.0
    ) -> NormalContact:
        """See :class:`tribox.forms.contact.pressure.NormalRule`; without the film's pressure."""
        vertices, (gap, area) = self.vertices, self.gaps(at)
        members: Bools = gap <= self.model.reach
        gap = np.where(np.isfinite(gap), gap, 2.0 * self.model.reach)
        pressure, slope = self.model.asperities.pressure(gap)
        pressure = np.where(members, mode.penalty_scale * pressure, 0.0)
        slope = np.where(members, mode.penalty_scale * slope, 0.0)
        covered = self.covered(at)[self.facet_of]
        closed = covered & members[vertices.of_point].all(axis=1)
        spread = np.where(closed, vertices.at_points(pressure, self.spread), 0.0)
        return NormalContact(
            closed=closed,
            spring=spread,
            pressure=np.where(closed, vertices.at_points(pressure), 0.0),
            gap=gap,
            nodal_pressure=pressure,
            active=members,
            rim=members,
            area=area,
            whole=covered,
            stiffness=-slope,
        )

    def energy(self, normal: NormalContact, penalty_scale: float) -> float:
        """See :class:`tribox.forms.contact.pressure.NormalRule`: what the asperities store."""
        film = normal.lubrication
        if normal.gap is None or normal.area is None or film is None:
            return 0.0
        density = np.where(film.members, self.model.asperities.energy(normal.gap), 0.0)
        density *= film.ratio * normal.area / self.vertices.area
        return float(self.surface.slave.weight @ self.vertices.at_points(density))


def _facets(surface: ContactSurface) -> tuple[Longs, Longs]:
    """Vertices (f, k) of the slave facets of all ranks, in an order that does not depend on these.

    Also the number (q,) there of the facet of each point of this rank; collective.
    """
    vertices = surface.vertices
    _, first, own = np.unique(surface.slave.facet, return_index=True, return_inverse=True)
    gathered = vertices.comm.allgather(vertices.of_point[first])
    every = np.concatenate(gathered)
    order = np.lexsort(np.sort(every, axis=1).T)
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    before = sum(len(facets) for facets in gathered[: vertices.comm.rank])
    return every[order], number[before + own]


def dual(shape: Floats, weight: Floats, facet: Longs, bent: bool = False) -> Floats:
    """ψ (q, k) of functions N (q, k): on each facet ψ = D M⁻¹ N, with M = Σ w N Nᵀ, D = Σ w N.

    Σ w ψ f is D times the values at the vertices of what fits f best in the span of N.

    Args:
        shape: N.
        weight: w (q,) of the points.
        facet: (q,) numbers of their facets, from 0 on. One with a single point keeps N there.
        bent: fit in the span of N and N_1 N_2 instead, on three points and more.
    """
    count, k = int(facet.max(initial=-1)) + 1, shape.shape[1]
    span = np.column_stack([shape, shape.prod(axis=1)]) if bent else shape
    size = span.shape[1]
    mass, area = np.zeros((count, size, size)), np.zeros((count, k))
    weighted: Floats = weight[:, None] * span
    np.add.at(mass, facet, weighted[:, :, None] * span[:, None, :])
    np.add.at(area, facet, weight[:, None] * shape)
    per_facet = area[:, :, None] * np.linalg.pinv(mass, hermitian=True)[:, :k]
    return np.einsum("qkl,ql->qk", per_facet[facet], span)
