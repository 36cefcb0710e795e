"""Which states are drawn, and what their titles say."""

import numpy as np
import pytest

from tests.app.figures.made_results import write_strip
from tribox.app.figures.deformed import states_to_draw
from tribox.app.figures.style import fitting
from tribox.app.results import read


def drawn(tmp_path, **how) -> dict[str, tuple[int, str]]:
    found = states_to_draw(read(write_strip(tmp_path / "out", **how)))
    return {state.name: (state.step, state.title) for state in found}


def test_ends_of_stages_the_highest_load_and_the_last_state(tmp_path):
    found = drawn(tmp_path)
    assert {name: step for name, (step, _) in found.items()} == {
        "deformed-1-press": 2,
        "deformed-highest-load": 3,
        "deformed": 5,
    }
    assert found["deformed-1-press"][1] == "stage press, t = 1 s, step 2 of 5; end of press"
    assert found["deformed"][1] == "stage slide at 200 µm/s, t = 2.5 s, step 5 of 5"
    assert found["deformed-highest-load"][1].endswith("step 3 of 5; highest load")


def test_a_step_without_output_gives_way_to_the_nearest(tmp_path):
    found = drawn(tmp_path, outputs=(1, 4, 5))
    assert found["deformed-1-press"][0] == 1
    assert "nearest output to the end of press" in found["deformed-1-press"][1]
    assert found["deformed-highest-load"][0] == 4
    assert found["deformed-highest-load"][1].endswith("nearest output to the highest load (step 3)")


@pytest.mark.parametrize(("last", "said"), [(10.0, 0), (9.995, 0), (9.9, 1)])
def test_the_highest_load_is_told_where_other_pictures_show_less(tmp_path, last, said):
    results = read(write_strip(tmp_path / "out"))
    force = np.array([5.0, 10.0, 10.0, 10.0, last])
    results.table("history").columns["normal_force"] = force
    titles = {state.name: state.title for state in states_to_draw(results)}
    assert set(titles) == {"deformed-1-press", "deformed"}
    assert sum("highest load" in title for title in titles.values()) == said
    assert ("highest load" in titles["deformed-1-press"]) == bool(said)


def test_no_second_picture_of_one_state(tmp_path):
    found = drawn(tmp_path, outputs=(2, 5))
    assert set(found) == {"deformed-1-press", "deformed"}
    assert "end of press; nearest output to the highest load" in found["deformed-1-press"][1]


@pytest.mark.parametrize(
    ("status", "said"),
    [
        ("failed", "last state before the failure"),
        ("interrupted", "last state before the interruption"),
    ],
)
def test_the_title_says_how_a_run_ended(tmp_path, status, said):
    assert said in drawn(tmp_path, outputs=(5,), status=status)["deformed"][1]


def test_nothing_to_draw_without_fields(tmp_path):
    assert drawn(tmp_path, outputs=()) == {}


# -- Units that fit the values ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "unit", "name", "factor"),
    [
        ([2e-9, 3e-8], "m", "nm", 1e9), ([1e-3 * (1 - 1e-12)], "m", "mm", 1e3),
        ([25.0], "m", "m", 1.0), ([2500.0], "m", "m", 1.0), ([-3e6, np.nan], "Pa", "MPa", 1e-6),
        ([1e-4], "Pa", "Pa", 1.0), ([0.0], "N", "N", 1.0), ([3.0], "", "", 1.0),
        ([1e-14], "N", "pN", 1e12),
    ],
)  # fmt: skip
def test_the_largest_value_has_one_to_three_digits(values, unit, name, factor):
    found = fitting(values, unit)
    assert found.name == name
    assert found.factor == pytest.approx(factor)


def test_a_value_with_its_unit():
    assert fitting([2e-4], "m/s").text(2e-4) == "200 µm/s"


@pytest.mark.parametrize(
    ("values", "unit", "text", "name"),
    [
        ([1e-3, 2e-3], "m", "1", "mm"), ([3e-8, 1e-9], "m", "30", "nm"),
        ([1e-6], "m²", "1", "mm²"), ([2.0, 1e4], "N", "0.002", "kN"), ([1e-20], "m", "1e-08", "pm"),
        ([0.0], "m", "0", "m"), ([float("nan"), 1e3], "Pa", "–", "kPa"), ([5e3], "", "5000", ""),
        ([2e6, 1e-9], "Pa", "2", "MPa"),
    ],
)  # fmt: skip
def test_a_number_in_the_unit_of_the_largest(values, unit, text, name):
    scale = fitting(values, unit)
    assert (scale.number(values[0]), scale.name) == (text, name)
