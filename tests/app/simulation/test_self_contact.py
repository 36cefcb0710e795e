"""A body whose surfaces close on each other: a clip of two legs that a plane presses together."""

import numpy as np
import pytest

from tests.mesh_file import write_mesh
from tests.solved import solved
from tribox.app.errors import InputError

MM = 1e-3
LONG, LEG, GAP = 8, 2, 1  # cells of 0.5 mm by 0.25 mm: of a leg, over its height, and between


def clip(path, halves, shared=False):
    """A clip as a gmsh file; halves: of two bodies that share nodes; shared: its slot is one."""
    high = 2 * LEG + GAP
    nodes = [(0.5 * i, 0.25 * j) for j in range(high + 1) for i in range(LONG + 1)]

    def at(i, j):
        return 1 + i + (LONG + 1) * j

    rows = [f"1 2 1 1 {at(i, 0)} {at(i + 1, 0)}" for i in range(LONG)]
    rows += [f"1 2 2 2 {at(i + 1, high)} {at(i, high)}" for i in range(LONG)]
    start = 1 if shared else 2
    rows += [f"1 2 3 3 {at(i + 1, LEG)} {at(i, LEG)}" for i in range(1, LONG)]
    rows += [f"1 2 4 4 {at(i, LEG + GAP)} {at(i + 1, LEG + GAP)}" for i in range(start, LONG)]
    if shared:
        rows += [f"1 2 3 3 {at(1, LEG + 1)} {at(1, LEG)}"]
    for j in range(high):
        for i in range(LONG):
            if LEG <= j < LEG + GAP and i > 0:
                continue
            tag = 6 if halves and j >= LEG + GAP else 5
            cell = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
            rows.append(f"3 2 {tag} {tag} {' '.join(map(str, cell))}")
    names = ['1 1 "floor"', '1 2 "back"', '1 3 "lower"', '1 4 "upper"', '2 5 "clip"']
    names += ['2 6 "leg"'] if halves else []
    write_mesh(path, names, nodes, rows)
    return {"mesh": str(path), "scale": "mm"}


def pressed(geometry, **tables):
    """The clip on its floor, pressed at its back until its legs meet and rub."""
    rubber = {"material": "neo-hookean", "E": "5 MPa", "nu": 0.4}
    names = ["clip", "leg"] if tables.pop("halves", False) else ["clip"]
    way = {"x": [[0.0, 0.0], [1.0, 0.1 * MM]], "y": [[0.0, 0.0], [1.0, -0.5 * MM]]}
    high = 0.25 * (2 * LEG + GAP) * MM
    plane = {"shape": "plane", "point": [0.0, high], "normal": [0, -1], "displacement": way}
    dry = {"law": "coulomb", "mu": 0.3}
    return {
        "geometry": geometry,
        "bodies": {name: rubber for name in names},
        "tools": {"plane": plane},
        "contact": [
            {"slave": "back", "master": "plane", "friction": dry},
            {"slave": "upper", "master": "lower", "friction": dry},
        ],
        "boundary": [{"surface": "floor", "displacement": {"x": 0, "y": 0}}],
        "stage": [{"name": "press", "duration": "1 s", "steps": 8}],
        **tables,
    }


def of_legs(done):
    """Normal force of the legs on each other, N, step by step."""
    column = done.state.pair_columns.index("normal_force")
    return [row[column] for row in done.state.pair_rows[1::2]]


def facts(comm, directory):
    """Forces and work of the clip, one body and, on one rank, two."""
    found = []
    for halves in (False, True)[: 1 + (comm.size == 1)]:
        path = directory / f"clip-{halves}-{comm.size}.msh"
        if comm.rank == 0:
            clip(path, halves)
        comm.barrier()
        done = solved(pressed({"mesh": str(path), "scale": "mm"}, halves=halves), comm)
        rows = [(r.normal_force, r.friction_force, r.external_work) for r in done.rows]
        pair = of_legs(done)
        resultant = done.state.motion.force_balance({"press"})
        found.append({"rows": rows, "pair": pair, "left": resultant})
    return found


@pytest.mark.mpi(facts, 2)
def test_a_body_that_closes_on_itself_is_as_two_that_are_one(on_ranks):
    one, two = on_ranks(facts, 1)
    assert one["pair"][0] == 0.0 and one["pair"][-1] > 1e-2 * one["rows"][-1][0]
    np.testing.assert_allclose(one["rows"], two["rows"], rtol=1e-7)
    assert one["left"] < 1e-7 and two["left"] < 1e-7
    [shared] = on_ranks(facts, 2)
    np.testing.assert_allclose(shared["rows"], one["rows"], rtol=1e-6)


def test_surfaces_that_share_a_node_cannot_close_there(tmp_path):
    with pytest.raises(InputError, match='share 1 nodes, so body "clip" cannot close there; leave'):
        solved(pressed(clip(tmp_path / "clip.msh", False, shared=True)))


def test_explicit_steps_know_no_difference_either(tmp_path):
    found = []
    for halves in (False, True):
        data = pressed(clip(tmp_path / f"clip-{halves}.msh", halves), halves=halves)
        for body in data["bodies"].values():
            body["density"] = 1e5  # steps ten times as long as those of rubber
        motion = data["tools"]["plane"]["displacement"]
        for table in motion.values():
            table[1][0] = 1e-3
        data["solver"] = {"kind": "explicit", "damping": "2e3 1/s"}
        data["stage"] = [{"name": "press", "duration": "1 ms", "steps": 2}]
        done = solved(data)
        found.append([of_legs(done), [row.external_work for row in done.rows]])
    assert found[0][0][-1] > 0.0
    np.testing.assert_allclose(found[0], found[1], rtol=1e-7)
