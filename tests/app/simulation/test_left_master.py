"""The warning of points that have run past the end of the master."""

from __future__ import annotations

import tomllib

import pytest
from mpi4py import MPI

from tribox.app.case.case import Case
from tribox.app.run.run import run_case


@pytest.mark.parametrize(
    ("offset", "width", "sliding", "end"),
    [
        ("0.1 mm", "1.5 mm", "0.15 mm", None),
        ("0.1 mm", "1.2 mm", "0.3 mm", "(0.0012, 0) m"),
        ("0.1 mm", "1.2 mm", "-0.3 mm", "(0, 0) m"),
        # Longer than the master from the start: what hangs over has never been above it.
        ("-0.1 mm", "0.8 mm", "0 mm", None),
        # Pressed, it has spread over the left end too.
        ("-0.1 mm", "0.8 mm", "0.15 mm", "(0, 0) m and (0.0008, 0) m"),
    ],
)
def test_only_points_that_were_above_the_master_run_past_its_end(
    tmp_path, block, offset, width, sliding, end
):
    data = tomllib.loads(block)
    data["geometry"]["lower"]["width"] = width
    data["geometry"]["offset"] = offset
    data["boundary"][1]["displacement"]["x"] = [["1 s", "0 mm"], ["2 s", sliding]]
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    log = (tmp_path / "out" / "log.txt").read_text()
    past = [line for line in log.splitlines() if "runs past the end of" in line]
    assert len(past) == (end is not None)
    for line in past:
        assert f"elastomer_contact runs past the end of aluminium_contact at {end}, unde" in line
        assert "stage slide)" in line
