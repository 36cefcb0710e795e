"""What is told of rigid tools at the end of a run: on the terminal, and in the report."""

from __future__ import annotations

import re

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tests.tool_cases import block_case, block_mesh, case_of, circle, plane
from tribox.app.report.page import contents
from tribox.app.results import read
from tribox.app.run.run import run_case

DOWN = {"y": [["0 s", "0 m"], ["1 s", "-50 um"], ["2 s", "-10 um"]]}
TURN = {"angle": [["1 s", "0 rad"], ["2 s", "0.02 rad"]]}


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    """Results of a tool that presses most in the middle of its run, and one that does nothing."""
    directory = tmp_path_factory.mktemp("tools")
    tools = {
        "punch": circle(displacement=DOWN, rotation=TURN),
        "idle": plane(point=[0, 5e-3], normal=[0, -1]),
    }
    contact = {"master": "punch", "slave": "top", "friction": {"law": "coulomb", "mu": 0.3}}
    stage = [{"name": name, "duration": "1 s", "steps": 2} for name in ("press", "leave")]
    data = block_case(
        block_mesh(directory / "block.msh"), tools=tools, contact=[contact], stage=stage
    )
    data["output"] = {"figures": False, "fields_every": 1}
    run_case(case_of(data), directory / "out", quiet=True, comm=MPI.COMM_SELF)
    return read(directory / "out")


def test_a_line_of_each_tool_is_in_the_log(pressed):
    lines = read_log(pressed.directory).splitlines()
    first, second = (line for line in lines if re.search(r"\btool (punch|idle): moved", line))
    rows = pressed.tools[pressed.tools["tool"] == "punch"]
    force, moment = rows[["force_x", "force_y"]].to_numpy(), rows["moment_z"].to_numpy()
    most = np.linalg.norm(force, axis=1).max()
    assert most > 1.5 * np.linalg.norm(force[-1])
    assert f"moved by (0, -1e-05) m, turned by 0.02 rad; force on it ({force[-1][0]:.4g}, " in first
    assert f"{force[-1][1]:.4g}) N, at most {most:.4g} N; moment {moment[-1]:.4g} N m" in first
    assert first.endswith(f"at most {np.abs(moment).max():.4g} N m")
    assert second.endswith(
        "tool idle: moved by (0, 0) m; force on it (0, 0) N, at most 0 N; moment 0 N m, "
        "at most 0 N m"
    )


def test_the_report_has_tables_of_tools_at_the_ends_and_at_their_largest(pressed):
    (part,) = contents(pressed)["parts"]
    tables = {table.caption: table for table in part.tables}
    ends = tables["Tools: force and moment of the bodies on them"]
    most = tables["Tools: largest value of each over the run"]
    assert [row[:2] for row in ends.rows] == [
        ("punch", "press"), ("punch", "leave"), ("idle", "press"), ("idle", "leave"),
    ]  # fmt: skip
    assert [row[0] for row in most.rows] == ["punch", "idle"]
    titles = [title for title, _ in most.headings]
    at = {title: dict(zip(titles, row, strict=True)) for title, row in zip("ab", most.rows)}
    assert (
        at["a"]["displacement u_y"] == "-50"
        and most.headings[titles.index("displacement u_y")][1] == "µm"
    )
    assert at["a"]["rotation θ"] == "0.02" and at["b"]["rotation θ"] == "0"
    force = 1e3 * pressed.tools["force_y"].max()
    assert most.headings[titles.index("force R_y")][1] == "mN"
    assert float(at["a"]["force R_y"]) == pytest.approx(force, rel=1e-3)
    # The driving force is the other way round, and keeps its sign.
    assert float(at["a"]["driving force, y"]) == pytest.approx(-force, rel=1e-3)
    assert any(table.title == "Tool punch" for table in contents(pressed)["inputs"])
