"""Solids in the plane, in space and of revolution: energies, patches, closed forms, pressure."""

import dolfinx
import numpy as np
import pytest
import ufl

from tests.forms.bodies.in_forms import forms_of, kinematics
from tests.grid import grid
from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.constraints import Prescribed, component_dofs
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.implicit.newton import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.forms.bodies.kinematics import section_of
from tribox.forms.bodies.loads import FollowerPressure, mean_normal, reference_area
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean, shear_and_bulk
from tribox.forms.bodies.solid import DEGREE, Solid

NEO = NeoHookean(1.0, 5.0)
RUBBER = MooneyRivlin(0.4, 0.1, 5.0)
HENCKY = Hencky(1.0, 5.0)
SPACE = ("hexahedron", "tetrahedron")


def box(cell, degree=1, counts=2, distortion=0.0, size=(1.0, 1.0, 1.0), left=0.0, shear=0.0):
    """Displacement on a box (a rectangle from x = left in the plane), inner nodes moved about."""
    dim = 3 if cell in SPACE else 2
    n = [counts] * dim if isinstance(counts, int) else list(counts)
    mesh = grid(cell, n, size[:dim])
    x = mesh.geometry.x
    inside = ((x > 1e-9)[:, :dim] & (x[:, :dim] < np.array(size[:dim]) - 1e-9)).all(axis=1)
    moves = np.random.default_rng(2).uniform(-1, 1, (len(x), dim)) * distortion
    x[inside, :dim] += moves[inside] * np.array(size[:dim]) / n
    x[:, 0] += left + shear * x[:, 1]
    return dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", degree, (dim,))))


def solid_on(u, material, formulation, section=None):
    mesh = u.function_space.mesh
    cells = np.arange(mesh.topology.index_map(mesh.topology.dim).size_local, dtype=np.int32)
    return Solid("body", u, cells, material, formulation, section=section)


def points(u):
    dim = u.function_space.mesh.geometry.dim
    return u.function_space.tabulate_dof_coordinates()[:, :dim]


def side(u, where):
    mesh = u.function_space.mesh
    return dolfinx.mesh.locate_entities_boundary(mesh, mesh.topology.dim - 1, where)


def forces(parts):
    return sum(dolfinx.fem.assemble_vector(part.residual).array for part in parts)


def wavy(u):
    degree = u.function_space.element.basix_element.degree
    u.x.array[:] = 0.05 / degree**2 * np.random.default_rng(0).normal(size=len(u.x.array))


def slopes(u, function, directions, h=1e-5):
    """Central differences of a function of the unknowns along some directions."""
    x, out = u.x.array.copy(), []
    for d in directions:
        ends = []
        for sign in (1.0, -1.0):
            u.x.array[:] = x + sign * h * d
            ends.append(function())
        out.append((ends[0] - ends[1]) / (2.0 * h))
    u.x.array[:] = x
    return np.array(out)


def directions(u, count=6):
    return np.random.default_rng(3).normal(size=(count, len(u.x.array)))


# cell, formulation, section, material
ELEMENTS = {
    "quadrilateral, reduced": ("quadrilateral", "q1-sri", "plane-strain", HENCKY),
    "quadrilateral, full": ("quadrilateral", "q1", "plane-strain", RUBBER),
    "triangle": ("triangle", "q1", "plane-strain", NEO),
    "hexahedron, reduced": ("hexahedron", "q1-sri", "3D", NEO),
    "hexahedron, full": ("hexahedron", "q1", "3D", RUBBER),
    "hexahedron, Hencky": ("hexahedron", "q1-sri", "3D", HENCKY),
    "tetrahedron": ("tetrahedron", "q1", "3D", RUBBER),
    "quadratic tetrahedron": ("tetrahedron", "q2", "3D", NEO),
    "quadratic hexahedron": ("hexahedron", "q2", "3D", NEO),
    "ring, reduced": ("quadrilateral", "q1-sri", "axisymmetric", HENCKY),
    "ring, full": ("quadrilateral", "q1", "axisymmetric", RUBBER),
    "ring of triangles": ("triangle", "q1", "axisymmetric", NEO),
    "quadratic ring": ("quadrilateral", "q2", "axisymmetric", NEO),
    "quadratic quadrilateral": ("quadrilateral", "q2", "plane-strain", NEO),
    "quadratic triangle": ("triangle", "q2", "plane-strain", RUBBER),
}


