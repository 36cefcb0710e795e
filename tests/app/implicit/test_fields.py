"""A field on the slave's vertices as a block of unknowns, coupled with the gap both ways.

A layer on the slave takes up a content s, kg/m², where it is pressed, passes it on along the
surface, and swells by it, which closes the gap:

    m (s − s_old)/Δt + Σ κ (s − s_next)/L = γ m (1 − exp(−d/d₀)),   d = ⟨−(g − β s)⟩.

It stands for what a film or a temperature will be, in tests alone.
"""

import pickle
from dataclasses import dataclass
from itertools import pairwise
from types import SimpleNamespace

import dolfinx
import numpy as np
import pytest
import scipy.sparse
from mpi4py import MPI

import tribox.app.implicit.newton
from tests.conftest import SOFT, STIFF
from tests.laws import coulomb
from tribox.app.checkpoint.layout import Layout
from tribox.app.equilibrium.constraints import Prescribed, component_dofs
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.rigid_tool import RigidTool
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.implicit.newton import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.tangent import Coupling, PairTangent
from tribox.geometry.generators.two_blocks import Block as Rectangle
from tribox.geometry.generators.two_blocks import Box, TwoBlocks
from tribox.geometry.meshes.blocks import Block, with_blocks
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.surfaces.rigid import RigidMotion
from tribox.geometry.surfaces.rigid_shapes import Circle
from tribox.geometry.surfaces.surface import ContactSurface

BETA, KAPPA, GAMMA, DEPTH = 0.02, 0.03, 0.8, 0.01
PENALTY, DT, STEPS = 50.0, 0.5, 6


PLANE = TwoBlocks(Rectangle(1.0, 0.5, (7, 3)), Rectangle(2.0, 0.5, (9, 2)), offset=0.47)
SPACE = TwoBlocks(Box(1.0, 0.5, 1.0, (3, 1, 2)), Box(2.0, 0.5, 2.0, (4, 1, 3)))
# Where the slave hangs over the end of the master, its layer is linked all the same.
OVER = TwoBlocks(Rectangle(1.0, 0.5, (7, 3)), Rectangle(2.0, 0.5, (9, 2)), offset=1.45)
SHAPES = {"bodies": PLANE, "over the end": OVER, "tool": PLANE, "space": SPACE}


class SwollenPressure(AveragedPressure):
    """The pressure of gaps that a layer closes by ``swelling`` (v,), m."""

    swelling = 0.0

    def at_vertices(self, gaps, covered, mode, least_depth=0.0):
        gaps = gaps - self.swelling * self.area(covered)
        return super().at_vertices(gaps, covered, mode, least_depth)


@dataclass
class Contents:
    """What the layer holds after a converged step."""

    content: np.ndarray


