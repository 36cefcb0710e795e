"""Contact pressure from gaps: averaged over the slave's vertices, or from the gap of each point."""

from dataclasses import replace

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from tests.contact_boxes import PENALTY, SHAPES, Scene, take_all_for_kinked
from tests.laws import coulomb, film_map
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import (
    AveragedPressure,
    PointwisePressure,
    nodal_pressure,
    normal_rule,
)
from tribox.forms.contact.state import AS_IS, ContactMode
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.geometry.generators.two_blocks import Block, Box, TwoBlocks
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.surfaces.facets import order_by_place
from tribox.geometry.surfaces.surface import ContactSurface

KINDS = ("averaged", "pointwise")
DEPTH = 0.02


def still(X):
    return np.zeros_like(X)


def touching(shape, rule=AveragedPressure, penalty=PENALTY):
    """A rule, and the projections of a slave that lies on a flat master with no gap at all."""
    scene = Scene(shape, FrictionlessLaw(), degree=5, fine=True)
    at = scene.term.evaluate(scene.moved(still, 0.0), 1.0).projection
    assert at.on_surface.all() and np.abs(at.gap).max() < 1e-12
    return rule(scene.surface, penalty), at


# -- from gaps to pressure ------------------------------------------------------------------------


@pytest.mark.parametrize("shape", ["T3", "Q9"])
@pytest.mark.parametrize("sag", [0.1, 3.0, -3.0])
def test_a_chord_over_a_round_master_carries_an_even_pressure(shape, sag):
    """Gaps with the sagitta of a chord, up to three times the penetration: its mean is nothing.

    P₂ of Legendre has no share in linear functions. Point by point some points carry nothing then.
    """
    averaged, at = touching(shape)
    xi = averaged.surface.slave.xi[:, 0]
    gap = DEPTH * (-1.0 + sag * (6.0 * xi * (xi - 1.0) + 1.0))
    normal = averaged.evaluate(replace(at, gap=gap), AS_IS)
    np.testing.assert_allclose(normal.pressure, PENALTY * DEPTH, rtol=1e-10)
    assert normal.closed.all()
    point = PointwisePressure(averaged.surface, PENALTY).evaluate(replace(at, gap=gap), AS_IS)
    apart = np.ptp(point.pressure) / (PENALTY * DEPTH)
    assert apart > 0.7 * abs(sag)
    assert (point.pressure == 0.0).any() == (abs(sag) > 1.0)


