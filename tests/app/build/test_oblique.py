"""Platens, planes of symmetry and loads along no axis: as along one, in a frame that is turned."""

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from tribox.app.build.boundary_conditions import Loads
from tribox.app.case.boundary import Boundary
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.errors import InputError
from tribox.app.implicit.options import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper, StepResult
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.generators.two_boxes import Box, TwoBoxes
from tribox.geometry.meshes.mesh import NamedMesh, generate

SOFT = NeoHookean(shear_modulus=1.0, bulk_modulus=5.0)


def shape(dim: int):
    if dim == 3:
        return TwoBoxes(Box(1.0, 0.5, 0.8, (3, 2, 2)), Box(2.0, 0.5, 1.0, (2, 1, 1)), gap=1.0)
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
    direction = (turn @ axis).tolist()
    platen = {"direction": direction}
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
    result = one.step(2.0)
    residuals = np.array(result.residuals)
    late = np.nonzero((residuals < 1e-1) & (residuals > 1e-8))[0]
    assert len(late) >= 2
    for at in late[:-1]:
        assert residuals[at + 1] < 30.0 * residuals[at] ** 2


STUCK = {
    "one direction": (
        [
            {"surface": "elastomer_left", "symmetry": True},
            {
                "surface": "top",
                "platen": {"direction": (turned(2) @ [1.0, 1e-5]).tolist(), "force": 0},
            },
        ],
        "both decide its displacement in an oblique direction",
    ),
    "nothing left": (
        [
            {"surface": "elastomer_left", "symmetry": True},
            {"surface": "top", "displacement": {"x": 0, "y": 0}},
        ],
        "at a node of elastomer_left other boundaries hold all that it could move",
    ),
}


@pytest.mark.parametrize("name", STUCK)
def test_oblique_surfaces_leave_each_other_something_at_a_corner(name):
    faces, message = STUCK[name]
    with pytest.raises(InputError, match=message):
        Problem(turned(2), faces)
