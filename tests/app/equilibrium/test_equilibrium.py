"""The whole tangent against finite differences, and what rounding leaves of the residual."""

import dolfinx
import numpy as np
import pytest
from petsc4py import PETSc

from tests.grid import grid
from tests.laws import FILM, coulomb, film_map
from tribox.app.equilibrium.constraints import Platen, Prescribed
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.forms.bodies.loads import FollowerPressure
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid


def bent(blocks, shift):
    """Unknowns of both bodies bent together, the upper one shifted."""

    def common(X):
        along = 0.024 * np.cos(2.1 * X[:, 0] - 0.9)
        return np.stack([along, 0.08 * np.sin(2.6 * X[:, 0] + 0.9)], axis=1)

    shift = np.array(shift)
    return blocks.displaced(lambda X: common(X + shift) + shift, common)


def prepared(pair, law, **parts):
    """The problem with a history of one step, the current unknowns, and its matrix."""
    blocks = pair()
    problem = blocks.problem(law, **parts)
    [term] = problem.contacts
    term.commit(term.evaluate(bent(blocks, (0.01, -0.06)), 1.0))
    x = bent(blocks, (0.16, -0.08))
    return problem, x, problem.new_matrix(x)


def unbalanced(problem, x):
    problem.residual(None, x, problem.new_vector())
    return problem.unbalanced.copy()


def test_tangent_with_held_edges_platen_and_pressure(pair):
    """The matrix that Newton solves with, in directions that keep what is prescribed."""
    blocks = pair()
    side = FollowerPressure(blocks.u, blocks.named.facets("elastomer_left"))
    side.set(0.7)
    top = Platen(blocks.held("top", 1).dofs, force=-0.4)
    held = [blocks.held("bottom", 0), blocks.held("bottom", 1), blocks.held("top", 0)]
    problem, x, A = prepared(pair, coulomb(0.2), prescribed=held, platens=[top], loads=[side])
    f, d, image = x.duplicate(), x.duplicate(), x.duplicate()
    problem.jacobian(None, x, A, A)
    rng = np.random.default_rng(3)
    h = 1e-6
    for _ in range(3):
        direction = rng.normal(size=x.getSize())
        direction[problem.constrained_dofs()] = 0.0
        direction[top.dofs] = direction[top.all_dofs[0]]
        sides = []
        for sign in (1.0, -1.0):
            d.array[:] = x.array_r + sign * h * direction
            problem.residual(None, d, f)
            sides.append(f.array_r.copy())
        exact = (sides[0] - sides[1]) / (2.0 * h)
        d.array[:] = direction
        A.mult(d, image)
        assert np.abs(image.array_r - exact).max() < 1e-6 * np.abs(exact).max()
        # The follower's stiffness is in there, and large enough to be missed.
        side.set(0.0)
        problem.jacobian(None, x, A, A)
        A.mult(d, image)
        assert np.abs(image.array_r - exact).max() > 1e-4 * np.abs(exact).max()
        side.set(0.7)
        problem.jacobian(None, x, A, A)


def test_evaluations_leave_no_trace(pair):
    """History is a value of the converged step: residual and tangent may be asked for at will."""
    problem, x, A = prepared(pair, film_map(), film=FILM)
    (term,) = problem.contacts
    kept = term.state
    first = unbalanced(problem, x)
    away = x.copy()
    away.array[:] += 0.01 * np.random.default_rng(0).normal(size=away.getSize())
    unbalanced(problem, away)
    problem.assemble_tangent(away, A)
    assert term.state is kept
    np.testing.assert_array_equal(unbalanced(problem, x), first)


# -- What rounding leaves of the residual, against Newton's method carried on without end ----------

SECTIONS = {
    "plane-strain": ("quadrilateral", (6, 6)),
    "axisymmetric": ("quadrilateral", (6, 6)),
    "3D": ("hexahedron", (3, 3, 3)),
}


def body(
    section: str, inner: float = 0.0, width: float = 1.0
) -> tuple[dolfinx.fem.Function, Solid]:
    """A square or cube; ``inner``: the radius of its left side, where that is no axis.

    Its sides are 1 long; ``width``: of those along x.
    """
    kind, counts = SECTIONS[section]
    mesh = grid(kind, counts, [1.0] * len(counts))
    mesh.geometry.x[:, 0] = width * mesh.geometry.x[:, 0] + inner
    dim = len(counts)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,))))
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    return u, Solid("body", u, cells, NeoHookean(1.0, 5.0), "q1", section=section)


