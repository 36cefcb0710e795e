"""A run goes on on another number of ranks, with what it would have given on one."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from tests.app.checkpoint.going_on import as_killed, case_of, numbers, run
from tests.app.checkpoint.small_cases import EXPLICIT, IMPLICIT
from tests.app.simulation.film_runs import OIL, data_of
from tests.app.simulation.test_ranks import SAME, largest
from tribox.app.case.case import Case
from tribox.app.results.reading import read_table
from tribox.app.simulation.history import PHYSICAL, RESULTANTS

TIGHT = {"tolerance": 1e-11}
KRYLOV = TIGHT | {"linear": "krylov", "petsc": {"ksp_rtol": 1e-12, "ksp_max_it": 2000}}


def found_film(root: Path) -> dict[str, Any]:
    """A roll on oiled rubber, beside a block with which a rank may have no part of the contact."""
    data = data_of(**OIL)
    data["geometry"]["blocks"]["rubber"]["elements"] = [30, 2]
    aside = {"x": ["20 mm", "32 mm"], "y": ["-4 mm", "0 mm"], "elements": [30, 2]}
    data["geometry"]["blocks"]["aside"] = aside
    data["bodies"]["aside"] = data["bodies"]["rubber"]
    data["boundary"] += [{"surface": "aside_bottom", "displacement": {"x": 0, "y": 0}}]
    return data


def found_over_facets(root: Path) -> dict[str, Any]:
    """A rubber block that slides through a flooded film on a block that reaches beyond it."""
    data = data_of(cells=2)
    del data["tools"]
    data["geometry"]["blocks"] = {
        "rubber": {"x": ["-4 mm", "4 mm"], "y": ["0 mm", "3 mm"], "elements": [16, 3]},
        "plate": {"x": ["-9 mm", "9 mm"], "y": ["-1 mm", "0 mm"], "elements": [20, 1]},
    }
    data["bodies"]["plate"] = {"material": "hencky", "E": "1 GPa", "nu": 0.3}
    data["contact"][0] |= {"slave": "rubber_bottom", "master": "plate_top"}
    data["boundary"] = [
        {"surface": "plate_bottom", "displacement": {"x": 0, "y": 0}},
        {
            "surface": "rubber_top",
            "displacement": {"x": [["1 s", "0 mm"], ["3 s", "2 mm"]]},
            "platen": {"direction": "y", "pressure": [["0 s", "0 MPa"], ["1 s", "0.2 MPa"]]},
        },
    ]
    return data


CASES = {
    "space by Krylov": (IMPLICIT["space by Krylov"], KRYLOV),
    "pairs": (IMPLICIT["pairs"], TIGHT),
    "film that is found": (found_film, {"tolerance": 1e-10, "partition": "cells"}),
    "film over facets": (found_over_facets, TIGHT),
    "thrown": (EXPLICIT["thrown"], {"kind": "explicit"}),
}

WAVERING = 20  # iterations of a step that rounding may change the number of

FEW = ("film that is found", "thrown")


def switched(
    comm: MPI.Comm, directory: Path, names: Sequence[str] = FEW
) -> dict[str, dict[str, Any]]:
    """Cases that go on on other ranks: differences too large, iterations of both runs."""
    before = comm.Split(int(comm.rank >= 2), comm.rank)  # the first two ranks
    found: dict[str, Any] = {}
    for name in names[: len(names) if comm.size == 2 else 1]:
        maker, solver = CASES[name]
        root = directory / name
        root.mkdir(exist_ok=True)
        data = comm.bcast(maker(root) if comm.rank == 0 else None)  # one rank writes its mesh
        case = case_of(data | {"solver": solver}, fields_every=0)
        if comm.rank == 0:
            run(case, root / "one")
        if comm.rank < 2:
            run(case, root / "two", before)
        ways = {"one": comm} if comm.size == 2 else {"two": comm}
        found |= {f"{name}: {way}": _gone_on(case, root, way, c) for way, c in ways.items()}
        if comm.size == 2 and comm.rank == 0:
            found[f"{name}: two to one"] = _gone_on(case, root, "two", MPI.COMM_SELF)
        comm.barrier()
    before.Free()
    return found


def switched_long(comm: MPI.Comm, directory: Path) -> dict[str, dict[str, Any]]:
    """The other cases."""
    return switched(comm, directory, [name for name in CASES if name not in FEW])


def _gone_on(case: Case, root: Path, way: str, comm: MPI.Comm) -> dict[str, Any]:
    directory = root / f"from {way} on {comm.size}"
    if comm.rank == 0:
        written = numbers(root / way)
        as_killed(root / way, directory, written[int(0.65 * (len(written) - 1))])
    comm.barrier()
    run(case, directory, comm, resume=True)
    if comm.rank > 0:
        return {}
    where = (root / "one", root / way, directory)
    alone, begun, rows = (read_table(path / "history.csv") for path in where)
    apart = {
        name: max(abs(a[name] - b[name]) for a, b in zip(rows, alone, strict=True))
        for name in (*PHYSICAL, *RESULTANTS)
    }
    summary = json.loads((directory / "summary.json").read_text())
    return {
        "apart": {n: v for n, v in apart.items() if v > SAME * largest(alone, n)},
        "iterations": [[int(row["newton_iterations"]) for row in table] for table in (begun, rows)],
        "resumed": summary["resumed"][0],
        "ranks": summary["ranks"],
    }


def switches() -> list[Any]:
    """Cases, each with the ranks it began on and goes on on, as parameters of a test."""
    found = []
    for name in CASES:
        scene, marks = (switched, []) if name in FEW else (switched_long, [pytest.mark.long])
        switched_to = ((1, 2, "one"), (2, 1, "two to one"), (2, 3, "two"))
        for began, ranks, way in switched_to[: 3 if name == FEW[0] else 2]:
            mpi = pytest.mark.mpi(scene, max(began, ranks))
            values = (scene, f"{name}: {way}", max(began, ranks), ranks)
            found.append(
                pytest.param(*values, marks=[mpi, *marks], id=f"{name} {began} to {ranks}")
            )
    return found


@pytest.mark.parametrize(("scene", "key", "started", "ranks"), switches())
def test_a_run_goes_on_on_other_ranks(on_ranks, scene, key, started, ranks):
    found = on_ranks(scene, started)[key]
    assert found["apart"] == {} and found["ranks"] == ranks
    assert 0 < found["resumed"] < len(found["iterations"][0])
    # Where a body is let go and Newton's method wavers, rounding decides how long it takes.
    pairs = zip(*found["iterations"], strict=True)
    calm = [pair for pair in pairs if max(pair) <= WAVERING]
    assert len(calm) >= found["resumed"] and all(before == now for before, now in calm)
