"""How far a run is within its stages, and how long the rest takes."""

from __future__ import annotations

import pytest
from rich.console import Console

from tribox.app.case.reading import load_case
from tribox.app.run.stage_bars import StageBars
from tribox.app.run.stage_progress import StagesProgress, clock


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.time = 100.0

    def __call__(self) -> float:
        return self.time


@pytest.fixture
def now():
    return Clock()


@pytest.fixture
def stages(case_file, film, now):
    """Of a case that presses for 1 s and slides at 1e-5 and 2e-3 m/s, 4 um a step, 60 at most."""
    return StagesProgress(load_case(case_file(film)), now)


def to_the_slide(stages, now):
    stages.at(0.4, 0.4)
    now.time += 2.0
    stages.at(1.0, 0.4)
    stages.end_load_step()


def test_a_stage_with_a_duration_goes_by_its_time(stages, now):
    press = stages.here
    assert (press.share, press.seconds_left(now()), press.time_left(now())) == (0.0, None, "")
    stages.at(0.25, 0.125)
    now.time += 3.0
    assert press.share == 0.25
    assert press.seconds_left(now()) == pytest.approx(9.0, rel=1e-12)
    assert press.place() == "0.25/1 s"
    assert press.time_left(now()) == "0:09 left"


def test_until_steady_it_goes_by_load_steps_and_the_most_steps(stages, now):
    to_the_slide(stages, now)
    press, slide = stages.begun
    assert press.time_left(now()) == "done in 0:02" and press.share == 1.0
    assert slide.place() == "load step 1/2, step 0/60"
    stages.at(1.0 + 15 * 0.4, 0.2)  # 4 um at 1e-5 m/s take 0.4 s; the last step was cut
    now.time += 1.0
    assert slide.place() == "load step 1/2, step 15/60"
    assert slide.share == pytest.approx(15 / 60 / 2, rel=1e-12)
    assert slide.time_left(now()) == "at most 0:07 left"
    stages.end_load_step()
    stages.at(7.0 + 3 * 2e-3, 2e-3)
    assert slide.place() == "load step 2/2, step 3/60"
    assert slide.share == pytest.approx((1 + 3 / 60) / 2, rel=1e-9)
    stages.end_load_step()
    assert slide.share == 1.0 and slide.ended == now()


def test_the_time_of_a_stage_is_its_own_and_tells_steps_apart(case_file, block):
    text = block.replace('duration = "1 s"\nsteps = 6', 'duration = "6 ns"\nsteps = 6')
    stages = StagesProgress(load_case(case_file(text)))
    stages.at(1.0, 1.0)
    stages.end_load_step()
    places = [stages.at(1.0 + k * 1e-9, 1e-9).place() for k in (1, 2, 3)]
    assert [place[:1] for place in places] == ["1", "2", "3"]
    assert all(place.endswith("e-09/6e-09 s") for place in places), places


def rendered(stages, details: str, width: int) -> list[str]:
    console = Console(width=width, record=True, file=open("/dev/null", "w"), force_terminal=False)
    bars = StageBars(stages, console)
    bars.details = details
    bars.close()
    with console.capture() as capture:
        console.print(bars.render())
    return [line.rstrip() for line in capture.get().splitlines()]


def test_bars_fit_into_a_narrow_terminal(stages, now):
    to_the_slide(stages, now)
    stages.at(1.4, 0.4)
    now.time += 1.0
    details = "step 4  V 1e-05 m/s  N 0.5 N  F_T 0.02 N  residual 1.6e-11  0 cuts"
    press, slide, last = rendered(stages, details, 72)
    assert press.startswith("1/2 press ━") and press.endswith("━ done in 0:02")
    assert slide.startswith("2/2 slide ") and "load step 1/2, step 1/60, at most" in slide
    assert last == details
    assert max(map(len, rendered(stages, 3 * details, 40))) <= 40


@pytest.mark.parametrize(
    ("seconds", "text"), [(4.6, "0:05"), (61, "1:01"), (3599.4, "59:59"), (3723, "1:02:03")]
)
def test_clock(seconds, text):
    assert clock(seconds) == text
