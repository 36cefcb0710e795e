"""The compiled loop over cells against the forms that DOLFINx generates, to round-off."""

import os

import dolfinx
import numpy as np
import pytest
import ufl

import tribox.forms.native
import tribox.geometry.native.compiler
from tests.grid import grid
from tribox.forms.bodies.compiled_cells import CompiledCells
from tribox.forms.bodies.internal_force import GeneratedForce, InternalForce
from tribox.forms.bodies.loads import FollowerPressure, reference_area
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
    mesh = grid(cell, cells, [1.0, 0.7])
    x = mesh.geometry.x
    x[:, :2] += distortion / max(cells) * np.random.default_rng(3).uniform(-1, 1, (len(x), 2))
    if section == "axisymmetric":
        x[:, 0] += 0.3
    element = ("Lagrange", DEGREE[formulation], (2,))
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, element))
    all_cells = np.arange(mesh.topology.index_map(2).size_local, dtype=np.int32)
    return u, Solid("body", u, all_cells, material, formulation, section=section)


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
    assert InternalForce(u, [solid]).energy(u.x.array) == pytest.approx(area * density, rel=1e-8)


def same_forces(u, solid, size):
    """Compare forces and energy of both ways."""
    stretched(u, size)
    fast, slow = InternalForce(u, [solid]), InternalForce(u, [solid], compiled=False)
    assert fast.compiled and isinstance(fast.parts[0], CompiledCells)
    assert not slow.compiled and isinstance(slow.parts[0], GeneratedForce)
    mine, theirs = np.ones_like(u.x.array), np.ones_like(u.x.array)
    assert fast.evaluate(u.x.array, mine) and slow.evaluate(u.x.array, theirs)
    largest = np.abs(theirs).max()
    # F = 1 + O(size): what rounds F is an error of the stress of 1e-16/size.
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=4e-16 / min(size, 0.1) * largest * 20)
    energy = slow.energy(u.x.array)
    assert energy > 0.0
    assert fast.energy(u.x.array) == pytest.approx(energy, rel=1e-13, abs=1e-14)


@pytest.mark.parametrize("name", MATERIALS)
def test_large_strains(name):
    """Beyond the series of the logarithmic strain, and J far from one."""
    u, solid = body("quadrilateral", MATERIALS[name], "q1", distortion=0.0)
    where = u.function_space.tabulate_dof_coordinates()[:, :2]
    for gradient in ([[2.0, 0.4], [0.1, 0.5]], [[-0.7, 0.0], [0.2, -0.5]]):
        u.x.array[:] = (where @ np.array(gradient).T).reshape(-1)
        mine, theirs = np.zeros_like(u.x.array), np.zeros_like(u.x.array)
        InternalForce(u, [solid]).evaluate(u.x.array, mine)
        InternalForce(u, [solid], compiled=False).evaluate(u.x.array, theirs)
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-13 * np.abs(theirs).max())
        assert InternalForce(u, [solid]).energy(u.x.array) == pytest.approx(solid.strain_energy())


def test_no_force_at_rest_and_a_left_handed_numbering():
    """Cells whose nodes run clockwise count as positive area, as DOLFINx counts them."""
    u, solid = body("triangle", MATERIALS["neo-hookean"], "q1")
    x = u.function_space.tabulate_dof_coordinates()[:, :2]
    corners = x[np.asarray(u.function_space.dofmap.list)]
    turned = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0.0
    assert turned.any() and not turned.all()
    force = np.ones_like(u.x.array)
    u.x.array[:] = 0.0
    internal = InternalForce(u, [solid])
    internal.evaluate(u.x.array, force)
    assert np.abs(force).max() < 1e-15
    stretched(u, 0.1)
    assert internal.energy(u.x.array) == pytest.approx(solid.strain_energy(), rel=1e-13)


@pytest.mark.parametrize("formulation", ["q1", "q1-sri"])
def test_an_inverted_cell_is_told(formulation):
    u, solid = body("quadrilateral", MATERIALS["neo-hookean"], formulation, distortion=0.0)
    internal, force = InternalForce(u, [solid]), np.zeros_like(u.x.array)
    assert internal.evaluate(u.x.array, force)
    x = u.function_space.tabulate_dof_coordinates()[:, :2]
    corner = int(np.argmax(x.sum(axis=1)))
    u.x.array[2 * corner : 2 * corner + 2] = -0.8 * np.array([0.2, 0.7 / 3.0])
    assert not internal.evaluate(u.x.array, force)
    assert internal.energy(u.x.array) == np.inf
    u.x.array[2 * corner] = np.nan
    assert not internal.evaluate(u.x.array, force)


