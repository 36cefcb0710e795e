"""Contacts that are hard to solve: what they cost, and whether the forces are right at the end.

``ridge``: a block pressed and slid over a ridge of 10 or 15 degrees, whose facets are coarse, as in
``tests/app/simulation/test_recontact.py``; negative angles are grooves. ``kinks``: a film below a
block that passes kinks of 10 degrees, and ``rolling-kinks`` one below a rolling polygon.
``overhang``: a slave that is slid half past the master's end. ``touch``: first touch of a body of
ν = 0.4999, by displacement.
``blocks``: block-slide at mesh levels, with its forces against those of other codes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.comparison import level_options
from benchmarks.curved_contact.runs import (
    FRICTIONLESS,
    MM,
    STIFF,
    Outcome,
    case_text,
    film,
    moved,
    run,
    soft,
    stages,
)
from benchmarks.curved_contact.shapes import ridge, tool_on_rubber
from benchmarks.verify.contact import REFERENCE
from benchmarks.verify.result import CASES
from tribox.app.case.reading import load_case


@dataclass(frozen=True, slots=True)
class Setup:
    """One row of the table.

    Attributes:
        kind: see above; value: degrees, ν or the mesh level; mu: coefficient of friction.
    """

    kind: str = "ridge"
    value: float = 10.0
    mu: float = 0.2


BASE = QUICK = Setup()
ROWS = (
    *(Setup("ridge", d, mu) for d, mu in ((10, 0.2), (10, 0.5), (15, 0.5), (-10, 0.2), (2, 0.2))),
    Setup("kinks", 10.0, 0.0),
    Setup("kinks", -10.0, 0.0),
    Setup("rolling-kinks", 10.0, 0.0),
    Setup("overhang", 0.0, 0.2),
    Setup("overhang", 0.0, 0.5),
    *(Setup("touch", nu, 0.0) for nu in (0.45, 0.495, 0.4999)),
    Setup("touch-round-slave", 0.4999, 0.0),
    *(Setup("blocks", level, 0.2) for level in (1, 2, 4)),
)

BLOCK = """
title = "block over an edge"
[geometry]
mesh = "mesh.msh"
thickness = "1 mm"
[bodies.elastomer]
material = "neo-hookean"
E = "5 MPa"
nu = 0.45
[bodies.aluminium]
material = "neo-hookean"
E = "70 GPa"
nu = 0.33
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
{contact}
[[boundary]]
surface = "bottom"
displacement = {{ x = 0, y = 0 }}
[[boundary]]
surface = "top"
displacement = {{ x = "driven", y = [["0 s", 0], ["1 s", "-0.05 mm"]] }}
[[stage]]
name = "press"
duration = "1 s"
steps = 4
rate_dependent = false
[[stage]]
name = "slide"
velocity = "{way} mm/s"
duration = "1 s"
steps = 28
[output]
figures = false
"""
COULOMB = 'friction = {{ law = "coulomb", mu = {mu} }}'
FILM = film(MM)


def _ridge(setup: Setup, scratch: Path, overrides: Sequence[str]) -> Outcome:
    ridge(scratch / "mesh.msh", setup.value)
    contact = FILM if setup.kind == "kinks" else COULOMB.format(mu=setup.mu)
    return run(BLOCK.format(contact=contact, way=1.4), scratch, overrides)


def _overhang(setup: Setup, scratch: Path, overrides: Sequence[str]) -> Outcome:
    path = CASES / "block-slide.toml"
    options = [
        'boundary.1.displacement.x=[["1 s", 0], ["4 s", "1.2 mm"]]',
        "stage.1.steps=60",
        f"contact.0.friction.mu={setup.mu}",
    ]
    return run(path.read_text(encoding="utf-8"), scratch, [*options, *overrides])


def _rolling(setup: Setup, scratch: Path, overrides: Sequence[str]) -> Outcome:
    """A polygon of kinks of so many degrees rolls on rubber: its top turns as its centre moves."""
    size = 2.0 * 5 * MM * math.sin(math.radians(0.5 * setup.value))
    # A coarse polygon: its apex is a corner, so that what touches first is a kink.
    tool_on_rubber(scratch / "mesh.msh", 0.05 * MM, size, 5 * MM, 4.4 * MM)
    angle = -0.2  # rad; the rubber lags a tenth behind the surface of the tool
    turned = f'rotation = {{ angle = [["1 s", 0], ["2 s", {angle}]], centre = [0, "5 mm"] }}'
    bottom, staged = moved('"driven"', "0.05 mm"), stages(5, 20, 0.9 * 5 * MM * angle)
    return run(case_text(FILM, bottom, turned, staged, rubber=soft(0.495)), scratch, overrides)


def _touch(setup: Setup, scratch: Path, overrides: Sequence[str]) -> Outcome:
    size, round_slave = 0.04 * MM, setup.kind == "touch-round-slave"
    tool_on_rubber(scratch / "mesh.msh", size, 1.3 * size, 2.4 * MM, 2.4 * MM)
    tool, rubber = (soft(setup.value), STIFF)[:: 1 if round_slave else -1]
    text = case_text(
        FRICTIONLESS, moved("0"), moved("0", "-0.05 mm"), stages(5),
        rubber=rubber, tool=tool, slave="tool" if round_slave else "rubber",
    )  # fmt: skip
    return run(text, scratch, overrides)


def _blocks(setup: Setup, scratch: Path, overrides: Sequence[str]) -> Outcome:
    path = CASES / "block-slide.toml"
    options = level_options(load_case(path), int(setup.value))[1::2]
    return run(path.read_text(encoding="utf-8"), scratch, [*options, *overrides])


KINDS: dict[str, Callable[[Setup, Path, Sequence[str]], Outcome]] = {
    "ridge": _ridge,
    "kinks": _ridge,
    "rolling-kinks": _rolling,
    "overhang": _overhang,
    "touch": _touch,
    "touch-round-slave": _touch,
    "blocks": _blocks,
}


def row(setup: Setup, scratch: Path, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    """Solve one problem; its row of the table."""
    outcome = KINDS[setup.kind](setup, scratch, overrides)
    out: dict[str, Any] = {"kind": setup.kind, "value": setup.value, "mu": setup.mu}
    out |= outcome.cost() | {"steps": len(outcome.frames)}
    if not outcome.frames:
        return out | {"failure": outcome.failure}
    last = outcome.frames[-1]
    out |= {"time": last.row.time, "N": last.row.normal_resultant, "T": last.along}
    out |= {"T/∫p": last.along / last.load if last.load else float("nan")}
    if setup.kind == "blocks" and int(setup.value) in REFERENCE:
        pressed, *end = REFERENCE[int(setup.value)]
        found = (outcome.stage("press")[-1].row.normal_force, last.row.drag, last.row.normal_force)
        wrong = np.array(found) / np.array([pressed, *end]) - 1.0
        out["forces off by %"] = " ".join(f"{100 * w:+.3f}" for w in wrong)
    return out | ({"failure": outcome.failure} if outcome.failure else {})
