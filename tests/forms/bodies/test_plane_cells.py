"""The compiled loops over cells in the plane and of rings against the forms of DOLFINx."""

import dolfinx
import numpy as np
import pytest
import ufl
from mpi4py import MPI

from tests.forms.bodies.element_matrices import (
    cells_of,
    compare,
    no_number_in_an_inverted_cell,
    same_carried_pressures,
    summed,
)
from tests.forms.bodies.in_forms import in_ufl
from tests.grid import coordinate_element, grid
from tribox.app.equilibrium.bodies import Bodies
from tribox.forms.bodies.compiled_cells import OwnCells
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean, Yeoh
from tribox.forms.bodies.solid import DEGREE, Solid

MATERIALS = {
    "neo-hookean": NeoHookean(1.0, 5.0),
    "mooney-rivlin": MooneyRivlin(0.4, 0.1, 5.0),
    "hencky": Hencky(1.0, 5.0),
}
KINDS = [("quadrilateral", "q1"), ("quadrilateral", "q1-sri"), ("triangle", "q1")]
# The forms of most rings are in the image.
RINGS = [(name, "quadrilateral", "q1-sri") for name in MATERIALS]
RINGS += [("hencky", "quadrilateral", "q1"), ("mooney-rivlin", "triangle", "q1")]
YEOH = Yeoh(0.5, -0.04, 0.02, 5.0)
# What no loop of its own serves: of cells of second order, and of an energy.
OTHERS = [
    (YEOH, "quadrilateral", "q1-sri", "plane-strain"),
    (YEOH, "triangle", "q2", "axisymmetric"),
    (MATERIALS["hencky"], "quadrilateral", "q2", "axisymmetric"),
    (MATERIALS["neo-hookean"], "quadrilateral", "q2", "plane-strain"),
]

SECTIONS = [("plane-strain", "triangle", "q1"), ("axisymmetric", "quadrilateral", "q1-sri")]


def body(cell, material, formulation, cells=(5, 3), distortion=0.15, section=None):
    """A displacement on a distorted mesh, and the body on all of it; rings have a hole."""
    dim = len(cells)
    mesh = grid(cell, cells, [1.0, 0.7, 0.5][:dim])
    x = mesh.geometry.x
    x[:, :dim] += distortion / max(cells) * np.random.default_rng(3).uniform(-1, 1, (len(x), dim))
    if section == "axisymmetric":
        x[:, 0] += 0.3
    element = ("Lagrange", DEGREE[formulation], (dim,))
    mesh = mesh if DEGREE[formulation] == 1 else bent(mesh)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, element))
    all_cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    return u, Solid("body", u, all_cells, material, formulation, section=section)


def bent(mesh):
    """The same cells with curved sides."""
    domain = coordinate_element(mesh.topology.cell_name(), 2, order=2)
    nodes = dolfinx.fem.functionspace(mesh, domain.ufl_coordinate_element())
    x = nodes.tabulate_dof_coordinates()[:, :2]
    cells = np.asarray(nodes.dofmap.list, dtype=np.int64)
    return dolfinx.mesh.create_mesh(MPI.COMM_SELF, cells, x=x + 0.03 * np.sin(7.0 * x), e=domain)


def stretched(u, size, seed=0):
    """A homogeneous stretch with a ripple of the given size on it."""
    where = u.function_space.tabulate_dof_coordinates()[:, :2]
    ripple = np.random.default_rng(seed).uniform(-1, 1, where.shape)
    gradient = np.array([[0.3, 0.25], [-0.4, -0.2]]) * min(1.0, 20.0 * size)
    u.x.array[:] = (where @ gradient.T + 0.2 * size * ripple).reshape(-1)


@pytest.mark.parametrize("size", [0.5, 0.1, 1e-4])
@pytest.mark.parametrize(("cell", "formulation"), KINDS)
@pytest.mark.parametrize("name", MATERIALS)
def test_forces_energy_and_tangent_are_those_of_the_forms(name, cell, formulation, size):
    """15 cells: one block of eight is full, the last one is not.

    At the largest size some cells are beyond the logarithm's series.
    """
    same(*body(cell, MATERIALS[name], formulation), size)


