"""Stresses of Yeoh's and Ogden's bodies in homogeneous tests, against principal stresses by hand.

With G = Σ μα/2, and λ̄ = J^(−1/3) λ,
Kirchhoff's principal stresses are τ_a = Σ μ_p (λ̄_a^α_p − mean) + K/2 (J² − 1) of Ogden, and
τ_a = 2 W′(Ī1) (λ̄_a² − Ī1/3) + K/2 (J² − 1) of Yeoh.
"""

import dolfinx
import numpy as np
import pytest

from tests.forms.bodies.element_matrices import cells_of, summed
from tests.grid import grid
from tribox.forms.bodies.materials import Ogden, Yeoh
from tribox.forms.bodies.point_stress import PointStress
from tribox.forms.bodies.solid import DEGREE, Solid

K = 400.0
YEOH = Yeoh(0.6, -0.03, 0.004, K)
TRELOAR = Ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0), K)
MATERIALS = {"yeoh": YEOH, "ogden": TRELOAR}
SECTIONS = {"plane-strain": "quadrilateral", "axisymmetric": "quadrilateral", "3D": "hexahedron"}


def kirchhoff(material, stretches):
    """Principal Kirchhoff stresses (3,)."""
    stretches = np.asarray(stretches, dtype=float)
    J = stretches.prod()
    bar = stretches / np.cbrt(J)
    if isinstance(material, Yeoh):
        x = np.sum(bar**2) - 3.0
        slope = material.C10 + 2.0 * material.C20 * x + 3.0 * material.C30 * x**2
        shear = 2.0 * slope * (bar**2 - np.mean(bar**2))
    else:
        pairs = zip(material.mu, material.alpha, strict=True)
        shear = sum(mu * (bar**a - np.mean(bar**a)) for mu, a in pairs)
    return shear + 0.5 * material.bulk_modulus * (J**2 - 1.0)


class Cell:
    """One cell: the unit square or cube."""

    def __init__(self, material, section, formulation="q1"):
        cell = SECTIONS[section]
        self.dim = 3 if section == "3D" else 2
        mesh = grid(cell, (1,) * self.dim)
        space = ("Lagrange", DEGREE[formulation], (self.dim,))
        self.u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, space))
        cells = np.zeros(1, np.int32)
        solid = Solid("cell", self.u, cells, material, formulation, section=section)
        self.cells = cells_of(self.u, solid)
        self.where = self.u.function_space.tabulate_dof_coordinates()[:, : self.dim]

    def deform(self, F):
        self.u.x.array[:] = (self.where @ (np.asarray(F) - np.eye(self.dim)).T).reshape(-1)


TESTS = {
    "uniaxial": lambda s: (s, s**-0.5, s**-0.5),
    "equibiaxial": lambda s: (s, s, s**-2.0),
    "pure shear": lambda s: (s, 1.0 / s, 1.0),
    "compressed": lambda s: (s, 0.97, 0.98),
}


@pytest.mark.parametrize("section", SECTIONS)
@pytest.mark.parametrize("name", MATERIALS)
def test_points(section, name):
    """All three principal stresses, the hoop's and that across the plane too."""
    material = MATERIALS[name]
    stretches = np.array([TESTS[test](s) for test in TESTS for s in (0.6, 1.0, 2.5)])
    if section == "plane-strain":
        stretches[:, 2] = 1.0
    F = np.stack([np.diag(row) for row in stretches])
    found = PointStress(material, section).cauchy(F)
    expected = np.stack([np.diag(kirchhoff(material, row) / row.prod()) for row in stretches])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize(
    ("section", "formulation"),
    [("plane-strain", "q1-sri"), ("axisymmetric", "q1-sri"), ("3D", "q1-sri")],
)
def test_tangent_is_the_derivative_of_the_forces(section, formulation, name):
    """In a bent cell, where stretches differ by point, and undeformed; and these of the energy."""
    cell = Cell(MATERIALS[name], section, formulation)
    rng, h = np.random.default_rng(3), 1e-6
    for size in (0.0, 0.2):
        at = size * rng.uniform(-1.0, 1.0, len(cell.u.x.array))
        direction = rng.uniform(-1.0, 1.0, len(at))
        ends = []
        for step in (h, -h):
            cell.u.x.array[:] = at + step * direction
            forces = np.zeros_like(at)
            assert cell.cells.add(cell.u.x.array, forces)
            ends.append((forces, cell.cells.energy(cell.u.x.array)))
        (right, more), (left, less) = ends
        cell.u.x.array[:] = at
        tangent, forces = summed(cell.u, cell.cells.loops), np.zeros_like(at)
        assert cell.cells.add(at, forces)
        expected, found = (right - left) / (2.0 * h), tangent @ direction
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())
        np.testing.assert_allclose(tangent, tangent.T, rtol=0, atol=1e-12 * np.abs(tangent).max())
        assert forces @ direction == pytest.approx((more - less) / (2.0 * h), rel=1e-7, abs=1e-7)
