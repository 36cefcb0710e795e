"""Stored energies in space against closed formulas, and their smoothness at equal stretches."""

import dolfinx
import numpy as np
import pytest

from tests.grid import grid
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean, Ogden, Yeoh
from tribox.forms.bodies.solid import Solid

G, K = 1.3, 4.0
MATERIALS = {
    "neo-hookean": NeoHookean(G, K),
    "mooney-rivlin": MooneyRivlin(0.5, 0.15, K),
    "yeoh": Yeoh(0.65, -0.05, 0.02, K),
    "ogden": Ogden((0.9, 0.02, -0.53), (1.3, 5.0, -2.5), K),
    "hencky": Hencky(G, K),
}


def formula(name, F):
    """Energy density of a deformation gradient (3, 3)."""
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


class Cube:
    """A unit cube of one hexahedron under homogeneous deformation."""

    def __init__(self, name):
        mesh = grid("hexahedron", (1, 1, 1))
        self.u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (3,))))
        self.solid = Solid("cube", self.u, np.zeros(1, np.int32), MATERIALS[name], "q1")

    def deform(self, F):
        where = self.u.function_space.tabulate_dof_coordinates()
        self.u.x.array[:] = (where @ (np.asarray(F) - np.eye(3)).T).reshape(-1)

    def energy(self, F):
        self.deform(F)
        return self.solid.strain_energy()

    def stress(self, F):
        """First Piola–Kirchhoff stress from the nodal forces: ∫ P dV = Σ f ⊗ X."""
        self.deform(F)
        [part] = self.solid.forms
        forces = dolfinx.fem.assemble_vector(part.residual).array.reshape(-1, 3)
        return forces.T @ self.u.function_space.tabulate_dof_coordinates()

    def tangent(self, F):
        self.deform(F)
        return dolfinx.fem.assemble_matrix(self.solid.forms[0].tangent).to_dense()


def gradients(size, count=10):
    rng = np.random.default_rng(6)
    found = [np.eye(3) + size * rng.normal(size=(3, 3)) for _ in range(4 * count)]
    return [F for F in found if np.linalg.det(F) > 0.3][:count]


@pytest.fixture(scope="module", params=MATERIALS)
def case(request):
    return request.param, Cube(request.param)


def test_energy_is_the_formula(case):
    name, cube = case
    for F in gradients(0.07):
        assert cube.energy(F) == pytest.approx(formula(name, F), rel=1e-11, abs=1e-13)
    rough = 1e-3 if name == "hencky" else 1e-11  # a series that converges slowly out there
    for F in gradients(0.25):
        assert cube.energy(F) == pytest.approx(formula(name, F), rel=rough)


def test_stress_is_the_derivative_of_the_formula(case):
    name, cube = case
    h = 1e-5
    for F in gradients(0.07, 3):
        P = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                dF = np.zeros((3, 3))
                dF[i, j] = h
                P[i, j] = (formula(name, F + dF) - formula(name, F - dF)) / (2.0 * h)
        np.testing.assert_allclose(cube.stress(F), P, rtol=0, atol=2e-8 * np.abs(P).max())


def test_equal_stretches_are_nothing_special(case):
    """Two or three stretches that coincide: finite tangents, and the moduli of small strain."""
    name, cube = case
    shear = MATERIALS[name].shear_modulus
    for F in (np.eye(3), 1.2 * np.eye(3), np.diag([1.3, 1.3, 0.8]), np.diag([0.9, 1.1, 1.1])):
        A = cube.tangent(F)
        assert np.isfinite(A).all() and np.abs(A).max() > 0.1
    h = 1e-4
    for e, modulus in (
        ([[0, 1, 0], [0, 0, 0], [0, 0, 0]], shear),
        ([[1, 0, 0], [0, 0, 0], [0, 0, 0]], K + 4.0 / 3.0 * shear),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], 9.0 * K),
    ):
        strain = h * np.asarray(e, dtype=float)
        slope = cube.stress(np.eye(3) + strain) - cube.stress(np.eye(3) - strain)
        assert np.sum(slope * e) / (2.0 * h) == pytest.approx(modulus, rel=1e-6)


def test_accuracy_of_the_logarithm_in_space():
    """As its docstring says, over simple and equibiaxial isochoric stretches."""
    cube = Cube("hencky")
    for largest, error in ((1.3, 1e-12), (1.5, 2e-9), (2.0, 1e-5)):
        for stretch in (largest, 1.0 / largest):
            for F in (
                np.diag([stretch, 1.0, 1.0 / stretch]),
                np.diag([stretch, stretch**-0.5, stretch**-0.5]),
            ):
                assert cube.energy(F) == pytest.approx(formula("hencky", F), rel=error)
    assert cube.energy(np.diag([2.0, 1.0, 0.5])) < formula("hencky", np.diag([2.0, 1.0, 0.5]))
