"""Contact surfaces: points, facets, search and closest-point projection."""
