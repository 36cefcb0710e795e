"""Stored energies in the plane and in space against closed formulas; where stretches coincide."""

import dolfinx
import numpy as np
import pytest

from tests.forms.bodies.element_matrices import cells_of, summed
from tests.grid import grid
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Linear
from tribox.forms.bodies.materials import (
    Hencky,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
    contact_shear_modulus,
    oedometric_modulus,
    shear_and_bulk,
)
from tribox.forms.bodies.point_stress import DISTORTION, VOLUME, energy_at_points
from tribox.forms.bodies.solid import Solid

G, K = 1.3, 4.0
MATERIALS = {
    "neo-hookean": NeoHookean(G, K),
    "mooney-rivlin": MooneyRivlin(0.5, 0.15, K),
    "yeoh": Yeoh(0.65, -0.05, 0.02, K),
    "ogden": Ogden((0.9, -0.4), (1.3, -2.0), K),
    "hencky": Hencky(G, K),
}


def formula(name, F):
    """Energy density of a deformation gradient, in the plane (2, 2) or in space (3, 3)."""
    F = whole(F)
    C, J = F.T @ F, np.linalg.det(F)
    if name == "neo-hookean":
        log = np.log(J)
        return 0.5 * G * (np.trace(C) - 3.0) - G * log + 0.5 * (K - 2.0 / 3.0 * G) * log**2
    if name == "hencky":
        strain = 0.5 * np.log(np.linalg.eigvalsh(C))
        return G * np.sum((strain - strain.mean()) ** 2) + 0.5 * K * strain.sum() ** 2
    isochoric = C / J ** (2.0 / 3.0)
    first = np.trace(isochoric)
    volumetric = 0.25 * K * (J**2 - 1.0 - 2.0 * np.log(J))
    if name == "yeoh":
        return np.polyval([0.02, -0.05, 0.65, 0.0], first - 3.0) + volumetric
    if name == "ogden":
        stretches = np.sqrt(np.linalg.eigvalsh(isochoric))
        terms = zip(MATERIALS[name].mu, MATERIALS[name].alpha, strict=True)
        return sum(m / a * (np.sum(stretches**a) - 3.0) for m, a in terms) + volumetric
    second = 0.5 * (first**2 - np.trace(isochoric @ isochoric))
    return 0.5 * (first - 3.0) + 0.15 * (second - 3.0) + volumetric


def whole(F):
    """A deformation gradient in space, the third direction of a plane one as it was."""
    out = np.eye(3)
    out[: len(F), : len(F)] = F
    return out


class Cell:
    """A unit square or cube of one cell under homogeneous deformation."""

    def __init__(self, name, dim):
        mesh = grid({2: "quadrilateral", 3: "hexahedron"}[dim], (1,) * dim)
        self.u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,))))
        self.where = self.u.function_space.tabulate_dof_coordinates()[:, :dim]
        solid = Solid("cell", self.u, np.zeros(1, np.int32), MATERIALS[name], "q1-sri")
        self.cells = cells_of(self.u, solid)

    def deform(self, F):
        self.u.x.array[:] = (self.where @ (np.asarray(F) - np.eye(len(F))).T).reshape(-1)

    def energy(self, F):
        self.deform(F)
        return self.cells.energy(self.u.x.array)

    def stress(self, F):
        """First Piola–Kirchhoff stress from the nodal forces: ∫ P dV = Σ f ⊗ X."""
        self.deform(F)
        forces = np.zeros_like(self.u.x.array)
        assert self.cells.add(self.u.x.array, forces)
        return forces.reshape(self.where.shape).T @ self.where

    def tangent(self, F):
        self.deform(F)
        return summed(self.u, self.cells.loops)


def gradients(dim, size, count=10):
    found = np.eye(dim) + size * np.random.default_rng(6).normal(size=(4 * count, dim, dim))
    return [F for F in found if np.linalg.det(F) > 0.3][:count]


@pytest.fixture(scope="module", params=MATERIALS)
def name(request):
    return request.param


@pytest.fixture(scope="module", params=[2, 3], ids=["plane", "space"])
def cell(request, name):
    return Cell(name, request.param)


def test_energy_is_the_formula(name, cell):
    plane = len(cell.where) == 4
    for F in gradients(2, 0.3, 20) if plane else gradients(3, 0.07):
        assert cell.energy(F) == pytest.approx(formula(name, F), rel=1e-11, abs=1e-13)
    rough = 1e-3 if name == "hencky" else 1e-11  # a series that converges slowly out there
    for F in [] if plane else gradients(3, 0.25):
        assert cell.energy(F) == pytest.approx(formula(name, F), rel=rough)


