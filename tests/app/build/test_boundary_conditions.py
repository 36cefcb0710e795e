"""What boundaries prescribe: directions, rotations, the axis of symmetry, platens."""

from dataclasses import dataclass, field
from functools import lru_cache

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from tribox.app.build.boundary_conditions import Loads
from tribox.app.case.boundary import Boundary
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.errors import InputError
from tribox.app.implicit.newton import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper, StepResult
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid
from tribox.geometry.generators.cylinders import FlatBlock, HalfCylinder, LineContact
from tribox.geometry.generators.two_blocks import Block, Box, TwoBlocks
from tribox.geometry.meshes.mesh import NamedMesh, generate


@lru_cache
def mesh(kind: str) -> NamedMesh:
    if kind == "3D":
        boxes = TwoBlocks(Box(1.0, 0.5, 0.8, (2, 1, 2)), Box(2.0, 0.5, 1.0, (3, 1, 2)))
        return generate(boxes, MPI.COMM_WORLD)
    offset = 0.0 if kind == "axisymmetric" else None
    blocks = TwoBlocks(Block(1.0, 0.5, (2, 1)), Block(2.0, 0.5, (3, 1)), offset)
    return generate(blocks, MPI.COMM_WORLD)


@dataclass
class Setting:
    """Boundaries on two bodies that nothing else holds."""

    section: str
    boundaries: list[dict]
    degree: int = 1
    u: dolfinx.fem.Function = field(init=False)
    loads: Loads = field(init=False)

    def __post_init__(self) -> None:
        named = mesh(self.section)
        element = ("Lagrange", self.degree, (named.mesh.geometry.dim,))
        self.u = dolfinx.fem.Function(dolfinx.fem.functionspace(named.mesh, element))
        self.loads = Loads(named, self.u, self.section, 1.0)
        for boundary in self.boundaries:
            self.loads.add(Boundary.model_validate(boundary))

    def moved(self, time: float, driven: float) -> np.ndarray:
        """Prescribed displacements (n, i); NaN where nothing is."""
        for program in self.loads.programs:
            program(time, driven)
        problem = Equilibrium(self.u, [], [], self.loads.prescribed, self.loads.platens)
        x = problem.new_vector()
        x.array[:] = np.nan
        return problem.constrained_values(x).reshape(-1, self.u.function_space.mesh.geometry.dim)

    def on(self, where) -> np.ndarray:
        """Positions of owned nodes, and which of them a condition chooses."""
        space = self.u.function_space
        owned = space.dofmap.index_map.size_local
        x = space.tabulate_dof_coordinates()[:owned, : space.mesh.geometry.dim]
        return x, where(x)


def top(x):
    return x[:, 1] > 0.5 - 1e-9


@pytest.mark.parametrize("degree", [1, 2])
def test_driven_along_a_direction(degree):
    table = {"x": "driven", "z": "driven", "y": -0.1, "direction": [3.0, 0.0, 4.0]}
    case = Setting("3D", [{"surface": "top", "displacement": table}], degree)
    _, chosen = case.on(top)
    values = case.moved(1.0, 0.5)
    total = case.u.function_space.mesh.comm.allreduce(int(chosen.sum()))
    assert total == (9 if degree == 1 else 25)
    np.testing.assert_allclose(values[chosen], np.tile([0.3, -0.1, 0.4], (chosen.sum(), 1)))
    assert np.isnan(values[~chosen]).all()


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_rotation_in_space(axis):
    """Distances from the axis are kept, and the angle is right-handed about it."""
    centre = np.array([0.7, 0.2, 0.4])
    turn = {"axis": axis, "centre": list(centre), "angle": [["0 s", "0 deg"], ["1 s", "90 deg"]]}
    case = Setting("3D", [{"surface": "top", "rotation": turn}])
    x, chosen = case.on(top)
    along = "xyz".index(axis)
    first, second = (along + 1) % 3, (along + 2) % 3
    values = case.moved(1.0, 0.0)[chosen]
    assert np.isnan(values[:, along]).all()
    arm = x[chosen] - centre
    np.testing.assert_allclose(arm[:, first] + values[:, first], -arm[:, second], atol=1e-14)
    np.testing.assert_allclose(arm[:, second] + values[:, second], arm[:, first], atol=1e-14)
    small = case.moved(1e-9, 0.0)[chosen]
    angle = 0.5 * np.pi * 1e-9
    np.testing.assert_allclose(small[:, first], -angle * arm[:, second], rtol=1e-6)


