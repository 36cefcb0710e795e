"""Stored energies against closed formulas, moduli, objectivity, and the branches of Hencky's."""

import dolfinx
import numpy as np
import pytest
import ufl
from petsc4py import PETSc

from tests.grid import grid
from tribox.forms.bodies.kinematics import plane_strain
from tribox.forms.bodies.materials import (
    Hencky,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
    oedometric_modulus,
    shear_and_bulk,
)
from tribox.forms.bodies.solid import compile_energy

MATERIALS = {
    "neo-hookean": NeoHookean(shear_modulus=1.3, bulk_modulus=4.0),
    "mooney-rivlin": MooneyRivlin(C10=0.5, C01=0.15, bulk_modulus=4.0),
    "yeoh": Yeoh(C10=0.65, C20=-0.05, C30=0.02, bulk_modulus=4.0),
    "ogden": Ogden(mu=(0.9, 0.02, -0.4), alpha=(1.3, 5.0, -2.5), bulk_modulus=4.0),
    "hencky": Hencky(shear_modulus=1.3, bulk_modulus=4.0),
}


def neo_hookean(C, J):
    shear, bulk = 1.3, 4.0
    return (
        0.5 * shear * (np.trace(C) - 3.0)
        - shear * np.log(J)
        + 0.5 * (bulk - 2.0 / 3.0 * shear) * np.log(J) ** 2
    )


def mooney_rivlin(C, J):
    isochoric = C / J ** (2.0 / 3.0)
    first = np.trace(isochoric)
    second = 0.5 * (first**2 - np.trace(isochoric @ isochoric))
    return 0.5 * (first - 3.0) + 0.15 * (second - 3.0) + volumetric(J)


def volumetric(J):
    return 0.25 * 4.0 * (J**2 - 1.0 - 2.0 * np.log(J))


def yeoh(C, J):
    x = np.trace(C) / J ** (2.0 / 3.0) - 3.0
    return 0.65 * x - 0.05 * x**2 + 0.02 * x**3 + volumetric(J)


def ogden(C, J):
    stretches = np.sqrt(np.linalg.eigvalsh(C)) / J ** (1.0 / 3.0)
    terms = zip((0.9, 0.02, -0.4), (1.3, 5.0, -2.5), strict=True)
    return sum(m / a * (np.sum(stretches**a) - 3.0) for m, a in terms) + volumetric(J)


def hencky(C, J):
    strain = 0.5 * np.log(np.linalg.eigvalsh(C))
    deviator = strain - strain.mean()
    return 1.3 * deviator @ deviator + 0.5 * 4.0 * strain.sum() ** 2


FORMULAS = {
    "neo-hookean": neo_hookean, "mooney-rivlin": mooney_rivlin, "yeoh": yeoh, "ogden": ogden,
    "hencky": hencky,
}  # fmt: skip


class Cell:
    """One unit square of a material under homogeneous deformation."""

    def __init__(self, material):
        mesh = grid("quadrilateral", (1, 1))
        space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,)))
        self.u = dolfinx.fem.Function(space)
        self.where = space.tabulate_dof_coordinates()[:, :2]
        constants = {
            name: dolfinx.fem.Constant(mesh, PETSc.ScalarType(value))
            for name, value in material.parameters().items()
        }
        parts = material.energy(plane_strain(self.u), constants)
        dx = ufl.dx(domain=mesh, metadata={"quadrature_degree": 2})
        self.forms = [compile_energy(part, dx, self.u) for part in parts]

    def deform(self, F):
        self.u.x.array[:] = (self.where @ (np.asarray(F) - np.eye(2)).T).reshape(-1)

    def energies(self, F):
        self.deform(F)
        return [dolfinx.fem.assemble_scalar(form.energy) for form in self.forms]

    def energy(self, F):
        return sum(self.energies(F))

    def stress(self, F):
        """First Piola–Kirchhoff stress, from the nodal forces: ∫ P dA = Σ f ⊗ X."""
        self.deform(F)
        forces = sum(dolfinx.fem.assemble_vector(form.residual).array for form in self.forms)
        return forces.reshape(-1, 2).T @ self.where


@pytest.fixture(scope="module", params=MATERIALS)
def case(request):
    material = MATERIALS[request.param]
    return material, FORMULAS[request.param], Cell(material)


def some_gradients(count=20, size=0.3):
    rng = np.random.default_rng(6)
    gradients = np.eye(2) + size * rng.normal(size=(4 * count, 2, 2))
    found = [F for F in gradients if np.linalg.det(F) > 0.3][:count]
    assert len(found) == count
    return found


