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

from benchmarks.curved_contact.runs import Frame, Outcome, run
from benchmarks.curved_contact.shapes import tool_on_rubber
from tribox.app.verify.curved import Extent, extent, slip_integral

MM = 1e-3
RADIUS = 5 * MM
STRESS, FILM = 3200.0, 250e-9  # Pa, η V/D; m
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

    @property
    def eta(self) -> float:
        """Pa s, such that the stress is the same at all speeds."""
        return STRESS * FILM / self.speed


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

CASE = """
title = "film over a round tool"
[geometry]
mesh = "mesh.msh"
{section}

[bodies.tool]
{tool}
density = 2700
[bodies.rubber]
material = "neo-hookean"
E = "10 MPa"
nu = {nu}
density = 1100

[[contact]]
slave = "{slave}_contact"
master = "{master}_contact"
penalty_factor = {factor}
{smoothing}
film = {{ thickness = {film} }}
[contact.friction]
law = "friction-map"
mu_s = 0.1
K_T = "1e11 Pa/m"
eta_b = {eta}
D_max = {film}
alpha = 1.0
V_star = "1 mm/s"
V_star_at = {film}

[[boundary]]
surface = "{fixed}"
displacement = {{ x = 0, y = 0 }}
[[boundary]]
surface = "{moved}"
displacement = {{ x = "driven", y = [["0 s", 0], ["1 s", "{press} mm"]] }}

[[stage]]
name = "press"
duration = "1 s"
steps = 5
rate_dependent = false
solver = "implicit"
[[stage]]
name = "slide"
velocity = {speed}
duration = {duration}
steps = {steps}
{slide}
[output]
figures = false
"""
TOOLS = {
    "aluminium": 'material = "hencky"\nE = "70 GPa"\nnu = 0.33',
    "rubber": 'material = "neo-hookean"\nE = "10 MPa"\nnu = {nu}',
}
EXPLICIT = 'solver = "explicit"\nramp = {ramp}'
SCALING = """
[solver]
kind = "explicit"
mass_scaling = {{ kind = "limiting", step = "{step} s" }}
"""


def case_of(setup: Setup) -> str:
    """The case file."""
    duration = setup.slide * MM / setup.speed
    explicit, tool = setup.solver == "explicit", setup.moves == "tool"
    text = CASE.format(
        section='section = "axisymmetric"' if setup.ring else 'thickness = "1 mm"',
        tool=TOOLS[setup.tool].format(nu=setup.nu),
        nu=setup.nu,
        slave=setup.slave,
        master={"rubber": "tool", "tool": "rubber"}[setup.slave],
        factor=30.0 * setup.factor,
        fixed="bottom" if tool else "top",
        moved="top" if tool else "bottom",
        press=-0.05 if tool else 0.05,
        smoothing='smoothing_angle = "30 deg"' if setup.smooth else "",
        film=FILM,
        eta=setup.eta,
        speed=setup.speed,
        duration=duration,
        steps=setup.steps,
        slide=EXPLICIT.format(ramp=0.4 * duration) if explicit else "",
    )
    return text + (SCALING.format(step=3e-10 * setup.size * 5.0) if explicit else "")


def mesh(path: Path, size: float, ring: float = 0.0, tool_zone: float = 3 * MM) -> None:
    """Write the mesh.

    All in m: facets of the rubber, the ring's axis, width of the tool's surface that may touch.
    """
    tool_on_rubber(
        path,
        radius=RADIUS,
        size=size,
        tool_size=1.3 * size,
        zone=2 * round(2.2 * MM / size) * size,
        tool_zone=tool_zone,
        width=10 * MM,
        height=2 * MM,
        axis=ring,
    )


def solve(setup: Setup, scratch: Path, overrides: tuple[str, ...]) -> Outcome:
    """Mesh and run it."""
    mesh(scratch / "mesh.msh", SHARE * setup.size * 1e-6, setup.ring * MM)
    return run(case_of(setup), scratch, overrides)


def contact_of(outcome: Outcome, frame: Frame) -> Extent:
    """Where the bodies touch after a step."""
    return extent(
        frame.nodes["rubber_contact"],
        frame.nodes["tool_contact"],
        outcome.reference["rubber_contact"],
        RADIUS,
    )


def row(setup: Setup, scratch: Path, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    """Solve one problem; its row of the table."""
    outcome = solve(setup, scratch, overrides)
    out = asdict(setup)
    out |= iterations(outcome)
    slid = outcome.stage("slide")
    if outcome.failure or len(slid) < 2:
        return out | {"failure": outcome.failure}
    try:
        return out | measured(setup, outcome, slid)
    except ValueError as error:
        return out | {"failure": str(error)}


def iterations(outcome: Outcome) -> dict[str, Any]:
    """What the run cost."""
    return {
        "newton": f"{outcome.iterations('press')}+{outcome.iterations('slide')}",
        "most": outcome.most,
        "cuts": outcome.cuts,
        "seconds": outcome.seconds,
    }


def measured(setup: Setup, outcome: Outcome, slid: list[Frame]) -> dict[str, Any]:
    """Numbers of the last half of the slide."""
    pairs = list(pairwise(slid))[(len(slid) - 1) // 2 :]
    plain, true, ends, drag = [], [], [], []
    for before, now in pairs:
        found = contact_of(outcome, now)
        depth = _depth(setup, outcome, found)
        ends.append(found)
        drag.append(abs(now.row.tangential_force))
        plain.append(STRESS * found.length * depth)
        true.append(setup.eta / FILM * abs(_slip(before, now, found)) * depth)
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
    if setup.ring:
        return np.pi * (found.left + found.right)
    return outcome.model.thickness


def _slip(before: Frame, now: Frame, found: Extent) -> float:
    names = ("rubber_contact", "tool_contact")
    new, old = (tuple(f.nodes[n] for n in names) for f in (now, before))
    return slip_integral(new, old, found, now.row.time - before.row.time)  # type: ignore[arg-type]
