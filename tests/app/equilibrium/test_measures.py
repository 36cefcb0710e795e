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


def squeezed(section: str, moved: float) -> Equilibrium:
    """A unit square or cube, its ends held; all of it moved up, and squeezed by 5 %."""
    kind, counts = SECTIONS[section]
    mesh = grid(kind, counts, [1.0] * len(counts))
    dim = len(counts)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,))))
    count = mesh.topology.index_map(dim).size_local
    cells = np.arange(count, dtype=np.int32)
    solid = Solid("body", u, cells, NeoHookean(1.0, 5.0), "q1", section=section)
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


@pytest.mark.parametrize("moved", [0.0, 100.0])
@pytest.mark.parametrize("section", SECTIONS)
def test_roundoff_is_what_newton_ends_at(section, moved):
    """Neither less, or no iteration would end, nor ten times more."""
    problem = squeezed(section, moved)
    x, f, step = (problem.new_vector() for _ in range(3))
    height = problem.space.tabulate_dof_coordinates()[:, 1]
    x.array.reshape(-1, problem.dim)[:, 1] = moved - 0.05 * height
    A = problem.new_matrix(x)
    ksp = PETSc.KSP().create(problem.comm)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    norms = []
    for _ in range(10):
        problem.residual(None, x, f)
        norms.append(f.norm() / problem.roundoff)
        problem.jacobian(None, x, A, A)
        ksp.setOperators(A)
        ksp.solve(f, step)
        x.axpy(-1.0, step)
    assert norms[0] > 1e3
    assert 0.1 < np.median(norms[5:]) and max(norms[5:]) < 1.0, norms


@pytest.mark.parametrize(
    ("way", "reached"), [(0.0, True), (10.0, True), (1e9, False), (np.inf, False), (np.nan, False)]
)
def test_places_where_only_rounding_is_left_are_out_of_reach(way, reached):
    """Divergent iterations had come to rest 5e9 m away, where rounding hid all forces."""
    problem = squeezed("plane-strain", 0.0)
    x = problem.new_vector()
    x.array[1] = way
    assert problem.rounding.is_within_reach(x) is reached