class SwellingTerm(ContactTerm):
    """A contact whose slave has such a layer; ``block`` holds s at its vertices."""

    def __init__(self, surface, law, penalty, block):
        super().__init__(surface, law, penalty)
        self.block, self.beside = block, block.nodes[:, None]
        self.rule = SwollenPressure(surface, penalty)
        self.linearised = PairTangent(surface, self.rule)
        self.state.film = Contents(np.zeros(surface.vertices.count))
        vertices = surface.vertices
        assert np.allclose(block.on_all_ranks(*_first_places(block, vertices.comm)), _x(vertices))
        _, first = np.unique(surface.slave.facet, return_index=True)
        corners = vertices.of_point[first]  # of this rank's facets
        sides = [(0, 1)] if surface.dim == 2 else [(0, 1), (1, 3), (3, 2), (2, 0)]
        self.ends = np.concatenate([corners[:, side] for side in sides])
        weighted = surface.slave.weight[:, None] * vertices.shape
        self.own_area = np.bincount(
            vertices.of_point.reshape(-1), weighted.reshape(-1), vertices.count
        )

    def evaluate(self, x, dt, mode=None):
        comm = self.surface.vertices.comm
        content = self.block.scale * self.block.on_all_ranks(x.array_r, comm)
        if not np.array_equal(BETA * content, self.rule.swelling):
            self._last = None
        self.content, self.rule.swelling = content, BETA * content
        trial = super().evaluate(x, dt, mode) if mode else super().evaluate(x, dt)
        self.block.reference = self._parts(trial)[1]
        return trial

    def _links(self):
        """Matrix of Σ κ (s − s_next)/L over this rank's facets."""
        at = self.surface.vertices.position[self.ends]
        share = KAPPA / np.linalg.norm(at[:, 1] - at[:, 0], axis=1)
        (a, b), n = self.ends.T, self.surface.vertices.count
        rows = np.concatenate([a, b, a, b])
        columns = np.concatenate([a, b, b, a])
        return scipy.sparse.csr_matrix(
            (np.concatenate([share, share, -share, -share]), (rows, columns)), shape=(n, n)
        )

    def _depth(self, trial):
        return trial.normal_contact.nodal_pressure / self.penalty

    def _parts(self, trial):
        """This rank's part of the residual (v,), and the size of what is summed up."""
        stored = self.own_area * (self.content - self.state.film.content) / trial.dt
        taken = GAMMA * self.own_area * (1.0 - np.exp(-self._depth(trial) / DEPTH))
        parts = np.stack([stored, self._links() @ self.content, -taken])
        total = self.surface.vertices.total(parts)
        return parts.sum(axis=0), self.block.weight * float(np.linalg.norm(total, axis=1).max())

    def forces_at_nodes(self, trial):
        nodes, values, squared = super().forces_at_nodes(trial)
        own = np.zeros((self.surface.vertices.count, self.surface.dim))
        own[np.arange(len(own)), self.block.components] = self.block.weight * self._parts(trial)[0]
        return np.append(nodes, self.block.nodes), np.concatenate([values, own]), squared

    def add_tangent(self, trial, entries):
        couplings = super().add_tangent(trial, entries)
        left, right = self.linearised.vertex_sides(self.state, trial)
        slope = GAMMA / DEPTH * np.exp(-self._depth(trial) / DEPTH) * (self._depth(trial) > 0.0)
        by_content = scipy.sparse.diags(self.own_area / trial.dt - BETA * slope * self.own_area)
        area = scipy.sparse.diags(-BETA * self.linearised.area_of(trial))
        whole = scipy.sparse.bmat(
            [
                [scipy.sparse.csr_matrix((left.shape[1],) * 2), (area @ left).T],
                [scipy.sparse.diags(slope) @ right, by_content + self._links()],
            ]
        ).tocoo()
        n, nodes = left.shape[1], np.append(self.surface.nodes, self.block.nodes)
        vertices, dim = np.arange(self.surface.vertices.count), self.surface.dim
        place = np.append(np.arange(n), n + vertices * dim + self.block.components)
        scale = np.append(np.ones(n), np.full(len(vertices), self.block.scale))
        weight = np.append(np.ones(n), np.full(len(vertices), self.block.weight))
        values = whole.data * weight[whole.row] * scale[whole.col]
        size = dim * len(nodes)
        matrix = scipy.sparse.csr_matrix(
            (values, (place[whole.row], place[whole.col])), shape=(size, size)
        )
        return [*couplings, Coupling(nodes, nodes, matrix)]

    def commit(self, trial):
        super().commit(trial)
        self.state.film = Contents(self.content.copy())


def _first_places(block, comm):
    values = np.zeros(1 + max(comm.allgather(int(block.dofs.max(initial=0)))))
    values[block.dofs] = block.place[:, 0]
    return values, comm


def _x(vertices):
    return vertices.position[:, 0]


