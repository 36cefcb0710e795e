"""Bodies that flow: elastic limit, tangents against differences, what is remembered and when."""

from dataclasses import replace

import basix.ufl
import dolfinx
import dolfinx.fem.petsc
import numpy as np
import pytest
import ufl

from tests.forms.bodies.element_matrices import summed
from tests.forms.bodies.in_forms import forms_of, radius
from tests.grid import grid
from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.pattern import cell_matrix
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Backstress, Linear, Voce
from tribox.forms.bodies.kinematics import circumference
from tribox.forms.bodies.materials import Hencky, NeoHookean
from tribox.forms.bodies.memory_solid import MemorySolid, make_solid
from tribox.forms.bodies.softening import Mullins
from tribox.forms.bodies.solid import DEGREE
from tribox.forms.bodies.viscous_points import Branch, Viscoelastic

G, K = 1.0, 5.0
NEVER = ElastoPlastic(G, K, Linear(1e3))
SOON = ElastoPlastic(G, K, Voce(0.02, 0.05, 8.0, 0.01))
BACK = replace(SOON, kinematic=(Backstress(0.5, 12.0), Backstress(0.02)))
SOFT = Viscoelastic(NeoHookean(G, K), (Branch(0.5, 0.3),), Mullins(1.5, 2e-3, 0.1))
VISCOUS = Viscoelastic(NeoHookean(G, K), (Branch(0.7, 0.3), Branch(0.4, 2.0)))
KINDS = [
    ("quadrilateral", "plane-strain", "q1"), ("quadrilateral", "plane-strain", "q1-sri"),
    ("quadrilateral", "axisymmetric", "q1-sri"), ("triangle", "plane-strain", "q2"),
    ("triangle", "axisymmetric", "q1"), ("hexahedron", "3D", "q1-sri"), ("tetrahedron", "3D", "q1"),
]  # fmt: skip
FEW = [KINDS[0], KINDS[2], KINDS[4], KINDS[5]]


def body(cell, section, formulation, material, counts=(2, 2, 2), wave=0.05):
    """A block, a ring's section around a hole or a box, off the axis, slightly distorted."""
    dim = 3 if section == "3D" else 2
    mesh = grid(cell, counts[:dim], [1.5, 1.0, 1.0][:dim], [0.5, 0.0, 0.0][:dim])
    x = mesh.geometry.x
    x[:, 0] += wave * x[:, 1] * np.sin(3.0 * x[:, 0])
    u = dolfinx.fem.Function(
        dolfinx.fem.functionspace(mesh, ("Lagrange", DEGREE[formulation], (dim,)))
    )
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    return u, make_solid("body", u, cells, material, formulation, section=section)


def bend(u, size=0.1, seed=0):
    """A smooth displacement with all gradients, and some noise that is small beside them."""
    dim = u.function_space.mesh.geometry.dim
    x = u.function_space.tabulate_dof_coordinates()[:, :dim]
    waves = np.random.default_rng(seed).uniform(-1.0, 1.0, (dim, dim))
    noise = np.random.default_rng(seed + 1).normal(size=x.shape)
    u.x.array[:] = (size * np.sin(x @ waves) + 0.02 * size * noise).reshape(-1)


def forces(solid):
    out = sum(
        (dolfinx.fem.assemble_vector(part.residual).array for part in forms_of(solid)),
        np.zeros_like(solid.displacement.x.array),
    )
    solid.add_point_forces(out)
    return out


def energy(solid):
    return Bodies(solid.displacement, [solid]).strain_energy()


def stiffness(solid):
    out = sum(
        (dolfinx.fem.assemble_matrix(part.tangent).to_dense() for part in forms_of(solid)), 0.0
    )
    return out + summed(solid.displacement, [solid.point_cells]) if solid.remembers else out


