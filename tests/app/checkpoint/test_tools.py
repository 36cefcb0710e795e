"""Runs with rigid tools that go on from a checkpoint, on the same ranks and on others."""

import json

import numpy as np
import pytest

from tests.app.checkpoint.going_on import as_killed, case_of, numbers, run, unlike
from tests.app.simulation.test_tools import rolled
from tests.tool_cases import WIDTH, block_case, block_mesh, plane
from tribox.app.figures.force_displacement import moved_parts
from tribox.app.results import read
from tribox.app.results.directory import read_table
from tribox.app.simulation import explicit_stage


def data_of(mesh, explicit=False):
    """A free roller, and a wall that a force presses on the block.

    Without explicit steps it is the force that a displacement came to, and is released in the end.
    """
    tables = rolled(moment=0)
    wall = plane(point=[WIDTH, 0], normal=[-1, 0], force={"x": [["0 s", 0], ["1 s", "-0.1 N"]]})
    tables["tools"]["wall"] = wall
    frictionless = {"law": "frictionless"}
    tables["contact"].append({"slave": "right", "master": "wall", "friction": frictionless})
    data = block_case(mesh, **tables)
    if not explicit:
        moved = {"displacement": {"x": [["0 s", 0], ["1 s", "-3 um"]]}, "hold_force": ["x"]}
        data["tools"]["wall"] = plane(
            point=[WIDTH, 0], normal=[-1, 0], **moved, displacement_stages=["press"]
        )
        data["stage"][1]["steps"] = 2
        last = {"name": "let go", "duration": "1 s", "steps": 5, "release": ["wall"]}
        data["stage"].append(last)
    if explicit:
        data["bodies"]["block"]["density"] = 1000
        data["tools"]["punch"]["rotation"]["inertia"] = "2e-11 kg*m^2"
        data["tools"]["wall"]["mass"] = "10 mg"
        data["solver"] = {"kind": "explicit", "damping": "2e4 1/s"}
        data["stage"] = [{"name": "all", "duration": "0.1 ms", "steps": 4}]
        quick = {"y": [["0 s", "0 m"], ["0.05 ms", "-5 um"]], "x": [["0 s", 0], ["0.1 ms", "5 um"]]}
        data["tools"]["punch"]["displacement"] = quick
        data["tools"]["wall"]["force"] = {"x": [["0 s", 0], ["0.05 ms", "-0.1 N"]]}
    return data


@pytest.mark.parametrize("explicit", [False, True])
def test_tools_go_on_as_if_nothing_had_been(tmp_path, monkeypatch, explicit):
    monkeypatch.setattr(explicit_stage, "CHECK_EVERY", 10)
    case = case_of(data_of(block_mesh(tmp_path / "block.msh"), explicit))
    reference = tmp_path / "done"
    run(case, reference)
    written = numbers(reference)
    directory = as_killed(reference, tmp_path / "out", written[int(0.65 * (len(written) - 1))])
    run(case, directory, resume=True)
    assert unlike(reference, directory) == []
    assert {row["tool"] for row in read_table(directory / "tools.csv")} == {"punch", "wall"}
    # In the picture the curve of a tool ends where it is released.
    moved = moved_parts(read(directory))
    assert set(moved.where("surface", "wall")["stage"]) == {one.name for one in case.stage[:2]}


def gone_on(comm, directory):
    """A run begun on one rank and gone on with on all; its rows beside those of one alone."""
    if comm.rank == 0:
        block_mesh(directory / "block.msh")
    comm.barrier()
    case = case_of(data_of(directory / "block.msh"), fields_every=0)
    if comm.rank == 0:
        run(case, directory / "one")
        written = numbers(directory / "one")
        as_killed(directory / "one", directory / "more", written[int(0.65 * (len(written) - 1))])
    comm.barrier()
    run(case, directory / "more", comm, resume=True)
    if comm.rank > 0:
        return {}
    tables = [read_table(directory / name / "tools.csv") for name in ("one", "more")]
    rows = [[[v for v in row.values() if isinstance(v, float)] for row in t] for t in tables]
    summary = json.loads((directory / "more" / "summary.json").read_text())
    return {"rows": rows, "resumed": summary["resumed"], "ranks": summary["ranks"]}


@pytest.mark.mpi(gone_on, 2)
def test_tools_go_on_on_other_ranks(on_ranks):
    found = on_ranks(gone_on, 2)
    assert found["ranks"] == 2 and 0 < found["resumed"][0] < len(found["rows"][0])
    alone, more = map(np.array, found["rows"])
    size = np.abs(alone).max(axis=0)
    apart = np.abs(more - alone) / np.where(size > 0.0, size, 1.0)
    assert apart.max() < 1e-6