@pytest.fixture(scope="module", params=ELEMENTS)
def element(request):
    """A few distorted elements away from the axis, out of shape, as (displacement, solid)."""
    cell, formulation, section, material = ELEMENTS[request.param]
    u = box(cell, DEGREE[formulation], 1 if cell == "hexahedron" else 2, 0.15, left=0.3)
    if cell == "hexahedron":
        x = u.function_space.mesh.geometry.x
        x += 0.1 * np.sin(5.0 * x[:, [1, 2, 0]])
    wavy(u)
    return u, solid_on(u, material, formulation, section)


def test_residual_is_the_derivative_of_the_energy(element):
    u, solid = element
    bodies, forces = Bodies(u, [solid]), np.zeros_like(u.x.array)
    linear = len(points(u)) == len(u.function_space.mesh.geometry.x)
    along = np.eye(len(u.x.array)) if linear and solid.section != "3D" else directions(u)
    slope = slopes(u, bodies.strain_energy, along)
    assert bodies.add_forces(forces)
    bar = 1e-8 if len(along) == len(u.x.array) else 1e-7
    np.testing.assert_allclose(along @ forces, slope, rtol=0, atol=bar * np.abs(slope).max())


# --- patch tests ----------------------------------------------------------------------------------

GRADIENTS = {
    "3D": np.array([[0.2, 0.1, -0.05], [-0.15, -0.1, 0.08], [0.05, -0.12, 0.15]]),
    "plane-strain": np.array([[0.25, 0.1], [-0.15, -0.1]]),
    # Radius and height stretched evenly: the only homogeneous states of a body of revolution.
    "axisymmetric": np.array([[0.2, 0.0], [0.0, -0.15]]),
}


