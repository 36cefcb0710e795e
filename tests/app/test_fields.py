"""Stress output against linear elasticity at small strain and closed forms at large strain."""

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from app.fields import StressField
from forms.materials import Hencky, MooneyRivlin, NeoHookean, shear_and_bulk
from forms.solids import Solid

E, NU = 3.0e6, 0.4


def stretched(gradient: np.ndarray, material: object) -> StressField:
    """Stress of a square under the displacement gradient (2, 2)."""
    mesh = dolfinx.mesh.create_unit_square(MPI.COMM_SELF, 2, 2, dolfinx.mesh.CellType.quadrilateral)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,))))
    u.interpolate(lambda x: gradient @ x[:2])
    cells = np.arange(4, dtype=np.int32)
    field = StressField(u, [Solid("body", u, cells, material, "q1-sri")])  # type: ignore[arg-type]
    field.update()
    return field


@pytest.mark.parametrize(
    "material",
    [
        NeoHookean(*shear_and_bulk(E, NU)),
        Hencky(*shear_and_bulk(E, NU)),
        MooneyRivlin(
            0.3 * shear_and_bulk(E, NU)[0], 0.2 * shear_and_bulk(E, NU)[0], shear_and_bulk(E, NU)[1]
        ),
    ],
    ids=lambda m: type(m).__name__,
)
def test_small_strain_is_linear_elasticity_with_its_out_of_plane_stress(material: object) -> None:
    gradient = 1e-6 * np.array([[1.0, 0.4], [0.2, -0.7]])
    strain = np.zeros((3, 3))
    strain[:2, :2] = 0.5 * (gradient + gradient.T)
    shear, bulk = shear_and_bulk(E, NU)
    trace = np.trace(strain)
    expected = 2.0 * shear * (strain - trace / 3.0 * np.eye(3)) + bulk * trace * np.eye(3)
    field = stretched(gradient, material)
    sigma = field.stress.x.array.reshape(-1, 3, 3)
    assert np.allclose(sigma, expected, atol=1e-5 * np.abs(expected).max())
    assert sigma[0, 2, 2] == pytest.approx(NU * (sigma[0, 0, 0] + sigma[0, 1, 1]), rel=1e-4)
    deviator = expected - np.trace(expected) / 3.0 * np.eye(3)
    assert field.von_mises.x.array == pytest.approx(np.sqrt(1.5 * np.sum(deviator**2)), rel=1e-4)
    assert field.pressure.x.array == pytest.approx(-bulk * trace, rel=1e-4)


def test_hencky_stress_at_large_strain_is_linear_in_logarithmic_strain() -> None:
    shear, bulk = shear_and_bulk(E, NU)
    stretch = np.array([1.5, 0.8, 1.0])
    logs = np.log(stretch)
    kirchhoff = 2.0 * shear * (logs - logs.mean()) + bulk * logs.sum()
    field = stretched(np.diag(stretch[:2] - 1.0), Hencky(shear, bulk))
    sigma = field.stress.x.array.reshape(-1, 3, 3)[0]
    assert np.diag(sigma) == pytest.approx(kirchhoff / stretch.prod(), rel=1e-10)
    assert np.abs(sigma - np.diag(np.diag(sigma))).max() < 1e-6 * np.abs(kirchhoff).max()
