"""Which states of a run are worth a picture, and what its title says."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tribox.app.figures.style import unit_of_velocity, velocity_text
from tribox.app.simulation.history import time_text

if TYPE_CHECKING:
    from tribox.app.results import Results
    from tribox.app.results.reading import Table

AS_HIGH = 0.999  # share of the largest normal force from which on a load counts as the highest
HIGHEST = "highest load"
ENDINGS = {
    "failed": "last state before the failure",
    "interrupted": "last state before the interruption",
    "running": "last state so far",
}


@dataclass(frozen=True, slots=True)
class State:
    """A state to draw."""

    name: str  # of the picture, without its ending
    step: int  # of the field output
    title: str  # what it shows, for people


def states_to_draw(results: Results) -> list[State]:
    """The last state, the end of each stage before the last, and the highest load.

    The highest load has no picture of its own where another shows it or as good as that, and no
    mention where several do.
    """
    outputs = np.asarray(results.steps, dtype=np.int64)
    if not len(outputs):
        return []
    history = results.table("history")
    last = int(outputs[-1])
    names, notes = {last: "deformed"}, {last: [ENDINGS.get(results.summary.get("status", ""), "")]}
    ends = stage_ends(results)
    for number, (stage, end) in enumerate(ends[:-1], 1):
        step = _nearest(outputs, end)
        names.setdefault(step, f"deformed-{number}-{re.sub(r'[^A-Za-z0-9.+=_%µμ-]+', '_', stage)}")
        near = "" if step == last else f"nearest output to the end of {stage}"
        notes.setdefault(step, []).append(f"end of {stage}" if step == end else near)
    peak = _highest(history, list(names), outputs)
    if peak is not None:
        step, note = peak
        names.setdefault(step, "deformed-highest-load")
        exact = note == HIGHEST
        notes.setdefault(step, []).append(note if exact or step != last else "")
    return [State(names[s], s, _title(results, s, notes[s])) for s in sorted(names)]


def title_of(results: Results, step: int) -> str:
    """Stage, time and number of a step, for people."""
    return _title(results, step, [])


def stage_ends(results: Results) -> list[tuple[str, int]]:
    """Each stage of a run with its last step, in order."""
    history = results.table("history")
    if not len(history):
        return []
    return [(str(stage), int(rows["step"][-1])) for stage, rows in history.parts("stage")]


def _highest(history: Table, drawn: list[int], outputs: Any) -> tuple[int, str] | None:
    """The output at the highest load and what to say of it.

    None where nothing is pressed, and where no other picture shows a lower load than one that is
    drawn.
    """
    if not len(history) or "normal_force" not in history:
        return None
    force = history["normal_force"]
    steps = history["step"].astype(np.int64)
    largest = float(np.nanmax(force))
    if not largest > 0.0:
        return None
    high = {int(step) for step in steps[force >= AS_HIGH * largest]}
    shown = [step for step in drawn if step in high]
    if shown:
        return (shown[0], HIGHEST) if len(shown) == 1 < len(drawn) else None
    at = int(steps[np.nanargmax(force)])
    written = [s for s in outputs.tolist() if s in high]
    if at in written:
        return at, HIGHEST
    if written:
        return written[0], HIGHEST
    return _nearest(outputs, at), f"nearest output to the highest load (step {at})"


def _nearest(outputs: Any, step: int) -> int:
    return int(outputs[np.argmin(np.abs(outputs - step))])


def _title(results: Results, step: int, notes: list[str]) -> str:
    """Stage, velocity, time and step, then what is special."""
    words = [note for note in notes if note]
    history = results.table("history")
    found = history.where("step", step).records() if len(history) else []
    row = found[0] if found else None
    if row is None:
        return "; ".join([f"step {step}", *words])
    total = int(history["step"][-1])
    velocity, time = float(row.get("velocity", 0.0)), float(row["time"])
    unit = unit_of_velocity(results)
    moving = f" at {velocity_text(velocity, unit)}" if abs(velocity) > 0.0 else ""
    when = time_text(time, float(row.get("dt", 0.0)))
    said = f"stage {row['stage']}{moving}, t = {when}, step {step} of {total}"
    return "; ".join([said, *words])
