"""That a run says so where rounding kept the residual above the tolerance that was asked for."""

import json
import tomllib

import pytest

from tests.app.read_log import read_log
from tribox.app.case.case import Case
from tribox.app.run.run import run_case

CARRIED = {"x": [[0.0, "0 mm"], [1.0, "30 mm"], [2.0, "30.15 mm"]]}


def gel(data: dict) -> None:
    """So soft that its forces drown in what rounding does to the aluminium."""
    data["bodies"]["elastomer"]["E"] = "1 kPa"


def carried(data: dict) -> None:
    """Both blocks travel by 30 mm: that much of the digits of the displacement is lost."""
    down = data["boundary"][1]["displacement"]["y"]
    data["boundary"][1]["displacement"] = {**CARRIED, "y": down}
    data["boundary"][0]["displacement"] = {"x": [*CARRIED["x"][:2], [2.0, "30 mm"]], "y": 0}
    data["solver"] = {"tolerance": 1e-9}


def plain(data: dict) -> None:
    """Nothing of the kind."""


@pytest.mark.parametrize(
    ("change", "cure"),
    [
        (gel, "a lower modulus of aluminium, which is 3e+07 times as stiff"),
        (carried, "letting the other body move, as aluminium has moved far"),
        (plain, None),
    ],
    ids=lambda v: getattr(v, "__name__", None),
)
def test_a_residual_that_rounding_keeps_up_is_warned_of_once(block, tmp_path, change, cure):
    data = tomllib.loads(block) | {"output": {"fields_every": 0, "figures": False}}
    change(data)
    case = Case.model_validate(data)
    run_case(case, tmp_path / "out", quiet=True)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    found = [line for line in summary["warnings"] if "rounding" in line]
    share = summary["residual_at_roundoff"]
    if cure is None:
        assert share is None and not found
        return
    [line] = found
    assert case.solver.tolerance < share < 1e-5
    assert f"a residual of {share:.1e} of the contact or reaction force was accepted" in line
    assert f"solver.tolerance = {case.solver.tolerance:g}" in line and cure in line
    assert line in read_log(tmp_path / "out")
