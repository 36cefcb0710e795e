"""Points that touch the same facets, now and at the last step: their blocks are added up.

Axis letters: p points, g groups.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tribox.geometry.surfaces.facets import Bools, Longs


@dataclass(frozen=True, slots=True)
class PointGroups:
    """Points ``take`` (p,) by groups: ``group`` (p,), and a point of each group (g,)."""

    take: Longs
    group: Longs
    point: Longs

    @classmethod
    def of(cls, take: Longs, key: Longs) -> PointGroups:
        """Points with the same ``key`` (p,) make up a group."""
        _, first, group = np.unique(key, return_index=True, return_inverse=True)
        return cls(take, group.reshape(-1).astype(np.int64), take[first])

    def ordered(self, which: Bools) -> tuple[Longs, Longs]:
        """Where the points of some groups (g,) begin, (c + 1,), and these points, one by one."""
        here = which[self.group]
        order = np.argsort(self.group[here], kind="stable")
        count = np.bincount(self.group[here], minlength=len(which))[which]
        ends = np.append(0, np.cumsum(count)).astype(np.int64)
        return ends, np.ascontiguousarray(self.take[here][order])
