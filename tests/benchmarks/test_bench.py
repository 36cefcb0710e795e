"""``tribox bench``: what it runs, what it measures in a run, and the tables it makes of it."""

from pathlib import Path

import numpy as np
import pytest

import tribox
from benchmarks import probe as bench_probe
from benchmarks.bench import CONTACT, PARTS, Measured, Options, measure, run_bench, tables
from benchmarks.comparison import Job
from benchmarks.explicit import contact_table, kernel_table, step_table
from benchmarks.law_figures import (
    FLOWS,
    draw_law,
    film_stress,
    traction_over_pressure,
    velocity_jumps,
)
from tribox.app.errors import InputError

SHORT = ["stage.0.steps=2", "stage.1.steps=8", "output.figures=true"]


@pytest.fixture(scope="module")
def short(block, tmp_path_factory):
    path = tmp_path_factory.mktemp("bench") / "short.toml"
    path.write_text(block, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def measured(short) -> Measured:
    words = [word for option in SHORT for word in ("--set", option)]
    return measure(Job("short", 1, (str(short), *words)))


def made_up(level: int = 1, name: str = "a run", **changes) -> Measured:
    """A run whose parts took a second each, and contact in all half a second."""
    seconds = dict.fromkeys(PARTS, 1.0) | dict.fromkeys(CONTACT, 0.5 / len(CONTACT))
    values = {"dofs": 100, "steps": 4, "attempts": 5, "iterations": 20, "gross": 2}
    values |= {"command": 20.0, "seconds": seconds, "factorisation": 0.05, "memory": 50.0}
    values["calls"] = {"solid tangent": 10, "merge into the residual": 40, "solve": 25}
    return Measured(name=name, level=level, **(values | changes))


def cells(lines: list[str], row: str) -> list[str]:
    (line,) = [line for line in lines if line.startswith(f"| {row} |")]
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


def test_a_case_without_newton_iterations_is_refused():
    case = Path(tribox.__file__).with_name("cases") / "impact.toml"
    with pytest.raises(InputError, match=r"impact\.toml: all stages are explicit.*--against"):
        run_bench(["1"], Options(case, None, 1))


def test_tables_state_shares_ratios_and_growth():
    lines = list(tables([made_up(1), made_up(2, dofs=400, memory=75.0)]))
    assert cells(lines, "Newton") == ["20", "20"]
    assert cells(lines, "tangents factorised") == ["10", "10"]
    assert cells(lines, "linear solves") == ["25", "25"]
    assert cells(lines, "residuals evaluated") == ["40", "40"]
    assert cells(lines, "without set-up (s)") == ["18.00", "18.00"]
    assert cells(lines, "solve") == ["1.000 (5 %)", "1.000 (5 %)"]
    # Solids 3, factorisation 2 and solve 1 s; contact 0.5, pattern 1 and the rest 1 s more.
    assert cells(lines, "whole iteration (ms)") == ["425.00"] * 2
    whole = "**whole / (solid assembly + factorisation + solve)**"
    assert cells(lines, whole) == [f"**{8.5 / 6:.3f}**"] * 2
    assert cells(lines, "**contact / one solid tangent assembly**") == ["**0.25**"] * 2
    assert cells(lines, "whole / one MUMPS factorisation") == ["8.50"] * 2
    growth = lines[lines.index("Growth from level to level:") :]
    assert cells(growth, "dofs") == ["× 4.00"]
    assert cells(growth, "peak memory") == ["× 1.50"]


def test_every_probe_is_met_in_a_run(measured):
    """A part nobody calls any more would read as one that costs nothing."""
    expected = {*bench_probe.FRAME.values(), *bench_probe.PROBES.values(), "law"}
    expected |= {"numeric factorisation", "symbolic factorisation", "solve", "rest of contact"}
    assert {part for part in expected if not measured.calls.get(part)} == set()
    assert all(measured.seconds[part] > 0.0 for part in expected)


def test_bench_is_a_command(tribox):
    done = tribox("bench", "no-level", process=True)
    assert done.returncode == 2
    assert done.stderr.strip() == (
        'tribox: bench: "no-level" is neither a mesh level (1 to 64) nor one of: law, explicit'
    )


# -- The figures of the law: what they show, and that they are drawn -------------------------------


def test_the_literal_rule_takes_energy_from_nowhere_and_the_consistent_one_does_not():
    literal, consistent = velocity_jumps("literal"), velocity_jumps("consistent")
    # At each return below V*: half (1 - alpha) K_T (mu p/K_T)^2, times 3 of the 4 cycles.
    gained = 0.5 * 0.5 * 1e12 * (0.1 * 3e6 / 1e12) ** 2
    assert consistent.least >= 0.0
    assert np.isclose(literal.least, -gained, rtol=0.1)
    assert (np.diff(consistent.dissipated) >= 0.0).all()
    assert (np.diff(literal.dissipated) < -0.9 * gained).sum() == 3


def test_the_film_flows_as_its_options_say():
    speed = np.geomspace(1e-4, 1.0, 50)
    plain, limit, thin, thick = (film_stress(speed, **flow) for flow in FLOWS.values())
    np.testing.assert_allclose(plain, 0.8 * speed / 250e-9)
    assert (limit < 8e4 * (1 + 1e-12)).all() and limit[-1] > 7.9e4
    assert (thin < plain).all() and np.allclose(thick, plain * np.exp(0.9))
    pressure = np.array([1e-9, 1e-3])
    assert traction_over_pressure(0.0, pressure).min() > 1e3
    assert traction_over_pressure(1e4, pressure).max() < 1.0


def test_every_figure_is_drawn(tmp_path, drawn_figures):
    files = draw_law(tmp_path / "figures")
    assert len(files) == 3 and all(file.stat().st_size > 1e4 for file in files)


# -- The tables of explicit timings, on meshes that cost nothing -----------------------------------


def test_parts_of_explicit_steps_are_measured():
    assert len(list(kernel_table(cells=6))) == 2 + 6
    assert len(list(contact_table(0.2))) == 2 + 2
    head, _, *rows = step_table((0.2,))
    assert len(rows) == 2
    for row in rows:
        found = dict(zip(cells_of(head), cells_of(row), strict=True))
        parts = ("assembly", "contact", "time integration")
        assert sum(float(found[part].rstrip("% ")) for part in parts) == pytest.approx(100, abs=3)


def cells_of(line):
    return [cell.strip() for cell in line.strip("|").split("|")]
