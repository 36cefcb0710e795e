from tribox.app.equilibrium.timers import Stopwatch


class Clock:
    """A clock that the test turns."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def test_an_inner_part_is_taken_out_of_the_outer_one():
    clock = Clock()
    watch = Stopwatch(clock)
    with watch("outer"):
        clock.now += 1.0
        with watch("inner"):
            clock.now += 10.0
        clock.now += 2.0
    clock.now += 50.0  # belongs to nobody
    with watch("inner"):
        clock.now += 5.0
    assert dict(watch.seconds) == {"outer": 3.0, "inner": 15.0}
    assert dict(watch.calls) == {"outer": 1, "inner": 2}
