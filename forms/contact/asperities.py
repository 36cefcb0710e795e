r"""Pressure of rough surfaces with a film between them: asperities in the place of the penalty.

At each vertex of the slave the gap between the mean planes gives the pressure of the asperities
(:mod:`tribox.forms.film.roughness`). It is averaged, and the pressure spread, with the dual
functions ψ of the linear N_A (B. Wohlmuth, SIAM J. Numer. Anal. 38, 2000),

.. math:: \int \psi_A N_B\, dA = \delta_{AB} \int N_A\, dA

so that the gap of a vertex is that at the vertex, and the body feels the pressure of the vertex
there. With N_A themselves both are averages over the neighbours: before the edge of a contact,
where the gap bends most, they are too large by l²g''/12, and of 35 facets in the contact this alone
makes friction in the mixed regime 7 % too high.

Axis letters: q points, v vertices, f facets, k vertices of a facet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.state import (
    ContactMode,
    NormalContact,
)
from tribox.forms.film.places import FilmPlaces
from tribox.forms.film.roughness import Asperities, RoughGap
from tribox.forms.friction.film_rheology import FilmRheology
from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.surface import ContactSurface

_WHOLE = 0.999  # share of a vertex's area that must have the master below it


@dataclass(frozen=True, slots=True)
class FilmModel:
    """What a film and its surfaces are made of.

    Attributes:
        rough: roughness; asperities: what they carry; rheology: of the oil.
        share: "contact": the asperities rub by the law, the film by its viscosity; "map": the law
            is a map with films, which is given p_a and h_T.
        oil: m, θh of the oil on the slave; infinite: flooded.
        reach: m, gap beyond which oil is only kept.
        steady: whether each step is the steady state of its speed.
        scale: Pa, of the order of the pressures.
        cells: of the film per facet of the slave.
    """

    rough: RoughGap
    asperities: Asperities
    rheology: FilmRheology
    share: Literal["contact", "map"]
    oil: float
    reach: float
    steady: bool
    scale: float
    cells: int = 1


class AsperityPressure(AveragedPressure):
    """Pressure of the asperities from the mean gaps of the vertices.

    Attributes:
        model: of the film; places: of it; facet_of: (q,) numbers of the points' facets there.
        shape: (q, k), ψ.
    """

    def __init__(self, surface: ContactSurface, model: FilmModel) -> None:
        """Take the surface; where a penalty is asked for, the stiffness of the closed gap."""
        step = np.array([0.0])
        stiffness = -float(model.asperities.pressure(step)[1][0])
        super().__init__(surface, max(stiffness, model.scale / model.reach))
        self.model = model
        _, first, self.facet_of = np.unique(
            surface.slave.facet, return_index=True, return_inverse=True
        )
        facets = surface.vertices.of_point[first]
        self.places = FilmPlaces(facets, surface.vertices.count, model.cells)
        self.shape = dual(self.vertices.shape, surface.slave.weight, self.facet_of)

    def gaps(self, at: Projection) -> Floats:
        """Gaps (v,), m, at the vertices; infinite where the master is not below all of their area.

        Args:
            at: projections of all points.
        """
        vertices, weight = self.vertices, self.surface.slave.weight
        on = np.where(at.on_surface, 1.0 if at.share is None else at.share, 0.0)
        covered = vertices.sums(weight * on) > _WHOLE * vertices.area
        summed = vertices.sums(weight * on * np.where(at.on_surface, at.gap, 0.0), self.shape)
        return np.where(covered, summed / vertices.area, np.inf)

    def evaluate(
        self, at: Projection, mode: ContactMode, least_depth: float = 0.0
    ) -> NormalContact:
        """See :class:`tribox.forms.contact.pressure.NormalRule`; without the film's pressure."""
        vertices, gap = self.vertices, self.gaps(at)
        members: Bools = gap <= self.model.reach
        gap = np.where(np.isfinite(gap), gap, 2.0 * self.model.reach)
        pressure, slope = self.model.asperities.pressure(gap)
        pressure = np.where(members, mode.penalty_scale * pressure, 0.0)
        slope = np.where(members, mode.penalty_scale * slope, 0.0)
        closed = at.on_surface & members[vertices.of_point].all(axis=1)
        spread = np.where(closed, vertices.at_points(pressure, self.shape), 0.0)
        return NormalContact(
            closed=closed,
            spring=spread,
            pressure=np.where(closed, vertices.at_points(pressure), 0.0),
            gap=gap,
            nodal_pressure=pressure,
            active=members,
            rim=members,
            stiffness=-slope,
        )

    def energy(self, normal: NormalContact, penalty_scale: float) -> float:
        """See :class:`tribox.forms.contact.pressure.NormalRule`: what the asperities store."""
        film = normal.lubrication
        if normal.gap is None or film is None:
            return 0.0
        density = np.where(film.members, self.model.asperities.energy(normal.gap), 0.0)
        return float(self.vertices.area @ (film.ratio * density))


def dual(shape: Floats, weight: Floats, facet: Longs) -> Floats:
    """ψ (q, k) of functions N (q, k): on each facet ψ = D M⁻¹ N, with M = Σ w N Nᵀ, D = Σ w N.

    Args:
        shape: N.
        weight: w (q,) of the points.
        facet: (q,) numbers of their facets, from 0 on. One with a single point keeps N there.
    """
    count, k = int(facet.max(initial=-1)) + 1, shape.shape[1]
    weighted = weight[:, None] * shape
    mass, area = np.zeros((count, k, k)), np.zeros((count, k))
    np.add.at(mass, facet, weighted[:, :, None] * shape[:, None, :])
    np.add.at(area, facet, weighted)
    per_facet = area[:, :, None] * np.linalg.pinv(mass, hermitian=True)
    out: Floats = np.einsum("qkl,ql->qk", per_facet[facet], shape)
    return out
