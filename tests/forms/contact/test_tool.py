"""A rigid tool as master: its forces and moment, its tangent with the angle, its invariance.

Of every rigid shape: a block is put above some place of it, near the ends of pieces.
"""

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from tests.contact_boxes import dense_tangent, nodal_forces, slope_error, unknowns_of
from tests.geometry.surfaces.rigid_shapes import SMOOTH, STEP
from tests.geometry.surfaces.test_rigid_mesh import hill, parabolas, triangles
from tests.laws import coulomb
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.law import Regime
from tribox.geometry.generators.two_blocks import Block as Rectangle
from tribox.geometry.generators.two_blocks import Box, TwoBlocks
from tribox.geometry.meshes.blocks import Block, with_blocks
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.surfaces.rigid import RigidMotion, normals
from tribox.geometry.surfaces.rigid_mesh import MeshSurface
from tribox.geometry.surfaces.rigid_polyline import Polyline
from tribox.geometry.surfaces.rigid_shapes import Circle, Extruded, Plane, directions_across
from tribox.geometry.surfaces.surface import ContactSurface

PENALTY = 40.0
MESHES = {
    2: TwoBlocks(Rectangle(1.0, 0.5, (4, 2)), Rectangle(2.0, 0.4, (2, 1))),
    3: TwoBlocks(Box(1.0, 0.5, 1.0, (2, 1, 2)), Box(2.0, 0.4, 2.0, (2, 1, 2))),
}
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
    "end": (0, 0.96), "steep": (1, 0.08), "punch": (1, 0.02), "smooth segments": (3, 0.6),
    "parabolas": (1, 0.9), "triangles": (12, 0.3), "quadrilaterals": (5, 0.9),
    "smooth quadrilaterals": (5, 0.9),
}  # fmt: skip