@pytest.mark.parametrize("shape", ["Q4", "T6", "tet4", "hex27"])
def test_force_is_that_of_the_vertices(shape):
    """∫ t_N dA = Σ m_A s_A, with each vertex's own penalty; open vertices carry nothing."""
    _, at = touching(shape)
    surface = Scene(shape, FrictionlessLaw(), degree=5, fine=True).surface
    vertices = surface.vertices
    penalty = PENALTY * np.linspace(1.0, 4.0, vertices.count)
    gap = 0.03 * np.sin(9.0 * surface.slave.position[:, 0])
    normal = AveragedPressure(surface, penalty).evaluate(replace(at, gap=gap), AS_IS)
    mean = vertices.sums(surface.slave.weight * gap) / vertices.area
    np.testing.assert_allclose(normal.gap, mean, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(normal.nodal_pressure, penalty * np.maximum(-mean, 0.0), rtol=1e-12)
    assert normal.active.any() and not normal.active.all()
    assert np.array_equal(normal.active, mean <= 0.0)
    force = vertices.area @ normal.nodal_pressure
    assert surface.slave.weight @ normal.pressure == pytest.approx(force, rel=1e-12)
    assert vertices.area @ nodal_pressure(surface, normal.pressure) == pytest.approx(force)
    around = normal.active[vertices.of_point].any(axis=1)
    assert np.array_equal(normal.closed, around)


@pytest.mark.parametrize("rule", [AveragedPressure, PointwisePressure])
def test_what_only_touches_is_stiff_unless_only_what_presses_is(rule):
    """It keeps a body from being loose; the derivative of its pressure is none."""
    made, at = touching("Q4", rule)
    x, least = made.surface.slave.position[:, 0], 1e-12
    gap = np.where(x < np.median(x), -DEPTH, 1e-13)
    normal = made.evaluate(replace(at, gap=gap), AS_IS, least)
    assert np.all(normal.stiffness == made.penalty)
    exact = made.evaluate(replace(at, gap=gap), ContactMode(only_pressed=True), least)
    springs = exact.spring if exact.nodal_pressure is None else exact.nodal_pressure
    assert 0 < np.count_nonzero(springs) < len(springs)
    np.testing.assert_array_equal(exact.stiffness, np.where(springs > 0.0, made.penalty, 0.0))
    for name in ("closed", "spring", "pressure"):
        np.testing.assert_array_equal(getattr(exact, name), getattr(normal, name))


@pytest.mark.parametrize("rule", [AveragedPressure, PointwisePressure])
def test_pressure_does_not_jump_where_rounding_ends(rule):
    """It is none up to there, grows from nothing, and is the penalty's from twice that on."""
    made, at = touching("Q4", rule)
    least, averaged = 1e-3, rule is AveragedPressure
    lengths = made.surface.vertices.length if averaged else np.linalg.norm(at.tangents, axis=-1)
    depths = np.array([0.0, 0.9, 1.0, 1.1, 1.5, 1.999, 2.0, 2.001, 3.0]) * least * lengths.max()
    found = [made.evaluate(replace(at, gap=np.full_like(at.gap, -d)), AS_IS, least) for d in depths]
    springs = [one.nodal_pressure if averaged else one.pressure for one in found]
    pressure, stiffness = (
        [one[lengths.argmax()] for one in of] for of in (springs, [one.stiffness for one in found])
    )
    assert not any(pressure[:3])
    np.testing.assert_allclose(pressure[6:], PENALTY * depths[6:], rtol=1e-10)
    assert np.all(np.abs(np.diff(pressure)) <= 2.001 * PENALTY * np.diff(depths))
    assert (stiffness[4], stiffness[8]) == (2.0 * PENALTY, PENALTY)


@pytest.mark.parametrize("rule", [AveragedPressure, PointwisePressure])
def test_scaled_and_adhesive_contact(rule):
    """A scaled penalty scales the pressure; an adhesive gap pulls, and counts as no pressure."""
    made, at = touching("Q4", rule)
    pressed, lifted = (replace(at, gap=np.full_like(at.gap, g)) for g in (-DEPTH, DEPTH))
    soft = made.evaluate(pressed, ContactMode(penalty_scale=0.1))
    np.testing.assert_allclose(soft.pressure, 0.1 * PENALTY * DEPTH, rtol=1e-12)
    energy = 0.5 * 0.1 * PENALTY * DEPTH**2 * made.surface.slave.weight.sum()
    assert made.energy(soft, 0.1) == pytest.approx(energy, rel=1e-12)
    assert not made.evaluate(lifted, ContactMode(adhesive_gap=0.5 * DEPTH)).closed.any()
    held = made.evaluate(lifted, ContactMode(adhesive_gap=2.0 * DEPTH))
    np.testing.assert_allclose(held.spring, -PENALTY * DEPTH, rtol=1e-12)
    assert held.closed.all() and not held.pressure.any()


@pytest.mark.parametrize("kind", KINDS)
def test_penalties_that_are_none_are_refused(kind):
    surface = touching("Q4")[0].surface
    count = surface.vertices.count if kind == "averaged" else len(surface.slave.weight)
    what = "vertices" if kind == "averaged" else "points"
    for wrong in (0.0, -1.0, np.nan, np.inf, np.where(np.arange(count) == 1, 0.0, 1.0)):
        with pytest.raises(ValueError, match="penalty: must be positive and finite"):
            normal_rule(kind, surface, wrong)
    with pytest.raises(ValueError, match=f"penalty: {count + 1} numbers for {count} {what}"):
        normal_rule(kind, surface, np.ones(count + 1))
    given = np.linspace(1.0, 2.0, count)
    made = normal_rule(kind, surface, given)
    given[:] = 0.0
    np.testing.assert_array_equal(made.penalty, np.linspace(1.0, 2.0, count))


# -- energy and stiffness -------------------------------------------------------------------------

# Along x, along y, down; how much the bodies are bent. Overhung: past the end of the master.
POSES = {
    "partly open": ((0.01, 0.02, -0.06), 0.05),
    "bent": ((0.03, -0.02, -0.09), 0.08),
    "overhung": ((0.33, 0.02, -0.07), 0.02),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("kind", KINDS)
def test_work_of_the_pressure_is_the_energy(shape, pose, kind):
    """dE = R·du along a path of finite length: Gauss' quadrature of the forces' work."""
    scene = Scene(shape, FrictionlessLaw(), degree=5, pressure=kind)
    count = len(scene.term.penalty)
    scene.term = ContactTerm(
        scene.surface, FrictionlessLaw(), PENALTY * np.linspace(1.0, 2.0, count), 0.0, kind
    )
    shift, bend = POSES[pose]
    x = scene.vector(np.array(shift)[[0, 2] if scene.dim == 2 else [0, 1, 2]], bend, 0.7, 0.01)
    trial = scene.term.evaluate(x, 1.0)
    assert np.count_nonzero(trial.pressure) >= 2
    assert (~trial.projection.on_surface).any() == (pose == "overhung")
    way = 1e-5 * np.random.default_rng(2).normal(size=scene.size)
    start, moved = x.array_r.copy(), x.copy()
    places, weights = np.polynomial.legendre.leggauss(4)
    work = 0.0
    for place, weight in zip(places, weights, strict=True):
        moved.array[:] = start + 0.5 * (1.0 + place) * way
        work += 0.5 * weight * float(scene.residual(moved)[0] @ way)
    ends = []
    for end in (start, start + way):
        moved.array[:] = end
        ends.append(scene.term.interface_energy(scene.term.evaluate(moved, 1.0)))
    assert ends[1] - ends[0] == pytest.approx(work, rel=1e-7)
    assert abs(work) > 1e-9 * ends[0]


@pytest.mark.parametrize("shape", SHAPES)
def test_springs_at_the_points_are_at_least_as_stiff(shape):
    """Σ_A K_A (Σ_q w N_A g)²/m_A ≤ Σ_q w k g², and equal for an even gap and penalty."""
    surface = Scene(shape, FrictionlessLaw(), degree=5).surface
    vertices, weight = surface.vertices, surface.slave.weight
    rng = np.random.default_rng(3)
    for penalty in (PENALTY, PENALTY * rng.uniform(0.1, 10.0, vertices.count)):
        rule = AveragedPressure(surface, penalty)
        springs = weight * rule.point_stiffness()
        gaps = [rng.normal(size=len(weight)) for _ in range(20)] + [np.ones(len(weight))]
        for gap in gaps:
            together = np.sum(rule.penalty * vertices.sums(weight * gap) ** 2 / vertices.area)
            assert together <= springs @ gap**2 * (1.0 + 1e-12)
        assert together == pytest.approx(springs.sum(), rel=1e-12)  # of the even gap


# -- ranks ----------------------------------------------------------------------------------------

SHARED = ("T3", "Q9", "tet4", "hex8")
FILMS = ("T3 film", "hex8 film", "T3 over the end", "T3 rays")
NAMES = ("elastomer_contact", "aluminium_contact")


def parted(shape: str, comm: MPI.Comm) -> ContactSurface:
    """The contact of two bodies whose slave facets are shared out among the ranks; collective."""
    cell, order = SHAPES[shape]
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    blocks: TwoBlocks
    if dim == 2:
        blocks = TwoBlocks(Block(1.0, 0.5, (6, 2)), Block(2.0, 0.5, (7, 2)), 0.47, cell=cell)
    else:
        upper, lower = Box(1.0, 0.5, 0.6, (4, 1, 3)), Box(2.0, 0.5, 1.0, (5, 1, 4))
        blocks = TwoBlocks(upper, lower, (0.47, 0.23), cell=cell)
    named = generate(blocks, comm, [NAMES])
    space = dolfinx.fem.functionspace(named.mesh, ("Lagrange", order, (dim,)))
    return ContactSurface(space, *map(named.facets, NAMES), 5)


def facts(comm, directory):
    """Residual and tangent of a pair that sticks and slides, by the places of the nodes."""
    found = {shape: facts_of(shape, comm) for shape in SHARED}
    found |= {f"{shape} film": facts_of(shape, comm, film=0.5) for shape in ("T3", "hex8")}
    found["T3 over the end"] = facts_of("T3", comm, film=0.5, start=0.535)
    with pytest.MonkeyPatch.context() as patch:
        take_all_for_kinked(patch)
        found["T3 rays"] = facts_of("T3", comm, film=0.5, start=0.54)
    return found


def facts_of(shape, comm, film=0.0, start=0.0):
    surface = parted(shape, comm)
    space, dim = surface.space, surface.dim
    law = film_map() if film else coulomb(0.3)
    penalty = PENALTY * np.linspace(1.0, 2.0, surface.vertices.count)
    term = ContactTerm(surface, law, penalty, film, modulus=50.0)
    problem = Equilibrium(dolfinx.fem.Function(space), [], [term])
    where = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local, :dim]
    upper = np.zeros(len(where), dtype=bool)
    body = np.unique(space.dofmap.list[_cells_above(space)])
    upper[body[body < len(where)]] = True
    f = problem.new_vector()
    phase = 3.0 if film and not start else 0.0  # with it the rim lies at seams
    for step in (0.01, 0.02):
        moved = 0.05 * np.sin(3.0 * where + 1.0)[:, ::-1]
        moved[upper, 0] += start + step
        moved[upper, 1] += 0.04 * np.sin(5.0 * where[upper, 0] + where[upper, -1] + phase) - step
        x = problem.new_vector()
        x.array[:] = moved.reshape(-1)
        problem.residual(None, x, f)
        trial = problem.trials[0]
        A = problem.new_matrix(x)
        problem.assemble_tangent(x, A)
        problem.commit()
    order = _by_place(comm, where + 1e-3 * upper[:, None])
    rows = (dim * order[:, None] + np.arange(dim)).reshape(-1)
    force = np.concatenate(comm.allgather(f.array_r))[rows]
    whole = np.concatenate(comm.allgather(_dense_rows(A)))[np.ix_(rows, rows)]
    return {
        "force": force.tolist(),
        "tangent": whole.tolist(),
        "pressure": trial.nodal_pressure.tolist(),
        "gap": trial.nodal_gap.tolist(),
        "open": int(np.sum(~trial.normal_contact.active)),
        "closed": comm.allreduce(int(trial.kinematics.closed.sum())),
        "shared": int(surface.vertices.shared.sum()),
        "rim": int(np.sum(_rim(trial))),
        "seam": int(np.sum(_rim(trial) & surface.vertices.shared)),
        "fading": comm.allreduce(_count_fading(trial)),
        "rays": trial.projection.rays is not None,
    }


def _rim(trial):
    rim = trial.normal_contact.rim
    return np.zeros_like(trial.normal_contact.active) if rim is None else rim


def _count_fading(trial):
    share = trial.projection.share
    return 0 if share is None else int(np.count_nonzero((share < 1.0) & trial.kinematics.closed))


def _cells_above(space):
    """Cells (local, ghosts too) of the upper body, which is above y = 0."""
    mesh = space.mesh
    cells = mesh.topology.index_map(mesh.topology.dim)
    every = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
    return every[dolfinx.mesh.compute_midpoints(mesh, mesh.topology.dim, every)[:, 1] > 0.0]


def _by_place(comm, where):
    """Global nodes in order of place; the ranks' nodes are numbered one after the other."""
    return order_by_place(np.concatenate(comm.allgather(where)))


def _dense_rows(A):
    start, end = A.getOwnershipRange()
    indptr, columns, values = A.getValuesCSR()
    out = np.zeros((end - start, A.getSize()[1]))
    out[np.repeat(np.arange(end - start), np.diff(indptr)), columns] = values
    return out


@pytest.mark.mpi(facts, 2, 3)
@pytest.mark.parametrize("shape", [*SHARED, *FILMS])
def test_forces_and_tangent_do_not_depend_on_the_ranks(shape, on_ranks):
    """Entry by entry, where vertices have their facets on several ranks."""
    alone = on_ranks(facts, 1)[shape]
    assert alone["shared"] == 0 and alone["open"] > 0 and max(alone["pressure"]) > 0.0
    assert (alone["rim"] > 0) == (shape in FILMS)
    assert (alone["fading"] > 0) == (shape in FILMS[2:]) and alone["rays"] == (shape == FILMS[3])
    for ranks in (2, 3):
        one = on_ranks(facts, ranks)[shape]
        assert one["shared"] > 0 and (one["seam"] > 0 or shape != "hex8 film")
        assert all(one[name] == alone[name] for name in ("open", "closed", "rim", "fading"))
        for name in ("force", "tangent", "pressure", "gap"):
            expected = np.array(alone[name])
            scale = np.abs(expected).max()
            np.testing.assert_allclose(one[name], expected, rtol=0.0, atol=1e-12 * scale)