@pytest.mark.parametrize("degree", [1, 2])
def test_the_axis_of_symmetry_stays_where_it_is(degree):
    case = Setting("axisymmetric", [{"surface": "top", "displacement": {"x": 0.0}}], degree)
    x, chosen = case.on(lambda x: x[:, 0] < 1e-12)
    values = case.moved(1.0, 0.0)
    np.testing.assert_array_equal(values[chosen, 0], 0.0)
    nodes = case.u.function_space.mesh.comm.allreduce(int(chosen.sum()))
    assert nodes == (4 if degree == 1 else 6)
    assert np.isnan(values[~chosen & (x[:, 1] < 0.5 - 1e-9)]).all()
    assert np.isnan(values[:, 1]).all()
    case.loads.check_corners()  # x = 0 of the top agrees with the axis


def test_an_axis_that_is_told_to_move_is_refused():
    case = Setting("axisymmetric", [{"surface": "top", "displacement": {"x": "driven"}}])
    with pytest.raises(InputError, match='"the axis x = 0" and "top" share a node'):
        case.loads.check_corners()


def test_surfaces_of_one_rotation_may_share_nodes():
    turn = {"axis": "y", "angle": 0.1}
    two = [{"surface": s, "rotation": turn} for s in ("top", "elastomer_left")]
    Setting("3D", two).loads.check_corners()
    other = {"surface": "elastomer_left", "rotation": {"axis": "y", "angle": 0.2}}
    with pytest.raises(InputError, match="each in its own way"):
        Setting("3D", [two[0], other]).loads.check_corners()


@pytest.mark.parametrize(
    ("section", "surface", "direction", "force"),
    [
        ("3D", "top", "y", -0.8 * 3.0),
        ("3D", "elastomer_front", "z", -0.5 * 3.0),
        ("3D", "aluminium_left", "x", 0.5 * 3.0),
        ("axisymmetric", "top", "y", -np.pi * 3.0),
        ("axisymmetric", "elastomer_right", "x", -np.pi * 3.0),
        ("plane-strain", "top", "y", -1.0 * 3.0),
    ],
)
def test_force_of_a_platen(section, surface, direction, force):
    """Pressure times the whole reference area, into the body."""
    platen = {"direction": direction, "pressure": 3.0}
    case = Setting(section, [{"surface": surface, "platen": platen}])
    for program in case.loads.programs:
        program(0.0, 0.0)
    assert case.loads.platens[0].force == pytest.approx(force, rel=1e-12)


def test_a_platen_along_its_surface_is_refused():
    with pytest.raises(InputError, match='direction = "z" is tangential'):
        Setting("3D", [{"surface": "top", "platen": {"direction": "z", "force": 1.0}}])


@pytest.mark.parametrize(
    ("surface", "said"),
    [
        ("top", []),
        ("elastomer_contact", ["is curved or oblique (mean normal 0.", "moves as one along that"]),
    ],
)
def test_a_platen_on_a_curved_surface_is_noted(surface, said):
    half, flat = HalfCylinder(10.0, 9.9, 2.0), FlatBlock(20.0, 10.0, 9.9, 2.0)
    named = generate(LineContact(half, flat), MPI.COMM_SELF)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(named.mesh, ("Lagrange", 1, (2,))))
    loads = Loads(named, u, "plane-strain", 1.0)
    platen = {"direction": "y", "pressure": 1e3}
    loads.add(Boundary.model_validate({"surface": surface, "platen": platen}))
    assert len(loads.notes) == bool(said)
    for part in said:
        assert part in loads.notes[0]


# -- Platens, planes of symmetry and loads along no axis: as along one, in a frame that is turn

SOFT = NeoHookean(shear_modulus=1.0, bulk_modulus=5.0)


def shape(dim: int):
    if dim == 3:
        return TwoBlocks(Box(1.0, 0.5, 0.8, (3, 2, 2)), Box(2.0, 0.5, 1.0, (2, 1, 1)), gap=1.0)
    return TwoBlocks(Block(1.0, 0.5, (4, 2)), Block(2.0, 0.5, (3, 1)), gap=1.0)


