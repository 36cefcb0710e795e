"""Figures at the end of a run: drawn from its files, and never the end of it."""

import tomllib

import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tribox.app.case.case import Case
from tribox.app.errors import Interrupted
from tribox.app.figures import run_figures
from tribox.app.results import Results
from tribox.app.run.run import run_case
from tribox.app.simulation.run_state import Observer


def small(block: str) -> Case:
    data = tomllib.loads(block)
    data["stage"] = [{"name": "press", "duration": "1 s", "steps": 2}]
    return Case.model_validate(data | {"output": {"figures": True, "fields_every": 1}})


def test_a_figure_that_cannot_be_drawn_is_a_warning(block, tmp_path, monkeypatch):
    def fails(results: Results, field: str = "") -> None:
        assert results.summary["status"] == "done" and len(results.history) == 2
        raise ValueError("no such colour")

    monkeypatch.setattr(run_figures, "draw_figures", fails)
    simulation = run_case(small(block), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    assert len(simulation.rows) == 2
    log = read_log(tmp_path / "out")
    assert "warning: the figures could not be drawn: ValueError('no such colour')" in log


def test_an_interrupted_run_has_figures(block, tmp_path, monkeypatch):
    from tribox.app.run import progress

    def stop(self, state, row, result) -> None:
        raise Interrupted

    monkeypatch.setattr(progress.Together, "step", stop)
    with pytest.raises(KeyboardInterrupt):
        run_case(small(block), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    assert {path.name for path in (tmp_path / "out" / "figures").iterdir()} >= {
        "deformed.png", "history.png",
    }  # fmt: skip
    assert issubclass(progress.Together, Observer)
