"""Figures of the tables of a run: what is drawn, over what, on which scales."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.app.figures.made_results import (
    PAIRS,
    STEPS,
    friction_force,
    history_row,
    normal_force,
    write_rows,
)
from tribox.app.figures.history import (
    abscissa_of,
    energies_figure,
    force_displacement_figure,
    forces_figure,
)
from tribox.app.figures.stribeck import series_of, stribeck_figure
from tribox.app.results import Results, read


def lines_of(axes) -> dict[str, np.ndarray]:
    return {line.get_label(): line.get_ydata() for line in axes.lines if line.get_label()[0] != "_"}


def test_forces_and_ratio_of_each_pair_and_of_all(strip):
    normal, friction, ratio = forces_figure(strip).axes
    for number, name in enumerate(PAIRS):
        own = np.array([normal_force(s, number) for s in STEPS])
        rubbed = np.array([friction_force(s, number) for s in STEPS])
        np.testing.assert_allclose(lines_of(normal)[name], own)
        np.testing.assert_allclose(lines_of(friction)[name], rubbed)
        np.testing.assert_allclose(lines_of(ratio)[name], rubbed / own)
    both = [sum(normal_force(s, k) for k in (0, 1)) for s in STEPS]
    np.testing.assert_allclose(lines_of(normal)["all pairs"], both)
    assert normal.get_ylabel() == "normal force N (N)"
    assert friction.get_ylabel() == "friction force F_T (N)"
    assert ratio.get_ylabel() == "friction coefficient F_T/N (-)"
    assert ratio.get_xlabel() == "time t (s)"
    assert [text.get_text() for text in normal.texts] == ["slide", "press"]
    assert set(lines_of(friction)) == {"all pairs", *PAIRS}  # no resultant over several pairs
    alone = read(strip.directory)  # the other pair never presses
    contacts = alone.table("contacts")
    contacts["normal_force"][contacts["pair"] == PAIRS[1]] = 0.0
    drawn = [*lines_of(forces_figure(alone).axes[1])]
    assert drawn == [PAIRS[0], "resultant of the friction, signed"]


def test_energies_are_stacked(strip):
    [axes] = energies_figure(strip).axes
    assert {line.get_label() for line in axes.lines} >= {"not accounted for"}
    assert [area.get_label() for area in axes.collections] == [
        "strain", "interface", "dissipated", "kinetic", "damped",
    ]  # fmt: skip
    assert axes.get_ylabel() == "energy (J)"


def test_force_over_displacement_of_what_moves(strip):
    along, down = force_displacement_figure(strip).axes
    assert [axes.get_title() for axes in (along, down)] == ["punch_top", "punch_top"]
    assert (along.get_xlabel(), along.get_ylabel()) == ("displacement u_x (µm)", "force R_x (mN)")
    press, slide = along.lines
    assert slide.get_xdata() == pytest.approx([0.0, 100.0, 200.0, 300.0])
    assert slide.get_ydata() == pytest.approx([200.0, 300.0, 400.0, 500.0])
    assert press.get_label() == "press" and len(press.get_xdata()) == 2
    assert down.lines[0].get_ydata() == pytest.approx([-normal_force(s, 0) for s in (1, 2)])


# -- runs with velocities -------------------------------------------------------------------------

FORCES = (0.05, 0.02, 0.4, 8.0)
SPEEDS = (1e-5, 1e-3, 1e-1, 1e1)


def write_film(directory: Path, film: str, press: float = 1.0, thickness: str = "30 nm") -> Results:
    """A run of one pair that slides at four velocities, two steps each, after it was pressed."""
    directory.mkdir()
    speeds = ", ".join(f'"{v} m/s"' for v in SPEEDS)
    lines = [
        f"velocities = [{speeds}]" if line.startswith("velocities") else line
        for line in film.replace('"30 nm"', f'"{thickness}"').splitlines()
    ]
    (directory / "case.toml").write_text("\n".join(lines))
    rows = [history_row(s, stage="press", time=press * s / 3, dt=press / 3) for s in (1, 2, 3)]
    path, time = 0.0, press
    for number, (speed, force) in enumerate(zip(SPEEDS, FORCES, strict=True)):
        for half in (0.5, 1.0):
            path, time = path + 4e-6, time + 4e-6 / speed
            rows.append(
                history_row(
                    len(rows) + 1, stage="slide", time=time, velocity=speed, normal_force=2.0,
                    friction_force=half * force, tangential_force=half * force,
                    driven_displacement=path, contact_area=1e-6,
                )
            )  # fmt: skip
    write_rows(directory / "history.csv", rows)
    ends = [{"label": "press", "steady": None, **rows[2]}]
    ends += [
        {"label": f"slide {v}", "steady": v != 1e-1, **rows[4 + 2 * k]}
        for k, v in enumerate(SPEEDS)
    ]
    summary = {"status": "done", "load_steps": ends, "bodies": ["elastomer", "aluminium"]}
    (directory / "summary.json").write_text(json.dumps(summary))
    return read(directory)


def test_velocities_are_drawn_over_the_path_and_decades_on_a_log_scale(film, tmp_path):
    normal, friction, ratio = forces_figure(write_film(tmp_path / "out", film)).axes
    assert ratio.get_xlabel() == "path of the driven surface since the end of press (µm)"
    assert friction.get_yscale() == ratio.get_yscale() == "log" and normal.get_yscale() == "linear"
    assert friction.lines[0].get_xdata()[3:] == pytest.approx(4.0 * np.arange(1, 9))
    # One unit for velocities over six decades, and the stage before them beside the path.
    assert {"press", "10⁻⁵ m/s", "0.1 m/s"} <= {text.get_text() for text in normal.texts}
    pressed = normal.lines[0].get_xdata()[:3]
    assert (np.diff(pressed) > 0.0).all() and pressed[2] == 0.0 and -2.0 < pressed[0] < -0.5


def test_no_line_is_drawn_across_the_threshold_speed(film, tmp_path):
    # V* at 30 nm is 1 mm/s √(1/3) = 0.58 mm/s: between the first two velocities.
    [one] = series_of(write_film(tmp_path / "out", film))
    assert one.star == pytest.approx(1e-3 / np.sqrt(3.0))
    left = stribeck_figure([one]).axes[0]
    joined = [line.get_xdata().tolist() for line in left.lines if line.get_marker() != "x"]
    assert joined == [[1e-5], [1e-3, 1e-1, 1e1]]
    [thick] = series_of(write_film(tmp_path / "thick", film, thickness="250 nm"))
    left = stribeck_figure([thick]).axes[0]
    assert len([line for line in left.lines if line.get_marker() != "x"]) == 1


def test_time_that_has_no_effect_does_not_hide_what_follows(film, tmp_path):
    text = film.replace('velocities = ["1e-5 m/s", "2e-3 m/s"]', 'velocity = "2e-3 m/s"')
    text = text.replace('slip_step = "4 um"\nmax_steps = 60', 'duration = "8 ms"')
    (tmp_path / "case.toml").write_text(text)
    pressed = [history_row(s, stage="press", time=s / 3, velocity=0.0) for s in (1, 2, 3)]
    slid = [
        history_row(s, stage="slide", time=1 + 1e-3 * (s - 3), velocity=2e-3) for s in (4, 8, 11)
    ]
    write_rows(tmp_path / "history.csv", pressed + slid)
    found = abscissa_of(read(tmp_path))
    assert found.label == "time since the end of press, which is not to scale (ms)"
    assert found.values[3:] == pytest.approx([1.0, 5.0, 8.0])
    assert (np.diff(found.values) > 0.0).all() and -1.0 < found.values[0] < 0.0
    assert found.values[2] == 0.0
    # Where time counts in both, steps are the only measure that shows both.
    (tmp_path / "case.toml").write_text(text.replace("rate_dependent = false", ""))
    assert abscissa_of(read(tmp_path)).label == "step"


def test_stribeck_view(film, tmp_path):
    results = write_film(tmp_path / "out", film)
    [one] = series_of(results)
    assert one.speed.tolist() == list(SPEEDS)
    assert one.ratio == pytest.approx(np.array(FORCES) / 2.0)
    viscosity = results.case.contact[0].friction.eta_b
    assert one.hersey == pytest.approx(viscosity * np.array(SPEEDS) / 2e6)
    assert one.settled.tolist() == [True, True, False, True]
    left, right = stribeck_figure([one]).axes
    assert left.get_xscale() == right.get_xscale() == left.get_yscale() == "log"
    assert left.get_xlabel() == "sliding velocity V (m/s)"
    assert right.get_xlabel().startswith("Hersey length η_b V/p (")
    [cross] = [line for line in left.lines if line.get_marker() == "x"]
    assert cross.get_xdata().tolist() == [1e-1]


def test_a_run_at_one_velocity_has_no_stribeck_view(strip):
    assert stribeck_figure(series_of(strip)) is None
