"""Tangent along rays, at the end of the master, and of the film at the rim of the contact."""

from dataclasses import replace

import numpy as np
import pytest

from tests.contact_boxes import take_all_for_kinked
from tests.forms.contact.test_tangent import STATES, prepared

MODULUS = 5.0  # E* that puts ends of the contact inside facets
OVER = {"right": 0.37, "far right": 0.58, "left": -0.47}  # shifts past an end of the master
NAMES = ("slip", "stick", "film")


@pytest.fixture
def along_rays(monkeypatch):
    take_all_for_kinked(monkeypatch)


def scene_of(shape="Q4", name="film", shift=0.0, modulus=None):
    state = STATES[name]
    if shift:
        state = replace(state, before=(shift, 0.0, -0.12), now=(shift + 0.03, 0.0, -0.14))
    scene, x = prepared(shape, state, bend=0.1, fine=True, degree=9)
    scene.term.modulus = modulus
    return scene, x


def at_the_rim(shape="Q4", name="film"):
    """Some vertices are open, and the film acts on what is covered beside them."""
    state = replace(STATES[name], before=(0.01, 0.02, -0.03), now=(0.13, -0.09, -0.04))
    scene, x = prepared(shape, state, bend=0.2, fine=True, degree=5)
    scene.term.modulus = MODULUS
    return scene, x


@pytest.mark.parametrize("shape", ["T3", "Q4", "Q9"])
@pytest.mark.parametrize("name", STATES)
def test_tangent_along_rays(along_rays, shape, name):
    scene, x = scene_of(shape, name)
    trial = scene.residual(x)[1]
    assert trial.projection.rays is not None and np.count_nonzero(trial.pressure) >= 2
    assert scene.error(x) < 1e-9


def test_point_by_point_neither_rays_nor_fading_are_used(along_rays):
    """That is the method as it was published."""
    state = replace(STATES["slip"], before=(0.37, 0.0, -0.12), now=(0.4, 0.0, -0.14))
    scene, x = prepared("Q4", state, bend=0.1, fine=True, degree=9, pressure="pointwise")
    trial = scene.residual(x)[1]
    assert trial.projection.rays is None and trial.projection.share is None
    assert not trial.projection.on_surface.all() and scene.surface.normals is not None
    assert scene.error(x) < 1e-9


@pytest.mark.parametrize("shift", OVER)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("modulus", [None, MODULUS])
def test_tangent_of_points_that_leave_the_master(name, shift, modulus):
    scene, x = scene_of("Q4", name, OVER[shift], modulus)
    assert_fades(scene, x)
    assert scene.error(x) < 1e-9


@pytest.mark.parametrize("name", ["slip", "film"])
def test_tangent_of_points_that_leave_along_rays(along_rays, name):
    scene, x = scene_of("Q9", name, OVER["right"], MODULUS)
    assert_fades(scene, x)
    assert scene.error(x) < 1e-9


def assert_fades(scene, x):
    trial = scene.residual(x)[1]
    at = trial.projection
    assert at.share is not None and not at.on_surface.all()
    assert np.any((at.share < 1.0) & trial.kinematics.closed & (trial.pressure > 0.0))


@pytest.mark.parametrize("shape", ["T6", "Q4", "tet4", "hex8"])
def test_tangent_of_a_film_at_the_rim(shape):
    scene, x = at_the_rim(shape)
    normal = scene.residual(x)[1].normal_contact
    assert normal.cover_slope is not None and normal.rim.any()
    assert np.any((normal.cover > 0.0) & (normal.cover < 1.0))
    assert scene.error(x) < 1e-9


def test_only_films_take_the_cover():
    """A dry contact with a modulus has the tangent that it has without."""
    for name in "slip", "film":
        scene, x = at_the_rim("Q4", name)
        plain = scene.tangent(x)
        scene.term.modulus, scene.term._last = None, None
        assert np.array_equal(scene.tangent(x), plain) == (name == "slip")
