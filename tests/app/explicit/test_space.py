"""Explicit dynamics in space and round an axis: mean forces, rings, initial velocities."""

import dolfinx
import numpy as np
import pytest
import scipy.linalg
from mpi4py import MPI

from tests.app.case.test_generators_3d import COMMON, RINGS
from tests.contact_boxes import GAP, Scene
from tests.forms.bodies.in_forms import forms_of
from tests.grid import grid
from tests.laws import coulomb
from tribox.app.case.reading import check_case
from tribox.app.equilibrium.constraints import Prescribed
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.simulation.contact_resultants import measure_contact
from tribox.app.simulation.explicit_stage import IntervalAverages
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.explicit_compiled import explicit_contact
from tribox.geometry.surfaces.surface import NodalVector

SOFT = NeoHookean(shear_modulus=1.0, bulk_modulus=5.0)
WAY = np.array([0.6, 0.8, 0.0])


def dragged(shape, formulation="q1"):
    """Two boxes, pressed and dragged by the top in ``WAY``."""
    scene = Scene(shape, coulomb(0.3))
    cells = np.arange(scene.space.mesh.topology.index_map(3).size_local, dtype=np.int32)
    u = dolfinx.fem.Function(scene.space)
    held = []
    for height in (-0.5, 0.5):
        at = np.nonzero(np.isclose(scene.where[:, 2], height))[0]
        held += [Prescribed((3 * at + i).astype(np.int32), 0.0) for i in range(3)]
    solid = Solid("both", u, cells, SOFT, formulation, density=1.0)
    return scene, held[3:], Equilibrium(u, [solid], [scene.term], held)


def drive(top, step):
    """Move the top to where it is in a step: down, and in ``WAY``."""
    move = [*(0.05 * step / 80 * WAY[:2]), -(GAP + 0.03 * min(step / 20, 1.0))]
    for part, value in zip(top, move, strict=True):
        part.value = value


@pytest.mark.parametrize("shape", ["hex8", "tet4"])
def test_the_stable_step(shape):
    """It is that of the assembled stiffness, and looking for it moves nothing."""
    _, _, problem = dragged(shape)
    u = problem.u.x.array
    u[:] = 1e-2 * np.sin(np.arange(len(u)))
    u[problem.constrained_dofs()] = 0.0
    before = u.copy()
    stepper = ExplicitStepper(problem)
    found = stepper.estimate().elements
    np.testing.assert_array_equal(u, before)
    matrices = [dolfinx.fem.assemble_matrix(part.tangent) for part in forms_of(problem.solids[0])]
    stiffness = sum(matrix.to_scipy().toarray() for matrix in matrices)
    free = np.setdiff1d(np.arange(len(u)), problem.constrained_dofs())
    values = scipy.linalg.eigh(
        stiffness[np.ix_(free, free)], np.diag(stepper.dynamics.mass[free]), eigvals_only=True
    )
    assert found == pytest.approx(2.0 / np.sqrt(values[-1]), rel=2e-2)
    assert found <= 2.0 / np.sqrt(values[-1])


@pytest.mark.parametrize("shape", ["hex8", "tet4"])
def test_rows_hold_mean_vectors(shape):
    """Force, friction and twist of an interval are means over its steps."""
    scene, top, problem = dragged(shape)
    stepper = ExplicitStepper(problem)
    dt = 0.5 * stepper.stable_step()
    averages, sums, normals = IntervalAverages(stepper), [], []
    weight = scene.surface.slave.weight
    for step in range(80):
        drive(top, step)
        stepper.advance(dt)
        averages.enter(dt)
        trial = problem.trials[0]
        friction = trial.response.traction
        moment = weight @ np.cross(trial.position, friction)
        load = weight * trial.pressure
        both = [weight @ trial.traction, weight @ friction, moment, load @ trial.position]
        sums.append([*both, [load.sum(), 0.0, 0.0]])
        normals.append((weight * (trial.pressure > 0.0)) @ trial.kinematics.normal)
    force, friction, moment, centre, load = np.mean(sums, axis=0)
    end = measure_contact(scene.term, problem.committed[0], MPI.COMM_SELF, WAY)
    [found], *_ = averages.close([end], WAY)
    np.testing.assert_allclose(found.force, force, rtol=1e-10)
    np.testing.assert_allclose(found.friction, friction, rtol=1e-10)
    assert np.linalg.norm(np.subtract(end.force, force)) > 0.01 * np.linalg.norm(force)
    # The interface stays nearly level: the mean normal is z, the way along it that of the drive.
    assert found.normal_resultant == pytest.approx(force[2], rel=1e-2)
    assert found.normal_force == pytest.approx(load[0], rel=1e-10)
    assert found.tangential_force == pytest.approx(friction @ WAY, rel=1e-2)
    # A small tilt already counts in the drag, of which the load is a multiple.
    normal = np.mean(normals, axis=0)
    normal /= np.linalg.norm(normal)
    along = WAY - (WAY @ normal) * normal
    along /= np.linalg.norm(along)
    assert found.drag == pytest.approx(-force @ along, rel=1e-10)
    twist = moment - np.cross(centre / load[0], friction)
    assert found.twist_moment == pytest.approx(twist @ normal, rel=1e-10)


