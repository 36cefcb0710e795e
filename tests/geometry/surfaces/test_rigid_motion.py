"""Control points of a tool that is displaced and turned, and how they change with its unknowns."""

import numpy as np
import pytest

from tribox.geometry.surfaces.rigid_motion import RigidMotion

PLANE = RigidMotion(np.array([0.3, -0.2]), np.array([[1.0, 0.5], [0.2, 0.4], [-0.7, 2.0]]), 0.7)
SPACE = RigidMotion(
    np.array([0.3, -0.2, 0.5]),
    np.array([[1.0, 0.5, 0.1], [0.2, 0.4, -0.3], [-0.7, 2.0, 0.6], [0.1, 0.2, 0.9]]),
    0.7,
    np.array([1.0, 2.0, -2.0]),
)
MOTIONS = [PLANE, SPACE]


@pytest.mark.parametrize("motion", MOTIONS, ids=["plane", "space"])
@pytest.mark.parametrize("theta", [0.0, 0.6, -2.5])
def test_derivatives_are_those_of_the_control_points(motion, theta):
    dim = motion.dim
    values = np.linspace(-0.4, 0.8, 2 * dim).reshape(2, dim)
    values[1, 0] = theta * motion.length
    flat, h = values.reshape(-1), 1e-5

    def placed(unknowns):
        return motion.control_points(*motion.read(unknowns.reshape(2, dim)))

    steps = h * np.eye(2 * dim)
    slopes = [(placed(flat + d) - placed(flat - d)) / (2.0 * h) for d in steps]
    tangent = motion.tangent(theta)
    np.testing.assert_allclose(tangent, np.stack(slopes, axis=2), atol=1e-8)
    turned = h * np.eye(2 * dim)[dim]
    sides = [
        motion.tangent(motion.read((flat + s * turned).reshape(2, dim))[1]) for s in (1.0, -1.0)
    ]
    change = (sides[0] - sides[1]) / (2.0 * h)
    np.testing.assert_allclose(change[:, :, dim], motion.bend(theta), atol=1e-8)
    np.testing.assert_array_equal(np.delete(change, dim, axis=2), 0.0)


@pytest.mark.parametrize("motion", MOTIONS, ids=["plane", "space"])
def test_distances_are_kept_and_the_axis_stays(motion):
    arms = motion.points - motion.centre
    turned = motion.control_points(np.zeros(motion.dim), 1.1) - motion.centre
    np.testing.assert_allclose(turned @ turned.T, arms @ arms.T, atol=1e-14)
    if motion.axis is not None:
        np.testing.assert_allclose(motion.rotation(1.1) @ motion.axis, motion.axis, atol=1e-14)


def test_turns_are_counter_clockwise_and_right_handed():
    quarter = PLANE.rotation(0.5 * np.pi)
    np.testing.assert_allclose(quarter @ [1.0, 0.0], [0.0, 1.0], atol=1e-15)
    about_z = RigidMotion(np.zeros(3), np.zeros((4, 3)), 1.0, np.array([0.0, 0.0, 2.0]))
    turned = about_z.rotation(0.5 * np.pi)
    np.testing.assert_allclose(turned @ [1.0, 0.0, 5.0], [0.0, 1.0, 5.0], atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(turned), 1.0, rtol=1e-15)
