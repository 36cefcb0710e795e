"""Tables and figures of docs/explicit.md, from runs made here.

From the repository: ``python3 -m benchmarks.explicit_verification agree`` (the sliding test by both
solvers, with the overlaid histories), ``... speed`` (the same with mass scaled for lower speeds)
and ``... scaling`` (how much mass is too much).
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.figures.style import COLOURS, DISPLACEMENT, FRICTION_FORCE, STYLE, columns, save
from tribox.app.results.reading import read_table
from tribox.app.run.run import run_case
from tribox.app.simulation.simulation import Simulation

ROOT = Path(__file__).parents[1]
CASE = ROOT / "cases" / "sfa-explicit.toml"
# The velocities of the case, each for a fixed way (m) in rows of 1 um, so that both solvers' rows
# lie at the same displacements.
WAYS = {"0.05 m/s": 24e-6, "0.1 m/s": 24e-6, "0.2 m/s": 36e-6}
# A layer of 2 mm, at one velocity.
SMALL = (
    "geometry.upper.width=2 mm",
    "geometry.upper.elements=[20, 2]",
    "geometry.lower.width=3 mm",
    "geometry.lower.elements=[25, 3]",
    "output.figures=false",
)
SPEED, STEP, DAMPING, RAMP = 0.05, 40e-9, 1e6, 20e-6  # of the case
FILMS = {"frictional": "10 nm", "mixed": "30 nm", "viscous": "180 nm"}


def draw_overlay(
    runs: dict[str, tuple[list[dict[str, Any]], list[dict[str, Any]]]], path: Path
) -> None:
    """Draw the friction force of runs made by both solvers over the driven displacement.

    An explicit row is a mean over its interval and is drawn at the middle of it.

    ``runs``: by what to call them, rows of the implicit history (dots) and the explicit (a line).
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(7, 4.4))
        axes = figure.subplots()
        for number, (label, (implicit, explicit)) in enumerate(runs.items()):
            colour = COLOURS[number % len(COLOURS)]
            at, force, speed = columns(
                implicit, "driven_displacement", "friction_force", "velocity"
            )
            driven = np.abs(speed) > 0.0
            axes.semilogy(at[driven] * 1e6, force[driven], "o", ms=4, mfc="none", color=colour)
            at, force, speed = columns(
                explicit, "driven_displacement", "friction_force", "velocity"
            )
            middle, driven = 0.5 * (at[1:] + at[:-1]), np.abs(speed[1:]) > 0.0
            axes.semilogy(middle[driven] * 1e6, force[1:][driven], color=colour, label=label)
        axes.plot([], [], "o", color="0.4", mfc="none", label="implicit")
        axes.plot([], [], "-", color="0.4", label="explicit")
        axes.set_xlabel(f"driven {DISPLACEMENT.name} (µm)")
        axes.set_ylabel(FRICTION_FORCE.label())
        axes.legend(fontsize=8)
        save(figure, path)


def run(case: Case) -> Simulation:
    """Run one case into a temporary directory."""
    with tempfile.TemporaryDirectory() as scratch:
        return run_case(case, Path(scratch) / "out", quiet=True)


def load_steps(rows: Sequence[dict[str, Any]]) -> dict[float, dict[str, Any]]:
    """The last row at each velocity."""
    return {row["velocity"]: row for row in rows if row["velocity"]}


def fixed_ways(kind: str) -> str:
    """An override that holds each velocity of the case for a fixed way, with one solver."""
    press = load_case(CASE).stage[0].model_dump(mode="json", exclude_unset=True)
    stages = [press]
    for text, way in WAYS.items():
        speed = float(text.split()[0])
        stages.append(
            {
                "name": f"slide {text}",
                "solver": kind,
                "velocity": text,
                "duration": way / speed,
                "steps": round(way / 1e-6),
                "ramp": RAMP,
            }
        )
    entries = (", ".join(f"{k} = {_toml(v)}" for k, v in stage.items()) for stage in stages)
    return "stage=[" + ", ".join(f"{{ {entry} }}" for entry in entries) + "]"


def _toml(value: object) -> str:
    return json.dumps(value)


