"""Runs with a body that flows, or creeps, go on as if they had not stopped, on any ranks."""

from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from tests.app.checkpoint.going_on import as_killed, case_of, numbers, run, unlike
from tests.app.checkpoint.small_cases import BOTTOM, COARSE, STAGES, changed
from tests.app.conftest import BLOCK
from tests.app.simulation.test_ranks import SAME
from tests.flowing import soft_block
from tribox.app.results.directory import read_table
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
CASES: dict[str, dict[str, Any]] = {
    "creep": changed(
        BLOCK,
        COARSE
        | {
            "stage": [STAGES[0] | {"rate_dependent": False}, STAGES[1]],
            "bodies.elastomer.prony": PRONY,
            "bodies.elastomer.mullins": MULLINS,
        },
    ),
    "implicit": soft_block(probe=PROBES, bodies__aluminium__kinematic=BACK),
    "cut": soft_block(rated=True, solver={"max_iterations": 3}),
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
        again = as_killed(directory / "two", directory / "back", 4)
        run(case, again, resume=True)
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
