"""A rigid tool as master: its forces and moment, its tangent with the angle, its invariance."""

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from tests.contact_boxes import dense_tangent, nodal_forces, unknowns_of
from tests.laws import coulomb
from tribox.forms.contact.penalty import ContactTerm
from tribox.geometry.generators.two_blocks import Block as Rectangle
from tribox.geometry.generators.two_blocks import Box, TwoBlocks
from tribox.geometry.meshes.blocks import Block, with_blocks
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.surfaces.rigid import RigidMotion
from tribox.geometry.surfaces.rigid_mesh import MeshSurface
from tribox.geometry.surfaces.rigid_polyline import Polyline
from tribox.geometry.surfaces.rigid_shapes import Circle, Plane
from tribox.geometry.surfaces.surface import ContactSurface

PENALTY = 40.0
SHAPES = {
    2: TwoBlocks(Rectangle(1.0, 0.5, (4, 2)), Rectangle(2.0, 0.4, (2, 1))),
    3: TwoBlocks(Box(1.0, 0.5, 1.0, (2, 1, 2)), Box(2.0, 0.4, 2.0, (2, 1, 2))),
}


class Scene:
    """The lower side of the upper body against a tool below it."""

    def __init__(self, dim=2, kind="averaged", degree=1, mu=0.3, shape=None):
        self.dim = dim
        self.named = generate(SHAPES[dim], MPI.COMM_SELF)
        block = Block.of_numbers("tool", dim + 1, MPI.COMM_SELF)
        plain = dolfinx.fem.functionspace(self.named.mesh, ("Lagrange", degree, (dim,)))
        self.space = with_blocks(plain, [block])
        facets = self.named.facets("elastomer_contact")
        self.tool = block.nodes[[0, -1]]
        at = plain.tabulate_dof_coordinates()[:, :dim]
        edge = dolfinx.fem.locate_dofs_topological(self.space, dim - 1, facets)
        self.low = at[edge].min(axis=0)
        if dim == 2:
            self.surface = Circle(np.array([self.low[0] + 0.6, self.low[1] - 0.8]), 0.82)
            self.centre, axis = np.array([self.low[0] + 0.3, self.low[1] - 1.3]), None
        else:
            self.surface = Plane(self.low + np.array([0.1, 0.0, 0.3]), [0.1, 1.0, -0.05])
            self.centre, axis = self.low + np.array([0.2, -0.4, 0.1]), np.array([0.3, 0.2, 1.0])
        if shape is not None:
            self.surface = shape(self.low)
        self.motion = RigidMotion(self.centre, self.surface.control_points, 0.7, axis)
        tool = self.surface, self.tool, self.motion
        pair = ContactSurface.for_tool(self.space, facets, *tool, 5)
        law = coulomb(mu, 25.0)
        self.term = ContactTerm(pair, law, PENALTY, pressure=kind, modulus=3.0)
        self.size = self.space.dofmap.index_map.size_local * dim

    def unknowns(self, seed, sway=0.004, tool=0.02, theta=0.1):
        """Nodes that sway a little, and a tool that is pressed on and turned."""
        random = np.random.default_rng(seed)
        x = sway * random.standard_normal(self.size).reshape(-1, self.dim)
        x[self.tool[0]] = tool * np.array([0.4, 1.0, -0.3])[: self.dim]
        x[self.tool[1]] = 0.0
        x[self.tool[1], 0] = theta * self.motion.length
        return x.reshape(-1)

    def vector(self, x):
        out = PETSc.Vec().createMPI((self.size, None), bsize=self.dim, comm=MPI.COMM_SELF)
        out.array[:] = x
        return out

    def residual(self, x):
        trial = self.term.evaluate(self.vector(x), 1.0)
        return nodal_forces(self.term, trial, self.size // self.dim).reshape(-1), trial

    def tangent(self, x):
        return dense_tangent(self.term, self.residual(x)[1], self.size // self.dim)

    def error(self, x, step=1e-6):
        """Largest error of the tangent against differences, over its largest entry."""
        exact, worst = self.tangent(x), 0.0
        for dof in self.acting():
            ends = []
            for sign in (1.0, -1.0):
                moved = x.copy()
                moved[dof] += sign * step
                ends.append(self.residual(moved)[0])
            column = (ends[0] - ends[1]) / (2.0 * step)
            worst = max(worst, np.abs(exact[:, dof] - column).max())
        return worst / np.abs(exact).max()

    def acting(self):
        """Unknowns of the slave's nodes, and those of the tool that do something."""
        nodes = np.unique(self.term.surface.slave.nodes)
        tool = unknowns_of(self.tool, self.dim)
        return np.concatenate([unknowns_of(nodes, self.dim), tool[: self.dim + 1]])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["averaged", "pointwise"])
def test_the_tangent_is_that_of_differences_for_the_angle_too(dim, kind):
    scene = Scene(dim, kind)
    scene.term.commit(scene.residual(scene.unknowns(1))[1])
    # Friction sticks at some points and slips at others, and the tool turns on.
    x = scene.unknowns(1) + 0.5 * (scene.unknowns(2, 0.002) - scene.unknowns(1, 0.0))
    tool = unknowns_of(scene.tool, dim)
    x[tool] += 0.01
    x[tool[dim + 1 :]] = 0.0
    trial = scene.residual(x)[1]
    assert trial.kinematics.closed.sum() > 3
    assert scene.error(x) < 2e-7


@pytest.mark.parametrize("dim", [2, 3])
def test_force_and_moment_are_integrals_over_the_points(dim):
    scene = Scene(dim)
    x = scene.unknowns(3)
    force, trial = scene.residual(x)
    weight = scene.term.surface.slave.weight
    at, traction = trial.projection, trial.traction
    total = force.reshape(-1, dim)
    # What the residual has on the tool is what holds it: the slave's traction points the other way.
    np.testing.assert_allclose(total[scene.tool[0]], weight @ traction, rtol=1e-12)
    arm = at.foot - (scene.centre + x.reshape(-1, dim)[scene.tool[0]])
    if dim == 2:
        moment = weight @ (arm[:, 0] * traction[:, 1] - arm[:, 1] * traction[:, 0])
    else:
        axis = scene.motion.axis / np.linalg.norm(scene.motion.axis)
        moment = weight @ (np.cross(arm, traction) @ axis)
    assert abs(moment) > 1e-3 * np.abs(total).max()
    found = total[scene.tool[1]]
    assert found[0] * scene.motion.length == pytest.approx(moment, rel=1e-9)
    assert not found[1:].any()
    np.testing.assert_allclose(total.sum(axis=0) - found, 0.0, atol=1e-12 * np.abs(total).max())


def test_turning_everything_turns_the_forces():
    """Slave, tool and history turned together: the same pressures, slips and moment."""
    scene = Scene()
    scene.term.commit(scene.residual(scene.unknowns(1))[1])
    x = scene.unknowns(1, theta=0.16)
    plain, before = scene.residual(x)
    angle, where = 0.7, scene.space.tabulate_dof_coordinates()[:, :2]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = (where + x.reshape(-1, 2)) @ turn.T - where
    centre = scene.centre + x.reshape(-1, 2)[scene.tool[0]]
    moved[scene.tool[0]] = turn @ centre - scene.centre
    moved[scene.tool[1]] = x.reshape(-1, 2)[scene.tool[1]] + [angle * scene.motion.length, 0.0]
    turned, after = scene.residual(moved.reshape(-1))
    assert np.abs(before.response.traction).max() > 1e-3
    np.testing.assert_allclose(after.pressure, before.pressure, rtol=1e-9, atol=1e-12)
    size = np.abs(plain).max()
    expected = plain.reshape(-1, 2) @ turn.T
    expected[scene.tool[1]] = plain.reshape(-1, 2)[scene.tool[1]]
    np.testing.assert_allclose(turned.reshape(-1, 2), expected, atol=1e-9 * size)


def kinked(low):
    """A line with a sharp corner that points up, below the middle of the slave."""
    points = low + np.array([[0.0, -0.02], [0.5, 0.03], [1.0, -0.03]])
    return Polyline(points, 0.0)


def faceted(low):
    """The same line as facets of a mesh."""
    points = low + np.array([[0.0, -0.02], [0.5, 0.03], [1.0, -0.03]])
    return MeshSurface(points, np.array([[0, 1], [1, 2]], dtype=np.int32))


@pytest.mark.parametrize("shape", [kinked, faceted])
@pytest.mark.parametrize("degree", [1, 2])
def test_the_tangent_is_exact_beside_sharp_corners_too(shape, degree):
    """There the slave's normals count, whose vertices come in as well."""
    scene = Scene(degree=degree, shape=shape)
    assert scene.term.surface.normals is not None
    start = scene.unknowns(1, tool=0.01, theta=0.02)
    scene.term.commit(scene.residual(start)[1])
    x = start + 0.5 * (scene.unknowns(2, 0.002) - scene.unknowns(1, 0.0))
    tool = unknowns_of(scene.tool, 2)
    x[tool] = start[tool] + 0.004
    x[tool[3:]] = 0.0
    trial = scene.residual(x)[1]
    assert trial.kinematics.closed.sum() > 3
    assert scene.error(x) < 2e-7
