"""Pressure of rough surfaces with a film between them: asperities in the place of the penalty.

At each vertex of the slave the mean gap between the mean planes gives the pressure of the
asperities (:mod:`tribox.forms.film.roughness`). Axis letters: q points, v vertices, f facets.
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
from tribox.forms.film.reynolds import FilmPlaces
from tribox.forms.film.roughness import Asperities, RoughGap
from tribox.forms.friction.film_rheology import FilmRheology
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

    def evaluate(
        self, at: Projection, mode: ContactMode, least_depth: float = 0.0
    ) -> NormalContact:
        """See :class:`tribox.forms.contact.pressure.NormalRule`; without the film's pressure."""
        vertices, weight = self.vertices, self.surface.slave.weight
        on = np.where(at.on_surface, 1.0 if at.share is None else at.share, 0.0)
        covered = vertices.sums(weight * on)
        gap = vertices.sums(weight * on * np.where(at.on_surface, at.gap, 0.0)) / vertices.area
        members = (covered > _WHOLE * vertices.area) & (gap <= self.model.reach)
        pressure, slope = self.model.asperities.pressure(gap)
        pressure = np.where(members, mode.penalty_scale * pressure, 0.0)
        slope = np.where(members, mode.penalty_scale * slope, 0.0)
        closed = at.on_surface & members[vertices.of_point].all(axis=1)
        at_points = np.where(closed, vertices.at_points(pressure), 0.0)
        return NormalContact(
            closed=closed,
            spring=at_points,
            pressure=at_points,
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
