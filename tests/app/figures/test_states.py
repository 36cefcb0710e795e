"""Which states are drawn, and what their titles say."""

import numpy as np
import pytest

from tests.app.figures.made_results import write_strip
from tribox.app.figures.states import states_to_draw
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
