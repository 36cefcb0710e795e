"""Which bodies their supports leave free to move as a whole."""

import tomllib

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tests.grid import grid
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.equilibrium.constraints import Platen, Prescribed
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.supports import (
    free_bodies,
    joined_bodies,
    loose_directions,
    rigid_motions,
    supports_at_hand,
)
from tribox.app.implicit.loose_bodies import WeakHold
from tribox.app.run.run import run_case
from tribox.forms.bodies.materials import Hencky
from tribox.forms.bodies.solid import Solid

SIZE = 2e-3


def problem(dim, supports=(), platen=None, section=None):
    """One body, supported at sides: (axis, end, component) each."""
    mesh = grid({2: "quadrilateral", 3: "hexahedron"}[dim], (2,) * dim, [SIZE] * dim)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,))))
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    solid = Solid("block", u, cells, Hencky(1.0, 1.0), "q1-sri", 1.0, section)

    def side(axis, end):
        return dolfinx.mesh.locate_entities_boundary(
            mesh, dim - 1, lambda x: np.isclose(x[axis], end * SIZE, atol=1e-9)
        )

    prescribed = [Prescribed.on(u, side(axis, end), component) for axis, end, component in supports]
    platens = []
    if platen is not None:
        axis, end, component, stiffness = platen
        dofs = Prescribed.on(u, side(axis, end), component).dofs
        platens = [Platen(dofs, force=-1.0, stiffness=stiffness)]
    return Equilibrium(u, [solid], [], prescribed, platens)


@pytest.mark.parametrize(
    ("supports", "platen", "free"),
    [
        ([], None, True),
        ([(1, 0, 1)], None, True),  # a sliding bottom: free along x
        ([(1, 0, 0), (1, 0, 1)], None, False),
        ([(1, 0, 1), (0, 0, 0)], None, False),  # two planes of symmetry
        ([(0, 0, 0), (0, 1, 0)], None, True),  # held in x on both sides: free along y
        ([(0, 0, 0)], (1, 1, 1, 0.0), True),  # a platen under a force moves along it
        ([(0, 0, 0)], (1, 1, 1, 3.0), False),  # a spring holds
        ([(1, 0, 0)], (1, 1, 1, 3.0), False),
    ],
)
def test_a_body_in_the_plane_is_free_unless_every_rigid_motion_is_prevented(supports, platen, free):
    bodies = free_bodies(problem(2, supports, platen))
    assert [body.name for body in bodies] == (["block"] if free else [])
    assert all(body.extent == pytest.approx(SIZE) for body in bodies)


def test_in_space_a_plane_does_not_hold_a_body_and_three_do():
    assert free_bodies(problem(3, [(2, 0, 2)]))
    assert free_bodies(problem(3, [(2, 0, 2), (1, 0, 1)]))
    assert not free_bodies(problem(3, [(2, 0, 2), (1, 0, 1), (0, 0, 0)]))


def test_a_body_of_revolution_moves_along_its_axis_only():
    assert free_bodies(problem(2, section="axisymmetric"))
    assert not free_bodies(problem(2, [(1, 0, 1)], section="axisymmetric"))


@pytest.mark.parametrize("dim", [2, 3])
def test_rigid_motions_stretch_nothing(dim):
    place = np.random.default_rng(1).normal(size=(7, dim))
    modes = rigid_motions(place)
    assert modes.shape == (7, 3 if dim == 2 else 6, dim)
    apart = place[:, None] - place[None]
    moved = modes[:, None] - modes[None]
    assert np.abs(np.einsum("nmri,nmi->nmr", moved, apart)).max() < 1e-14


def test_bonded_bodies_are_held_together_or_float_as_one():
    """Two blocks that share nodes: a support of one is a support of both."""
    mesh = grid("quadrilateral", (2, 1), [2 * SIZE, SIZE])
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,))))
    cells = np.arange(mesh.topology.index_map(2).size_local, dtype=np.int32)
    left = dolfinx.mesh.compute_midpoints(mesh, 2, cells)[:, 0] < SIZE
    material = Hencky(1.0, 1.0)
    parts = {"left": cells[left], "right": cells[~left]}
    solids = [Solid(n, u, part, material, "q1", 1.0, None) for n, part in parts.items()]
    [both] = free_bodies(Equilibrium(u, solids, [], [], []))
    assert both.name == "left and right" and both.extent == pytest.approx(2 * SIZE)
    at = dolfinx.mesh.locate_entities_boundary(mesh, 1, lambda x: np.isclose(x[0], 0.0))
    held = [Prescribed.on(u, at, component) for component in (0, 1)]
    assert free_bodies(Equilibrium(u, solids, [], held, [])) == []


# -- Bodies that common nodes or ties join are supported, and float, as one ------------------------

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
