"""The tangent with a pressure carried from another displacement."""

import dolfinx
import numpy as np
import pytest

from tests.forms.bodies.element_matrices import cells_of, summed
from tests.grid import grid
from tribox.app.equilibrium.constraints import Prescribed
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.implicit.newton import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.forms.bodies.materials import MooneyRivlin, NeoHookean, shear_and_bulk
from tribox.forms.bodies.solid import Solid

G, K = 1.0, 50.0
SLOPE = {
    "neo-hookean": lambda J: (K - 2.0 / 3.0 * G) * np.log(J) / J,
    "mooney-rivlin": lambda J: 0.5 * K * (J - 1.0 / J),
}
MATERIALS = {"neo-hookean": NeoHookean(G, K), "mooney-rivlin": MooneyRivlin(0.3, 0.2, K)}


def block(cell: str, material, counts: int) -> tuple[dolfinx.fem.Function, Solid]:
    dim = 3 if cell == "hexahedron" else 2
    mesh = grid(cell, [counts] * dim, [1.0] * dim)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,))))
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    return u, Solid("body", u, cells, material, "q1-sri")


@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
@pytest.mark.parametrize("name", MATERIALS)
def test_the_pressure_is_that_of_the_linearised_volume(cell, name):
    """In uniform strain all is known in closed form."""
    u, solid = block(cell, MATERIALS[name], 2)
    x = u.function_space.tabulate_dof_coordinates()
    dim = u.function_space.mesh.geometry.dim
    before, now, test, trial = 0.2 * np.random.default_rng(4).normal(size=(4, dim, dim))

    def field(gradient):
        return (x[:, :dim] @ gradient.T).reshape(-1)

    u.x.array[:] = field(now)
    solid.carried.carry(field(before))
    loops = cells_of(u, solid).loops
    A = summed(u, loops, solid.carried.excess()) - summed(u, loops)

    def volume(*parts):
        return np.linalg.det(np.eye(dim) + sum(parts))

    h = 1e-4
    J, slope = volume(before), SLOPE[name]
    curvature = (slope(J + h) - slope(J - h)) / (2 * h)
    step = h * (now - before)
    change = (volume(before, step) - volume(before, -step)) / (2 * h)
    excess = slope(J) + curvature * change - slope(volume(now))
    signs = ((1, 1), (1, -1), (-1, 1), (-1, -1))
    second = sum(a * b * volume(now, a * h * test, b * h * trial) for a, b in signs) / (4 * h * h)
    assert field(test) @ A @ field(trial) == pytest.approx(excess * second, rel=1e-5)


@pytest.mark.parametrize("nu", [0.45, 0.4999, 0.499999])
def test_a_block_is_bent_far_in_few_iterations_however_incompressible(nu):
    """The side of a block turns by 0.3 rad in one step."""
    u, solid = block("quadrilateral", NeoHookean(*shear_and_bulk(1.0, nu)), 4)
    c, s = np.cos(0.3), np.sin(0.3)
    prescribed = []
    for end in (0.0, 1.0):
        mesh = u.function_space.mesh
        side = dolfinx.mesh.locate_entities_boundary(mesh, 1, lambda x, y=end: np.isclose(x[1], y))
        for axis, row in enumerate(([c - 1.0, -s], [s, c - 1.0])):
            part = Prescribed.on(u, side, axis)
            place = u.function_space.tabulate_dof_coordinates()[part.dofs // 2, :2] - [0.5, 0.0]
            part.value = end * (place @ row)
            prescribed.append(part)
    problem = Equilibrium(u, [solid], [], prescribed)
    result = ImplicitStepper(problem, ImplicitOptions()).attempt(1.0)
    assert result.converged and result.iterations <= 7
