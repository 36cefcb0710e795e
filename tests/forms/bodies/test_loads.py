"""Follower pressure: force, work and tangent, on surfaces that turn and stretch."""

import dolfinx
import numpy as np
import pytest

from tests.grid import grid
from tribox.forms.bodies.loads import FollowerPressure, reference_area

P = 0.7


@pytest.fixture(scope="module", params=["quadrilateral", "triangle"])
def block(request):
    """A rectangle of 2 by 1."""
    mesh = grid(request.param, (4, 3), [2.0, 1.0])
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    return dolfinx.fem.Function(space)


def facets(u, where=lambda X: np.full(X.shape[1], True)):
    return dolfinx.mesh.locate_entities_boundary(u.function_space.mesh, 1, where)


def right(X):
    return np.isclose(X[0], 2.0)


def pressed(u, surface):
    load = FollowerPressure(u, surface)
    load.set(P)
    return load


def move(u, motion):
    u.interpolate(lambda X: motion(X[:2].T).T)


def wavy(X):
    return 0.2 * np.sin(2.0 * X[:, ::-1] + X) + X @ [[0.2, 0.5], [-0.4, 0.1]]


def residual(load):
    return dolfinx.fem.assemble_vector(load.residual).array.reshape(-1, 2)


def positions(u):
    return u.function_space.tabulate_dof_coordinates()[:, :2] + u.x.array.reshape(-1, 2)


def test_force_on_a_turned_and_stretched_side(block):
    """p times the current length, against the current normal; the residual is minus the force."""
    F = np.array([[0.6, -1.1], [0.9, 0.8]])
    move(block, lambda X: X @ (F - np.eye(2)).T)
    load = pressed(block, facets(block, right))
    side = F @ [0.0, 1.0]
    outward = np.array([side[1], -side[0]])  # the side runs upwards, the body is on its left
    np.testing.assert_allclose(residual(load).sum(axis=0), P * outward, rtol=1e-12)
    # Spread evenly along the side: half as much on each end node as on the others.
    forces = np.linalg.norm(residual(load), axis=1)
    loaded = np.sort(forces[forces > 1e-12])
    np.testing.assert_allclose(loaded, P * np.linalg.norm(side) * np.array([1, 1, 2, 2]) / 6)


def test_pressure_all_round_has_no_resultant_and_no_moment(block):
    move(block, wavy)
    forces = residual(pressed(block, facets(block)))
    now = positions(block)
    assert np.abs(forces).max() > 0.1
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-13)
    moment = now[:, 0] @ forces[:, 1] - now[:, 1] @ forces[:, 0]
    assert moment == pytest.approx(0.0, abs=1e-13)


def test_work_conjugate_of_pressure_all_round_is_the_area(block):
    """δW = −p δA: the residual is p times the derivative of the enclosed area."""
    move(block, wavy)
    forces = residual(pressed(block, facets(block)))
    at = block.function_space.tabulate_dof_coordinates()[:, :2]
    table = {(round(2 * x), round(3 * y)): n for n, (x, y) in enumerate(at)}
    # Round the rectangle against the clock.
    ring = [table[i, 0] for i in range(4)] + [table[4, j] for j in range(3)]
    ring += [table[4 - i, 3] for i in range(4)] + [table[0, 3 - j] for j in range(3)]

    def area(now):
        x, y = now[ring].T
        return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))

    now, h = positions(block), 1e-5
    assert area(at) == pytest.approx(2.0)
    for n in ring:
        for i in range(2):
            step = np.zeros_like(now)
            step[n, i] = h
            slope = (area(now + step) - area(now - step)) / (2.0 * h)
            assert forces[n, i] == pytest.approx(P * slope, abs=1e-9)


def test_tangent_against_finite_differences(block):
    move(block, wavy)
    load = pressed(block, facets(block, right))
    A = dolfinx.fem.assemble_matrix(load.tangent).to_dense()
    assert np.abs(A).max() > 0.1
    x, rng, h = block.x.array.copy(), np.random.default_rng(1), 1e-5
    for _ in range(3):
        d = rng.normal(size=len(x))
        block.x.array[:] = x + h * d
        after = residual(load)
        block.x.array[:] = x - h * d
        before = residual(load)
        block.x.array[:] = x
        np.testing.assert_allclose(
            A @ d, ((after - before) / (2.0 * h)).reshape(-1), rtol=0, atol=1e-9
        )


def test_reference_area(block):
    mesh = block.function_space.mesh
    assert reference_area(mesh, facets(block)) == pytest.approx(6.0, rel=1e-13)
    assert reference_area(mesh, facets(block, right)) == pytest.approx(1.0, rel=1e-13)