def cauchy_green(F):
    """Three-dimensional C of a plane-strain deformation, and J."""
    C = np.eye(3)
    C[:2, :2] = F.T @ F
    return C, np.linalg.det(F)


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def test_energy_is_the_formula(case):
    _, formula, cell = case
    for F in some_gradients():
        assert cell.energy(F) == pytest.approx(formula(*cauchy_green(F)), rel=1e-11, abs=1e-13)


def test_stress_is_the_derivative_of_the_formula(case):
    _, formula, cell = case
    h = 1e-5
    for F in some_gradients(6):
        P = np.empty((2, 2))
        for i in range(2):
            for j in range(2):
                dF = np.zeros((2, 2))
                dF[i, j] = h
                P[i, j] = (formula(*cauchy_green(F + dF)) - formula(*cauchy_green(F - dF))) / (
                    2.0 * h
                )
        np.testing.assert_allclose(cell.stress(F), P, rtol=0, atol=2e-8 * np.abs(P).max())


def test_small_strain_moduli(case):
    """Second derivatives at F = I: G in simple shear, K + 4G/3 in oedometric compression."""
    material, _, cell = case
    h = 1e-4

    def modulus(e):
        strain = h * np.asarray(e)
        slope = cell.stress(np.eye(2) + strain) - cell.stress(np.eye(2) - strain)
        return np.sum(slope * e) / (2.0 * h)

    assert modulus([[0.0, 1.0], [0.0, 0.0]]) == pytest.approx(material.shear_modulus, rel=1e-6)
    oedometric = material.bulk_modulus + 4.0 / 3.0 * material.shear_modulus
    assert modulus([[1.0, 0.0], [0.0, 0.0]]) == pytest.approx(oedometric, rel=1e-6)
    assert modulus([[0.0, 0.0], [0.0, 1.0]]) == pytest.approx(oedometric, rel=1e-6)
    assert oedometric_modulus(material) == pytest.approx(oedometric, rel=1e-15)


def test_volumetric_part_sees_the_volume_only(case):
    """What selective reduced integration takes at the centre depends on J alone."""
    _, _, cell = case
    one = cell.energies([[1.2, 0.0], [0.0, 0.9]])
    other = cell.energies([[1.5, 0.4], [0.3, 0.8]])  # the same determinant, 1.08
    assert one[1] == pytest.approx(other[1], rel=1e-12) and one[1] > 0.0
    assert abs(one[0] - other[0]) > 1e-2


@pytest.mark.parametrize(("mu", "alpha"), [((), ()), ((1.0,), (1.0, 2.0)), ((1.0,), (0.0,))])
def test_ogden_needs_pairs(mu, alpha):
    with pytest.raises(ValueError, match="alpha"):
        Ogden(mu, alpha, 1.0)


def test_hencky_is_smooth_where_its_series_ends():
    """The branch changes at (h₁ − h₂) = arcosh(1.02): both sides match the logarithms exactly."""
    cell = Cell(MATERIALS["hencky"])
    difference = np.arccosh(1.02)
    turn = rotation(0.4)
    stresses = []
    for factor in (0.9, 1.0 - 1e-9, 1.0 + 1e-9, 1.1):
        h = 0.5 * factor * difference
        F = turn @ np.diag([np.exp(0.05 + h), np.exp(0.05 - h)])
        assert cell.energy(F) == pytest.approx(hencky(*cauchy_green(F)), rel=1e-13)
        stresses.append(cell.stress(F))
    np.testing.assert_allclose(stresses[1], stresses[2], rtol=0, atol=1e-8)
    # Kirchhoff stress of the logarithmic strain: tau_i = 2 G dev h_i + K tr h, on both sides.
    for factor in (0.99, 1.01):
        h = np.array([0.05 + 0.5 * factor * difference, 0.05 - 0.5 * factor * difference, 0.0])
        tau = 2.0 * 1.3 * (h - h.mean()) + 4.0 * h.sum()
        P = cell.stress(np.diag(np.exp(h[:2])))
        np.testing.assert_allclose(np.diag(P), tau[:2] / np.exp(h[:2]), rtol=1e-12)


def test_moduli_from_young_and_poisson():
    G, K = shear_and_bulk(210.0, 0.3)
    assert pytest.approx(9.0 * K * G / (3.0 * K + G)) == 210.0
    assert (3.0 * K - 2.0 * G) / (2.0 * (3.0 * K + G)) == pytest.approx(0.3)