def test_equal_stretches_are_nothing_special(name, cell):
    """Two or three stretches that coincide: finite tangents, and the moduli of small strain."""
    dim, material, h = cell.where.shape[1], MATERIALS[name], 1e-4
    for stretches in ([1.0] * 3, [1.2] * 3, [1.3, 1.3, 0.8], [0.9, 1.1, 1.1]):
        A = cell.tangent(np.diag(stretches[:dim]))
        assert np.isfinite(A).all() and np.abs(A).max() > 0.1
    oedometric = material.bulk_modulus + 4.0 / 3.0 * material.shear_modulus
    assert oedometric_modulus(material) == pytest.approx(oedometric, rel=1e-15)
    shear = np.eye(dim, k=1) * (np.arange(dim) == 0)[:, None]
    x, y = (np.diag(np.eye(dim)[k]) for k in (0, 1))
    even = [(np.eye(3), 9.0 * K)] if dim == 3 else []
    for e, modulus in ((shear, material.shear_modulus), (x, oedometric), (y, oedometric), *even):
        slope = cell.stress(np.eye(dim) + h * e) - cell.stress(np.eye(dim) - h * e)
        assert np.sum(slope * e) / (2.0 * h) == pytest.approx(modulus, rel=1e-6)


@pytest.mark.parametrize("space", [False, True])
def test_volumetric_part_sees_the_volume_only(name, space):
    """What selective reduced integration takes at the centre depends on J alone."""
    F = np.stack([whole(F) for F in ([[1.2, 0.0], [0.0, 0.9]], [[1.5, 0.4], [0.3, 0.8]])])
    rows = F.reshape(2, 9)[:, slice(None) if space else [0, 1, 3, 4, 8]]  # of the volume 1.08
    one, other = (
        energy_at_points(MATERIALS[name], part, space)(rows, False)[0]
        for part in (DISTORTION, VOLUME)
    )
    assert other[0] == pytest.approx(other[1], rel=1e-12) and other[0] > 0.0
    assert abs(one[0] - one[1]) > 1e-2


@pytest.mark.parametrize(("mu", "alpha"), [((), ()), ((1.0,), (1.0, 2.0)), ((1.0,), (0.0,))])
def test_ogden_needs_pairs(mu, alpha):
    with pytest.raises(ValueError, match="alpha"):
        Ogden(mu, alpha, 1.0)


def test_hencky_is_smooth_where_its_series_ends():
    """The branch changes at (h₁ − h₂) = arcosh(1.02): both sides match the logarithms exactly."""
    cell = Cell("hencky", 2)
    difference, (c, s) = np.arccosh(1.02), (np.cos(0.4), np.sin(0.4))
    stresses = []
    for factor in (0.9, 1.0 - 1e-9, 1.0 + 1e-9, 1.1):
        h = 0.5 * factor * difference
        F = np.array([[c, -s], [s, c]]) @ np.diag([np.exp(0.05 + h), np.exp(0.05 - h)])
        assert cell.energy(F) == pytest.approx(formula("hencky", F), rel=1e-13)
        stresses.append(cell.stress(F))
    np.testing.assert_allclose(stresses[1], stresses[2], rtol=0, atol=1e-8)
    # Kirchhoff stress of the logarithmic strain: tau_i = 2 G dev h_i + K tr h, on both sides.
    for factor in (0.99, 1.01):
        h = np.array([0.05 + 0.5 * factor * difference, 0.05 - 0.5 * factor * difference, 0.0])
        tau = 2.0 * G * (h - h.mean()) + K * h.sum()
        P = cell.stress(np.diag(np.exp(h[:2])))
        np.testing.assert_allclose(np.diag(P), tau[:2] / np.exp(h[:2]), rtol=1e-12)


def test_accuracy_of_the_logarithm_in_space():
    """As its docstring says, over simple and equibiaxial isochoric stretches."""
    cube = Cell("hencky", 3)
    for largest, error in ((1.3, 1e-12), (1.5, 2e-9), (2.0, 1e-5)):
        for a in (largest, 1.0 / largest):
            for F in (np.diag([a, 1.0, 1.0 / a]), np.diag([a, a**-0.5, a**-0.5])):
                assert cube.energy(F) == pytest.approx(formula("hencky", F), rel=error)
    assert cube.energy(np.diag([2.0, 1.0, 0.5])) < formula("hencky", np.diag([2.0, 1.0, 0.5]))


def test_moduli_from_young_and_poisson():
    shear, bulk = shear_and_bulk(210.0, 0.3)
    assert pytest.approx(9.0 * bulk * shear / (3.0 * bulk + shear)) == 210.0
    assert (3.0 * bulk - 2.0 * shear) / (2.0 * (3.0 * bulk + shear)) == pytest.approx(0.3)


def test_a_metal_has_its_hardness():
    """3 (σ₀ + 0.2 H), whatever its elastic constants; one that does not yield has G."""
    law = Linear(30e6, 200e6)
    for shear in (26e9, 80e9):
        found = contact_shear_modulus(ElastoPlastic(shear, 68e9, law))
        assert found == pytest.approx(3.0 * (30e6 + 40e6))
    assert contact_shear_modulus(ElastoPlastic(26e9, 68e9, Linear(20e9))) == 26e9