@pytest.mark.parametrize(("cell", "section", "formulation"), FEW)
def test_below_the_yield_stress_it_is_the_elastic_body(cell, section, formulation):
    found = []
    for material in (Hencky(G, K), NEVER):
        u, solid = body(cell, section, formulation, material)
        assert isinstance(solid, MemorySolid) == (material is NEVER)
        bend(u)
        assert solid.evaluate(1.0, tangent=True)
        found.append((np.array(energy(solid)), forces(solid), stiffness(solid)))
    for elastic, plastic in zip(*found, strict=True):
        assert np.abs(elastic - plastic).max() <= 1e-12 * np.abs(elastic).max()
    assert (solid.plastic_strain() == 0.0).all() and (solid.dissipated == 0.0).all()


def by_forms(u, solid, dt):
    """Forces and stiffness by forms of DOLFINx, with what points give by themselves."""
    mesh, p, d = u.function_space.mesh, 9 if solid.section == "3D" else 5, solid.full_degree
    test, trial = ufl.TestFunction(u.function_space), ufl.TrialFunction(u.function_space)

    def gradient(v, one=0.0):
        g = ufl.grad(v)
        if p == 9:
            parts = [g[i, j] + one * (i == j) for i in range(3) for j in range(3)]
            return ufl.as_vector(parts)
        across = v[0] / radius(v) if solid.section == "axisymmetric" else 0.0
        plane = [one + g[0, 0], g[0, 1], g[1, 0], one + g[1, 1]]
        return ufl.as_vector([*plane, ufl.as_ufl(one + across)])

    def field(shape):
        element = basix.ufl.quadrature_element(mesh.basix_cell(), shape, "default", d)
        return dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, element))

    xi, _ = basix.make_quadrature(basix.CellType[mesh.topology.cell_name()], d)
    F = dolfinx.fem.Expression(gradient(u, 1.0), xi).eval(mesh, solid.cells).reshape(-1, p)
    law = solid.law
    reduced = not law.added and solid.reduced
    found = law.update(F, solid.points.committed, dt, True, volumetric=not reduced)
    stress, moduli = field((p,)), field((p, p))
    rows = stress.function_space.dofmap.list[solid.cells].reshape(-1)
    stress.x.array.reshape(-1, p)[rows] = found.P
    moduli.x.array.reshape(-1, p * p)[rows] = found.A.reshape(-1, p * p)
    weight = circumference(mesh, solid.section)
    dx = ufl.dx(mesh, metadata={"quadrature_degree": d})
    forward = ufl.dot(moduli, gradient(trial))
    force = dolfinx.fem.form(weight * ufl.inner(stress, gradient(test)) * dx)
    tangent = dolfinx.fem.form(weight * ufl.inner(forward, gradient(test)) * dx)
    parts = [(force, tangent), *((part.residual, part.tangent) for part in forms_of(solid))]
    vectors = [dolfinx.fem.assemble_vector(one).array for one, _ in parts]
    return sum(vectors), sum(dolfinx.fem.assemble_matrix(one).to_dense() for _, one in parts)


@pytest.mark.parametrize("kind", KINDS)
def test_the_loop_over_cells_gives_what_forms_do(kind):
    """Metals with and without backstress, branches beside an energy, softening: both matrices."""
    for material in (SOON, BACK, VISCOUS, SOFT):
        u, solid = body(*kind, material, counts=(3, 3, 1))  # 9 cells: a block, and one of another
        bend(u, 0.05)
        solid.evaluate(0.3)
        solid.commit()
        bend(u, 0.1, seed=5)
        assert solid.evaluate(0.3, tangent=True)
        bodies, out = Bodies(u, [solid]), np.zeros_like(u.x.array)
        matrix = cell_matrix(u.function_space)
        bodies.add_forces(out)
        bodies.add_tangent(matrix, 0, 1, False)
        matrix.assemble()
        wanted, stiff = by_forms(u, solid, 0.3)
        assert np.abs(out - wanted).max() <= 1e-12 * np.abs(wanted).max()
        assert np.abs(matrix[:, :] - stiff).max() <= 1e-12 * np.abs(stiff).max()


