"""Residual and tangent of a small block against every rigid shape, on its control points.

The control points are nodes of a cell of their own here, so that their forces are seen one by one.
They move as a displacement and an angle do.
"""

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from tests.contact_boxes import box, dense_tangent, nodal_forces, slope_error
from tests.geometry.surfaces.rigid_shapes import SMOOTH, STEP
from tests.geometry.surfaces.test_rigid_mesh import hill, parabolas, triangles
from tests.grid import coordinate_element
from tests.laws import coulomb
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.law import Regime
from tribox.geometry.surfaces.rigid import RigidMotion, normals
from tribox.geometry.surfaces.rigid_mesh import MeshSurface
from tribox.geometry.surfaces.rigid_polyline import Polyline
from tribox.geometry.surfaces.rigid_shapes import Extruded, directions_across
from tribox.geometry.surfaces.surface import ContactSurface, RigidMaster

GAP, WIDTH, HEIGHT, PENALTY = 0.05, 0.5, 0.3, 50.0
EIGHT = np.stack([np.arange(8), np.arange(1, 9)], axis=1)
LINE = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])
SHAPES = {
    **SMOOTH,
    "sharp": lambda: Polyline(STEP, [0.0, 0.2, 0.2], continued=(True, True)),
    "segments": lambda: MeshSurface(STEP, LINE),
    "groove": lambda: Polyline(np.array([[-1.0, 0.1], [0.0, 0.0], [1.0, 0.07]])),
    "ridge": lambda: Polyline(np.array([[-1.0, -0.08], [0.0, 0.0], [1.0, -0.07]])),
    "steep": lambda: Polyline(np.array([[0.25, 1.0], [0.0, 0.0], [-0.75, 0.0]])),
    "end": lambda: Polyline(np.array([[-1.0, 0.0], [0.0, 0.0]])),
    "smooth segments": lambda: MeshSurface(parabolas()[0], EIGHT, 1.0),
    "parabolas": lambda: MeshSurface(*parabolas()),
    "triangles": lambda: MeshSurface(*triangles()),
    "quadrilaterals": lambda: MeshSurface(*hill()),
    "smooth quadrilaterals": lambda: MeshSurface(*hill(), 1.0),
}
DEEP = np.array([[-1.0, 0.5], [0.0, 0.0], [1.0, 0.4]])
CORNERS = {
    "punch": lambda: Polyline(np.array([[1.0, 1.0], [1.0, 0.0], [-1.0, 0.0], [-1.0, 1.0]])),
    "deep groove": lambda: Polyline(DEEP),
    "long groove": lambda: Extruded(Polyline(DEEP), np.zeros(3), np.eye(3)[0], np.eye(3)[1]),
}
# Facet and ξ above which the block is put: near the ends of pieces, so that it lies on two.
ABOVE = {
    "end": (0, 0.926), "steep": (1, 0.08), "punch": (1, 0.02), "smooth segments": (3, 0.6),
    "parabolas": (1, 0.9), "triangles": (12, 0.3), "quadrilaterals": (5, 0.9),
    "smooth quadrilaterals": (5, 0.9),
}  # fmt: skip