def patch_error(cell, formulation, section, distortion, **shape):
    """Largest error of a homogeneous deformation prescribed all round a patch of elements."""
    u = box(cell, DEGREE[formulation], 3 if cell in SPACE else 4, distortion, **shape)
    solid = solid_on(u, NEO, formulation, section)
    exact = points(u) @ GRADIENTS[section].T
    dim = exact.shape[1]
    edge = np.zeros(len(exact), dtype=bool)
    for i in range(dim):
        edge[component_dofs(u.function_space, side(u, lambda X: X[0] > -1.0), i) // dim] = True
    assert 0 < np.count_nonzero(~edge)
    nodes = np.nonzero(edge)[0]
    held = [Prescribed((dim * nodes + i).astype(np.int32), exact[nodes, i]) for i in range(dim)]
    stepper = ImplicitStepper(Equilibrium(u, [solid], [], held), ImplicitOptions(tolerance=1e-12))
    assert stepper.attempt(1.0).converged
    return np.abs(u.x.array.reshape(-1, dim) - exact).max()


@pytest.mark.parametrize(
    ("cell", "formulation", "section"),
    [
        ("quadrilateral", "q1", "plane-strain"), ("quadrilateral", "q1-sri", "plane-strain"),
        ("triangle", "q1", "plane-strain"),
        ("hexahedron", "q1", "3D"), ("tetrahedron", "q1", "3D"), ("tetrahedron", "q2", "3D"),
        ("quadrilateral", "q1", "axisymmetric"), ("quadrilateral", "q2", "axisymmetric"),
        ("quadrilateral", "q2", "plane-strain"), ("triangle", "q2", "plane-strain"),
    ],
)  # fmt: skip
def test_patch_of_distorted_elements(cell, formulation, section):
    assert patch_error(cell, formulation, section, 0.2) < 1e-11


def test_patch_of_hexahedra_with_one_volumetric_point():
    """The centre alone does not integrate the volume of a distorted hexahedron exactly.

    The patch test holds on parallelepipeds, and its error falls with the square of the distortion,
    which mesh refinement makes vanish.
    """
    assert patch_error("hexahedron", "q1-sri", "3D", 0.0, shear=0.4) < 1e-11
    coarse, fine = (patch_error("hexahedron", "q1-sri", "3D", d) for d in (0.1, 0.05))
    assert 0.0 < fine < 0.35 * coarse < 1e-3


def test_patch_of_rings_with_one_volumetric_point():
    """Likewise; the error falls with the distortion, and with the cell's size over the radius."""

    def error(distortion, left=0.0):
        return patch_error("quadrilateral", "q1-sri", "axisymmetric", distortion, left=left)

    assert error(0.0) < 1e-11
    assert 0.0 < error(0.05) < 0.6 * error(0.1) < 1e-3
    assert error(0.1, left=20.0) < 0.1 * error(0.1)


# --- closed forms ---------------------------------------------------------------------------------


def pull(u, solid, stretch, symmetric):
    """Total force along y of a block held without friction on its planes of symmetry."""
    space = u.function_space
    top = Prescribed(component_dofs(space, side(u, lambda X: X[1] > 1.0 - 1e-9), 1))
    held = [top, Prescribed(component_dofs(space, side(u, lambda X: X[1] < 1e-9), 1))]
    for i in symmetric:
        at = side(u, lambda X, i=i: X[i] < 1e-9)
        held.append(Prescribed(component_dofs(space, at, i)))
    problem = Equilibrium(u, [solid], [], held)
    stepper = ImplicitStepper(problem, ImplicitOptions(tolerance=1e-10))
    for part in np.linspace(0.0, 1.0, 5)[1:]:
        top.value = part * (stretch - 1.0)
        assert stepper.attempt(1.0).converged
        stepper.commit()
    return problem.unbalanced[top.dofs].sum()


def squeezed_energy(formulation, counts):
    """Strain energy of a bonded, nearly incompressible layer squeezed by a twentieth."""
    u = box("quadrilateral", counts=counts, size=(4.0, 1.0))
    solid = solid_on(u, NeoHookean(*shear_and_bulk(3.0, 0.499)), formulation)
    plates = [side(u, lambda X: X[1] < 1e-9), side(u, lambda X: X[1] > 1.0 - 1e-9)]
    held = [
        Prescribed(component_dofs(u.function_space, plate, i)) for plate in plates for i in range(2)
    ]
    stepper = ImplicitStepper(Equilibrium(u, [solid], [], held), ImplicitOptions(tolerance=1e-10))
    for part in np.linspace(0.0, 1.0, 6)[1:]:
        held[3].value = -0.05 * part
        assert stepper.attempt(1.0).converged
        stepper.commit()
    return stepper.problem.strain_energy()


def test_reduced_integration_does_not_lock():
    """A coarse mesh is near a fine one; full integration on the same mesh is far too stiff."""
    fine = squeezed_energy("q1-sri", (32, 12))
    assert squeezed_energy("q1-sri", (12, 4)) == pytest.approx(fine, rel=0.1)
    assert squeezed_energy("q1", (12, 4)) > 1.5 * fine


@pytest.mark.parametrize("stretch", [0.7, 1.5])
def test_incompressible_block_and_cylinder(stretch):
    """Neo-Hookean, nu → 1/2, uniaxial: nominal stress G (λ − λ⁻²), on 1 m² and on π m²."""
    shear, bulk = shear_and_bulk(3.0, 0.4999)
    stress = shear * (stretch - stretch**-2)
    u = box("hexahedron", counts=2, distortion=0.15)
    block = pull(u, solid_on(u, NeoHookean(shear, bulk), "q1-sri"), stretch, (0, 2))
    assert block == pytest.approx(stress, rel=5e-3)
    u = box("quadrilateral", counts=3, distortion=0.15)
    ring = solid_on(u, NeoHookean(shear, bulk), "q1-sri", "axisymmetric")
    assert pull(u, ring, stretch, (0,)) == pytest.approx(np.pi * stress, rel=5e-3)
    top = points(u)[:, 1] > 1.0 - 1e-9
    moved = (points(u) + u.x.array.reshape(-1, 2))[top, 0]
    np.testing.assert_allclose(moved, points(u)[top, 0] * stretch**-0.5, atol=2e-3)


@pytest.mark.parametrize(("formulation", "counts"), [("q1-sri", (24, 1)), ("q2", (12, 1))])
def test_tube_under_inner_pressure(formulation, counts):
    """Incompressible neo-Hookean tube of fixed length: p = G ∫ (λ² − λ⁻²)/r dr, λ = r/R."""
    u = box("quadrilateral", DEGREE[formulation], counts, size=(1.0, 0.2), left=1.0)
    solid = solid_on(u, NeoHookean(1.0, 2e4), formulation, "axisymmetric")
    inner = 1.3
    R = np.linspace(1.0, 2.0, 20001)
    r = np.sqrt(R**2 + inner**2 - 1.0)
    pressure = np.trapezoid(((r / R) ** 2 - (R / r) ** 2) * R / r**2, R)
    space = u.function_space
    ends = side(u, lambda X: (X[1] < 1e-9) | (X[1] > 0.2 - 1e-9))
    load = FollowerPressure(u, side(u, lambda X: X[0] < 1.0 + 1e-9), "axisymmetric")
    held = [Prescribed(component_dofs(space, ends, 1))]
    problem = Equilibrium(u, [solid], [], held, [], [load])
    stepper = ImplicitStepper(problem, ImplicitOptions())
    for part in np.linspace(0.0, 1.0, 6)[1:]:
        load.set(part * pressure)
        assert stepper.attempt(1.0).converged
        stepper.commit()
    at = points(u)[:, 0] < 1.0 + 1e-9
    np.testing.assert_allclose(u.x.array.reshape(-1, 2)[at, 0], inner - 1.0, rtol=5e-3)


@pytest.mark.parametrize("formulation", ["q1", "q1-sri"])
def test_cylinder_under_even_pressure_stays_a_cylinder(formulation):
    """Stress and pressure share the nodes' forces alike, also at the axis, where cells are short of

    volume on one side: the volumetric stress acts at the centroid of the ring, not at its centre.
    """
    u = box("quadrilateral", counts=4)
    solid = solid_on(u, NeoHookean(1.0, 50.0), formulation, "axisymmetric")
    space = u.function_space
    bottom, axis = side(u, lambda X: X[1] < 1e-9), side(u, lambda X: X[0] < 1e-9)
    load = FollowerPressure(u, side(u, lambda X: X[1] > 1.0 - 1e-9), "axisymmetric")
    held = [Prescribed(component_dofs(space, bottom, 1))]
    held.append(Prescribed(component_dofs(space, axis, 0)))
    problem = Equilibrium(u, [solid], [], held, [], [load])
    load.set(0.4)
    assert ImplicitStepper(problem, ImplicitOptions(tolerance=1e-13)).attempt(1.0).converged
    moved, x = u.x.array.reshape(-1, 2), points(u)
    stretch = 1.0 + moved[np.argmax(x.sum(axis=1))]
    np.testing.assert_allclose(moved, x * (stretch - 1.0), atol=1e-11)
    assert stretch[1] < 0.9


# --- pressure -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cell", "degree", "section"),
    [
        ("hexahedron", 1, "3D"), ("tetrahedron", 2, "3D"), ("quadrilateral", 1, "axisymmetric"),
        ("triangle", 2, "axisymmetric"), ("quadrilateral", 2, "plane-strain"),
        ("triangle", 1, "plane-strain"),
    ],
)  # fmt: skip
def test_pressure_all_round_works_against_the_volume(cell, degree, section):
    """The residual is p times the derivative of the enclosed volume, its tangent the second."""
    u = box(cell, degree, 2, 0.1)
    load = FollowerPressure(u, side(u, lambda X: X[0] > -1.0), section)
    load.set(0.7)
    k = kinematics(u, section) if section != "plane-strain" else None
    weight = 2.0 * np.pi * ufl.SpatialCoordinate(u.function_space.mesh)[0]
    J = k.J if k else ufl.det(ufl.Identity(2) + ufl.grad(u))
    dx = ufl.dx(metadata={"quadrature_degree": 8})
    volume = dolfinx.fem.form((weight * J if section == "axisymmetric" else J) * dx)
    wavy(u)
    if section == "axisymmetric":  # the axis stays where it is
        u.x.array.reshape(-1, 2)[points(u)[:, 0] < 1e-9, 0] = 0.0
    along = directions(u, 4)
    if section == "axisymmetric":
        along.reshape(4, -1, 2)[:, points(u)[:, 0] < 1e-9, 0] = 0.0
    slope = slopes(u, lambda: dolfinx.fem.assemble_scalar(volume), along)
    np.testing.assert_allclose(along @ forces([load]), 0.7 * slope, atol=1e-8)
    assert np.abs(slope).max() > 0.1
    A = dolfinx.fem.assemble_matrix(load.tangent).to_dense()
    change = slopes(u, lambda: forces([load]), along, 1e-6)
    np.testing.assert_allclose(along @ A.T, change, atol=1e-7)