@pytest.mark.parametrize("size", [0.1, 1e-4])
@pytest.mark.parametrize(("name", "cell", "formulation"), RINGS)
def test_those_of_rings(name, cell, formulation, size):
    same(*body(cell, MATERIALS[name], formulation, section="axisymmetric"), size)


@pytest.mark.parametrize(("material", "cell", "formulation", "section"), OTHERS)
def test_those_of_points_alone(material, cell, formulation, section):
    u, solid = body(cell, material, formulation, (3, 3), section=section)
    for size in (0.1, 1e-4):
        same(u, solid, size)


def same(u, solid, size):
    stretched(u, size)
    compare(u, solid, 8e-14, 1e-13, 1e-12)


@pytest.mark.parametrize("name", MATERIALS)
def test_the_energy_of_tiny_strains_keeps_its_digits(name):
    """With strains of 1e-9 the forms have none left; that of linear elasticity is the limit."""
    u, solid = body("quadrilateral", MATERIALS[name], "q1")
    where = u.function_space.tabulate_dof_coordinates()[:, :2]
    H = 1e-9 * np.array([[0.7, 0.4], [-0.9, -0.2]])
    u.x.array[:] = (where @ H.T).reshape(-1)
    strain, material = 0.5 * (H + H.T), MATERIALS[name]
    G, K = material.shear_modulus, material.bulk_modulus
    density = G * (strain**2).sum() + 0.5 * (K - 2.0 / 3.0 * G) * np.trace(strain) ** 2
    area = dolfinx.fem.assemble_scalar(dolfinx.fem.form(1.0 * ufl.dx(u.function_space.mesh)))
    assert Bodies(u, [solid]).strain_energy() == pytest.approx(area * density, rel=1e-8)


@pytest.mark.parametrize("section", ["plane-strain", "axisymmetric", "3D"])
@pytest.mark.parametrize("formulation", ["q1", "q1-sri"])
def test_an_energy_of_ones_own_is_that_of_the_sources(section, formulation):
    """Forces, energy and tangent; a cell that is inverted is told."""
    cell = "hexahedron" if section == "3D" else "quadrilateral"
    for material in (*list(MATERIALS.values())[:2], YEOH):
        u, solid = body(cell, material, formulation, (3, 2, 1)[: 3 if section == "3D" else 2],
                        section=section)  # fmt: skip
        u.x.array[:] = 0.04 * np.random.default_rng(5).uniform(-1, 1, len(u.x.array))
        own = Solid("own", u, solid.cells, in_ufl(material), formulation, section=section)
        assert own.reduced == solid.reduced
        found = []
        for one in (solid, own):
            cells, force = cells_of(u, one), np.zeros_like(u.x.array)
            assert cells.add(u.x.array, force)
            tangent = summed(u, cells.tangent_loops(u.x.array))
            found.append((force, tangent, np.array(cells.energy(u.x.array))))
        for known, mine in zip(*found, strict=True):
            np.testing.assert_allclose(mine, known, rtol=0, atol=1e-12 * np.abs(known).max())
    assert type(cells) is OwnCells
    u.x.array[0] = 9.0
    assert not cells.add(u.x.array, force) and cells.energy(u.x.array) == np.inf


@pytest.mark.parametrize("name", MATERIALS)
def test_large_strains(name):
    """Beyond the series of the logarithmic strain, and J far from one."""
    u, solid = body("quadrilateral", MATERIALS[name], "q1", distortion=0.0)
    where = u.function_space.tabulate_dof_coordinates()[:, :2]
    for gradient in ([[2.0, 0.4], [0.1, 0.5]], [[-0.7, 0.0], [0.2, -0.5]]):
        u.x.array[:] = (where @ np.array(gradient).T).reshape(-1)
        compare(u, solid, 1e-13, 1e-12, 1e-12)


