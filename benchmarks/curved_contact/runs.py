"""The case of a round tool on rubber, one run with every step photographed, tables of rows."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mpi4py import MPI

from benchmarks.curved_contact.surfaces import Frame, Photographer
from tribox.app.build.model import Model, build_model
from tribox.app.case.reading import load_case
from tribox.app.errors import SolutionError
from tribox.app.simulation.simulation import Simulation
from tribox.geometry.surfaces.facets import Floats

MM = 1e-3
STRESS, FILM = 3200.0, 250e-9  # Pa, η V/D; m
STIFF = 'material = "hencky"\nE = "70 GPa"\nnu = 0.33\ndensity = 2700'
FRICTIONLESS = 'friction = { law = "frictionless" }'
SMOOTH = 'smoothing_angle = "30 deg"\n'
CASE = """
title = "round body on rubber"
[geometry]
mesh = "mesh.msh"
{section}
[bodies.tool]
{tool}
[bodies.rubber]
{rubber}
[[contact]]
slave = "{slave}_contact"
master = "{master}_contact"
{contact}
[[boundary]]
surface = "bottom"
{bottom}
[[boundary]]
surface = "top"
{top}
{stages}
[output]
figures = false
"""


def soft(nu: float) -> str:
    """Rubber."""
    return f'material = "neo-hookean"\nE = "10 MPa"\nnu = {nu!r}\ndensity = 1100'


def film(speed: float) -> str:
    """A film that carries everything and is Newtonian, with the same stress at all speeds, m/s."""
    return (
        f"film = {{ thickness = {FILM} }}\n"
        f'friction = {{ law = "friction-map", mu_s = 0.1, K_T = "1e11 Pa/m", '
        f"eta_b = {STRESS * FILM / speed:.12g}, D_max = {FILM}, alpha = 1.0, "
        f'V_star = "1 mm/s", V_star_at = {FILM} }}'
    )


def moved(x: str, y: str = "0") -> str:
    """A displacement by components, ``y`` reached within the first second."""
    down = y if y == "0" else f'[["0 s", 0], ["1 s", "{y}"]]'
    return f"displacement = {{ x = {x}, y = {down} }}"


def stages(press: int, slide: int = 0, velocity: float = 0.0, duration: float = 1.0) -> str:
    """Pressed in so many steps, then slid in so many, with a velocity, m/s, for so long, s."""
    text = f'[[stage]]\nname = "press"\nduration = "1 s"\nsolver = "implicit"\nsteps = {press}\n'
    if slide:
        text += 'rate_dependent = false\n[[stage]]\nname = "slide"\n'
        text += f"velocity = {velocity}\nduration = {duration}\nsteps = {slide}\n"
    return text


def case_text(
    contact: str,
    bottom: str,
    top: str,
    staged: str,
    *,
    rubber: str,
    tool: str = STIFF,
    slave: str = "rubber",
    section: str = 'thickness = "1 mm"',
) -> str:
    """A case file; what is given are the lines of its tables."""
    master = {"rubber": "tool", "tool": "rubber"}[slave]
    return CASE.format(
        section=section, tool=tool, rubber=rubber, slave=slave, master=master, contact=contact,
        bottom=bottom, top=top, stages=staged,
    )  # fmt: skip


@dataclass(slots=True)
class Outcome:
    """A run, whole or as far as it came.

    Attributes:
        model: what was solved; reference: (n, i), m, undeformed places of each surface's nodes.
        frames: its steps; cuts: failed attempts; seconds: wall time of the steps.
        failure: why it stopped early; empty if it did not.
    """

    model: Model
    reference: dict[str, Floats] = field(default_factory=dict)
    frames: list[Frame] = field(default_factory=list)
    cuts: int = 0
    seconds: float = 0.0
    failure: str = ""

    def stage(self, name: str) -> list[Frame]:
        """The steps of one stage."""
        return [frame for frame in self.frames if frame.row.stage == name]

    def cost(self) -> dict[str, Any]:
        """Newton iterations of each stage, those of the step that took most, cuts, seconds."""
        stages = dict.fromkeys(frame.row.stage for frame in self.frames)
        counts = [sum(f.row.newton_iterations for f in self.stage(name)) for name in stages]
        return {
            "newton": "+".join(map(str, counts)),
            "most": max((f.row.newton_iterations for f in self.frames), default=0),
            "cuts": self.cuts,
            "seconds": self.seconds,
        }


def run(text: str, scratch: Path, overrides: Sequence[str] = ()) -> Outcome:
    """Solve a case whose meshes lie in ``scratch``; a run that stops early is an outcome too."""
    path = scratch / "case.toml"
    path.write_text(text, encoding="utf-8")
    model = build_model(load_case(path, overrides), MPI.COMM_SELF)
    simulation, observer, failure = Simulation(model), Photographer(), ""
    began = time.perf_counter()
    try:
        simulation.run(observer)
    except SolutionError as error:
        failure = str(error)
    seconds = time.perf_counter() - began
    return Outcome(model, observer.reference, observer.frames, observer.cuts, seconds, failure)


# -- Which rows are asked for, and tables of what was found ----------------------------------------

Row = Mapping[str, Any]


def chosen(base: Any, axes: Mapping[str, Sequence[Any]], given: Mapping[str, str]) -> list[Any]:
    """The setups to be run: a product over given values, or each axis by itself from the base.

    ``given``: "value,value" by field; any field may be given.

    Raises:
        ValueError: there is no such field, or a value is of another kind than the base's.
    """
    if given:
        values = {name: [_read(base, name, v) for v in t.split(",")] for name, t in given.items()}
        products = itertools.product(*values.values())
        return [replace(base, **dict(zip(values, some, strict=True))) for some in products]
    out = [base]
    for name, some in axes.items():
        out += [s for value in some if (s := replace(base, **{name: value})) not in out]
    return out


def _read(base: Any, name: str, text: str) -> Any:
    present = getattr(base, name, None)
    if present is None:
        raise ValueError(f"no axis {name!r}; choose from {', '.join(base.__dataclass_fields__)}")
    if isinstance(present, bool):
        if text not in ("yes", "no"):
            raise ValueError(f"{name}: yes or no, found {text!r}")
        return text == "yes"
    return type(present)(text)


def cell(value: Any) -> str:
    """One entry of a table."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def markdown(rows: Sequence[Row]) -> Iterator[str]:
    """Lines of a table with all columns, in the order in which they first stand."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    yield "| " + " | ".join(name.replace("|", "/") for name in names) + " |"
    yield "|---" * len(names) + "|"
    for row in rows:
        yield "| " + " | ".join(cell(row.get(name, "")).replace("|", "/") for name in names) + " |"