def agreement_lines(figure: Path) -> Iterator[str]:
    """Steady forces of ``cases/sfa-explicit.toml`` by both solvers; draws their histories."""
    yield "| D | V (m/s) | film share | implicit T (N) | explicit T (N) | difference |"
    yield "|---|---|---|---|---|---|"
    pairs = {}
    explicit, implicit = (load_case(CASE, [fixed_ways(k)]) for k in ("explicit", "implicit"))
    both = zip(explicit.sweep_cases(), implicit.sweep_cases(), strict=True)
    for (label, mine), (_, theirs) in both:
        rows = []
        with tempfile.TemporaryDirectory() as scratch:
            for name, case in (("explicit", mine), ("implicit", theirs)):
                run_case(case, Path(scratch) / name, quiet=True)
                rows.append(read_table(Path(scratch) / name / "history.csv"))
        film = label.split("=")[1]
        pairs[f"D = {film}"] = (rows[1], rows[0])
        ends = [load_steps(table) for table in rows]
        for speed, row in ends[0].items():
            reference = ends[1][speed]["tangential_force"]
            off = row["tangential_force"] / reference - 1.0
            yield (
                f"| {film} | {speed:g} | {row['viscous_fraction']:.2g} | {reference:.5g} | "
                f"{row['tangential_force']:.5g} | {100 * off:+.3f} % |"
            )
    draw_overlay(pairs, figure)


def _at_speed(film: str, speed: float, stretch: float, kind: str) -> Case:
    """The small layer at one velocity, with all times of the explicit run ``stretch`` longer."""
    words = [
        *SMALL,
        f"contact.0.film.thickness={film}",
        f"stage.1.velocities=[{speed!r}]",
        f"stage.1.ramp={RAMP * SPEED / speed!r}",
        f"stage.1.solver={kind}",
        "stage.1.slip_step=0.25 um",
        "stage.1.steady_tolerance=2e-5",
        "stage.1.max_steps=400",
    ]
    if kind == "explicit":
        words += [
            f"solver.mass_scaling.step={STEP * stretch!r}",
            f"solver.damping={DAMPING / stretch!r}",
        ]
    return load_case(CASE, words).model_copy(update={"sweep": None})


def _compared(film: str, speed: float, stretch: float) -> str:
    """Cells of a table row; see ``HEAD``."""
    theirs = run(_at_speed(film, speed, stretch, "implicit")).rows
    simulation = run(_at_speed(film, speed, stretch, "explicit"))
    assert simulation.explicit is not None
    off = simulation.rows[-1].tangential_force / theirs[-1].tangential_force - 1
    [ratio] = simulation.explicit.summary()["kinetic_over_strain"].values()
    stepper = simulation.explicit.stepper
    added = stepper.masses.added / stepper.masses.original
    # An explicit row is the mean over an interval, and is compared with that of both its ends.
    found = [
        abs(mine.tangential_force - 0.5 * (a.tangential_force + b.tangential_force))
        for mine, (a, b) in zip(simulation.rows[1:], pairwise(theirs), strict=False)
        if mine.stage == "slide"
    ]
    apart = max(found) / theirs[-1].tangential_force  # over the steady force
    return (
        f"{STEP * stretch:.2g} | {added:.3g} | {ratio:.1e} | {100 * off:+.3f} % | "
        f"{100 * apart:.2g} % | {simulation.explicit.steps}"
    )


HEAD = "step (s) | mass added | kinetic/strain | steady force | history | "


def speed_lines() -> Iterator[str]:
    """Lower speeds with the mass scaled so that the number of steps stays the same."""
    yield f"| D | V (m/s) | {HEAD}steps |"
    yield "|" + 8 * "---|"
    for film in FILMS.values():
        for speed in (5e-2, 5e-3, 5e-4, 5e-6):
            yield f"| {film} | {speed:g} | {_compared(film, speed, SPEED / speed)} |"


def scaling_lines() -> Iterator[str]:
    """One speed with more and more mass."""
    yield f"| D | {HEAD}steps |"
    yield "|" + 7 * "---|"
    for film in ("10 nm", "180 nm"):
        for stretch in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0):
            yield f"| {film} | {_compared(film, SPEED, stretch)} |"


def main() -> None:
    """Print the table that was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["agree", "speed", "scaling"])
    parser.add_argument("--figure", type=Path, default=ROOT / "docs/figures/explicit_overlay.png")
    options = parser.parse_args()
    tables = {
        "agree": lambda: agreement_lines(options.figure),
        "speed": speed_lines,
        "scaling": scaling_lines,
    }
    for line in tables[options.what]():
        print(line, flush=True)


if __name__ == "__main__":
    main()
