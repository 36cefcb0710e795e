"""The page of a run that goes on: what it tells, and that it ends when the run does."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.app.report.test_report import EVIL, Reader
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError
from tribox.app.report.live import attempts_figure, watch_run
from tribox.app.results import read
from tribox.app.results.claim import DirectoryLock
from tribox.app.results.table import Table
from tribox.app.run import run_case

EVERY = 2.5


@pytest.fixture
def running(block, case_file, tmp_path):
    """Results of a run that seems to go on, and what keeps it so."""
    path = case_file(block.replace("small block", EVIL).replace("steps = 6", "steps = 2"))
    directory = tmp_path / "out"
    run_case(load_case(path), directory, quiet=True)
    say(directory, "running")
    lock = DirectoryLock(directory)
    lock.take()
    yield directory, lock
    lock.release()


def say(directory: Path, status: str) -> None:
    path = directory / "summary.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"status": status}))


def test_the_page_follows_a_run_until_it_ends(running, capsys):
    directory, lock = running
    page = directory / "report.html"
    table = directory / "progress.csv"
    whole = table.read_text()
    header, *lines = whole.splitlines(keepends=True)
    seen: list[str] = []

    def sleep(seconds: float) -> None:
        assert seconds == EVERY
        seen.append(page.read_text())
        if len(seen) == 1:  # a row in the middle of being written, one attempt failed
            failed = lines[-1].replace(",1.0,1,", ",1.0,0,")
            table.write_text(header + "".join(lines[:-1]) + failed + lines[-1][:9])
        else:
            table.write_text(whole)
            say(directory, "done")
            lock.release()

    assert watch_run(directory, None, EVERY, sleep) == len(seen) == 2
    first, second = Reader(seen[0]), Reader(seen[1])
    assert {"http-equiv": "refresh", "content": "3"} in first.all("meta")
    assert EVIL in first.words("h1") and not first.all("script")
    assert [one["alt"] for one in first.all("img")] == [
        "Forces and friction", "Attempts", "The last state that was written",
    ]  # fmt: skip
    assert first.words("td").count("converged") == 5 and "failed" not in first.words("td")
    assert second.words("td").count("failed") == 1
    assert len(second.words("td")) == len(first.words("td"))
    assert capsys.readouterr().out.count("open it in a browser") == 1


def test_the_last_attempts_are_drawn(running):
    figure = attempts_figure(read(running[0]).table("progress"))
    panels = figure.axes
    assert [axes.get_ylabel() for axes in panels][:2] == ["residual", "iterations"]
    assert len(panels[1].lines[0].get_ydata()) == 5


def test_of_explicit_intervals_the_time_steps_are_drawn():
    columns = {"converged": 1.0, "fraction": 1.0, "residual": np.nan, "iterations": 0.0}
    columns |= {"time_steps": 40.0, "kinetic_ratio": 0.2}
    table = Table({name: np.full(3, value) for name, value in columns.items()})
    panels = attempts_figure(table).axes
    assert [axes.get_ylabel() for axes in panels][:2] == ["E_kin/E_strain", "time steps"]
    assert all(len(axes.lines[0].get_ydata()) == 3 for axes in panels)


def test_a_sweep_has_no_such_page(running):
    directory, _ = running
    case = directory / "case.toml"
    sweep = '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, 0.2]\n'
    case.write_text(case.read_text() + "\n" + sweep)
    with pytest.raises(InputError, match="is a sweep; name the directory of one of its runs"):
        watch_run(directory, None, EVERY)