@pytest.mark.parametrize("section", ["plane-strain", "axisymmetric"])
@pytest.mark.parametrize("name", MATERIALS)
def test_carried_pressures(name, section):
    u, solid = body("quadrilateral", MATERIALS[name], "q1-sri", section=section)
    stretched(u, 0.1)
    same_carried_pressures(u, solid, 1e-12)


@pytest.mark.parametrize("formulation", ["q1", "q1-sri"])
@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("depth", [0.8, 1.3])
def test_what_is_no_number_in_an_inverted_cell(name, formulation, depth):
    no_number(name, formulation, depth, "plane-strain")


@pytest.mark.parametrize("name", MATERIALS)
def test_what_is_no_number_in_an_inverted_ring(name):
    no_number(name, "q1-sri", 0.8, "axisymmetric")
    no_number(name, "q1-sri", 1.3, "axisymmetric")


def no_number(name, formulation, depth, section):
    """The centre is inverted too, or not."""
    u, solid = body("quadrilateral", MATERIALS[name], formulation, distortion=0.0, section=section)
    stretched(u, 1e-3)
    no_number_in_an_inverted_cell(u, solid, -depth * np.array([0.2, 0.7 / 3.0]))


@pytest.mark.parametrize(("section", "cell", "formulation"), SECTIONS)
def test_a_rank_without_cells_of_a_body(section, cell, formulation):
    material, none = MATERIALS["hencky"], np.empty(0, dtype=np.int32)
    u, _ = body(cell, material, formulation, section=section)
    cells = cells_of(u, Solid("none", u, none, material, formulation, section=section))
    force = np.zeros_like(u.x.array)
    assert cells.add(u.x.array, force) and not force.any()
    assert cells.energy(u.x.array) == 0.0 and not summed(u, cells.loops).any()


@pytest.mark.parametrize("name", MATERIALS)
def test_a_disc_that_is_pressed(name):
    """Energy and forces up to the axis by hand: a homogeneous deformation of a solid of revolution.

    The work of the nodal forces along the deformation is the derivative of the energy by it.
    """
    u, solid = body("quadrilateral", MATERIALS[name], "q1-sri", distortion=0.0)
    solid = Solid("disc", u, solid.cells, MATERIALS[name], "q1-sri", section="axisymmetric")
    where = u.function_space.tabulate_dof_coordinates()[:, :2]
    cells, stretch = cells_of(u, solid), np.array([1.15, 0.8])

    def energy(at):
        u.x.array[:] = (where * (at - 1.0)).reshape(-1)
        return cells.energy(u.x.array)

    density = by_hand(name, stretch[0], stretch[1], stretch[0])
    assert energy(stretch) == pytest.approx(np.pi * 0.7 * density, rel=1e-12)
    forces = np.zeros_like(u.x.array)
    assert cells.add(u.x.array, forces)
    for axis in (0, 1):
        change = 1e-5 * np.eye(2)[axis]
        slope = (energy(stretch + change) - energy(stretch - change)) / 2e-5
        work = forces.reshape(-1, 2)[:, axis] @ where[:, axis]
        assert work == pytest.approx(slope, rel=1e-8, abs=1e-9)


def by_hand(name, *stretches):
    """Strain energy of three principal stretches, J/m³."""
    a, J = np.array(stretches), np.prod(stretches)
    if name == "neo-hookean":
        G, L = MATERIALS[name].parameters().values()
        return 0.5 * G * ((a**2).sum() - 3.0) - G * np.log(J) + 0.5 * L * np.log(J) ** 2
    if name == "mooney-rivlin":
        one, two, K = MATERIALS[name].parameters().values()
        b = a / np.cbrt(J)
        inverse = (b**-2.0).sum() - 3.0
        volume = 0.25 * K * (J**2 - 1.0 - 2.0 * np.log(J))
        return one * ((b**2).sum() - 3.0) + two * inverse + volume
    G, K = MATERIALS[name].parameters().values()
    h = np.log(a)
    return G * ((h - h.mean()) ** 2).sum() + 0.5 * K * np.log(J) ** 2
