"""Stress at points in numpy against the compiled one, in cells that are distorted and bent."""

import dolfinx
import numpy as np
import pytest
import ufl
from scipy import special
from ufl.algorithms import expand_derivatives
from ufl.corealg.map_dag import map_expr_dag

from tests.forms.bodies.in_forms import (
    PlanePart,
    WithoutVariables,
    centre_kinematics,
    in_ufl,
    kinematics,
    plane_kinematics,
    stretch_across,
)
from tests.forms.bodies.test_elastomer_stress import kirchhoff
from tests.grid import grid
from tribox.app.results.probes import BodyPoints
from tribox.forms.bodies.deformation import centre_rows, rows_at, volume_ratios
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean, Ogden, Yeoh
from tribox.forms.bodies.own_energy import free_variables, values_of
from tribox.forms.bodies.point_stress import PointStress, mean_pressure, von_mises
from tribox.forms.bodies.solid import Solid
from tribox.geometry.meshes.places import centre

MATERIALS = [
    NeoHookean(1.0, 4.0), MooneyRivlin(0.4, 0.15, 4.0), Yeoh(0.5, -0.05, 0.02, 4.0),
    Hencky(1.0, 4.0),
]  # fmt: skip
OGDEN = Ogden((0.9, -0.53), (1.3, -2.0), 4.0)
SECTIONS = {
    "plane-strain": ("quadrilateral", "q1-sri"),
    "axisymmetric": ("quadrilateral", "q1-sri"),
    "3D": ("hexahedron", "q1-sri"),
}


class Bent:
    """Distorted cells under a displacement without any order."""

    def __init__(self, section, cell=None, degree=1):
        kind = cell or SECTIONS[section][0]
        dim = 3 if section == "3D" else 2
        random = np.random.default_rng(1)
        mesh = grid(kind, (2,) * dim)
        x = mesh.geometry.x
        x[:, :dim] += 0.08 * random.uniform(-1.0, 1.0, (len(x), dim))
        x[:, 0] += 0.5
        self.section, self.mesh = section, mesh
        self.space = dolfinx.fem.functionspace(mesh, ("Lagrange", degree, (dim,)))
        self.u = dolfinx.fem.Function(self.space)
        self.u.x.array[:] = 0.05 * random.uniform(-1.0, 1.0, len(self.u.x.array))
        self.cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)

    @property
    def nodal(self):
        return self.u.x.array.reshape(-1, self.mesh.geometry.dim)[
            self.space.dofmap.list[self.cells]
        ]

    def compiled(self, expression, xi):
        found = dolfinx.fem.Expression(expression, xi).eval(self.mesh, self.cells)
        return np.asarray(found).reshape(len(self.cells), -1)


@pytest.fixture(scope="module", params=SECTIONS)
def bent(request):
    return Bent(request.param)


def cauchy(u, material, section):
    """Cauchy stress (3, 3) in UFL, of W(J, I1, I2) or, in a plane, of W(F, λ₃)."""
    mesh = u.function_space.mesh
    constants = {
        key: dolfinx.fem.Constant(mesh, value) for key, value in material.parameters().items()
    }
    material = in_ufl(material)
    if section == "3D":
        k = kinematics(u, section)
        energy, b = sum(material.energy(k, constants)), ufl.dot(k.F, k.F.T)
        by_j, by_1, by_2 = (ufl.diff(energy, i) for i in (k.J, k.I1, k.I2))
        parts = 2.0 * (by_1 + k.I1 * by_2) * b - 2.0 * by_2 * ufl.dot(b, b)
        return bare(by_j * ufl.Identity(3) + parts / k.J)
    across = stretch_across(u, section)
    if section == "plane-strain":
        across = dolfinx.fem.Constant(mesh, across)
    F, stretch = ufl.variable(ufl.Identity(2) + ufl.grad(u)), ufl.variable(across)
    k = plane_kinematics(F, PlanePart(stretch, ufl.det(F), ufl.inner(F, F)))
    energy = sum(material.energy(k, constants))
    flat, hoop = ufl.dot(ufl.diff(energy, F), F.T) / k.J, ufl.diff(energy, stretch) / k.plane.J
    rows = [[flat[i, 0], flat[i, 1], 0] for i in range(2)]
    return bare(ufl.as_tensor([*rows, [0, 0, hoop]]))


def bare(expression):
    return map_expr_dag(WithoutVariables(), expand_derivatives(expression))


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: type(m).__name__)
def test_stress_is_the_compiled_one(bent, material):
    xi = centre(bent.mesh.topology.cell_name())
    expected = bent.compiled(cauchy(bent.u, material, bent.section), xi).reshape(-1, 3, 3)
    F = rows_at(bent.space, bent.section, bent.cells, xi).deformation(bent.nodal)
    for own in (material, in_ufl(material)):
        found = PointStress(own, bent.section).cauchy(F)
        np.testing.assert_allclose(found, expected, atol=1e-13 * np.abs(expected).max())


