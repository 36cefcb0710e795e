"""What rounding leaves of the residual, against Newton's method carried on without end."""

from __future__ import annotations

import dolfinx
import numpy as np
import pytest
from petsc4py import PETSc

from tests.grid import grid
from tribox.app.equilibrium.constraints import Prescribed
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid

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
    count = mesh.topology.index_map(dim).size_local
    cells = np.arange(count, dtype=np.int32)
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