class Scene:
    """A block above some place of a shape."""

    def __init__(self, shape, friction, pressure="averaged"):
        self.shape, self.dim = shape, shape.dim
        self.place(*ABOVE.get(shape.name, (0, 0.95)))
        cell = "triangle" if self.dim == 2 else "tetrahedron"
        low, high = [-0.5 * WIDTH] * (self.dim - 1) + [GAP], [0.5 * WIDTH] * (self.dim - 1)
        x, cells = box(cell, [3] * (self.dim - 1) + [1], low, [*high, GAP + HEIGHT])
        corner = len(x) + np.arange(self.dim + 1)
        mesh = dolfinx.mesh.create_mesh(
            MPI.COMM_SELF,
            np.concatenate([cells, corner[None]]),
            x=np.concatenate([self.foot + x @ self.frame, shape.control_points]),
            e=coordinate_element(cell, self.dim),
        )
        facets = dolfinx.mesh.locate_entities_boundary(
            mesh, self.dim - 1, lambda X: np.isclose(self.local(X[: self.dim].T)[:, -1], GAP)
        )
        self.space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (self.dim,)))
        self.where = self.space.tabulate_dof_coordinates()[:, : self.dim]
        apart = np.linalg.norm(self.where[:, None] - shape.control_points, axis=2)
        self.tool = np.argmin(apart, axis=0)
        axis = None if self.dim == 2 else np.array([0.2, -1.0, 0.7])
        self.motion = RigidMotion(np.full(self.dim, 0.3), shape.control_points, 0.8, axis)
        master = RigidMaster(self.tool.astype(np.int64), shape)
        surface = ContactSurface(self.space, facets, master, 5)
        self.term = ContactTerm(surface, coulomb(friction), PENALTY, pressure=pressure)

    def place(self, facet, xi):
        """Origin and axes of the block, the last along the normal."""
        where = np.full((1, self.dim - 1), 0.4)
        where[0, 0] = xi
        at = self.shape.at(np.array([facet], dtype=np.int32), where)
        normal = normals(at.tangents)[0]
        self.foot = at.place[0]
        self.frame = np.concatenate([directions_across(normal), normal[None]])

    def local(self, x):
        return (x - self.foot) @ self.frame.T

    def unknowns(self, depth, along, shift, theta, sway=0.01):
        """Displacements (n, i): the block pressed in, and all carried with the tool."""
        bend = sway * np.sin(9.0 * self.local(self.where)[:, 0] + 0.3)
        values = np.outer(bend - GAP - depth, self.frame[-1]) + along * self.frame[0]
        self.move_tool(values, shift, theta)
        values[np.setdiff1d(np.arange(len(values)), self.tool)] += shift
        return values

    def move_tool(self, values, shift, theta):
        controls = self.motion.control_points(shift, theta)
        values[self.tool] = controls - self.shape.control_points

    def residual(self, values):
        return nodal_forces(self.term, self.evaluate(values), len(values)).reshape(-1)

    def evaluate(self, values):
        x = PETSc.Vec().createMPI((values.size, None), bsize=self.dim, comm=MPI.COMM_SELF)
        x.array[:] = values.reshape(-1)
        return self.term.evaluate(x, 1.0)

    def error(self, depth, along, shift, theta):
        """Largest difference of K d from central differences over the largest entry."""
        values = self.unknowns(depth, along, shift, theta)
        K = dense_tangent(self.term, self.evaluate(values), len(values))
        rng, worst = np.random.default_rng(0), 0.0
        for _ in range(2):
            way, turn = rng.normal(size=self.where.shape), rng.normal()
            d = way.copy()
            both = np.concatenate([way[0], [turn * self.motion.length], np.zeros(self.dim - 1)])
            d[self.tool] = self.motion.tangent(theta) @ both

            def along(h, way=way, turn=turn):
                moved = values + h * way
                self.move_tool(moved, shift + h * way[0], theta + h * turn)
                return self.residual(moved)

            worst = max(worst, slope_error(K @ d.reshape(-1), along))
        return worst


def prepared(name, friction, pressure="averaged"):
    shape = (SHAPES | CORNERS)[name]()
    shape.name = name
    scene = Scene(shape, friction, pressure)
    shift = np.array([0.01, -0.02, 0.015])[: scene.dim]
    scene.term.commit(scene.evaluate(scene.unknowns(0.03, 0.0, 0.5 * shift, 0.01)))
    return scene, (0.04, 0.015, shift, 0.03)


@pytest.mark.parametrize("pressure", ["averaged", "pointwise"])
@pytest.mark.parametrize("friction", [50.0, 0.1], ids=["stick", "slip"])
@pytest.mark.parametrize("name", SHAPES)
def test_tangent_against_differences(name, friction, pressure):
    """With points on several pieces, at a corner, and along rays where there are kinks."""
    scene, state = prepared(name, friction, pressure)
    trial = scene.evaluate(scene.unknowns(*state))
    regime = Regime.STICK if friction > 1.0 else Regime.SLIP
    assert np.count_nonzero(trial.response.regime == regime) >= 2
    assert np.count_nonzero(trial.pressure) >= 4
    pieces = len(np.unique(trial.projection.facet[trial.pressure > 0.0]))
    assert pieces >= 2 or name in ("line", "plane", "sharp", "segments", "steep", "end")
    along_rays = scene.shape.has_kinks and pressure == "averaged"
    assert (trial.projection.rays is not None) == along_rays
    assert scene.error(*state) < 1e-8