class Scene:
    """The lower side of the upper body against a tool below it."""

    def __init__(self, dim=2, kind="averaged", degree=1, mu=0.3, shape=None, above=None):
        self.dim = dim
        self.named = generate(MESHES[dim], MPI.COMM_SELF)
        if above is not None:
            self._put_above(shape, *above)
        block = Block.of_numbers("tool", dim + 1, MPI.COMM_SELF)
        plain = dolfinx.fem.functionspace(self.named.mesh, ("Lagrange", degree, (dim,)))
        self.space = with_blocks(plain, [block])
        facets = self.named.facets("elastomer_contact")
        self.tool = block.nodes[[0, -1]]
        at = plain.tabulate_dof_coordinates()[:, :dim]
        self.low = at[dolfinx.fem.locate_dofs_topological(self.space, dim - 1, facets)].min(axis=0)
        self._make_tool(shape, above)
        tool = self.surface, self.tool, self.motion
        pair = ContactSurface.for_tool(self.space, facets, *tool, 5)
        law = coulomb(mu, 25.0)
        self.term = ContactTerm(pair, law, PENALTY, pressure=kind, modulus=3.0)
        self.size = self.space.dofmap.index_map.size_local * dim
        self.where = self.space.tabulate_dof_coordinates()[:, :dim]

    def _put_above(self, shape, facet, xi):
        """Halve the mesh and turn it, so that the slave's middle is at a place of a shape."""
        where = np.full((1, self.dim - 1), 0.4)
        where[0, 0] = xi
        at = shape.at(np.array([facet], dtype=np.int32), where)
        self.up = normals(at.tangents)[0]
        self.along, *across = directions_across(self.up)
        frame = np.stack([self.along, self.up, *(-one for one in across)])
        x = self.named.mesh.geometry.x
        middle = np.array([1.0, 0.0, 1.0])[: self.dim]  # of the lower side of the upper body
        self.foot = at.place[0]
        x[:, : self.dim] = self.foot + 0.5 * (x[:, : self.dim] - middle) @ frame

    def _make_tool(self, shape, above):
        if self.dim == 2:
            self.surface = Circle(np.array([self.low[0] + 0.6, self.low[1] - 0.8]), 0.82)
            self.centre, axis = np.array([self.low[0] + 0.3, self.low[1] - 1.3]), None
        else:
            self.surface = Plane(self.low + np.array([0.1, 0.0, 0.3]), [0.1, 1.0, -0.05])
            self.centre, axis = self.low + np.array([0.2, -0.4, 0.1]), np.array([0.3, 0.2, 1.0])
        if shape is not None:
            self.surface = shape(self.low) if above is None else shape
        self.motion = RigidMotion(self.centre, self.surface.control_points, 0.7, axis)

    def unknowns(self, seed, sway=0.004, tool=0.02, theta=0.1):
        """Nodes that sway a little, and a tool that is pressed on and turned."""
        random = np.random.default_rng(seed)
        x = sway * random.standard_normal(self.size).reshape(-1, self.dim)
        x[self.tool[0]] = tool * np.array([0.4, 1.0, -0.3])[: self.dim]
        x[self.tool[1]] = 0.0
        x[self.tool[1], 0] = theta * self.motion.length
        return x.reshape(-1)

    def pressed(self, depth, along=0.0, shift=0.0, theta=0.0, sway=0.01):
        """The block pressed in along the normal, moved along it, and carried with the tool."""
        bend = sway * np.sin(9.0 * (self.where - self.foot) @ self.along + 0.3)
        x = np.outer(bend - depth, self.up) + along * self.along + shift
        x[self.tool[0]], x[self.tool[1]] = shift, 0.0
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

    def commit(self, x):
        self.term.commit(self.residual(x)[1])

    def turned(self, x, angle, shift):
        """The same displacements after a rigid motion of block and tool, and its rotation."""
        values = x.reshape(-1, self.dim)
        theta = values[self.tool[1], 0] / self.motion.length
        rotation = self.motion.rotation
        turn = rotation(theta + angle) @ rotation(theta).T
        centre = self.centre + values[self.tool[0]]
        out = centre + shift + (self.where + values - centre) @ turn.T - self.where
        out[self.tool[0]], out[self.tool[1]] = values[self.tool[0]] + shift, 0.0
        out[self.tool[1], 0] = (theta + angle) * self.motion.length
        return out.reshape(-1), turn

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

    def slope_error(self, x):
        """Largest error of K d in two directions, over the largest entry."""
        K, rng, worst = self.tangent(x), np.random.default_rng(0), 0.0
        for _ in range(2):
            d = np.zeros(self.size)
            d[self.acting()] = rng.normal(size=len(self.acting()))
            worst = max(worst, slope_error(K @ d, lambda h, d=d: self.residual(x + h * d)[0]))
        return worst

    def acting(self):
        """Unknowns of the slave's nodes, and those of the tool that do something."""
        nodes = np.unique(self.term.surface.slave.nodes)
        tool = unknowns_of(self.tool, self.dim)
        return np.concatenate([unknowns_of(nodes, self.dim), tool[: self.dim + 1]])


def over(name, mu, kind="averaged", degree=1, **changes):
    """A block above a place of a shape."""
    shape = (SHAPES | CORNERS)[name]()
    for key, value in changes.items():
        setattr(shape, key, value)
    return Scene(shape.dim, kind, degree, mu, shape, ABOVE.get(name, (0, 0.95)))


def prepared(name, mu, kind="averaged", degree=1, depth=0.04):
    """The same after a step, and what it is moved to in the next."""
    scene = over(name, mu, kind, degree)
    shift = np.array([0.01, -0.02, 0.015])[: scene.dim]
    scene.commit(scene.pressed(0.03, 0.0, 0.5 * shift, 0.01))
    return scene, scene.pressed(depth, 0.015, shift, 0.03)


@pytest.mark.parametrize("pressure", ["averaged", "pointwise"])
@pytest.mark.parametrize("friction", [50.0, 0.1], ids=["stick", "slip"])
@pytest.mark.parametrize("name", SHAPES)
def test_tangent_against_differences(name, friction, pressure):
    """With points on several pieces, at a corner, and along rays where there are kinks."""
    scene, x = prepared(name, friction, pressure)
    trial = scene.residual(x)[1]
    regime = Regime.STICK if friction > 1.0 else Regime.SLIP
    assert np.count_nonzero(trial.response.regime == regime) >= 2
    assert np.count_nonzero(trial.pressure) >= 4
    pieces = len(np.unique(trial.projection.facet[trial.pressure > 0.0]))
    assert pieces >= 2 or name in ("line", "plane", "sharp", "segments", "steep", "end")
    along_rays = scene.surface.has_kinks and pressure == "averaged"
    assert (trial.projection.rays is not None) == along_rays
    assert scene.slope_error(x) < 1e-8


