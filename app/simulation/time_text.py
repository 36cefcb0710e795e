"""Times in messages: digits enough to tell one step from the next."""

from __future__ import annotations

import math

FEWEST, MOST = 6, 17  # digits; a float has no more than 17


def time_text(time: float, dt: float) -> str:
    """A time in s, with the digits that a step of ``dt`` changes, and one more.

    Args:
        time: s.
        dt: s, length of the step that ends or begins there.
    """
    digits = FEWEST
    if time and dt and math.isfinite(time) and math.isfinite(dt):
        apart = math.floor(math.log10(abs(time))) - math.floor(math.log10(abs(dt)))
        digits = min(max(apart + 2, FEWEST), MOST)
    return f"{time:.{digits}g} s"
