"""The tables of docs/verification.md, from runs made here.

From the repository: ``python3 -m benchmarks.verification sfa`` (steady points of the sliding test
against the closed form; ``--results DIR`` reads a finished sweep instead of running it),
``... area-ratio`` (the part of the difference that the area ratio of the sliding surface explains),
``... blocks`` (block-slide against the reference forces), ``... penalty`` (its forces as the
penalty grows) and ``... cylinders`` (line contact as mesh, penalty and stiffness of stick change).
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.comparison import level_options
from benchmarks.verify.contact import REFERENCE, Profile, press, pressure_checks, traction_checks
from benchmarks.verify.report import percent
from benchmarks.verify.result import Check
from tribox.app.case.generators import TwoCylindersGeometry
from tribox.app.case.reading import load_case
from tribox.app.results.reading import read_table
from tribox.app.run.run import run_case
from tribox.forms.closed_forms import (
    Floats,
    effective_viscosity,
    film_fraction,
    threshold_speed,
)

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True, slots=True)
class SteadyPoint:
    """One thickness at one velocity, computed and by the closed form.

    Attributes:
        film: m; speed: m/s; star: m/s, V*; mu: computed μ(d); alpha: of the closed form.
        computed, closed: Pa s, effective viscosity.
    """

    film: float
    speed: float
    star: float
    mu: float
    alpha: float
    computed: float
    closed: float

    @property
    def error(self) -> float:
        """Relative, with sign."""
        return self.computed / self.closed - 1.0


def steady_points(directory: Path) -> Iterator[SteadyPoint]:
    """The steady points of a finished sweep of ``cases/sfa.toml``."""
    case = load_case(directory / "case.toml")
    rows = read_table(directory / "sweep.csv")
    for label, single in case.sweep_cases():
        contact = single.contact[0]
        parameters = contact.map
        assert parameters is not None and contact.film is not None
        for row in rows:
            if row["label"] == label and row["steady"] == 1.0:
                film = contact.film.thickness
                speed = abs(row["velocity"])
                pressure = row["normal_force"] / row["contact_area"]
                closed = effective_viscosity(speed, film, pressure, row["mu"], parameters)
                yield SteadyPoint(
                    film=film,
                    speed=speed,
                    star=float(threshold_speed(film, parameters)),
                    mu=row["mu"],
                    alpha=float(film_fraction(speed, film, parameters)),
                    computed=row["effective_viscosity"],
                    closed=float(closed),
                )


def sliding_tables(directory: Path) -> Iterator[str]:
    """Markdown tables of the sliding test: all points, largest errors and course by thickness."""
    points = list(steady_points(directory))
    yield "| D (nm) | V (m/s) | V/V* | μ | computed η_eff (Pa s) | closed form | error |"
    yield "|---|---|---|---|---|---|---|"
    for p in points:
        yield (
            f"| {p.film * 1e9:.0f} | {p.speed:.3g} | {p.speed / p.star:.2g} | {p.mu:.5f} "
            f"| {p.computed:.6g} | {p.closed:.6g} | {100 * p.error:+.3f} % |"
        )
    yield ""
    yield "| D (nm) | points | largest error | below V* | above V* | penetration (nm) | over D |"
    yield "|---|---|---|---|---|---|---|"
    parts = [
        (label, single.contact[0].film)
        for label, single in load_case(directory / "case.toml").sweep_cases()
    ]
    for label, layer in parts:
        assert layer is not None
        some = [p for p in points if p.film == layer.thickness]
        errors = np.array([p.error for p in some])
        viscous = np.array([p.alpha == 1.0 for p in some])
        history = read_table(directory / label / "history.csv")
        deepest = max(row["max_penetration"] for row in history)
        yield (
            f"| {layer.thickness * 1e9:.0f} | {len(some)} | {_largest(errors)} "
            f"| {_largest(errors[~viscous])} | {_largest(errors[viscous])} "
            f"| {deepest * 1e9:.2f} | {deepest / layer.thickness:.3f} |"
        )
    yield ""
    yield "| D (nm) | steps | attempts | Newton per step | energy error over external work |"
    yield "|---|---|---|---|---|"
    for label, layer in parts:
        summary = json.loads((directory / label / "summary.json").read_text(encoding="utf-8"))
        yield (
            f"| {layer.thickness * 1e9 if layer else 0.0:.0f} | {summary['steps']} "
            f"| {summary['attempts']} | {summary['newton_iterations'] / summary['steps']:.2f} "
            f"| {_unbalanced(read_table(directory / label / 'history.csv')):.1e} |"
        )


def _unbalanced(rows: Sequence[dict[str, Any]]) -> float:
    """The energy not accounted for at its largest, over the largest external work."""
    error, work = (max(abs(row[key]) for row in rows) for key in ("energy_error", "external_work"))
    return float(error / work)


def _largest(errors: Floats) -> str:
    return f"{100.0 * np.max(np.abs(errors)):.3f} %" if len(errors) else "–"


def area_ratio_lines() -> Iterator[str]:
    """Mean area ratio of the sliding surface, where the film carries all.

    The film's stress is per current area and the viscosity is reported with the reference area, so
    a steady viscous point lies above eta_b by the area ratio of the closed surface.
    """
    keys = ['contact.0.film.thickness="250 nm"', 'stage.1.velocities=["1e-3 m/s"]']
    case = load_case(ROOT / "cases" / "sfa.toml", [*keys, "output.figures=false"])
    with tempfile.TemporaryDirectory() as scratch:
        simulation = run_case(case, Path(scratch) / "run", quiet=True)
    (term,) = simulation.model.problem.contacts
    (trial,) = simulation.model.problem.trials
    closed = np.where(trial.pressure > 0.0, term.surface.slave.weight, 0.0)
    mean = float(closed @ term.state.area_ratio / closed.sum())
    law = case.contact[0].map
    assert law is not None
    ratio = simulation.rows[-1].effective_viscosity / law.eta_b
    yield f"mean da/dA of the closed surface {mean:.6f}; computed eta_eff / eta_b {ratio:.6f}"


def tribox(case: str, out: Path, options: Sequence[str]) -> None:
    """Run a case of the repository into ``out``.

    Raises:
        subprocess.CalledProcessError: the run failed.
    """
    command = [sys.executable, "-m", "tribox", "run", f"cases/{case}.toml", "--out", str(out)]
    subprocess.run([*command, *options], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)


def block_row(name: str, level: int, options: Sequence[str], where: Path) -> str:
    """Run the block-slide problem; one row of Markdown with forces and errors."""
    out, case = where / name, load_case(ROOT / "cases" / "block-slide.toml")
    refined = level_options(case, level)
    tribox("block-slide", out, [*refined, "--set", "output.figures=false", *options])
    rows = read_table(out / "history.csv")
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    pressed = [row for row in rows if row["stage"] == "press"][-1]
    forces = (pressed["normal_force"], rows[-1]["drag"], rows[-1]["normal_force"])
    values = " | ".join(
        f"{force:.5f} ({100.0 * (force / exact - 1.0):+.2f} %)"
        for force, exact in zip(forces, REFERENCE[level], strict=True)
    )
    deepest = max(row["max_penetration"] for row in rows)
    return (
        f"| {name} | {values} | {deepest * 1e6:.3g} | {summary['newton_iterations']} "
        f"| {summary['attempts']} | {_unbalanced(rows):.1e} |"
    )


BLOCK_HEAD = (
    "| {} | normal, pressed (N) | tangential, end (N) | normal, end (N) | penetration (µm) "
    "| Newton | attempts | energy error |\n" + "|---" * 8 + "|"
)


def _errors(profile: Profile, checks: Sequence[Check]) -> str:
    cells = (percent(check.error) for check in checks)
    return f"{profile.exact.half_width / profile.size:.0f} | {' | '.join(cells)} |"


def cylinder_tables() -> Iterator[str]:
    """Markdown tables of line contact: mesh, meshes that do not match, stiffness of stick."""
    pressure = "elements over a | a | p0 | largest p | rms | off the edges |"
    yield f"| contact_size (µm) | {pressure}\n" + "|---" * 7 + "|"
    for size in (28, 20, 14, 10, 7):
        options = [f"geometry.contact_size={size} um"]
        options.append(f"geometry.block.contact_size={1.3 * size} um")
        profile = press("hertz-line", options)
        yield f"| {size} | {_errors(profile, pressure_checks(profile))}"
    yield f"\n| meshes | penalty_factor | {pressure}\n" + "|---" * 8 + "|"
    for name, below in (("matching", 10), ("not matching", 13)):
        for factor in (30, 10, 3, 1):
            options = [f"contact.0.penalty_factor={factor}"]
            options.append(f"geometry.lower.contact_size={below} um")
            profile = press("hertz-two-cylinders", options)
            yield f"| {name} | {factor} | {_errors(profile, pressure_checks(profile))}"
    head = "elements over a | c | c by regime | rms | off the edges |"
    yield f"\n| K_T h/G | {head}\n" + "|---" * 6 + "|"
    case = load_case(ROOT / "cases" / "cattaneo-mindlin.toml")
    assert isinstance(case.geometry, TwoCylindersGeometry)
    unit = case.bodies["elastomer"].shear_modulus / case.geometry.contact_size
    for factor in (1, 3, 10, 30, 100):
        options = [f"contact.0.friction.K_T={factor * unit}"]
        profile = press("cattaneo-mindlin", options)
        yield f"| {factor} | {_errors(profile, traction_checks(profile))}"


def main() -> None:
    """Print the chosen tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("sfa", "area-ratio", "blocks", "penalty", "cylinders"))
    parser.add_argument("--results", type=Path, help="a finished sweep of cases/sfa.toml")
    parser.add_argument("--level", type=int, action="append", choices=(1, 2, 4))
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        where = Path(scratch)
        if chosen.what == "sfa":
            directory = chosen.results or where / "sfa"
            if chosen.results is None:
                tribox("sfa", directory, [])
            print("\n".join(sliding_tables(directory)))
        elif chosen.what == "area-ratio":
            print("\n".join(area_ratio_lines()))
        elif chosen.what == "cylinders":
            for line in cylinder_tables():
                print(line, flush=True)
        elif chosen.what == "blocks":
            print(BLOCK_HEAD.format("level"))
            for level in chosen.level or (1, 2):
                print(block_row(str(level), level, [], where), flush=True)
        else:
            print(BLOCK_HEAD.format("penalty_factor"))
            for factor in (1, 3, 10, 30, 100, 300, 1000, 3000):
                option = ["--set", f"contact.0.penalty_factor={factor}"]
                print(block_row(str(factor), 1, option, where), flush=True)


if __name__ == "__main__":
    main()
