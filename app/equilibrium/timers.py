"""Seconds spent in named parts of a run."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Stopwatch:
    """Adds up the time of named parts; an inner part is taken out of the outer one.

    Attributes:
        seconds: by part, s; calls: by part, how often it was begun.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        """Read the time from ``clock``, s: by default the wall's."""
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self._clock = clock
        self._open: list[str] = []
        self._since = 0.0

    @contextmanager
    def __call__(self, part: str) -> Iterator[None]:
        """Count the time inside the ``with`` block towards ``part``."""
        self.begin(part)
        try:
            yield
        finally:
            self.end()

    def begin(self, part: str) -> None:
        """Count the time from here on towards ``part``."""
        now = self._clock()
        if self._open:
            self.seconds[self._open[-1]] += now - self._since
        self.calls[part] += 1
        self._open.append(part)
        self._since = now

    def end(self) -> None:
        """Go on with what was counted before the part begun last."""
        now = self._clock()
        self.seconds[self._open.pop()] += now - self._since
        self._since = now
