"""Pressures that go up and down from point to point or vertex to vertex, and what smooths them.

Point by point, a facet touches with a few of its points where the penetration is less than its
sagitta: the penalty is too large for it. Averaged over vertices, the pressure waves where the
corners of a faceted master are further apart than they.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from tribox.geometry.surfaces.facets import Bools, Floats
from tribox.geometry.surfaces.surface import ContactSurface

WAVES = 0.05  # share of the mean pressure from which on pressures off a smooth curve are told
FEWEST = 6  # vertices within a contact below which nothing can be said
REACH = 2.5  # facets of the slave, at least, over which a curve is fitted to either side
AMID = 0.07  # of that way, between a vertex and the middle of those that a curve is fitted to
MARGIN = 8.0  # mean penetration over sagitta that leaves facets touched all over
COSTLY = 1.5  # of what is allowed: a combed contact is deeper for the same force than a smooth one


def waves(surface: ContactSurface, pressure: Floats, inside: Bools, spacing: float) -> float:
    """How far pressures of vertices are off a smooth curve, over their mean; collective.

    The curve is a parabola (in space a paraboloid) fitted to the vertices around each: as far as
    the next corner of the master to either side, so that it passes through the waves that corners
    make. Of the distances a quantile is taken that as many reach as lie beside corners, so that
    single peaks, as at corners of the slave, do not count.

    Args:
        surface: the pair.
        pressure: (v,), Pa, of the vertices.
        inside: (q,) points of this rank on facets that are amid pressed ones.
        spacing: m, of the master's corners.
    """
    vertices, weight = surface.vertices, surface.slave.weight
    amid = vertices.sums(weight * inside) >= (1.0 - 1e-9) * vertices.area
    if np.count_nonzero(amid) < FEWEST:
        return 0.0
    place, size = vertices.position[amid], float(vertices.length[amid].mean())
    off, fitted = off_curve(place, pressure[amid], max(REACH * size, spacing))
    if not fitted.any():
        return 0.0
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
    """The warning of pressures that are off a smooth curve over corners of the master.

    Args:
        index: of the contact.
        share: as :func:`waves` gives it.
        spacing: m, of the corners.
    """
    return (
        f"contact.{index}: combed pressures: from vertex to vertex they are off a smooth curve by "
        f"{100.0 * share:.2g} % of their mean, over corners between the master's facets, "
        f'{spacing:.3g} m apart; smooth the master (smoothing_angle = "30 deg"), or make its '
        "facets as short as those of the slave"
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