def test_only_what_is_committed_is_remembered():
    """Evaluations in any order and in vain change nothing: to the last bit."""
    u, solid = body(*KINDS[1], SOON)
    other, alone = body(*KINDS[1], SOON)
    for seed in (0, 3, 7):
        bend(u, 0.1, seed)
        x = u.x.array.copy()
        for size in (30.0, -0.5, 1.0):  # turned inside out, the other way, right
            u.x.array[:] = size * x
            assert solid.evaluate(1.0, tangent=size < 0.0) == (size < 30.0)
        solid.commit()
        bend(other, 0.1, seed)
        alone.evaluate(1.0)
        alone.commit()
    assert np.array_equal(solid.points.committed, alone.points.committed)
    assert np.array_equal(solid.dissipated, alone.dissipated) and solid.dissipated[0] > 0.0
    solid.commit()  # nothing was evaluated since: nothing to commit
    assert solid.points.number == 3 and np.array_equal(solid.dissipated, alone.dissipated)


@pytest.mark.parametrize("material", [BACK, VISCOUS], ids=["reverses", "creeps"])
def test_steps_write_over_old_states_but_those_that_others_hold(material):
    """Steps without tangents, as explicit ones are, against points that forget no array."""
    u, solid = body(*KINDS[1], material)
    state, seen, origin, kept = solid.points.committed, set(), None, None
    for number in range(8):
        bend(u, 0.02 * number, seed=number)
        assert solid.evaluate(0.3)
        F = solid._gradients()
        update = solid.law.update(F, state, 0.3, False, volumetric=not solid.reduced)
        solid.commit()
        np.testing.assert_allclose(solid.points.committed, update.state, rtol=0, atol=1e-13)
        state = update.state
        seen.add(solid.points.committed.ctypes.data)
        if number == 4:
            origin = solid.history().origin
            kept = origin.values.copy()
    assert len(seen) <= 4  # three in turn, and the one that was kept
    np.testing.assert_array_equal(origin.values, kept)
    assert (solid.law.start(1) == solid.points._initial).all()


def test_where_a_cell_is_inverted_the_force_is_no_number():
    u, solid = body(*KINDS[0], SOON)
    u.x.array[:] = -1.5 * u.function_space.tabulate_dof_coordinates()[:, :2].reshape(-1)
    u.x.array[1::2] = 0.0
    assert not solid.evaluate(1.0)
    assert np.isnan(forces(solid)).any() and not np.isfinite(energy(solid))
    u.x.array[:] = 0.0
    assert solid.evaluate(1.0)
    assert (forces(solid) == 0.0).all()


def test_a_history_brings_back_the_state():
    u, solid = body(*KINDS[1], SOON)
    for seed in (0, 3):
        bend(u, 0.1, seed)
        solid.evaluate(0.5, tangent=True)
        solid.commit()
    history = solid.history()
    again, new = body(*KINDS[1], SOON)
    again.x.array[:] = u.x.array
    kept = new.point_rows(new.cell_rows(history.origin.values))
    np.testing.assert_array_equal(kept, history.origin.values)
    new.adopt(history)
    new.repeat_step()
    assert np.array_equal(new.points.committed, solid.points.committed)
    assert np.array_equal(new.dissipated, solid.dissipated)
    assert energy(new) == energy(solid)


def test_points_that_do_not_flow_on_are_elastic_about_the_committed_state():
    """For the stable step: forces on from there as those of the elastic body, unloading or not."""
    u, solid = body(*KINDS[1], SOON)
    bend(u)
    solid.evaluate()
    solid.commit()
    assert solid.evaluate_elastic()
    before, x = forces(solid), u.x.array.copy()
    for sign in (1.0, -1.0):
        u.x.array[:] = (1.0 + sign * 1e-4) * x
        solid.evaluate_elastic()
        elastic = forces(solid) - before
        solid.evaluate()
        flowing = forces(solid) - before
        same = np.abs(elastic - flowing).max() <= 1e-3 * np.abs(elastic).max()
        assert same == (sign < 0.0)