def test_a_ring_breathes():
    """A thin ring of radius R thrown outwards swings with ω = √(E/ρ)/R."""
    radius, size, density = 10.0, 0.2, 2.0
    low, high = [radius - 0.5 * size, 0.0], [radius + 0.5 * size, size]
    mesh = grid("quadrilateral", (2, 2), high, low)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,))))
    solid = Solid("ring", u, np.arange(4, dtype=np.int32), SOFT, "q1-sri", density, "axisymmetric")
    stepper = ExplicitStepper(Equilibrium(u, [solid], []), velocity=np.tile([1e-4, 0.0], 9))
    volume = 2.0 * np.pi * radius * size**2
    assert stepper.dynamics.mass[::2].sum() == pytest.approx(density * volume, rel=1e-12)
    energy = stepper.kinetic_energy()
    assert energy == pytest.approx(0.5 * density * volume * 1e-8, rel=1e-12)
    before = u.x.array.copy()
    dt, moved = 0.9 * stepper.stable_step(), [0.0]
    np.testing.assert_array_equal(u.x.array, before)
    young = 9.0 * 5.0 * 1.0 / (3.0 * 5.0 + 1.0)
    expected = np.sqrt(young / density) / radius
    while stepper.time < 1.1 * np.pi / expected:
        stepper.advance(dt)
        moved.append(float(np.mean(u.x.array[::2])))
    after = int(np.nonzero(np.array(moved[1:]) < 0.0)[0][0])
    share = moved[after] / (moved[after] - moved[after + 1])
    assert np.pi / ((after + share) * dt) == pytest.approx(expected, rel=2e-3)
    assert max(moved) == pytest.approx(1e-4 / expected, rel=0.02)


def test_the_area_of_a_ring_grows_with_its_radius():
    """The explicit pair stretches like the implicit one; loops for the plane alone do not."""
    scene = Scene("Q4", coulomb(0.3), axisymmetric=True)
    pair = explicit_contact(scene.term)
    u = NodalVector(scene.space)
    u.owned[:] = (0.1 * scene.where[: len(u.owned) // 2, :2] * [1.0, 0.0]).reshape(-1)
    np.testing.assert_allclose(pair.evaluate(u, 1.0).area_ratio, 1.1**2, rtol=1e-12)


@pytest.mark.parametrize(
    ("section", "velocity", "said"),
    [
        ("plane-strain", "z = 3", "velocity.z = 3.0: there is no z in a mesh in the plane"),
        ("axisymmetric", "x = 3", "velocity.x = 3.0: a body of revolution cannot be thrown off"),
        ("axisymmetric", "y = 3", None),
    ],
)
def test_a_body_is_thrown_where_it_can_go(section, velocity, said, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(RINGS + COMMON)
    changes = [f"geometry.section={section}", 'solver={ kind = "explicit" }']
    changes += [f"bodies.{name}.density=1000" for name in ("elastomer", "aluminium")]
    lines = check_case(path, [*changes, f"bodies.elastomer.velocity={{ {velocity} }}"])
    assert [said in line for line in lines] == ([True] if said else []), lines