def test_stress_in_principal_stretches(bent):
    F = rows_at(bent.space, bent.section, bent.cells, centre(bent.mesh.topology.cell_name()))
    F = F.deformation(bent.nodal)
    squares, axes = np.linalg.eigh(F @ F.transpose(0, 2, 1))
    tau = np.stack([kirchhoff(OGDEN, row) for row in np.sqrt(squares)])
    expected = np.einsum("pia,pa,pja->pij", axes, tau / np.linalg.det(F)[:, None], axes)
    found = PointStress(OGDEN, bent.section).cauchy(F)
    np.testing.assert_allclose(found, expected, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("section", "cell", "degree"), [("plane-strain", "triangle", 2), ("3D", "hexahedron", 1)]
)
def test_deformation_off_the_centre(section, cell, degree):
    bent = Bent(section, cell, degree)
    dim = bent.mesh.geometry.dim
    xi = np.array([[0.2, 0.3, 0.7][:dim]])
    expected = bent.compiled(ufl.grad(bent.u), xi).reshape(-1, dim, dim)
    rows = rows_at(bent.space, section, bent.cells, xi)
    found = rows.deformation(bent.nodal)[:, :dim, :dim] - np.eye(dim)
    np.testing.assert_allclose(found, expected, atol=1e-14)


def test_volume_of_reduced_integration():
    """That of the compiled kinematics; round an axis not quite that of the centre."""
    bent = Bent("axisymmetric")
    expected = bent.compiled(centre_kinematics(bent.u, "axisymmetric").J, np.array([[0.5, 0.5]]))
    centred = centre_rows(bent.space, "axisymmetric", bent.cells).deformation(bent.nodal)
    np.testing.assert_allclose(np.linalg.det(centred), expected[:, 0], rtol=1e-14)
    plain = rows_at(bent.space, "axisymmetric", bent.cells, np.array([[0.5, 0.5]]))
    assert np.abs(np.linalg.det(plain.deformation(bent.nodal)) - expected[:, 0]).max() > 1e-5


def test_the_volumetric_part_may_be_that_of_another_place():
    """Of a Hencky body it is the pressure: −K ln J/J there, whatever the point's own volume is."""
    F, other = np.diag([1.2, 0.9, 1.1])[None], np.diag([1.1, 1.0, 1.0])[None]
    stress = PointStress(Hencky(1.0, 4.0), "3D").cauchy(F, other)
    assert mean_pressure(stress) == pytest.approx(-4.0 * np.log(1.1) / 1.1)
    own = PointStress(Hencky(1.0, 4.0), "3D").cauchy(F)
    assert von_mises(stress) == pytest.approx(von_mises(own))
    assert mean_pressure(own) == pytest.approx(-4.0 * np.log(1.188) / 1.188)


@pytest.mark.parametrize("section", SECTIONS)
def test_quadrature_points_fill_the_body(section):
    """Volume, and the work of a linear displacement's stress, of bodies between round numbers."""
    mesh = grid(SECTIONS[section][0], (2, 1, 2)[: 3 if section == "3D" else 2])
    dim = mesh.geometry.dim
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,)))
    u = dolfinx.fem.Function(space)
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    solid = Solid("body", u, cells, MATERIALS[0], SECTIONS[section][1], section=section)
    points = BodyPoints(space, solid)
    assert points.weight.sum() == pytest.approx(np.pi if section == "axisymmetric" else 1.0)
    nodal = (
        space.tabulate_dof_coordinates()[space.dofmap.list, :dim]
        @ np.diag([0.1, 0.2, 0.3])[:dim, :dim]
    )
    F = points.deformation(nodal)
    across = {"plane-strain": 1.0, "axisymmetric": 1.1, "3D": 1.3}[section]
    expected = np.diag([1.1, 1.2, across])
    np.testing.assert_allclose(F, np.broadcast_to(expected, F.shape), atol=1e-14)
    u.x.array.reshape(-1, dim)[space.dofmap.list] = nodal
    ratio = volume_ratios(u, section, cells, 2)
    np.testing.assert_allclose(ratio, 1.1 * 1.2 * across, rtol=1e-14)
    moved = points.displacement(nodal)
    np.testing.assert_allclose(moved, points.place * np.array([0.1, 0.2, 0.3])[:dim], atol=1e-14)


def test_functions_of_an_energy_have_their_values():
    """All that an energy in Python may be made of, against numpy."""
    (constant,), (x,) = free_variables(1)
    at = np.array([0.3, 0.7, 1.6])
    parts = {
        ufl.atan2(x, 2.0): np.arctan2(at, 2.0), ufl.erf(x): special.erf(at),
        ufl.bessel_I(1, x): special.iv(1, at), ufl.bessel_J(0, x): special.jv(0, at),
        ufl.max_value(x, 1.0): np.maximum(at, 1.0), ufl.min_value(x, 1.0): np.minimum(at, 1.0),
        ufl.conditional(ufl.And(ufl.gt(x, 0.5), ufl.lt(x, 1.0)), x, 0.0): [0.0, 0.7, 0.0],
        ufl.conditional(ufl.Not(ufl.Or(ufl.ge(x, 1.0), ufl.le(x, 0.5))), x, 0.0): [0.0, 0.7, 0.0],
        ufl.conditional(ufl.eq(x, x), ufl.tanh(x), ufl.atan(x)): np.tanh(at),
        ufl.sign(x - 0.5): [-1.0, 1.0, 1.0],
    }  # fmt: skip
    found = values_of(list(parts), {constant: at})
    for values, expected in zip(found, parts.values(), strict=True):
        np.testing.assert_allclose(values, expected, rtol=1e-15)
    with pytest.raises(NotImplementedError, match="no values of MultiIndex"):
        values_of([ufl.as_vector([x, x])[ufl.Index()]], {constant: at})