@pytest.mark.parametrize("name", ["sharp", "segments", "groove", "circle"])
def test_tangent_of_second_order_cells(name):
    """Along rays the vertices that the slave's normals take come in as well."""
    scene, x = prepared(name, 0.3, degree=2)
    assert scene.residual(x)[1].kinematics.closed.sum() > 3
    assert scene.slope_error(x) < 1e-8


@pytest.mark.parametrize("friction", [50.0, 0.1], ids=["stick", "slip"])
@pytest.mark.parametrize("name", ["deep groove", "long groove"])
def test_tangent_of_points_at_a_corner_or_on_an_edge(name, friction):
    scene, x = prepared(name, friction, "pointwise", depth=0.1)
    trial = scene.residual(x)[1]
    assert np.count_nonzero(trial.projection.clamped & trial.kinematics.closed) >= 2
    assert scene.slope_error(x) < 1e-8


def test_points_fade_at_the_end_of_a_polyline():
    scene, x = prepared("end", 0.1)
    at = scene.residual(x)[1].projection
    assert np.any((at.share > 0.05) & (at.share < 0.95))
    assert not at.on_surface.all()


@pytest.mark.parametrize("along_rays", [True, False])
def test_the_corner_of_a_punch_presses_straight_along_rays_alone(along_rays):
    """Closest points of a flat slave below it are on its flank, which presses sideways."""
    scene = over("punch", 0.0, has_kinks=along_rays)
    force, trial = scene.residual(scene.pressed(0.04, sway=0.0))
    held = force.reshape(-1, 2)[scene.tool[0]]
    along, down = held @ scene.along, held @ scene.up
    assert down > 0.1 * PENALTY * 0.04 * 0.5
    assert not trial.projection.on_surface.all() or not along_rays
    assert (abs(along) < 1e-12) if along_rays else (abs(along) > 0.02 * down)


@pytest.mark.parametrize("name", SHAPES)
def test_force_and_moment_are_integrals_over_the_points(name):
    scene, x = prepared(name, 0.1)
    force, trial = scene.residual(x)
    dim, weight = scene.dim, scene.term.surface.slave.weight
    at, traction, total = trial.projection, trial.traction, force.reshape(-1, scene.dim)
    # What the residual has on the tool is what holds it: the slave's traction points the other way.
    np.testing.assert_allclose(total[scene.tool[0]], weight @ traction, rtol=1e-12, atol=1e-15)
    arm = at.foot - (scene.centre + x.reshape(-1, dim)[scene.tool[0]])
    if dim == 2:
        moment = weight @ (arm[:, 0] * traction[:, 1] - arm[:, 1] * traction[:, 0])
    else:
        axis = scene.motion.axis / np.linalg.norm(scene.motion.axis)
        moment = weight @ (np.cross(arm, traction) @ axis)
    found, size = total[scene.tool[1]], np.abs(total).max()
    assert found[0] * scene.motion.length == pytest.approx(moment, rel=1e-9, abs=1e-12 * size)
    assert not found[1:].any()
    np.testing.assert_allclose(total.sum(axis=0) - found, 0.0, atol=1e-12 * size)


@pytest.mark.parametrize("name", ["circle", "die", "groove", "segments", "sphere", "triangles"])
def test_turning_everything_turns_the_forces(name):
    """The same pressures, slips and moment; where nothing else moves, friction stays."""
    scene, x = prepared(name, 50.0)
    for slips in (True, False):
        before, trial = scene.residual(x)
        moved, turn = scene.turned(x, 0.4, 0.1)
        after, later = scene.residual(moved)
        size = np.abs(before).max()
        expected = before.reshape(-1, scene.dim) @ turn.T
        expected[scene.tool[1]] = before.reshape(-1, scene.dim)[scene.tool[1]]
        np.testing.assert_allclose(after.reshape(-1, scene.dim), expected, atol=1e-9 * size)
        np.testing.assert_allclose(later.pressure, trial.pressure, rtol=1e-9, atol=1e-12)
        slip = np.abs(later.kinematics.slip).max()
        assert slip > 1e-3 if slips else slip < 1e-13
        assert np.abs(later.response.traction).max() > 0.01
        scene.commit(x)
