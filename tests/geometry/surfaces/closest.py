"""Distances from all facets of a surface, without a search."""

import numpy as np

from tribox.geometry.surfaces.compiled_facets import CompiledFacets
from tribox.geometry.surfaces.facets import FacetShape, Floats, Ints


def nearest(shape: FacetShape, facets: Floats, points: Floats) -> Floats:
    """Least distance (q,) of points (q, i) from any of the facets (f, a, i)."""
    count = len(facets)
    point: Ints = np.repeat(np.arange(len(points), dtype=np.int32), count)
    facet: Ints = np.tile(np.arange(count, dtype=np.int32), len(points))
    every = CompiledFacets(shape, count).distances(points, facets, point, facet)
    out: Floats = every.reshape(-1, count).min(axis=1)
    return out
