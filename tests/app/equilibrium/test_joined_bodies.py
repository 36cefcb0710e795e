"""Bodies that common nodes or ties join are supported, and float, as one."""

import tomllib

import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.equilibrium.supports import joined_bodies, loose_directions, supports_at_hand
from tribox.app.implicit.loose_bodies import WeakHold
from tribox.app.run.run import run_case

PRESSED = [["0 s", "0 MPa"], ["1 s", "1 MPa"], ["2 s", "0 MPa"]]


def two_blocks(block, boundaries, tied=True):
    """The problem of two blocks, tied or not, that some of their boundaries hold."""
    data = tomllib.loads(block)
    held = [{"surface": name, "displacement": {"x": 0, "y": 0}} for name in boundaries]
    data["boundary"] = held or [{"surface": "top", "pressure": [["0 s", "0 Pa"], ["1 s", "1 Pa"]]}]
    if tied:
        del data["contact"][0]["friction"]
        data["contact"][0]["tied"] = True
    data["stage"] = [{"name": "all", "duration": "1 s", "steps": 1}]
    return build_model(Case.model_validate(data), MPI.COMM_SELF)


@pytest.mark.parametrize(
    ("boundaries", "tied", "free"),
    [
        (["bottom"], True, []),
        (["top"], True, []),
        ([], True, ["elastomer and aluminium"]),
        (["bottom"], False, ["elastomer"]),
    ],
)
def test_tied_bodies_are_held_or_free_together(block, boundaries, tied, free):
    model = two_blocks(block, boundaries, tied)
    hold = WeakHold(model.problem)
    assert [body.name for body in hold.bodies] == free
    loose = {one.body for one in loose_directions(model.problem)}
    assert loose == {name for names in free for name in names.split(" and ")}
    # The tie between them keeps nothing in its place; the contact does.
    assert hold.pairs == [[] if tied else [0] for _ in free]
    lines = [note for note in model.notes if "only contact holds it there" in note]
    assert bool(lines) == bool(free)


def test_a_tie_that_acts_no_more_holds_no_more(block):
    problem = two_blocks(block, ["bottom"]).problem
    before = supports_at_hand(problem)
    problem.contacts[0].renew(active=False)
    assert supports_at_hand(problem) != before
    assert [body.name for body in WeakHold(problem).bodies] == ["elastomer"]
    assert [one.names for one in joined_bodies(problem, [True])] == [("elastomer", "aluminium")]


@pytest.mark.parametrize(("support", "floats"), [(True, False), (False, True)])
def test_tied_blocks_that_are_pressed_float_together_or_not_at_all(
    block, tmp_path, support, floats
):
    """On a support the tie holds the upper one when the load has gone; else both float as one."""
    data = tomllib.loads(block)
    for name in ("upper", "lower"):
        data["geometry"][name] = {"width": "1 mm", "height": "0.5 mm", "elements": [3, 2]}
    del data["contact"][0]["friction"]
    data["contact"][0]["tied"] = True
    held = {"surface": "bottom", "displacement": {"x": 0, "y": 0}}
    stages = {} if support else {"stages": ["press"]}
    data["boundary"] = [{"surface": "top", "pressure": PRESSED}, held | stages]
    names = ("press", "leave")
    data["stage"] = [{"name": name, "duration": "1 s", "steps": 1} for name in names]
    rows = run_case(
        Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF
    ).rows
    log = read_log(tmp_path / "out")
    assert (" floats in " in log) is floats
    assert ("body elastomer and aluminium floats in 1 step" in log) is floats
    assert rows[-1].strain_energy < 1e-9 * rows[0].strain_energy
