"""Solids: residuals against energies, the patch test, incompressibility, and round-off."""

import dolfinx
import numpy as np
import pytest
import ufl

from tests.grid import grid
from tribox.app.equilibrium.constraints import Prescribed, component_dofs
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.implicit.options import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.forms.bodies.kinematics import plane_strain
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean, shear_and_bulk
from tribox.forms.bodies.solid import Solid

MATERIALS = {
    "neo-hookean": NeoHookean(1.0, 5.0),
    "mooney-rivlin": MooneyRivlin(0.4, 0.1, 5.0),
    "hencky": Hencky(1.0, 5.0),
}


def rectangle(width=1.0, height=1.0, nx=3, ny=3, cell="quadrilateral", distortion=0.0):
    """Displacement on a rectangle whose inner nodes may be moved about."""
    mesh = grid(cell, (nx, ny), [width, height])
    x = mesh.geometry.x
    inside = (x[:, 0] % width > 1e-9) & (x[:, 1] % height > 1e-9)
    inside &= (x[:, 0] < width - 1e-9) & (x[:, 1] < height - 1e-9)
    moves = np.random.default_rng(2).uniform(-1, 1, (len(x), 2)) * distortion
    x[inside, :2] += moves[inside] * [width / nx, height / ny]
    return dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,))))


def solid_on(u, material, formulation):
    index = u.function_space.mesh.topology.index_map(2)
    return Solid("body", u, np.arange(index.size_local, dtype=np.int32), material, formulation)


def side(u, where):
    return dolfinx.mesh.locate_entities_boundary(u.function_space.mesh, 1, where)


def forces(solid):
    return sum(dolfinx.fem.assemble_vector(part.residual).array for part in solid.forms)


def wavy(u, seed=0):
    rng = np.random.default_rng(seed)
    u.x.array[:] = 0.08 * rng.normal(size=len(u.x.array))


def energy_slope(u, solid, h=1e-5):
    """Central differences of the strain energy for every unknown."""
    x, slope = u.x.array.copy(), np.empty(len(u.x.array))
    for i in range(len(x)):
        sides = []
        for sign in (1.0, -1.0):
            u.x.array[:] = x
            u.x.array[i] += sign * h
            sides.append(solid.strain_energy())
        slope[i] = (sides[0] - sides[1]) / (2.0 * h)
    u.x.array[:] = x
    return slope


@pytest.mark.parametrize("formulation", ["q1", "q1-sri"])
@pytest.mark.parametrize("name", MATERIALS)
def test_residual_is_the_derivative_of_the_energy(name, formulation):
    """Of the compiled forms as they are assembled. FFCx 0.9 compiles a linear form of two
    quadrature degrees wrongly; the residual is then off by percents."""
    u = rectangle(distortion=0.2)
    solid = solid_on(u, MATERIALS[name], formulation)
    wavy(u)
    slope = energy_slope(u, solid)
    np.testing.assert_allclose(forces(solid), slope, rtol=0, atol=1e-8 * np.abs(slope).max())


def test_reduced_integration_is_the_sum_of_its_parts():
    """Each part against a form of its own with that one quadrature degree, written out here."""
    u = rectangle(distortion=0.2)
    material = NeoHookean(1.0, 5.0)
    solid = solid_on(u, material, "q1-sri")
    wavy(u)
    distortional, volumetric = material.energy(plane_strain(u), material.parameters())
    test = ufl.TestFunction(u.function_space)
    parts = []
    for density, degree in ((distortional, 2), (volumetric, 1)):
        dx = ufl.dx(metadata={"quadrature_degree": degree})
        parts.append(
            dolfinx.fem.assemble_vector(
                dolfinx.fem.form(ufl.derivative(density * dx, u, test))
            ).array
        )
    whole = forces(solid)
    assert len(solid.forms) == 2
    np.testing.assert_allclose(whole, parts[0] + parts[1], rtol=0, atol=1e-14)
    # Full integration differs by far more, so that a part at the wrong points would be seen.
    full = forces(solid_on(u, material, "q1"))
    assert np.abs(full - whole).max() > 1e-3 * np.abs(whole).max()


