"""Pairs of points and facets among which a search says the closest are."""

import numpy as np


def pairs(search, points, facets):
    """The point (p,) and the facet (p,) of each pair, sorted by point."""
    among = search.candidates(points, facets)
    near = among.beyond <= among.limit
    point = np.repeat(np.arange(len(points)), np.diff(among.start))[near]
    facet = among.facet[near]
    if among.alone is not None:
        far = np.nonzero(among.alone >= 0)[0]
        point, facet = np.append(point, far), np.append(facet, among.alone[far])
    order = np.argsort(point, kind="stable")
    return point[order], facet[order]
