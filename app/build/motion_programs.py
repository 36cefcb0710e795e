"""How prescribed displacements follow time and the driven displacement."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from tribox.app.case.boundary import COMPONENTS, DRIVEN, Boundary
from tribox.app.case.time_tables import TimeTable
from tribox.geometry.surfaces.facets import Floats

Program = Callable[[float, float], float | Floats]
"""Displacement (m) of one component, of all nodes or of each, at (time, driven displacement)."""


def turning(arm: Floats, axis: Floats, component: int, angle: TimeTable) -> Program:
    """One displacement component of points turned about an axis, by Rodrigues' formula.

    Args:
        arm: (n, 3) from the axis to the points, m.
        axis: (3,) unit vector.
        component: of the displacement.
        angle: rad, over time.
    """
    across = np.cross(axis, arm)[:, component]
    outward = (arm - np.outer(arm @ axis, axis))[:, component]

    def value(time: float, driven: float) -> Floats:
        turn = angle(time)
        # cos − 1 without cancellation
        out: Floats = across * np.sin(turn) - outward * 2.0 * np.sin(0.5 * turn) ** 2
        return out

    return value


def displaced_components(boundary: Boundary) -> Iterator[tuple[int, Program, object]]:
    """Components with a displacement, its value, and what says so."""
    table = boundary.displacement
    for index, name in enumerate(COMPONENTS):
        moved = getattr(table, name, None)
        if table is not None and moved == DRIVEN:
            share = table.driven_share(name)
            yield index, of_drive(share), (DRIVEN, share)
        elif isinstance(moved, TimeTable):
            yield index, of_time(moved), moved


def moved_components(boundary: Boundary) -> Iterator[tuple[int, TimeTable]]:
    """Components with a velocity, and that."""
    for index, name in enumerate(COMPONENTS):
        speed = getattr(boundary.velocity, name, None)
        if isinstance(speed, TimeTable):
            yield index, speed


def of_drive(share: float) -> Program:
    """A share of the driven displacement."""
    return lambda time, driven: share * driven


def of_time(value: Callable[[float], float]) -> Program:
    """A function of time alone."""
    return lambda time, driven: value(time)
