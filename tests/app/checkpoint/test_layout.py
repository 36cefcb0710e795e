"""Snapshots of all ranks in an order that ranks do not change, and back on other ranks."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.checkpoint.going_on import case_of
from tests.app.checkpoint.small_cases import IMPLICIT
from tribox.app.build.model import build_model
from tribox.app.checkpoint.layout import Layout, differences
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


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> tuple[Layout, dict[str, Any]]:
    return laid_out(MPI.COMM_SELF, tmp_path_factory.mktemp("plane"), "coulomb")


def _swap(mesh: dict[str, Any]) -> None:
    mesh["cells"] = mesh["cells"][:, [1, 2, 3, 0]]


def _shift(mesh: dict[str, Any], name: str, by: float) -> None:
    mesh[name] = mesh[name] + by


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: None, []), (lambda m: _shift(m, "nodes", 1e-14), []),
        (lambda m: _shift(m, "nodes", 2e-9), ["nodes moved by up to 2e-09 m"]),
        (lambda m: _shift(m, "points_0", 1e-3), ["points moved by up to 0.001 m"]),
        (_swap, ["other cells"]),
        (lambda m: _shift(m, "bodies", 1), ["other bodies of the cells"]),
        (lambda m: m.update(cells=m["cells"][1:]), ["28 cells instead of 29"]),
        (lambda m: m.update(points_0=m["points_0"][1:]),
         ["other facets or points: contact points"]),
        (lambda m: m.pop("points_0"), ["other facets or points: contact points"]),
    ],
    ids=range(9),
)  # fmt: skip
def test_differences_of_meshes_are_named(plane, change, said):
    kept = plane[0].identity
    mine = dict(kept)
    change(mine)
    assert list(differences(mine, kept)) == said
