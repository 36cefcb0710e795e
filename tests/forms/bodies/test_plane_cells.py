"""The compiled tangent against the matrix that DOLFINx assembles, and what is no number."""

import numpy as np
import pytest

from tests.forms.bodies.element_matrices import (
    cells_of,
    dense,
    no_number_in_an_inverted_cell,
    same_carried_pressures,
    summed,
)
from tests.forms.bodies.in_forms import forms_of
from tests.forms.bodies.test_internal_force import KINDS, MATERIALS, OTHERS, RINGS, body, stretched
from tribox.forms.bodies.solid import Solid

SECTIONS = [("plane-strain", "triangle", "q1"), ("axisymmetric", "quadrilateral", "q1-sri")]


@pytest.mark.parametrize("size", [0.5, 0.1, 1e-4])
@pytest.mark.parametrize(("cell", "formulation"), KINDS)
@pytest.mark.parametrize("name", MATERIALS)
def test_compiled_tangent_is_that_of_the_generated_kernel(name, cell, formulation, size):
    """At the largest size some cells of a block of eight are beyond the logarithm's series."""
    same_tangent(*body(cell, MATERIALS[name], formulation), size)


@pytest.mark.parametrize("size", [0.1, 1e-4])
@pytest.mark.parametrize(("name", "cell", "formulation"), RINGS)
def test_tangent_of_rings(name, cell, formulation, size):
    same_tangent(*body(cell, MATERIALS[name], formulation, section="axisymmetric"), size)


@pytest.mark.parametrize(("material", "cell", "formulation", "section"), OTHERS)
def test_tangent_of_points_alone(material, cell, formulation, section):
    u, solid = body(cell, material, formulation, (3, 3), section=section)
    for size in (0.1, 1e-4):
        same_tangent(u, solid, size)


def same_tangent(u, solid, size):
    """Compare the tangent of both ways."""
    stretched(u, size)
    wanted = dense([part.tangent for part in forms_of(solid)])
    found = summed(u, cells_of(u, solid).loops)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    np.testing.assert_allclose(found, found.T, rtol=0, atol=1e-14 * np.abs(wanted).max())


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