@pytest.mark.parametrize("friction", [50.0, 0.1], ids=["stick", "slip"])
@pytest.mark.parametrize("name", ["deep groove", "long groove"])
def test_tangent_of_points_at_a_corner_or_on_an_edge(name, friction):
    scene, state = prepared(name, friction, "pointwise")
    state = (0.1, *state[1:])
    trial = scene.evaluate(scene.unknowns(*state))
    assert np.count_nonzero(trial.projection.clamped & trial.kinematics.closed) >= 2
    assert scene.error(*state) < 1e-8


def test_points_fade_at_the_end_of_a_polyline():
    scene, state = prepared("end", 0.1)
    at = scene.evaluate(scene.unknowns(*state)).projection
    assert np.any((at.share > 0.05) & (at.share < 0.95))
    assert not at.on_surface.all()


@pytest.mark.parametrize("along_rays", [True, False])
def test_the_corner_of_a_punch_presses_straight_along_rays_alone(along_rays):
    """Closest points of a flat slave below it are on its flank, which presses sideways."""
    scene, _ = prepared("punch", 0.0)
    scene.shape.has_kinks = along_rays
    scene = Scene(scene.shape, 0.0)
    values = scene.unknowns(0.04, 0.0, np.zeros(2), 0.0, sway=0.0)
    trial = scene.evaluate(values)
    along, down = scene.frame @ scene.residual(values).reshape(-1, 2)[scene.tool].sum(axis=0)
    assert down > 0.1 * PENALTY * 0.04 * WIDTH
    assert not trial.projection.on_surface.all() or not along_rays
    assert (abs(along) < 1e-12) if along_rays else (abs(along) > 0.02 * down)


@pytest.mark.parametrize("name", SHAPES)
def test_forces_and_moments_on_slave_and_tool_cancel(name):
    """The control points take the force and its moment; friction acts across the gap g."""
    scene, state = prepared(name, 0.1)
    values = scene.unknowns(*state)
    force = scene.residual(values).reshape(-1, scene.dim)
    trial, here = scene.evaluate(values), scene.where + values
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-13 * np.abs(force).max())
    weight = scene.term.surface.slave.weight
    lever = trial.position - trial.projection.foot
    couple = np.einsum("q,qij->ij", weight, moment(lever, -trial.traction))
    total = moment(here, force).sum(axis=0)
    np.testing.assert_allclose(total, couple, atol=1e-12 * np.abs(force).max())


def moment(arm, force):
    """Moments (p, i, j), as skew tensors."""
    return arm[:, :, None] * force[:, None, :] - arm[:, None, :] * force[:, :, None]


@pytest.mark.parametrize("name", ["circle", "die", "groove", "segments", "sphere", "triangles"])
def test_a_block_that_moves_with_the_tool_does_not_slip(name):
    """A rigid motion of both changes neither pressure nor friction, and turns the forces."""
    scene, state = prepared(name, 50.0)
    values = scene.unknowns(*state)
    scene.term.commit(scene.evaluate(values))
    before, trial = scene.residual(values).reshape(-1, scene.dim), scene.evaluate(values)
    theta, shift = state[3] + 0.4, state[2] + 0.1
    turn = scene.motion.rotation(theta) @ scene.motion.rotation(state[3]).T
    centre = scene.motion.centre + state[2]
    moved = scene.motion.centre + shift + (scene.where + values - centre) @ turn.T - scene.where
    after, later = scene.residual(moved).reshape(-1, scene.dim), scene.evaluate(moved)
    np.testing.assert_allclose(after, before @ turn.T, atol=1e-10 * np.abs(before).max())
    np.testing.assert_allclose(later.kinematics.slip, 0.0, atol=1e-13)
    assert np.abs(trial.response.traction).max() > 0.01