def test_areas_and_normals():
    u = box("hexahedron", size=(1.0, 2.0, 3.0))
    mesh, top = u.function_space.mesh, side(u, lambda X: X[1] > 2.0 - 1e-9)
    assert reference_area(mesh, top) == pytest.approx(3.0)
    assert mean_normal(mesh, top) == pytest.approx([0.0, 1.0, 0.0])
    u = box("quadrilateral", size=(1.0, 2.0), left=1.0)
    mesh, top = u.function_space.mesh, side(u, lambda X: X[1] > 2.0 - 1e-9)
    assert reference_area(mesh, top) == pytest.approx(1.0)
    assert reference_area(mesh, top, "axisymmetric") == pytest.approx(3.0 * np.pi)
    outside = side(u, lambda X: X[0] > 2.0 - 1e-9)
    assert reference_area(mesh, outside, "axisymmetric") == pytest.approx(8.0 * np.pi)
    assert mean_normal(mesh, outside)[0] == pytest.approx(1.0)


# --- round-off and mistakes -----------------------------------------------------------------------


@pytest.mark.parametrize("section", ["3D", "axisymmetric"])
def test_an_impossible_tolerance_ends_at_round_off(section):
    u = box("hexahedron" if section == "3D" else "quadrilateral", counts=5)
    solid = solid_on(u, NEO, "q1-sri", section)
    space, dim = u.function_space, len(points(u)[0])
    plates = [side(u, lambda X: X[1] < 1e-9), side(u, lambda X: X[1] > 1.0 - 1e-9)]
    held = [Prescribed(component_dofs(space, plate, i)) for plate in plates for i in range(dim)]
    if section == "axisymmetric":
        held.append(Prescribed(component_dofs(space, side(u, lambda X: X[0] < 1e-9), 0)))
    problem = Equilibrium(u, [solid], [], held)
    stepper = ImplicitStepper(problem, ImplicitOptions(tolerance=0.0))
    for value in (-0.02, -0.05):
        held[dim + 1].value = value
        result = stepper.attempt(1.0)
        assert result.converged and result.iterations <= 8, result
        stepper.commit()
        residual = result.residuals[-1] * problem.reference_force
        assert residual <= problem.roundoff < 1e-9 * problem.reference_force