class Scene:
    """An upper block with such a layer, pressed on another or on a tool, and drawn along."""

    def __init__(self, comm, kind="bodies", scale=1.0, weight=1.0):
        self.named = generate(SHAPES[kind], comm)
        dim, tool = self.named.mesh.geometry.dim, kind == "tool"
        plain = dolfinx.fem.functionspace(self.named.mesh, ("Lagrange", 1, (dim,)))
        facets = self.named.facets("elastomer_contact")
        nodes = dolfinx.fem.locate_dofs_topological(plain, dim - 1, facets)
        nodes = nodes[nodes < plain.dofmap.index_map.size_local]
        place = plain.tabulate_dof_coordinates()[nodes][:, :dim]
        field = Block("content", len(nodes), place, scale, weight, reference=0.0)
        numbers = Block.of_numbers("tool", 3, comm)
        spare = Block.of_numbers("spare", 1, comm)  # that nothing couples
        blocks = [numbers, field, spare] if tool else [field, spare]
        self.u = dolfinx.fem.Function(with_blocks(plain, blocks))
        space = self.u.function_space
        master, tools = self.named.facets("aluminium_contact"), []
        held = [Prescribed(spare.dofs)]
        if tool:
            low = comm.allreduce(float(place[:, 1].min(initial=np.inf)), op=MPI.MIN)
            circle = Circle(np.array([0.9, low - 3.0]), 3.0)
            motion = RigidMotion(np.array([0.9, low - 3.0]), circle.control_points, 0.7, None)
            free = np.zeros(3, dtype=bool)
            tools = [RigidTool("tool", circle, motion, numbers, free, False, np.zeros(3))]
            pair = ContactSurface.for_tool(space, facets, circle, tools[0].nodes, motion, 5)
            held.append(Prescribed(numbers.dofs))
        else:
            pair = ContactSurface(space, facets, master, 5)
        self.term = SwellingTerm(pair, coulomb(0.2), PENALTY, field)
        cells = {name: self.named.cells(name) for name in ("elastomer", "aluminium")}
        solids = [
            Solid(name, self.u, cells[name], material, "q1-sri")
            for name, material in (("elastomer", SOFT), ("aluminium", STIFF))
        ]
        self.top = [self._held("top", axis) for axis in range(dim)]
        held += [self._held("bottom", axis) for axis in range(dim)]
        self.problem = Equilibrium(
            self.u, solids, [self.term], [*self.top, *held], tools=tools, blocks=[field, spare]
        )
        assert self.problem.fields == [field]
        self.stepper = ImplicitStepper(self.problem, ImplicitOptions(tolerance=1e-11))
        self.field = field

    def _held(self, surface, axis):
        return Prescribed(component_dofs(self.u.function_space, self.named.facets(surface), axis))

    def run(self, steps):
        """Rows of s at the vertices, forces and sizes, after each step; the residuals of Newton."""
        rows, residuals = [], []
        for step in steps:
            self.top[0].value, self.top[1].value = 0.01 * max(step - 1, 0), -0.01 * (1 + step)
            result = self.stepper.attempt(DT)
            assert result.converged, result.residuals
            self.stepper.commit()
            residuals.append(result.residuals)
            force = [self.problem.reaction(part) for part in self.top]
            rows.append([*force, *self.term.content])
        return rows, residuals


def differences(scene, seed=0):
    """Tangent and differences of the residual (n, n), at a state somewhere off the solution."""
    problem, random = scene.problem, np.random.default_rng(seed)
    x, f = scene.stepper.x.copy(), problem.new_vector()
    x.array[:] += 1e-3 * random.standard_normal(problem.owned)
    x.array[scene.field.padding] = 0.0
    A, step = scene.stepper.solver.matrix, StepMode(DT)
    problem.jacobian(None, x, A, A, step)
    found, h = A[:, :], 1e-6
    wanted = np.empty_like(found)
    for column in range(problem.owned):
        sides = []
        for sign in (1.0, -1.0):
            y = x.copy()
            y.array[column] += sign * h
            problem.residual(None, y, f, step)
            sides.append(f.array_r.copy())
        wanted[:, column] = (sides[0] - sides[1]) / (2.0 * h)
    held = problem.constrained_dofs()
    wanted[:, held] = found[:, held]  # eliminated there
    return found, wanted


@pytest.mark.parametrize("kind", SHAPES)
def test_the_tangent_of_bodies_and_field_is_exact(kind):
    scene = Scene(MPI.COMM_SELF, kind, scale=3.0, weight=0.4)
    scene.run([1, 2])
    found, wanted = differences(scene)
    field, others = scene.field.dofs, np.setdiff1d(np.arange(len(found)), scene.field.dofs)
    for rows in (field, others):
        for columns in (field, others):
            part = wanted[np.ix_(rows, columns)]
            np.testing.assert_allclose(
                found[np.ix_(rows, columns)], part, atol=3e-6 * np.abs(part).max()
            )
            assert np.abs(part).max() > 1e-4


