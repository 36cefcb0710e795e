"""Runs with a body that flows, or creeps, go on as if they had not stopped, on any ranks."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.checkpoint.going_on import as_killed, case_of, numbers, run, unlike
from tests.app.checkpoint.small_cases import BOTTOM, COARSE, STAGES, changed
from tests.app.conftest import BLOCK
from tests.app.simulation.test_ranks import SAME
from tests.app.simulation.test_tools import rolled
from tests.flowing import soft_block
from tests.tool_cases import WIDTH, block_case, block_mesh, plane
from tribox.app.figures.history import moved_parts
from tribox.app.results import read
from tribox.app.results.reading import read_table
from tribox.app.simulation import explicit_stage
from tribox.app.simulation.history import PHYSICAL

PROBES = [{"name": "below", "point": ["1 mm", "-0.1 mm"]}, {"name": "lower", "body": "aluminium"}]
STRUCK = {
    "x": [["10 us", "0 mm"], ["20 us", "0.01 mm"]],
    "y": [["0 s", "0 mm"], ["10 us", "-0.03 mm"]],
}
PRONY = [[0.3, "0.2 s"], [0.2, "2 s"]]
MULLINS = {"r": 1.5, "m": "20 kPa", "beta": 0.1}
BACK = [["2 MPa", 20], ["1 MPa", 0]]
RUBBER = {"bodies.elastomer.prony": PRONY, "bodies.elastomer.mullins": MULLINS}
CREEP = [STAGES[0] | {"rate_dependent": False}, STAGES[1]]
CASES: dict[str, dict[str, Any]] = {
    "creep": changed(BLOCK, COARSE | RUBBER | {"stage": CREEP}),
    "implicit": soft_block(probe=PROBES, bodies__aluminium__kinematic=BACK),
    "cut": soft_block(rated=True, solver={"max_iterations": 2}),
    "explicit": soft_block(
        rated=True,
        solver={"kind": "explicit", "tolerance": 1e-8},
        stage=[{"name": "strike", "duration": "20 us", "steps": 2}],
        boundary=[BOTTOM, {"surface": "top", "displacement": STRUCK}],
        bodies__elastomer__density=1100,
        bodies__elastomer__mullins=MULLINS,
        bodies__aluminium__kinematic=BACK,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_run_that_goes_on_writes_the_same_bytes(name, tmp_path, monkeypatch):
    """The explicit one goes on from within a row of the history, too."""
    monkeypatch.setattr(explicit_stage, "CHECK_EVERY", 10)
    case = case_of(CASES[name])
    whole = run(case, tmp_path / "whole")
    rubber, metal = whole.model.problem.solids
    if name == "creep":
        assert rubber.dissipated_by_part.min() > 0.0 and not metal.remembers
    else:
        assert metal.flows and metal.plastic_strain().max() > 1e-5
    assert name != "cut" or any(row.attempts > 1 for row in whole.rows)
    written = numbers(tmp_path / "whole")
    for share in (0.35, 0.8):
        again = as_killed(
            tmp_path / "whole", tmp_path / f"{share}", written[int(share * len(written))]
        )
        run(case, again, resume=True)
        assert unlike(tmp_path / "whole", again) == []


def on_two(comm: MPI.Comm, directory: Path) -> dict[str, dict[str, float]]:
    """Differences of a run on all ranks, and of one begun there and ended on one, from one's."""
    keys = {"prony": PRONY, "mullins": MULLINS}
    remembers = {f"bodies__elastomer__{key}": value for key, value in keys.items()}
    remembers["bodies__aluminium__kinematic"] = BACK
    case = case_of(soft_block(probe=PROBES, **remembers) | {"solver": {"tolerance": 1e-11}})
    if comm.rank == 0:
        run(case, directory / "one")
    run(case, directory / "two", comm)
    if comm.rank == 0:
        run(case, as_killed(directory / "two", directory / "back", 4), resume=True)
    comm.barrier()
    if comm.rank == 0:
        as_killed(directory / "one", directory / "on", 4)
    comm.barrier()
    run(case, directory / "on", comm, resume=True)
    if comm.rank > 0:
        return {}
    rows = {
        way: read_table(directory / way / "history.csv") for way in ("one", "two", "back", "on")
    }
    probes = {way: read_table(directory / way / "probes.csv") for way in rows}
    found = {}
    for way in ("two", "back", "on"):
        names = (*PHYSICAL, "plastic_dissipation", "viscous_dissipation")
        found[way] = _apart(rows[way], rows["one"], names)
        found[way] |= _apart(probes[way], probes["one"], ["equivalent_plastic_strain"])
    return found


def _apart(rows: Any, others: Any, names: Any) -> dict[str, float]:
    """Columns that differ by more than ranks may."""
    apart = {
        name: max(abs(a[name] - b[name]) for a, b in zip(rows, others, strict=True))
        for name in names
    }
    most = {name: max(abs(b[name]) for b in others) for name in names}
    return {n: float(v) for n, v in apart.items() if v > SAME * most[n]}


@pytest.mark.mpi(on_two, 2)
def test_ranks_do_not_matter_to_what_flows_and_creeps(on_ranks):
    assert on_ranks(on_two, 2) == {"two": {}, "back": {}, "on": {}}


# -- Runs with rigid tools that go on from a checkpoint, on the same ranks and on others -----------


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
