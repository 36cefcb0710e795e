"""Notes on velocities that are too short for their friction to become steady."""

import tomllib

from tribox.app.build.case_notes import notes_on
from tribox.app.case.case import Case


def case(text: str, stage: dict | None = None, friction: dict | None = None) -> Case:
    data = tomllib.loads(text)
    data["contact"][0]["friction"] |= friction or {}
    data["stage"][1] |= stage or {}
    return Case.model_validate(data)


def short(case: Case) -> list[str]:
    return [note for note in notes_on(case) if "will not be steady" in note]


def test_weakening_needs_its_slip_whatever_the_step(film):
    # 1 um + (0.02/(1e-3 0.1) - 1)/B = 200 um, a little less as the film drags too.
    for step in (1e-6, 4e-6):
        few, enough = round(190e-6 / step), round(210e-6 / step)
        [note] = short(case(film, {"slip_step": step, "max_steps": few}))
        assert note.startswith("contact.0: stage slide gives each velocity at most")
        assert "1 of 2 velocities" in note  # above V* the film carries all
        assert short(case(film, {"slip_step": step, "max_steps": enough})) == []


def test_slip_of_stages_and_velocities_before_counts(film):
    few = {"max_steps": 30, "velocities": [1e-6, 1e-5, 1e-4]}
    [note] = short(case(film, few))
    assert "1 of 3 velocities" in note
    data = tomllib.loads(film)
    run_in = {"name": "run in", "duration": 1.0, "velocity": 2e-4}
    data["stage"].insert(1, run_in)
    data["stage"][2] |= few
    assert short(Case.model_validate(data)) == []


def test_a_coefficient_that_tends_to_zero_never_settles(film):
    # Below V* and without a film (D = 0), where nothing else carries.
    text = film.replace('"30 nm"', '"0 nm"')
    [note] = short(case(text, {"max_steps": 10_000}, {"mu_d": 0.0}))
    assert "never, as mu_d = 0" in note


def test_a_thick_layer_takes_long_to_be_sheared(film):
    stage = {"max_steps": 60, "velocities": [1e-5]}
    assert short(case(film, stage, {"mu_d": 0.12})) == []
    thick = film.replace('height = "0.1 mm"', 'height = "20 mm"')
    [note] = short(case(thick, stage, {"mu_d": 0.12}))
    assert "1 of 1 velocities" in note
