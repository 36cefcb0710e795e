"""The compiled loop over cells against the forms that DOLFINx generates, to round-off."""

import os

import dolfinx
import numpy as np
import pytest
import ufl
from mpi4py import MPI

import tribox.forms.native
import tribox.geometry.native.compiler
from tests.forms.bodies.element_matrices import cells_of, summed
from tests.forms.bodies.in_forms import InForms, in_ufl
from tests.grid import coordinate_element, grid
from tribox.app.equilibrium.bodies import Bodies
from tribox.forms.bodies.compiled_cells import CompiledCells, OwnCells
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean, Yeoh
from tribox.forms.bodies.solid import DEGREE, Solid
from tribox.geometry.native.compiler import KernelError

MATERIALS = {
    "neo-hookean": NeoHookean(1.0, 5.0),
    "mooney-rivlin": MooneyRivlin(0.4, 0.1, 5.0),
    "hencky": Hencky(1.0, 5.0),
}
KINDS = [("quadrilateral", "q1"), ("quadrilateral", "q1-sri"), ("triangle", "q1")]
# Material, cell and formulation of rings; the forms of most are in the image.
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


@pytest.mark.parametrize("size", [0.1, 1e-4])
@pytest.mark.parametrize(("cell", "formulation"), KINDS)
@pytest.mark.parametrize("name", MATERIALS)
def test_compiled_forces_are_those_of_the_generated_kernel(name, cell, formulation, size):
    """15 cells: one block of eight is full, the last one is not."""
    same_forces(*body(cell, MATERIALS[name], formulation), size)


@pytest.mark.parametrize("size", [0.1, 1e-4])
@pytest.mark.parametrize(("name", "cell", "formulation"), RINGS)
def test_forces_of_rings(name, cell, formulation, size):
    same_forces(*body(cell, MATERIALS[name], formulation, section="axisymmetric"), size)


@pytest.mark.parametrize(("material", "cell", "formulation", "section"), OTHERS)
def test_forces_of_points_alone(material, cell, formulation, section):
    u, solid = body(cell, material, formulation, (3, 3), section=section)
    for size in (0.1, 1e-4):
        same_forces(u, solid, size)


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


def same_forces(u, solid, size):
    """Compare forces and energy of both ways."""
    stretched(u, size)
    fast, slow = Bodies(u, [solid]), InForms(solid)
    assert isinstance(fast.cells[0], CompiledCells)
    mine, theirs = np.ones_like(u.x.array), np.ones_like(u.x.array)
    assert fast.evaluate(u.x.array, mine) and slow.evaluate(u.x.array, theirs)
    largest = np.abs(theirs).max()
    # F = 1 + O(size): what rounds F is an error of the stress of 1e-16/size.
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=4e-16 / min(size, 0.1) * largest * 20)
    energy = slow.strain_energy()
    assert energy > 0.0
    assert fast.strain_energy() == pytest.approx(energy, rel=1e-13, abs=1e-14)


@pytest.mark.parametrize("name", MATERIALS)
def test_large_strains(name):
    """Beyond the series of the logarithmic strain, and J far from one."""
    u, solid = body("quadrilateral", MATERIALS[name], "q1", distortion=0.0)
    where = u.function_space.tabulate_dof_coordinates()[:, :2]
    for gradient in ([[2.0, 0.4], [0.1, 0.5]], [[-0.7, 0.0], [0.2, -0.5]]):
        u.x.array[:] = (where @ np.array(gradient).T).reshape(-1)
        mine, theirs = np.zeros_like(u.x.array), np.zeros_like(u.x.array)
        Bodies(u, [solid]).evaluate(u.x.array, mine)
        InForms(solid).evaluate(u.x.array, theirs)
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-13 * np.abs(theirs).max())
        assert Bodies(u, [solid]).strain_energy() == pytest.approx(InForms(solid).strain_energy())


def test_without_a_compiler_there_is_an_error(monkeypatch, tmp_path):
    """And no run that is silently slower. The cache is empty, and nothing is on the path."""
    monkeypatch.setattr(tribox.geometry.native.compiler, "_caches", lambda: (tmp_path / "none",))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    tribox.forms.native.library.cache_clear()
    try:
        u, solid = body("quadrilateral", MATERIALS["hencky"], "q1-sri")
        with pytest.raises(KernelError, match=r"plane_kernel.c .*no C compiler on the PATH"):
            Bodies(u, [solid])
    finally:
        tribox.forms.native.library.cache_clear()


def test_a_library_is_compiled_once_and_a_broken_one_again(monkeypatch, tmp_path):
    monkeypatch.setattr(tribox.geometry.native.compiler, "_caches", lambda: (tmp_path / "cache",))
    tribox.forms.native.library.cache_clear()
    try:
        assert tribox.forms.native.library("plane_contact.c") is not None
        (built,) = (tmp_path / "cache").iterdir()
        stamp = built.stat().st_mtime_ns
        tribox.forms.native.library.cache_clear()
        assert tribox.forms.native.library("plane_contact.c") is not None
        assert built.stat().st_mtime_ns == stamp
        broken = tmp_path / "other" / built.name
        broken.parent.mkdir()
        broken.write_bytes(b"half a library")
        monkeypatch.setattr(
            tribox.geometry.native.compiler, "_caches", lambda: (tmp_path / "other",)
        )
        tribox.forms.native.library.cache_clear()
        assert tribox.forms.native.library("plane_contact.c") is not None
        assert broken.stat().st_size > 1000
    finally:
        tribox.forms.native.library.cache_clear()


def test_libraries_of_strangers_are_not_loaded(monkeypatch, tmp_path):
    directory = tmp_path / "cache"
    directory.mkdir()
    os.chown(directory, 4242, -1) if os.getuid() == 0 else pytest.skip("needs root")
    monkeypatch.setattr(tribox.geometry.native.compiler, "_caches", lambda: (directory,))
    tribox.forms.native.library.cache_clear()
    try:
        with pytest.raises(KernelError, match="belongs to somebody else"):
            tribox.forms.native.library("plane_contact.c")
        os.chown(directory, 0, -1)
        tribox.forms.native.library.cache_clear()
        assert tribox.forms.native.library("plane_contact.c") is not None
    finally:
        tribox.forms.native.library.cache_clear()