class Problem:
    """An upper block under boundaries in a turned frame; the lower is held fast."""

    def __init__(self, turn: np.ndarray, boundaries: list[dict], degree: int = 1) -> None:
        self.dim = len(turn)
        self.turn = turn
        self.named: NamedMesh = generate(shape(self.dim), MPI.COMM_WORLD)
        x = self.named.mesh.geometry.x
        self.places = x[:, : self.dim].copy()
        x[:, : self.dim] = x[:, : self.dim] @ turn.T
        element = ("Lagrange", degree, (self.dim,))
        self.u = dolfinx.fem.Function(dolfinx.fem.functionspace(self.named.mesh, element))
        section = "3D" if self.dim == 3 else "plane-strain"
        self.loads = Loads(self.named, self.u, section, 1.0)
        fast = {"surface": "bottom", "displacement": dict.fromkeys("xyz"[: self.dim], 0)}
        for boundary in [fast, *boundaries]:
            self.loads.add(Boundary.model_validate(boundary))
        self.loads.finish()
        kind = "q2" if degree == 2 else "q1"
        solids = [
            Solid(name, self.u, self.named.cells(name), SOFT, kind)
            for name in ("elastomer", "aluminium")
        ]
        loads = self.loads
        self.equilibrium = Equilibrium(
            self.u,
            solids,
            [],
            loads.prescribed,
            loads.platens,
            loads.forms.loads,
            loads.nodal_loads,
        )
        self.stepper = ImplicitStepper(self.equilibrium, ImplicitOptions(tolerance=1e-12))

    def step(self, time: float) -> StepResult:
        for program in self.loads.programs:
            program(time, 0.0)
        return self.stepper.advance(1.0)

    def turned_back(self) -> np.ndarray:
        """Displacements (n, i) at the owned nodes in the frame that is not turned."""
        out: np.ndarray = self.stepper.x.array_r.reshape(-1, self.dim) @ self.turn
        return out

    def direction(self, vector: list[float]) -> list[float]:
        return (self.turn @ np.array(vector)).tolist()


def turned(dim: int) -> np.ndarray:
    if dim == 2:
        return Rotation.from_euler("z", 0.4).as_matrix()[:2, :2]
    return Rotation.from_rotvec([0.5, -0.3, 0.7]).as_matrix()


def boundaries(turn: np.ndarray, force: float | None) -> list[dict]:
    """A block on a side that slides, pressed askew from above by a platen, and sheared."""
    dim = len(turn)
    side, axis = np.eye(dim)[:2]
    platen = {"direction": (turn @ axis).tolist()}
    if force is None:
        ramp = [["0 s", 0.0], ["2 s", 0.1]]
        platen |= {"force": 0, "displacement": ramp, "displacement_stages": ["s"]}
    else:
        platen |= {"force": [["0 s", 0.0], ["2 s", force]]}
    shear = dict(zip("xyz", (turn @ (0.05 * side + 0.02 * axis)).tolist(), strict=False))
    out = [
        {"surface": "top", "platen": platen},
        {"surface": "elastomer_left", "symmetry": True},
        {"surface": "elastomer_contact", "symmetry": True},
        {"surface": "elastomer_right", "traction": shear},
    ]
    if dim == 3:
        out.append({"surface": "elastomer_front", "symmetry": True})
    return out


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("force", [0.15, None], ids=["force", "displacement"])
def test_an_oblique_platen_is_one_along_an_axis_in_a_turned_frame(dim, force, monkeypatch):
    plain = Problem(np.eye(dim), boundaries(np.eye(dim), force))
    oblique = Problem(turned(dim), boundaries(turned(dim), force))
    assert not plain.equilibrium.constraints.slanted
    assert len(oblique.equilibrium.constraints.slanted) == dim + 1
    if force is None:
        plain.loads.stage = oblique.loads.stage = "s"
    for time in (1.0, 2.0):
        results = [one.step(time) for one in (plain, oblique)]
        assert results[0].iterations == results[1].iterations
    moved = plain.stepper.x.array_r.reshape(-1, dim)
    assert np.abs(oblique.turned_back() - moved).max() < 1e-10 * np.abs(moved).max()
    reactions = [one.equilibrium.reaction(one.equilibrium.platens[0]) for one in (plain, oblique)]
    assert abs(reactions[0]) > 0.05
    assert reactions[1] == pytest.approx(reactions[0], rel=1e-9)


def test_newton_converges_quadratically_on_an_oblique_platen():
    one = Problem(turned(2), boundaries(turned(2), 0.6))
    residuals = np.array(one.step(2.0).residuals)
    late = np.nonzero((residuals < 1e-1) & (residuals > 1e-8))[0]
    assert len(late) >= 2
    for at in late[:-1]:
        assert residuals[at + 1] < 30.0 * residuals[at] ** 2


SIDE = {"surface": "elastomer_left", "symmetry": True}
STUCK = {
    "both decide its displacement in an oblique direction": {
        "platen": {"direction": (turned(2) @ [1.0, 1e-5]).tolist(), "force": 0}
    },
    "at a node of elastomer_left other boundaries hold all that it could move": {
        "displacement": {"x": 0, "y": 0}
    },
}


@pytest.mark.parametrize("message", STUCK, ids=["one direction", "nothing left"])
def test_oblique_surfaces_leave_each_other_something_at_a_corner(message):
    faces = [SIDE, {"surface": "top", **STUCK[message]}]
    with pytest.raises(InputError, match=message):
        Problem(turned(2), faces)
