"""How much of a facet at the rim of a contact counts as covered.

With averaged pressure a facet between a vertex that carries pressure and one that does not has
pressure on all of its length, which falls to zero at the open vertex; the bodies part somewhere in
between. Film and area must not reach further than they touch: in such facets the own gap of a point
decides. A point stands for a piece of the facet over which the gap changes by ε, so that it is
covered by

    χ = ⟨½ − g/ε⟩, at most 1,

the share of the piece that is closed. This makes the covered length continuous in time although the
points are few. The range of gaps that ε follows from is that of the last converged step: the tangent
needs ∂χ/∂g = −1/ε only, and ε changes the width of the transition, not its place.
"""

from __future__ import annotations

import numpy as np

from forms.contact.state import NormalContact
from geometry.surfaces.facets import Floats
from geometry.surfaces.surface import ContactSurface

# Least ε, over facet length: flat bodies that touch along a whole facet have no range of gaps.
_LEAST_RANGE = 1e-4


def rim_cover(
    surface: ContactSurface, normal: NormalContact, gap: Floats, last_gap: Floats
) -> tuple[Floats, Floats]:
    """Covered share χ (q,) of each point, and ∂χ/∂g (q,), 1/m.

    Args:
        surface: the pair's surfaces.
        normal: which points and vertices are active.
        gap: (q,), m, own gaps of the points.
        last_gap: (q,), m, of the last converged step; infinite where there was no projection.
    """
    cover, slope = np.ones(len(gap)), np.zeros(len(gap))
    if normal.active is None:
        return cover, slope
    partly = normal.closed & ~normal.active[surface.vertices.of_point].all(axis=1)
    at = np.nonzero(partly)[0]
    if not len(at):
        return cover, slope
    width = _piece_ranges(surface, last_gap)[at]
    share = 0.5 - gap[at] / width
    cover[at] = np.clip(share, 0.0, 1.0)
    slope[at] = np.where((share > 0.0) & (share < 1.0), -1.0 / width, 0.0)
    return cover, slope


def _piece_ranges(surface: ContactSurface, gap: Floats) -> Floats:
    """ε (q,), m: change of the gaps ``gap`` over the piece that each point stands for."""
    slave = surface.slave
    count = int(slave.facet.max(initial=-1)) + 1
    known = np.isfinite(gap)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, slave.facet[known], gap[known])
    np.maximum.at(high, slave.facet[known], gap[known])
    spread = np.where(high > low, high - low, 0.0)[slave.facet]
    share = slave.facet_share ** (1.0 / surface.shape.directions)
    out: Floats = share * np.maximum(spread, _LEAST_RANGE * slave.facet_length)
    return out
