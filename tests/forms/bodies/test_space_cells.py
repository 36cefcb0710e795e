"""The compiled loop over cells in space against what DOLFINx assembles, to round-off."""

import dolfinx
import numpy as np
import pytest
import ufl

from tests.forms.bodies.element_matrices import (
    cells_of,
    compare,
    no_number_in_an_inverted_cell,
    same_carried_pressures,
    summed,
)
from tests.grid import coordinate_element, grid
from tribox.forms.bodies.materials import (
    Hencky,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
    shear_and_bulk,
)
from tribox.forms.bodies.solid import DEGREE, Solid
from tribox.geometry.compat import cell_nodes

MATERIALS = {
    "neo-hookean": NeoHookean(1.0, 5.0),
    "mooney-rivlin": MooneyRivlin(0.4, 0.1, 5.0),
    "hencky": Hencky(1.0, 5.0),
    "yeoh": Yeoh(0.5, -0.04, 0.02, 5.0),
}
INCOMPRESSIBLE = {
    "neo-hookean": NeoHookean(*shear_and_bulk(1.0, 0.499)),
    "mooney-rivlin": MooneyRivlin(0.4, 0.1, 500.0),
    "hencky": Hencky(*shear_and_bulk(1.0, 0.499)),
    "yeoh": Yeoh(0.5, -0.04, 0.02, 500.0),
}
OGDEN = Ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0), 5.0)
# Full integration differs by the points alone, so that one material shows it.
KINDS = [
    *((name, cell, kind) for name in MATERIALS for cell, kind in
      (("hexahedron", "q1-sri"), ("tetrahedron", "q1"))),
    ("mooney-rivlin", "hexahedron", "q1"),
]  # fmt: skip
HEXAHEDRA = [(name, formulation) for name, cell, formulation in KINDS if cell == "hexahedron"]
GRADIENT = np.array([[0.3, 0.25, 0.1], [-0.4, -0.2, 0.2], [0.1, -0.3, 0.4]])
TURN = np.array([[0.0, -0.8, 0.6], [1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])


def on_all(comm, mesh):
    """A mesh that one rank has, over all ranks."""
    cells, x = cell_nodes(mesh).astype(np.int64), mesh.geometry.x
    if comm.rank > 0:
        cells, x = cells[:0], x[:0]
    return dolfinx.mesh.create_mesh(comm, cells, x=x, e=coordinate_element("hexahedron", 3))


def body(cell, material, formulation, distortion=0.15, comm=None):
    """A displacement on a distorted mesh, and the body on all of it; nine hexahedra."""
    mesh = grid(cell, (3, 1, 3), [1.0, 0.4, 0.8])
    mesh = mesh if comm is None else on_all(comm, mesh)
    x = mesh.geometry.x
    x += distortion / 3.0 * np.sin(np.array([7.0, 11.0, 13.0]) * x[:, [1, 2, 0]] + x)
    u = dolfinx.fem.Function(
        dolfinx.fem.functionspace(mesh, ("Lagrange", DEGREE[formulation], (3,)))
    )
    count = mesh.topology.index_map(3).size_local
    return u, Solid("body", u, np.arange(count, dtype=np.int32), material, formulation)


def deform(u, size, turned=False):
    """A stretch with a ripple, both of the given size, that curves the faces of the cells.

    ``turned``: the whole body is turned too, by a finite rotation.
    """
    where = u.function_space.tabulate_dof_coordinates()
    ripple = np.sin(9.0 * where[:, [2, 0, 1]] + 5.0 * where) * np.array([1.0, -0.7, 0.8])
    moved = where + size * (where @ GRADIENT.T + 0.06 * ripple)
    u.x.array[:] = ((moved @ TURN.T if turned else moved) - where).reshape(-1)


@pytest.mark.parametrize(("name", "cell", "formulation"), KINDS)
def test_forces_energy_and_tangent_are_those_of_the_forms(name, cell, formulation):
    """Small, large, turned; nearly incompressible. Of nine cells a block is full, one is not."""
    u, solid = body(cell, MATERIALS[name], formulation)
    for size, turned in ((0.7, False), (0.7, True), (1e-2, True), (1e-5, False)):
        deform(u, size, turned)
        assert compare(u, solid) > 1e-4 * size
    solid = Solid("body", u, solid.cells, INCOMPRESSIBLE[name], formulation)
    for size in (0.5, 1e-2):
        deform(u, size, turned=True)
        compare(u, solid)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("material", [*MATERIALS.values(), OGDEN], ids=[*MATERIALS, "ogden"])
def test_second_order_by_differences(material, cell):
    """Without the forms, which take a minute to compile: work of the forces, and their change."""
    u, solid = body(cell, material, "q2")
    cells, along = cells_of(u, solid), np.random.default_rng(2).uniform(-1, 1, len(u.x.array))
    deform(u, 0.5, turned=True)
    at, step, ends = u.x.array.copy(), 2e-6, []
    found = summed(u, cells.loops)
    for sign in (1.0, -1.0):
        u.x.array[:] = at + sign * step * along
        force = np.zeros_like(at)
        assert cells.add(u.x.array, force)
        ends.append((cells.energy(u.x.array), force))
    energy, forces = ((one - other) / (2.0 * step) for one, other in zip(*ends, strict=True))
    force = np.zeros_like(at)
    cells.add(at, force)
    assert force @ along == pytest.approx(energy, rel=1e-7)
    np.testing.assert_allclose(found @ along, forces, rtol=0, atol=1e-6 * np.abs(forces).max())
    np.testing.assert_allclose(found, found.T, rtol=0, atol=1e-14 * np.abs(found).max())
    # A homogeneous deformation has the energy of first-order cells, which the forms have.
    where = u.function_space.tabulate_dof_coordinates()
    u.x.array[:] = (where @ (0.5 * GRADIENT).T).reshape(-1)
    first, other = body(cell, material, "q1")
    where = first.function_space.tabulate_dof_coordinates()
    first.x.array[:] = (where @ (0.5 * GRADIENT).T).reshape(-1)
    wanted = cells_of(first, other).energy(first.x.array)
    assert cells.energy(u.x.array) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("name", MATERIALS)
def test_large_strains_and_equal_stretches(name):
    """Far beyond where the logarithm's series is exact, and where principal axes are not unique."""
    u, solid = body("hexahedron", MATERIALS[name], "q1-sri", distortion=0.0)
    where = u.function_space.tabulate_dof_coordinates()
    uniaxial = np.diag([2.5, 0.7, 0.7]) - np.eye(3)
    for gradient in (uniaxial, -0.3 * np.eye(3), uniaxial + 0.9 * GRADIENT):
        u.x.array[:] = (where @ gradient.T).reshape(-1)
        compare(u, solid)


@pytest.mark.parametrize(("name", "formulation"), [*HEXAHEDRA, ("mooney-rivlin", "q2")])
def test_the_energy_of_small_strains(name, formulation):
    """Simple shear by 1e-7 of a body that has moved far: G γ²/2, though F is 1 + 1e-7.

    The energy by the forms is wrong by a percent there.
    """
    u, solid = body("hexahedron", MATERIALS[name], formulation)
    where = u.function_space.tabulate_dof_coordinates()
    u.x.array[:] = (np.array([1.0, 0.0, 0.0]) * 1e-7 * (where[:, 1:2] + 1e3)).reshape(-1)
    volume = dolfinx.fem.form(1.0 * ufl.dx(u.function_space.mesh))
    expected = 0.5e-14 * solid.material.shear_modulus * dolfinx.fem.assemble_scalar(volume)
    assert cells_of(u, solid).energy(u.x.array) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("name", MATERIALS)
def test_carried_pressures(name):
    u, solid = body("hexahedron", INCOMPRESSIBLE[name], "q1-sri")
    deform(u, 0.1)
    same_carried_pressures(u, solid, 1e-14)


@pytest.mark.parametrize(("name", "formulation"), HEXAHEDRA)
@pytest.mark.parametrize("depth", [0.8, 4.0])
def test_what_is_no_number_in_an_inverted_cell(name, formulation, depth):
    """The centre is inverted too, or not."""
    u, solid = body("hexahedron", MATERIALS[name], formulation, distortion=0.0)
    deform(u, 0.1)
    no_number_in_an_inverted_cell(u, solid, -depth * np.array([1.0 / 3.0, 0.4, 0.8 / 3.0]))
