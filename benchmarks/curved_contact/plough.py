"""Ploughing and rolling: friction against μ times the pressure, whatever the step.

A round tool is pressed 0.05 mm into rubber and drawn along it (``plough``), or rolls on it, its
surface a tenth faster than the rubber's base (``roll``), with 5 to 40 steps per mm. All of the
contact slides, but for the first micrometre at its leading end, so that ΣT, along each point's own
surface, is μ Σp to 1e-3; the drag of a film is the same at all steps. Means are over
the last 0.4 of the way, whole steps of all: what a film drags is the mean over each step, and in
rolling it changes on the way.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.curved_contact import runs
from benchmarks.curved_contact.film import RADIUS, SHARE, mesh
from benchmarks.curved_contact.runs import MM, Outcome, case_text, run, soft, stages

MU = 0.3
WAY = 1.0  # mm
LAG = 0.9
TOOL_ZONE = 2 * (WAY / LAG + 1.2) * MM  # the tool rolls onto it by WAY/LAG, with a contact of 1.1


@dataclass(frozen=True, slots=True)
class Setup:
    """One row of the table.

    Attributes:
        kind: "plough" or "roll"; law: "dry" or "film"; steps: per mm.
        size: µm, facets of the rubber; nu: of it; smooth: whether the tool is.
    """

    kind: str = "plough"
    law: str = "dry"
    steps: int = 10
    size: float = 80.0
    nu: float = 0.495
    smooth: bool = True


BASE = Setup()
QUICK = replace(BASE, steps=5)
ROWS = tuple(
    Setup(kind, law, steps)
    for kind in ("plough", "roll")
    for law in ("dry", "film")
    for steps in (5, 10, 40)
)


def case_of(setup: Setup) -> str:
    """The case file."""
    rolls, speed = setup.kind == "roll", WAY * MM
    slip = (1.0 / LAG - 1.0) * speed if rolls else speed
    angle = -WAY * MM / RADIUS / LAG
    turned = f'rotation = {{ angle = [["1 s", 0], ["2 s", {angle}]], centre = [0, {RADIUS}] }}'
    dry = f'friction = {{ law = "coulomb", mu = {MU} }}'
    smoothing = runs.SMOOTH if setup.smooth else ""
    return case_text(
        smoothing + (dry if setup.law == "dry" else runs.film(slip)),
        runs.moved('"driven"', "0.05 mm"),
        turned if rolls else runs.moved("0"),
        stages(5, round(setup.steps * WAY), -speed if rolls else speed),
        rubber=soft(setup.nu),
    )


def row(setup: Setup, scratch: Path, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    """Solve one problem; its row of the table."""
    mesh(scratch / "mesh.msh", SHARE * setup.size * 1e-6, tool_zone=TOOL_ZONE)
    outcome = run(case_of(setup), scratch, overrides)
    out = asdict(setup) | outcome.cost()
    last = [f for f in outcome.stage("slide") if f.row.time > 1.6 + 1e-6]
    failure = outcome.failure or _off_the_tool(outcome, 2e-6 * setup.size)
    if failure or not last:
        return out | {"failure": failure}
    share = np.array([abs(f.along) / f.load for f in last])
    column = np.array([abs(f.row.tangential_force) / f.row.normal_resultant for f in last])
    T = np.array([abs(f.row.tangential_force) for f in last])
    out |= {"T": float(T.mean()), "ripple max %": 100 * float(np.abs(T / T.mean() - 1.0).max())}
    out |= {"T/∫p": float(share.mean()), "column T/N": float(column.mean())}
    if setup.law == "dry":
        out["T/∫p off μ, most"] = float(np.abs(share / MU - 1.0).max())
    return out | {"stick": float(np.mean([f.row.stick_fraction for f in last]))}


def _off_the_tool(outcome: Outcome, near: float) -> str:
    """What is wrong if the contact has come ``near`` (m) an end of the tool's surface, or ""."""
    for frame in outcome.frames:
        pressed = frame.position[frame.pressure > 0.0, 0]
        left, *_, right = frame.nodes["tool_contact"][:, 0]
        if len(pressed) and not (left + near < pressed.min() and pressed.max() < right - near):
            return f"the contact comes to the end of the tool at t = {frame.row.time:g} s"
    return ""
