"""Pressures that alternate from point to point or from vertex to vertex, and what smooths them.

Point by point, a facet touches with a few of its points where the penetration is less than its
sagitta: the penalty is too large for it. Averaged over vertices, the pressure alternates where the
corners of a faceted master fall on some of them.
"""

from __future__ import annotations

import math

import numpy as np

from tribox.geometry.surfaces.facets import Bools, Floats
from tribox.geometry.surfaces.surface import ContactSurface

ALTERNATES = 0.05  # share of the mean pressure from which on alternating pressures are told
FEWEST = 6  # vertices within a contact below which nothing can be said
MARGIN = 8.0  # mean penetration over sagitta that leaves facets touched all over
COSTLY = 1.5  # of what is allowed: a combed contact is deeper for the same force than a smooth one


def alternation(surface: ContactSurface, pressure: Floats, inside: Bools) -> float:
    """Amplitude over mean of a pressure that alternates from vertex to vertex; collective.

    With S the mean over the facets around each vertex of the means of their vertices, (I - S)^2 p
    is p itself of a pressure that alternates, and nearly nothing of a smooth one. The lower
    quartile over the contact leaves out where it is steep, as at corners and rims of the slave.

    Args:
        surface: the pair.
        pressure: (v,), Pa, of the vertices.
        inside: (q,) points of this rank on facets that are amid pressed ones.
    """
    vertices, weight = surface.vertices, surface.slave.weight
    amid = vertices.sums(weight * inside) >= (1.0 - 1e-9) * vertices.area
    if np.count_nonzero(amid) < FEWEST:
        return 0.0
    rough = pressure
    for _ in range(2):
        of_facet = rough[vertices.of_point].mean(axis=1)
        rough = rough - vertices.sums(weight * of_facet) / vertices.area
    return float(np.quantile(np.abs(rough[amid]), 0.25) / np.mean(pressure[amid]))


def alternation_text(index: int, share: float) -> str:
    """The warning of a pressure that alternates from vertex to vertex over corners of the master.

    Args:
        index: of the contact.
        share: as :func:`alternation` gives it.
    """
    return (
        f"contact.{index}: combed pressures: they alternate from vertex to vertex by "
        f"{100.0 * share:.2g} % of their mean, over corners between the master's facets; smooth "
        'the master (smoothing_angle = "30 deg"), or make its facets as short as those of the slave'
    )


def softer_factor(factor: float, mean: float, sagitta: float, cost: float) -> float | None:
    """A penalty factor with which facets touch all over; None where it would cost too much.

    The penetration goes as 1/K. One digit is kept.

    Args:
        factor: the present `penalty_factor`.
        mean: m, penetration weighted by the pressure.
        sagitta: m, of the facets.
        cost: share of the approach of the bodies that is penetration, over what is allowed.
    """
    if sagitta <= 0.0 or mean <= 0.0:
        return None
    wanted = factor * min(mean / (MARGIN * sagitta), 0.1)
    digit = 10.0 ** math.floor(math.log10(wanted))
    wanted = float(f"{digit * math.floor(wanted / digit):.1g}")
    return wanted if cost * factor / wanted <= COSTLY else None
