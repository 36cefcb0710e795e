"""Animations: how many frames, of what size, in which colours."""

import numpy as np
import pytest
from PIL import Image

from tests.app.figures.made_results import write_strip
from tribox.app.errors import InputError
from tribox.app.figures import animation
from tribox.app.figures.animation import MOST_FRAMES, animate, frames_of
from tribox.app.results import read


def test_frames_are_few_and_evenly_chosen():
    few = np.array([3, 7, 9])
    assert frames_of(few) == [3, 7, 9]
    many = frames_of(np.arange(1, 1001))
    assert len(many) == MOST_FRAMES and many[0] == 1 and many[-1] == 1000
    assert set(np.diff(many)) <= {10, 11}


def test_every_output_is_a_frame_in_the_same_colours(strip, tmp_path):
    assert animate(strip, tmp_path / "a.gif", "von_mises_stress") == 5
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]
    with Image.open(tmp_path / "a.gif") as movie:
        assert movie.n_frames == 5
        frames = []
        for number in range(5):
            movie.seek(number)
            frames.append(np.asarray(movie.convert("RGB"), dtype=float))
    assert len({frame.shape for frame in frames}) == 1
    # The stress grows from step to step, and its colours with it; the colour bar stays.
    height, width, _ = frames[0].shape
    brightness = [frame[:, : int(0.86 * width)].mean() for frame in frames]
    assert (np.diff(brightness) > 0.0).all()
    bar = [frame[height // 5 :, int(0.89 * width) :] for frame in frames]
    assert np.abs(bar[0] - bar[-1]).mean() < 2.0


def test_an_animation_that_fails_leaves_what_was_there(strip, tmp_path, monkeypatch):
    def title(results, step):
        if step == 3:
            raise OSError("no room")
        return "title"

    monkeypatch.setattr(animation, "title_of", title)
    (tmp_path / "a.gif").write_text("before")
    with pytest.raises(OSError, match="no room"):
        animate(strip, tmp_path / "a.gif", "von_mises_stress")
    assert [p.name for p in tmp_path.iterdir()] == ["a.gif"]
    assert (tmp_path / "a.gif").read_text() == "before"


def test_one_output_is_no_animation(tmp_path):
    results = read(write_strip(tmp_path / "out", outputs=(5,)))
    with pytest.raises(InputError, match="1 field output; an animation needs two or more"):
        animate(results, tmp_path / "a.gif", "von_mises_stress")