@pytest.mark.parametrize("kind", SHAPES)
def test_newton_is_quadratic_and_the_content_is_balanced(kind, monkeypatch):
    monkeypatch.setattr(tribox.app.implicit.newton, "REUSE_SAFETY", np.inf)
    scene = Scene(MPI.COMM_SELF, kind)
    before, taken = np.zeros(scene.term.surface.vertices.count), []
    area = scene.term.surface.vertices.area
    for step in range(1, STEPS):
        rows, (residuals,) = scene.run([step])
        content = np.array(rows[0][len(scene.top) :])
        depth = scene.term._depth(scene.problem.trials[0])
        source = GAMMA * area @ (1.0 - np.exp(-depth / DEPTH))
        assert area @ (content - before) / DT == pytest.approx(source, rel=1e-9)
        before = content
        taken.append(source)
        ends = [(a, b) for a, b in pairwise(residuals) if a < 5e-3]
        assert ends, residuals
        for a, b in ends:
            assert b < 20.0 * a**2 + 1e-12, residuals
    assert min(taken) > 0.01 and np.ptp(before) > 0.01
    # It matters: swollen layers press more.
    assert BETA * before.max() > 0.1 * depth.max()


@pytest.mark.parametrize(("scale", "weight"), [(1e3, 1e-3), (1e-2, 1e5)])
def test_the_measure_of_a_field_does_not_change_the_solution(scale, weight):
    """Line searches compare all rows by their norm: a weight far too large costs iterations."""
    rows, residuals = Scene(MPI.COMM_SELF).run(range(1, 4))
    other, again = Scene(MPI.COMM_SELF, scale=scale, weight=weight).run(range(1, 4))
    np.testing.assert_allclose(other, rows, rtol=1e-9)
    if weight < 1.0:
        assert [len(some) for some in again] == [len(some) for some in residuals]


def test_forces_and_field_are_each_judged_by_their_own_size():
    problem, (field,) = (scene := Scene(MPI.COMM_SELF)).problem, [scene.field]
    f, field.reference = problem.new_vector(), 4.0
    f.array[0], f.array[field.dofs[:2]] = 3.0, 30.0
    assert problem.judged(f, 10.0) == pytest.approx((10.0 * 30.0 * np.sqrt(2.0) / 4.0, 10.0))
    f.array[field.dofs[:2]] = 0.3
    assert problem.judged(f, 10.0) == (3.0, 10.0)


def test_explicit_steps_refuse_a_field():
    with pytest.raises(ValueError, match="content: fields do not go with explicit steps"):
        ExplicitStepper(Scene(MPI.COMM_SELF).problem)


def facts(comm, directory):
    """Runs on these ranks, whole and gone on from what one rank, and these, have kept."""
    return {kind: _facts_of(kind, comm) for kind in SHAPES}


def _facts_of(kind, comm):
    kept, later = {}, {}
    for name, ranks in (("one", MPI.COMM_SELF), ("same", comm))[comm.size == 1 :]:
        scene = Scene(ranks, kind)
        rows, residuals = scene.run(range(1, 4))
        tree, arrays = _layout(scene).gather(scene.stepper.snapshot())
        kept[name] = pickle.dumps((tree, arrays))
    more = scene.run(range(4, STEPS))
    for name, packed in kept.items():
        scene = Scene(comm, kind)
        scene.top[0].value, scene.top[1].value = 0.02, -0.04
        tree, arrays = pickle.loads(packed)
        arrays = arrays if comm.rank == 0 else {}
        scene.stepper.restore(_layout(scene).scatter(tree, arrays))
        later[name] = scene.run(range(4, STEPS))[0]
    counts = [len(some) for some in residuals + more[1]]
    return {"rows": rows + more[0], "counts": counts, "later": later}


def _layout(scene):
    return Layout(SimpleNamespace(problem=scene.problem, named=scene.named))


@pytest.mark.mpi(facts, 2)
@pytest.mark.parametrize("kind", SHAPES)
def test_ranks_and_a_run_that_goes_on_agree(on_ranks, kind):
    one = on_ranks(facts, 1)[kind]
    for found in (one, on_ranks(facts, 2)[kind]):
        assert found["counts"] == one["counts"]
        np.testing.assert_allclose(found["rows"], one["rows"], rtol=1e-9, atol=1e-12)
        for rows in found["later"].values():
            np.testing.assert_allclose(rows, one["rows"][3:], rtol=1e-9, atol=1e-12)
