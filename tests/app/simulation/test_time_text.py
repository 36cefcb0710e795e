"""Times in messages tell steps apart, however short these are beside the time."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tribox.app.simulation.history import time_text


@pytest.mark.parametrize(
    ("time", "dt", "text"),
    [
        (0.1, 0.1, "0.1 s"),
        (1.0 / 3.0, 0.1, "0.333333 s"),
        (0.100000001, 1e-9, "0.100000001 s"),
        (1234.5678901, 1e-4, "1234.56789 s"),
        (0.0, 1e-9, "0 s"),
        (2.5, 0.0, "2.5 s"),
        (2.5, float("inf"), "2.5 s"),
    ],
)
def test_digits_follow_from_the_step(time, dt, text):
    assert time_text(time, dt) == text


@given(
    start=st.floats(1e-9, 1e6),
    share=st.floats(1e-11, 1e3),
    cut=st.sampled_from([1.0, 0.5, 0.25]),
)
def test_a_step_and_the_next_have_different_times(start, share, cut):
    """Also one half or a quarter as long as the one before."""
    dt = start * share
    first, second = time_text(start, dt), time_text(start + cut * dt, cut * dt)
    assert float(first.removesuffix(" s")) < float(second.removesuffix(" s"))
