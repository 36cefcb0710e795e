"""Measures that a solution is judged by."""

from __future__ import annotations

import numpy as np
import pytest

from tests.app.equilibrium.test_free_bodies import SIZE, problem


@pytest.mark.parametrize(
    ("way", "reached"), [(0.0, True), (10.0, True), (1e9, False), (np.inf, False), (np.nan, False)]
)
def test_places_where_only_rounding_is_left_are_out_of_reach(way, reached):
    """Divergent iterations had come to rest 5e9 m away, where rounding hid all forces."""
    equilibrium = problem(2)
    x = equilibrium.new_vector()
    x.array[1] = way * SIZE
    assert equilibrium.rounding.is_within_reach(x) is reached