def test_a_ring_that_is_compressed_bears_its_section_times_the_yield_stress():
    """Free to widen: Kirchhoff's stress is σ_Y(α), its elastic strain τ/E, and volume changes."""
    hardening = Linear(0.02, 0.1)
    material = ElastoPlastic(G, K, hardening)
    E = 9.0 * K * G / (3.0 * K + G)
    nu = (3.0 * K - 2.0 * G) / (2.0 * (3.0 * K + G))
    for section, area in (("axisymmetric", np.pi * (1.5**2 - 0.5**2)), ("3D", 1.0)):
        cell = "hexahedron" if section == "3D" else "quadrilateral"
        u, solid = body(cell, section, "q1-sri", material, wave=0.0)
        dim = u.function_space.mesh.geometry.dim
        x = u.function_space.tabulate_dof_coordinates()[:, :dim]
        strain = -0.2
        alpha = (abs(strain) - hardening.yield_stress / E) / (1.0 + hardening.modulus / E)
        tau = -(hardening.yield_stress + hardening.modulus * alpha)
        across = -nu * tau / E + 0.5 * alpha
        stretch = np.full(dim, np.exp(across))
        stretch[1] = np.exp(strain)
        u.x.array[:] = (x * (stretch - 1.0)).reshape(-1)
        solid.evaluate()
        force = forces(solid).reshape(-1, dim)[np.isclose(x[:, 1], x[:, 1].max()), 1].sum()
        assert force == pytest.approx(tau / stretch[1] * area, rel=1e-12)
        assert solid.plastic_strain() == pytest.approx(alpha, rel=1e-12)
        solid.commit()
        volume = area * 1.0
        work = hardening.stress(np.array(alpha)) * alpha
        assert solid.dissipated[0] == pytest.approx(work * volume, rel=1e-3)
        # Along a way that flows from end to end the rest is half the growth of the yield stress.
        more = -0.001
        u.x.array[:] += (x * stretch * np.expm1(more * np.array([-0.5, 1.0, -0.5])[:dim])).ravel()
        before = solid.dissipated
        solid.evaluate()
        solid.commit()
        spent, numerical = solid.dissipated - before
        growth = solid.plastic_strain().mean() - alpha
        assert spent > 0.0
        assert numerical == pytest.approx(0.5 * hardening.modulus * growth**2 * volume, rel=0.1)


def test_the_stress_of_points_reaches_any_place_of_a_cell():
    """Below the yield stress it is the elastic stress, exactly where it is linear in the cell."""
    for kind in (KINDS[1], KINDS[5]):
        values = []
        for material in (Hencky(G, K), NEVER):
            u, solid = body(*kind, material)
            dim = u.function_space.mesh.geometry.dim
            x = u.function_space.tabulate_dof_coordinates()[:, :dim]
            F = np.eye(3) + 0.1 * np.random.default_rng(1).uniform(-1.0, 1.0, (3, 3))
            F[:dim, dim:] = F[dim:, :dim] = 0.0
            F[dim:, dim:] = np.eye(3 - dim)
            u.x.array[:] = (x @ (F[:dim, :dim] - np.eye(dim)).T).reshape(-1)
            cells = solid.cells[1:]
            xi = np.random.default_rng(2).uniform(0.0, 1.0, (len(cells), dim))
            at = solid.stress_at(cells, xi)
            same = np.tile(F, (len(cells), 1, 1))
            values.append(at.cauchy(same, same))
        np.testing.assert_allclose(values[1], values[0], rtol=0, atol=1e-13)
        assert (at.plastic_strain() == 0.0).all()


def test_a_rank_without_cells_of_the_body_takes_part():
    u = body(*KINDS[1], SOON)[0]
    none = MemorySolid("none", u, np.empty(0, np.int32), SOON, "q1-sri")
    bend(u)
    assert none.evaluate(1.0, tangent=True) and none.evaluate_elastic()
    assert (forces(none) == 0.0).all() and (stiffness(none) == 0.0).all()
    none.commit()
    assert energy(none) == 0.0 and (none.dissipated == 0.0).all()
    assert none.largest_flow() == (0.0, 0.0)
    assert none.point_rows(none.cell_rows(none.history().origin.values)).shape == (0, 5)
    F = np.empty((0, 3, 3))
    assert none.stress_at(none.cells, None).cauchy(F, F).shape == (0, 3, 3)
