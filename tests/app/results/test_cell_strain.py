"""Strain in the plane in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from tribox.app.results.fields import strain_in_plane, strain_in_space


@pytest.mark.parametrize("size", [0.0, 1e-13, 1e-6, 1e-2, 0.3])
def test_closed_form_is_the_spectral_decomposition(size):
    rng = np.random.default_rng(3)
    F = np.tile(np.eye(3), (400, 1, 1))
    F[:, :2, :2] += size * rng.uniform(-1.0, 1.0, (400, 2, 2))
    F[:, 2, 2] += size * rng.uniform(-1.0, 1.0, 400)
    turn = rng.uniform(0.0, 2.0 * np.pi, 400)
    c, s = np.cos(turn), np.sin(turn)
    F[:, :2, :2] = np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], 1) @ F[:, :2, :2]
    ours, theirs = strain_in_plane(F), strain_in_space(F)
    np.testing.assert_allclose(ours.J, theirs.J, rtol=1e-14)
    np.testing.assert_allclose(ours.max_stretch, theirs.max_stretch, rtol=1e-14)
    np.testing.assert_allclose(ours.log_strain, theirs.log_strain, atol=2e-14)


def test_strain_of_a_rotated_stretch_is_that_by_hand():
    angle = 0.7
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    F = turn @ np.diag([2.0, 0.25, 1.5])
    found = strain_in_plane(F[None])
    by_hand = turn @ np.diag(np.log([2.0, 0.25, 1.5])) @ turn.T
    np.testing.assert_allclose(found.log_strain[0], by_hand, atol=1e-15)
    assert found.max_stretch[0] == pytest.approx(2.0) and found.J[0] == pytest.approx(0.75)