@pytest.mark.parametrize("formulation", ["q1", "q1-sri"])
def test_tangent_is_the_derivative_of_the_residual(formulation):
    u = rectangle(distortion=0.2)
    solid = solid_on(u, MATERIALS["hencky"], formulation)
    wavy(u)
    A = sum(dolfinx.fem.assemble_matrix(part.tangent).to_dense() for part in solid.forms)
    np.testing.assert_allclose(A, A.T, rtol=0, atol=1e-13 * np.abs(A).max())
    x, h = u.x.array.copy(), 1e-6
    for seed in range(3):
        d = np.random.default_rng(seed).normal(size=len(x))
        u.x.array[:] = x + h * d
        after = forces(solid)
        u.x.array[:] = x - h * d
        slope = (after - forces(solid)) / (2.0 * h)
        np.testing.assert_allclose(A @ d, slope, rtol=0, atol=1e-7 * np.abs(slope).max())


@pytest.mark.parametrize(
    ("cell", "formulation"),
    [("quadrilateral", "q1"), ("quadrilateral", "q1-sri"), ("triangle", "q1")],
)
def test_patch(cell, formulation):
    """A homogeneous deformation, prescribed at the boundary of a distorted mesh, is found."""
    u = rectangle(nx=4, ny=4, cell=cell, distortion=0.25)
    solid = solid_on(u, MATERIALS["neo-hookean"], formulation)
    grad = np.array([[0.25, 0.1], [-0.15, -0.1]])
    where = u.function_space.tabulate_dof_coordinates()[:, :2]
    edge = (np.isclose(where, 0.0) | np.isclose(where, 1.0)).any(axis=1)
    exact = where @ grad.T
    held = [
        Prescribed(np.array([2 * n + i], dtype=np.int32), exact[n, i])
        for n in np.nonzero(edge)[0]
        for i in range(2)
    ]
    assert 0 < np.count_nonzero(~edge) == 9
    stepper = ImplicitStepper(Equilibrium(u, [solid], [], held), ImplicitOptions(tolerance=1e-12))
    assert stepper.attempt(1.0).converged
    np.testing.assert_allclose(u.x.array.reshape(-1, 2), exact, rtol=0, atol=1e-11)


def stretched(u, solid, stretch):
    """Force per reference area of a block pulled along x, free to contract along y."""
    left, bottom = side(u, lambda X: np.isclose(X[0], 0.0)), side(u, lambda X: X[1] < 1e-9)
    right = side(u, lambda X: np.isclose(X[0], 1.0))
    space = u.function_space
    held = [
        Prescribed(component_dofs(space, left, 0)),
        Prescribed(component_dofs(space, bottom, 1)),
        Prescribed(component_dofs(space, right, 0)),
    ]
    problem = Equilibrium(u, [solid], [], held)
    stepper = ImplicitStepper(problem, ImplicitOptions(tolerance=1e-10))
    for part in np.linspace(0.0, 1.0, 5)[1:]:
        held[2].value = part * (stretch - 1.0)
        assert stepper.attempt(1.0).converged
        stepper.commit()
    return problem.unbalanced[held[2].dofs].sum()


@pytest.mark.parametrize("stretch", [0.7, 1.3, 1.8])
def test_incompressible_block_in_plane_strain(stretch):
    """Neo-Hookean, nu → 1/2: nominal stress G (λ − λ⁻³)."""
    u = rectangle(distortion=0.2)
    shear, bulk = shear_and_bulk(3.0, 0.4999)
    stress = stretched(u, solid_on(u, NeoHookean(shear, bulk), "q1-sri"), stretch)
    assert stress == pytest.approx(shear * (stretch - stretch**-3), rel=5e-3)


def squeezed_energy(formulation, nx, ny):
    """Strain energy of a bonded, nearly incompressible layer squeezed by a twentieth."""
    u = rectangle(4.0, 1.0, nx, ny)
    solid = solid_on(u, NeoHookean(*shear_and_bulk(3.0, 0.499)), formulation)
    space = u.function_space
    plates = [side(u, lambda X: X[1] < 1e-9), side(u, lambda X: X[1] > 1.0 - 1e-9)]
    held = [Prescribed(component_dofs(space, plate, i)) for plate in plates for i in range(2)]
    stepper = ImplicitStepper(Equilibrium(u, [solid], [], held), ImplicitOptions(tolerance=1e-10))
    for part in np.linspace(0.0, 1.0, 6)[1:]:
        held[3].value = -0.05 * part
        assert stepper.attempt(1.0).converged
        stepper.commit()
    return solid.strain_energy()


def test_reduced_integration_does_not_lock():
    """A coarse mesh is near a fine one; full integration on the same mesh is far too stiff."""
    fine = squeezed_energy("q1-sri", 32, 12)
    assert squeezed_energy("q1-sri", 12, 4) == pytest.approx(fine, rel=0.1)
    assert squeezed_energy("q1", 12, 4) > 1.5 * fine
