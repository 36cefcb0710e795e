"""A film over a curved tool: its drag against η V/D times the length of the contact.

A round tool of aluminium is pressed into a block of rubber by 0.05 mm and slid by 1 mm through a
film that carries everything and is Newtonian (D = D_max). What it must drag is known once it is
known where the bodies touch and how fast they pass each other, and both are read from the deformed
surfaces. The film's stress is a few kPa beside a pressure of about 1 MPa, so it deforms nothing.
The rubber's base is what moves, unless the setup says otherwise.

The rubber's surface below the tool is strained by λ - 1 of up to some per cent where ν is far below
0.5: its points then pass a tool of velocity V at λV. So there are two ratios: ``ratio``, T over
η V/D times the extent, and ``T/∫ηv/D``, with the true speed v.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.curved_contact import runs
from benchmarks.curved_contact.runs import MM, STRESS, Frame, Outcome, case_text, run, soft, stages
from benchmarks.curved_contact.shapes import tool_on_rubber
from benchmarks.curved_contact.surfaces import Extent, extent, slip_integral

RADIUS = 5 * MM
SHARE = 0.97  # facets of 80 um are made of 77.6, so that a step is no whole number of them


@dataclass(frozen=True, slots=True)
class Setup:
    """One row of the table.

    Attributes:
        nu: of the rubber; size: µm, its facets; factor: of the default penalty.
        smooth: whether the master is smoothed; slave: "rubber" or "tool".
        tool: "aluminium", or "rubber": both elastic.
        moves: "rubber", whose base is pressed up and drawn along, or "tool".
        ring: mm, radius at which the section is a ring's, slid outwards; 0: plane strain. It is
            large, for a ring that is widened gets thinner.
        solver: of the slide; steps: of it; slide: mm; speed: m/s.
    """

    nu: float = 0.495
    size: float = 40.0
    factor: float = 1.0
    smooth: bool = True
    slave: str = "rubber"
    tool: str = "aluminium"
    moves: str = "rubber"
    ring: float = 0.0
    solver: str = "implicit"
    steps: int = 10
    slide: float = 1.0
    speed: float = 1e-3


BASE = Setup()
QUICK = replace(BASE, size=80.0, steps=4, slide=0.4)
# A short slide, with inertia and without: the rubber's shear waves run at 55 m/s.
SHORT = replace(BASE, nu=0.45, size=80.0, steps=5, slide=0.2, speed=0.5, moves="tool")
EXTRA = (SHORT, replace(SHORT, solver="explicit"))
AXES: dict[str, tuple[Any, ...]] = {
    "nu": (0.45, 0.495, 0.4999),
    "size": (80.0, 40.0, 20.0),
    "factor": (0.1, 1.0, 10.0),
    "smooth": (True, False),
    "slave": ("rubber", "tool"),
    "tool": ("aluminium", "rubber"),
    "ring": (0.0, 200.0),
}
EXPLICIT = """solver = "explicit"
ramp = {ramp}
[solver]
kind = "explicit"
mass_scaling = {{ kind = "limiting", step = "{step} s" }}
"""


def case_of(setup: Setup) -> str:
    """The case file."""
    duration, tool = setup.slide * MM / setup.speed, setup.moves == "tool"
    staged = stages(5, setup.steps, setup.speed, duration)
    if setup.solver == "explicit":
        staged += EXPLICIT.format(ramp=0.4 * duration, step=3e-10 * setup.size * 5.0)
    smoothing = runs.SMOOTH if setup.smooth else ""
    ends = (runs.moved("0"), runs.moved('"driven"', "-0.05 mm" if tool else "0.05 mm"))
    bottom, top = ends if tool else ends[::-1]
    return case_text(
        f"penalty_factor = {30.0 * setup.factor}\n{smoothing}{runs.film(setup.speed)}",
        bottom, top, staged,
        rubber=soft(setup.nu),
        tool=runs.STIFF if setup.tool == "aluminium" else soft(setup.nu),
        slave=setup.slave,
        section='section = "axisymmetric"' if setup.ring else 'thickness = "1 mm"',
    )  # fmt: skip


def mesh(path: Path, size: float, ring: float = 0.0, tool_zone: float = 3 * MM) -> None:
    """Write the mesh.

    All in m: facets of the rubber, the ring's axis, width of the tool's surface that may touch.
    """
    zone = 2 * round(2.2 * MM / size) * size
    tool_on_rubber(path, size, 1.3 * size, zone, tool_zone, ring)


def row(setup: Setup, scratch: Path, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    """Solve one problem; its row of the table."""
    mesh(scratch / "mesh.msh", SHARE * setup.size * 1e-6, setup.ring * MM)
    outcome = run(case_of(setup), scratch, overrides)
    out = asdict(setup) | outcome.cost()
    slid = outcome.stage("slide")
    if outcome.failure or len(slid) < 2:
        return out | {"failure": outcome.failure}
    try:
        return out | measured(setup, outcome, slid)
    except ValueError as error:
        return out | {"failure": str(error)}


def measured(setup: Setup, outcome: Outcome, slid: list[Frame]) -> dict[str, Any]:
    """Numbers of the last half of the slide."""
    pairs = list(pairwise(slid))[(len(slid) - 1) // 2 :]
    viscous, undeformed = STRESS / setup.speed, outcome.reference["rubber_contact"]
    plain, true, ends, drag = [], [], [], []
    for before, now in pairs:
        new, old = ((f.nodes["rubber_contact"], f.nodes["tool_contact"]) for f in (now, before))
        found = extent(*new, undeformed, RADIUS)
        depth = _depth(setup, outcome, found)
        ends.append(found)
        drag.append(abs(now.row.tangential_force))
        plain.append(STRESS * found.length * depth)
        slip = slip_integral(new, old, found, now.row.time - before.row.time)
        true.append(viscous * abs(slip) * depth)
    T, last = np.array(drag), pairs[-1][1]
    mean = float(T.mean())
    half = float(np.mean([e.half_width for e in ends]))
    depth = _depth(setup, outcome, ends[-1])
    peak = 2.0 * last.load / depth / (np.pi * half)
    area = float(np.mean([now.row.contact_area for _, now in pairs]))
    reference = float(np.mean([e.reference for e in ends]))
    return {
        "ratio": mean / float(np.mean(plain)),
        "T/∫ηv/D": mean / float(np.mean(true)),
        "ripple std %": 100.0 * float(T.std()) / mean,
        "ripple max %": 100.0 * float(np.abs(T - mean).max()) / mean,
        "a µm": half * 1e6,
        "area/extent": area / (reference * depth),
        "p max/p0": float(last.pressure.max()) / peak,
        "N": last.row.normal_resultant,
        "T points": abs(last.along) / abs(last.row.tangential_force),
    }


def _depth(setup: Setup, outcome: Outcome, found: Extent) -> float:
    """Length of the contact across the section, m."""
    return np.pi * (found.left + found.right) if setup.ring else outcome.model.thickness