def test_what_does_not_go_together_is_refused():
    u = box("quadrilateral")
    with pytest.raises(ValueError, match="body: q2 on a displacement of degree 1"):
        solid_on(u, NEO, "q2")
    with pytest.raises(ValueError, match="a mesh in 2D cannot be taken for 3D"):
        solid_on(u, NEO, "q1", "3D")
    with pytest.raises(ValueError, match="a mesh in 3D cannot be taken for axisymmetric"):
        section_of(3, "axisymmetric")
    assert section_of(2, None) == "plane-strain" and section_of(3, None) == "3D"


class WholeSaintVenant:
    """E = (C − I)/2: G |E|² + Λ/2 (tr E)², in one part, and nothing of J alone."""

    shear_modulus, bulk_modulus = 1.0, 5.0

    def parameters(self):
        return {}

    def energy(self, k, c):
        square = 0.25 * (k.I1**2 - 2.0 * k.I2 - 2.0 * k.I1 + 3.0)
        whole = square + 0.125 * (5.0 - 2.0 / 3.0) * (k.I1 - 3.0) ** 2
        return whole, ufl.as_ufl(0)


def test_an_energy_without_a_part_of_the_volume_is_integrated_in_full():
    u = box("quadrilateral", counts=1)
    solid = solid_on(u, WholeSaintVenant(), "q1-sri")
    u.interpolate(lambda x: (0.1 * x[0], 0.0 * x[0]))
    strain = 0.5 * (1.1**2 - 1.0)
    energy = (1.0 + 0.5 * (5.0 - 2.0 / 3.0)) * strain**2
    assert not solid.reduced
    assert Bodies(u, [solid]).strain_energy() == pytest.approx(energy, rel=1e-12)
    pull = forces(forms_of(solid))[points(u).repeat(2, axis=0)[:, 0] > 0.5][::2].sum()
    assert pull == pytest.approx(2.0 * energy / strain * 1.1, rel=1e-12)
