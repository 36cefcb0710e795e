"""What the figures of a history are drawn over: time, the path of the driven surface, or steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from tribox.app.figures.names import unit_of_velocity
from tribox.app.figures.style import Floats
from tribox.app.figures.symbols import DRIVEN_PATH, STEP, TIME
from tribox.app.figures.units import fitting, velocity_text

if TYPE_CHECKING:
    from tribox.app.results import Results
    from tribox.app.results.table import Table

# Time per step of one stage over that of another from which on time would hide one of them.
UNEVEN = 30.0
SQUEEZED = 0.05  # of the rest of the axis, for stages that are not to scale
STILL = 1e-9  # of the whole path: a surface that has moved by less is not driven yet
NAMES_APART = 0.035  # of the axis


@dataclass(frozen=True, slots=True)
class Abscissa:
    """Places of the rows of a history.

    Attributes:
        values: (n,), in the unit of the label, one for each row; label: of the axis.
        starts: (value, name) where each stage or velocity begins.
    """

    values: Floats
    label: str
    starts: tuple[tuple[float, str], ...]

    @property
    def begin(self) -> float:
        """Where the run begins, before its first row."""
        return _begin(self.values)

    def mark(self, axes: Axes, *, named: bool) -> None:
        """A line where each stage or velocity begins, and its name above the axes.

        Of names that would overlap, that of the longer stage stands; one stage alone has none.
        """
        if len(self.starts) < 2:
            return
        for place, _ in self.starts:
            axes.axvline(place, color="0.8", lw=0.8, zorder=0)
        apart = NAMES_APART * float(np.ptp([*self.values, *(p for p, _ in self.starts)]) or 1.0)
        ends = [*(place for place, _ in self.starts[1:]), float(self.values[-1])]
        lengths = [end - place for end, (place, _) in zip(ends, self.starts, strict=True)]
        shown: list[float] = []
        for k in np.argsort(lengths, kind="stable")[::-1]:
            place, name = self.starts[k]
            if not named or any(abs(place - other) < apart for other in shown):
                continue
            shown.append(place)
            axes.annotate(
                name, (place, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 3),
                textcoords="offset points", fontsize=7, color="0.35", rotation=45,
            )  # fmt: skip


def _begin(values: Floats) -> float:
    """Where a run begins, whose first row need not stand beyond 0."""
    first = float(values[0])
    return 0.0 if first > 0.0 else 2.0 * first - float(values[min(1, len(values) - 1)])


def abscissa_of(results: Results) -> Abscissa:
    """What the history of a run is drawn over.

    The path of the driven surface, where velocities are held until steady: time at the slowest
    would hide that at all others; stages before it stand to its left. Else time; but where the
    stages differ so much in time per step that one could not be seen, time without the stages that
    it has no effect in, or steps.
    """
    history = results.table("history")
    time, driven = history["time"], history["driven_displacement"]
    path = np.cumsum(np.abs(np.diff(driven, prepend=0.0)))
    if any(stage.velocities for stage in results.case.stage) and path[-1] > 0.0:
        unit = fitting(path, "m")
        label = DRIVEN_PATH.label(unit.name)
        moved = history["stage"][int(np.argmax(path > STILL * path[-1]))]
        still = int(np.argmax(history["stage"] == moved))
        if still:
            first = ", ".join(dict.fromkeys(history["stage"][:still]))
            # Before anything is driven: beside the path, and not all of it on one line.
            path[:still] = np.linspace(-SQUEEZED * path[-1], 0.0, still + 1)[1:]
            label = f"path of the driven surface since the end of {first} ({unit.name})"
        return _made(results, unit.of(path), label)
    if not _uneven(history, time):
        unit = fitting(time, "s")
        return _made(results, unit.of(time), TIME.label(unit.name))
    idle = _idle_rows(results)
    since = time - time[max(idle - 1, 0)]
    if 0 < idle < len(time) and not _uneven(history.rows(slice(idle, None)), since[idle:]):
        since[:idle] = np.linspace(-SQUEEZED * since[-1], 0.0, idle + 1)[1:]
        unit = fitting(since, "s")
        before = ", ".join(dict.fromkeys(history["stage"][:idle]))
        label = f"time since the end of {before}, which is not to scale ({unit.name})"
        return _made(results, unit.of(since), label)
    return _made(results, history["step"], STEP.name)


def _idle_rows(results: Results) -> int:
    """Number of rows at the beginning in stages that time has no effect in."""
    idle = {stage.name for stage in results.case.stage if not stage.rate_dependent}
    counts = np.array([stage not in idle for stage in results.table("history")["stage"]])
    return int(np.argmax(counts)) if counts.any() else 0


def _uneven(history: Table, time: Floats) -> bool:
    """Whether the time of a step in one stage is far from that in another."""
    of = [np.flatnonzero(history["stage"] == name) for name in dict.fromkeys(history["stage"])]
    ends, counts = time[[rows[-1] for rows in of]], np.array([len(rows) for rows in of])
    lengths = np.diff(ends, prepend=0.0) / counts
    lengths = lengths[lengths > 0.0]
    return bool(len(lengths) > 1 and lengths.max() > UNEVEN * lengths.min())


def _made(results: Results, values: Floats, label: str) -> Abscissa:
    history = results.table("history")
    several = {stage.name for stage in results.case.stage if stage.velocities}
    rows = zip(history["stage"], history["velocity"], strict=True)
    keys = [(stage, velocity if stage in several else 0.0) for stage, velocity in rows]
    begins = [i for i, key in enumerate(keys) if i == 0 or key != keys[i - 1]]
    starts, unit = [], unit_of_velocity(results)
    for i in begins:
        stage, velocity = keys[i]
        before = float(values[i - 1]) if i else _begin(values)
        name = velocity_text(velocity, unit) if stage in several else str(stage)
        starts.append((before, name))
    return Abscissa(values, label, tuple(starts))
