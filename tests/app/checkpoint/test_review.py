"""Runs that go on: what nobody thinks of at first."""

from __future__ import annotations

import json
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from app.build.model import build_model
from app.case.case import Case
from app.checkpoint.files import latest
from app.errors import InputError, Interrupted
from app.results.directory import check_free, checkpoint_numbers
from app.run.interruption import Interruption
from app.run.run import run_case
from app.simulation.simulation import Simulation
from tests.app.conftest import BLOCK, SLID

COARSE = {
    "geometry": {
        "kind": "two-blocks",
        "thickness": "1 mm",
        "upper": {"width": "1.0 mm", "height": "0.5 mm", "elements": [5, 3]},
        "lower": {"width": "2.0 mm", "height": "0.5 mm", "elements": [7, 2]},
    },
    "stage": [
        {"name": "press", "duration": "1 s", "steps": 2},
        {"name": "slide", "duration": "1 s", "steps": 3},
    ],
}
OUTPUT = {"figures": False, "fields_every": 0, "checkpoint_every": 1, "checkpoints_kept": 50}


def case_of(text: str = BLOCK, **tables: Any) -> Case:
    output = OUTPUT | tables.pop("output", {})
    return Case.model_validate(tomllib.loads(text) | COARSE | tables | {"output": output})


def run(case: Case, directory: Path, **how: Any) -> Simulation:
    return run_case(case, directory, quiet=True, comm=MPI.COMM_SELF, **how)


def as_killed(done: Path, directory: Path, number: int) -> Path:
    """A copy of a directory, as if the run had been killed after a checkpoint."""
    shutil.copytree(done, directory)
    for one in checkpoint_numbers(directory):
        if one > number:
            shutil.rmtree(directory / "checkpoints" / f"{one:06d}")
    path = directory / "summary.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"status": "running"}))
    return directory


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> Path:
    """A run that is done, with a checkpoint of each step."""
    directory = tmp_path_factory.mktemp("done") / "out"
    run(case_of(), directory)
    return directory


# -- stops ------------------------------------------------------------------------------------


def test_a_run_stopped_while_a_step_is_cut_goes_on_to_the_same_rows(tmp_path, monkeypatch):
    """Attempts that failed before the stop count, and are not made again."""
    stages = [COARSE["stage"][0], COARSE["stage"][1] | {"steps": 2}]
    case = case_of(stage=stages, solver={"max_iterations": 2})
    whole = run(case, tmp_path / "whole")
    cuts = sum(row.attempts - 1 for row in whole.rows)
    assert cuts >= 2
    for number in range(1, cuts + 1):
        seen = 0

        def cut(self, *_, number=number):
            nonlocal seen
            seen += 1
            if seen == number:
                raise Interrupted

        out = tmp_path / f"cut-{number}"
        with monkeypatch.context() as patch:
            patch.setattr(Interruption, "cut", cut)
            with pytest.raises(Interrupted):
                run(case, out)
        run(case, out, resume=True)
        for name in ("history.csv", "contacts.csv", "surfaces.csv", "bodies.csv"):
            assert (out / name).read_text() == (tmp_path / "whole" / name).read_text(), number
