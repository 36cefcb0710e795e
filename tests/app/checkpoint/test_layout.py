"""Snapshots of all ranks in an order that ranks do not change, and back on other ranks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.checkpoint.going_on import case_of
from tests.app.checkpoint.small_cases import IMPLICIT
from tribox.app.build.model import build_model
from tribox.app.checkpoint.layout import Layout, copied, differences
from tribox.app.equilibrium.snapshot import AtPoints, Nodal, Partial


def laid_out(comm: MPI.Comm, directory: Path, name: str) -> tuple[Layout, dict[str, Any]]:
    """A layout of a small case, and a snapshot whose values follow from places alone."""
    # One rank writes its mesh.
    data = comm.bcast(IMPLICIT[name](directory) if comm.rank == 0 else None)
    model = build_model(case_of(data), comm)
    problem = model.problem
    where = problem.space.tabulate_dof_coordinates()[: problem.owned // problem.dim, : problem.dim]
    points = [term.surface.slave.position for term in problem.contacts]
    snapshot = {
        "nodal": Nodal((2.0 * where - 1.0).reshape(-1)),
        "points": [AtPoints(pair, at + pair) for pair, at in enumerate(points)],
        "flags": AtPoints(0, points[0][:, 0] > 1e-3),
        "facets": {"deep": [AtPoints(0, (1e6 * points[0]).round().astype(np.int32))]},
        "sum": Partial(np.array([1.0, comm.rank + 1.0])),
        "array": np.arange(3.0),
        "plain": [1, "two", None, {"three": 3.0}],
    }
    return Layout(model), snapshot


def gathered(comm: MPI.Comm, directory: Path, name: str = "three bodies") -> dict[str, Any]:
    """What is written of a snapshot; and whether every rank gets back what was its own."""
    layout, snapshot = laid_out(comm, directory, name)
    tree, arrays = layout.gather(snapshot)
    again = layout.scatter(tree, arrays)
    mine = {
        "nodal": np.array_equal(again["nodal"], snapshot["nodal"].values),
        "points": all(
            np.array_equal(a, b.values)
            for a, b in zip(again["points"], snapshot["points"], strict=True)
        ),
        "flags": np.array_equal(again["flags"], snapshot["flags"].values),
        "kinds": again["flags"].dtype == bool and again["facets"]["deep"][0].dtype == np.int32,
        "sum": comm.allreduce(again["sum"]).tolist() == [comm.size, sum(range(comm.size + 1))],
        "array": again["array"].tolist() == [0.0, 1.0, 2.0],
        "plain": again["plain"] == snapshot["plain"],
    }
    wrong = comm.allgather([key for key, right in mine.items() if not right])
    written = {key: array.tolist() for key, array in arrays.items() if "/" not in key}
    identity = {key: array.tolist() for key, array in layout.identity.items()}
    whole = {"tree": tree, "arrays": written, "identity": identity}
    return {"wrong": wrong, "whole": whole}


@pytest.mark.mpi(gathered, 2, 3)
@pytest.mark.parametrize("ranks", [1, 2, 3])
def test_what_is_written_does_not_depend_on_ranks_and_comes_back(on_ranks, ranks):
    found, alone = on_ranks(gathered, ranks), on_ranks(gathered, 1)
    assert found["wrong"] == ranks * [[]]
    mine, theirs = found["whole"], alone["whole"]
    assert mine["tree"] == theirs["tree"] and mine["identity"].keys() == theirs["identity"].keys()
    assert mine["identity"]["cells"] == theirs["identity"]["cells"]
    for key in ("nodes", "points_0", "points_1", "bodies"):
        assert np.allclose(mine["identity"][key], theirs["identity"][key], rtol=0.0, atol=1e-15)
    assert mine["arrays"].keys() == theirs["arrays"].keys()
    name = mine["tree"]["sum"]["$"][1]
    assert mine["arrays"][name] == [ranks, ranks * (ranks + 1) / 2]
    for key, array in mine["arrays"].items():
        assert key == name or np.allclose(array, theirs["arrays"][key], rtol=0.0, atol=1e-14)


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> tuple[Layout, dict[str, Any]]:
    return laid_out(MPI.COMM_SELF, tmp_path_factory.mktemp("plane"), "coulomb")


def test_the_tree_is_plain_data(plane):
    layout, snapshot = plane
    tree, arrays = layout.gather(snapshot)
    assert json.loads(json.dumps(tree)) == tree
    assert all(isinstance(array, np.ndarray) for array in arrays.values())


def test_a_copy_shares_no_memory(plane):
    _, snapshot = plane
    copy = copied(snapshot)
    for kind in (Nodal, AtPoints, Partial):
        for key, value in snapshot.items():
            if isinstance(value, kind):
                assert not np.shares_memory(copy[key].values, value.values)
                assert np.array_equal(copy[key].values, value.values)
    assert not np.shares_memory(copy["array"], snapshot["array"])
    assert copy["plain"] == snapshot["plain"]


def _swap(mesh: dict[str, Any]) -> None:
    mesh["cells"] = mesh["cells"][:, [1, 2, 3, 0]]


def _shift(mesh: dict[str, Any], name: str, by: float) -> None:
    mesh[name] = mesh[name] + by


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: None, []),
        (lambda m: _shift(m, "nodes", 1e-14), []),
        (lambda m: _shift(m, "nodes", 2e-9), ["nodes moved by up to 2e-09 m"]),
        (lambda m: _shift(m, "points_0", 1e-3), ["points moved by up to 0.001 m"]),
        (_swap, ["other cells"]),
        (lambda m: _shift(m, "bodies", 1), ["other bodies of the cells"]),
        (lambda m: m.update(cells=m["cells"][1:]), ["28 cells instead of 29"]),
        (
            lambda m: m.update(points_0=m["points_0"][1:]),
            ["other facets or points: contact points"],
        ),
        (lambda m: m.pop("points_0"), ["other facets or points: contact points"]),
    ],
    ids=range(9),
)
def test_differences_of_meshes_are_named(plane, change, said):
    kept = plane[0].identity
    mine = dict(kept)
    change(mine)
    assert list(differences(mine, kept)) == said