def test_without_a_compiler_there_is_an_error(monkeypatch, tmp_path):
    """And no run that is silently slower. The cache is empty, and nothing is on the path."""
    monkeypatch.setattr(tribox.geometry.native.compiler, "_caches", lambda: (tmp_path / "none",))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    tribox.forms.native.library.cache_clear()
    try:
        u, solid = body("quadrilateral", MATERIALS["hencky"], "q1-sri")
        with pytest.raises(KernelError, match=r"plane_kernel.c .*no C compiler on the PATH"):
            InternalForce(u, [solid])
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


# -- Follower pressure: force, work and tangent, on surfaces that turn and stretch -----------------

P = 0.7


@pytest.fixture(scope="module", params=["quadrilateral", "triangle"])
def block(request):
    """A rectangle of 2 by 1."""
    mesh = grid(request.param, (4, 3), [2.0, 1.0])
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    return dolfinx.fem.Function(space)


def facets(u, where=lambda X: np.full(X.shape[1], True)):
    return dolfinx.mesh.locate_entities_boundary(u.function_space.mesh, 1, where)


def right(X):
    return np.isclose(X[0], 2.0)


def pressed(u, surface):
    load = FollowerPressure(u, surface)
    load.set(P)
    return load


def move(u, motion):
    u.interpolate(lambda X: motion(X[:2].T).T)


def wavy(X):
    return 0.2 * np.sin(2.0 * X[:, ::-1] + X) + X @ [[0.2, 0.5], [-0.4, 0.1]]


def residual(load):
    return dolfinx.fem.assemble_vector(load.residual).array.reshape(-1, 2)


def positions(u):
    return u.function_space.tabulate_dof_coordinates()[:, :2] + u.x.array.reshape(-1, 2)


def test_force_on_a_turned_and_stretched_side(block):
    """p times the current length, against the current normal; the residual is minus the force."""
    F = np.array([[0.6, -1.1], [0.9, 0.8]])
    move(block, lambda X: X @ (F - np.eye(2)).T)
    load = pressed(block, facets(block, right))
    side = F @ [0.0, 1.0]
    outward = np.array([side[1], -side[0]])  # the side runs upwards, the body is on its left
    np.testing.assert_allclose(residual(load).sum(axis=0), P * outward, rtol=1e-12)
    # Spread evenly along the side: half as much on each end node as on the others.
    forces = np.linalg.norm(residual(load), axis=1)
    loaded = np.sort(forces[forces > 1e-12])
    np.testing.assert_allclose(loaded, P * np.linalg.norm(side) * np.array([1, 1, 2, 2]) / 6)


def test_pressure_all_round_has_no_resultant_and_no_moment(block):
    move(block, wavy)
    forces = residual(pressed(block, facets(block)))
    now = positions(block)
    assert np.abs(forces).max() > 0.1
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-13)
    moment = now[:, 0] @ forces[:, 1] - now[:, 1] @ forces[:, 0]
    assert moment == pytest.approx(0.0, abs=1e-13)


def test_work_conjugate_of_pressure_all_round_is_the_area(block):
    """δW = −p δA: the residual is p times the derivative of the enclosed area."""
    move(block, wavy)
    forces = residual(pressed(block, facets(block)))
    at = block.function_space.tabulate_dof_coordinates()[:, :2]
    table = {(round(2 * x), round(3 * y)): n for n, (x, y) in enumerate(at)}
    # Round the rectangle against the clock.
    ring = [table[i, 0] for i in range(4)] + [table[4, j] for j in range(3)]
    ring += [table[4 - i, 3] for i in range(4)] + [table[0, 3 - j] for j in range(3)]

    def area(now):
        x, y = now[ring].T
        return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))

    now, h = positions(block), 1e-5
    assert area(at) == pytest.approx(2.0)
    for n in ring:
        for i in range(2):
            step = np.zeros_like(now)
            step[n, i] = h
            slope = (area(now + step) - area(now - step)) / (2.0 * h)
            assert forces[n, i] == pytest.approx(P * slope, abs=1e-9)


def test_tangent_against_finite_differences(block):
    move(block, wavy)
    load = pressed(block, facets(block, right))
    A = dolfinx.fem.assemble_matrix(load.tangent).to_dense()
    assert np.abs(A).max() > 0.1
    x, rng, h = block.x.array.copy(), np.random.default_rng(1), 1e-5
    for _ in range(3):
        d = rng.normal(size=len(x))
        block.x.array[:] = x + h * d
        after = residual(load)
        block.x.array[:] = x - h * d
        before = residual(load)
        block.x.array[:] = x
        np.testing.assert_allclose(
            A @ d, ((after - before) / (2.0 * h)).reshape(-1), rtol=0, atol=1e-9
        )


def test_reference_area(block):
    mesh = block.function_space.mesh
    assert reference_area(mesh, facets(block)) == pytest.approx(6.0, rel=1e-13)
    assert reference_area(mesh, facets(block, right)) == pytest.approx(1.0, rel=1e-13)