def squeezed(section: str, moved: float, width: float = 1.0) -> Equilibrium:
    """The body with its ends held; all of it moved up, and squeezed by 5 %."""
    u, solid = body(section, width=width)
    mesh, dim = u.function_space.mesh, u.function_space.dofmap.index_map_bs
    held = []
    for end in (0.0, 1.0):
        facets = dolfinx.mesh.locate_entities_boundary(
            mesh, dim - 1, lambda x, end=end: np.abs(x[1] - end) < 1e-9
        )
        held += Prescribed.components(u, facets)
        held[-dim + 1].value = moved - 0.05 * end
    if section == "axisymmetric":
        axis = dolfinx.mesh.locate_entities_boundary(mesh, 1, lambda x: x[0] < 1e-9)
        held.append(Prescribed.on(u, axis, 0))
    return Equilibrium(u, [solid], [], held)


def endless(problem: Equilibrium, x: PETSc.Vec, iterations: int) -> list[float]:
    """Residual norms over the floor, of Newton's iterations from ``x``, which goes along."""
    f, step = problem.new_vector(), problem.new_vector()
    A = problem.new_matrix(x)
    ksp = PETSc.KSP().create(problem.comm)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    norms = []
    for _ in range(iterations):
        problem.residual(None, x, f)
        norms.append(f.norm() / problem.roundoff)
        problem.jacobian(None, x, A, A)
        ksp.setOperators(A)
        ksp.solve(f, step)
        x.axpy(-1.0, step)
    return norms


@pytest.mark.parametrize("moved", [0.0, 100.0])
@pytest.mark.parametrize("section", SECTIONS)
def test_roundoff_is_what_newton_ends_at(section, moved):
    """Neither less, or no iteration would end, nor ten times more."""
    problem = squeezed(section, moved)
    x = problem.new_vector()
    height = problem.space.tabulate_dof_coordinates()[:, 1]
    x.array.reshape(-1, problem.dim)[:, 1] = moved - 0.05 * height
    norms = endless(problem, x, 10)
    assert norms[0] > 1e3
    assert 0.1 < np.median(norms[5:]) and max(norms[5:]) < 1.0, norms


@pytest.mark.parametrize("section", SECTIONS)
def test_long_cells_round_more_than_their_volume_says(section):
    """Beside a fine contact cells are long: a floor by their volume was never reached."""
    problem = squeezed(section, 0.0, width=1.0 / 30.0)
    x = problem.new_vector()
    x.array.reshape(-1, problem.dim)[:, 1] = -0.05 * problem.space.tabulate_dof_coordinates()[:, 1]
    norms = endless(problem, x, 10)
    assert norms[0] > 1e3
    assert 0.05 < np.median(norms[5:]) and max(norms[5:]) < 1.0, norms


@pytest.mark.parametrize("section", ["plane-strain", "3D"])
def test_a_body_that_is_let_go_far_away_is_solved(section):
    """Turned too: no force is left, and rounding of the way is more than that of a body at rest."""
    problem = squeezed(section, 0.0)
    x, f = problem.new_vector(), problem.new_vector()
    place, way = problem.space.tabulate_dof_coordinates(), x.array.reshape(-1, problem.dim)
    way[:, 0] = (np.cos(1.0) - 1.0) * place[:, 0] - np.sin(1.0) * place[:, 1]
    way[:, 1] = np.sin(1.0) * place[:, 0] + (np.cos(1.0) - 1.0) * place[:, 1] + 100.0
    for one in problem.constraints.prescribed:
        one.acts = False
    problem.rounding.let_go = set(problem.rounding.names)
    problem.residual(None, x, f)
    assert problem.roundoff < f.norm() < problem.roundoff_beside(1.0) < 1e-6


def test_roundoff_is_that_of_the_deformed_body():
    """A tube widened 8 times is a sixth as thick, where the same errors are larger forces."""
    u, solid = body("axisymmetric", inner=2.5)
    mesh = u.function_space.mesh
    sides = [
        dolfinx.mesh.locate_entities_boundary(mesh, 1, lambda x, i=i, at=at: np.isclose(x[i], at))
        for i, at in ((0, 2.5), (1, 0.0), (1, 1.0))
    ]
    held = [Prescribed.on(u, side, i) for side, i in zip(sides, (0, 1, 1), strict=True)]
    problem = Equilibrium(u, [solid], [], held)
    held[0].value = 17.5
    x, radius = problem.new_vector(), problem.space.tabulate_dof_coordinates()[:, 0]
    x.array[::2] = np.sqrt(radius**2 + 20.0**2 - 2.5**2) - radius  # at a volume that stays
    norms = endless(problem, x, 20)
    assert norms[0] > 1e3
    assert 0.1 < np.median(norms[10:]) and max(norms[10:]) < 1.0, norms


@pytest.mark.parametrize(
    ("way", "reached"), [(0.0, True), (10.0, True), (1e9, False), (np.inf, False), (np.nan, False)]
)
def test_places_where_only_rounding_is_left_are_out_of_reach(way, reached):
    """Divergent iterations had come to rest 5e9 m away, where rounding hid all forces."""
    problem = squeezed("plane-strain", 0.0)
    x = problem.new_vector()
    x.array[1] = way
    assert problem.rounding.is_within_reach(x) is reached
