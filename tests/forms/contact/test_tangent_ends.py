"""Tangent along rays, at the end of the master, and of the film at the rim of the contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import forms.contact.tangent
from forms.contact.tangent import PairTangent
from geometry.surfaces.rays import RaySearch
from geometry.surfaces.slave_normals import CHORDS
from tests.forms.contact.test_tangent import STATES, prepared, without

MODULUS = 5.0  # E* that puts ends of the contact inside facets
OVER = {"right": 0.3, "far right": 0.55, "left": -0.45}  # shifts past an end of the master
NAMES = ("slip", "stick", "film")


@pytest.fixture
def along_rays(monkeypatch):
    """Flat masters count as kinked, so that points are projected along the slave's normals."""
    make_ready = RaySearch.__init__

    def kinked(self, *arguments):
        make_ready(self, *arguments)
        self.has_kinks = True

    monkeypatch.setattr(RaySearch, "__init__", kinked)


def scene_of(shape="Q4", name="film", shift=0.0, modulus=None):
    state = STATES[name]
    if shift:
        state = replace(state, before=(shift, 0.0, -0.12), now=(shift + 0.03, 0.0, -0.14))
    scene, x = prepared(shape, state, bend=0.1, fine=True, degree=9)
    scene.term.modulus = modulus
    return scene, x


@pytest.mark.parametrize("shape", ["T3", "Q4", "Q9"])
@pytest.mark.parametrize("name", STATES)
def test_tangent_along_rays(along_rays, shape, name):
    scene, x = scene_of(shape, name)
    trial = scene.residual(x)[1]
    assert trial.projection.rays is not None and np.count_nonzero(trial.pressure) >= 2
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
    scene, x = scene_of(shape, modulus=MODULUS)
    normal = scene.residual(x)[1].normal_contact
    assert normal.cover_slope is not None and normal.rim.any()
    assert np.any((normal.cover > 0.0) & (normal.cover < 1.0))
    assert scene.error(x) < 1e-9


def test_only_films_take_the_cover():
    """A dry contact with a modulus has the tangent that it has without."""
    for name in "slip", "film":
        scene, x = scene_of("Q4", name)
        plain = scene.tangent(x)
        scene.term.modulus, scene.term._last = MODULUS, None
        assert np.array_equal(scene.tangent(x), plain) == (name == "slip")


# -- each term is needed --------------------------------------------------------------------------


def without_function(name):
    """A part of the traction's change that is left out."""

    def switch(patch):
        whole = getattr(forms.contact.tangent, name)
        patch.setattr(forms.contact.tangent, name, lambda *a: 0.0 * whole(*a))

    return switch


def without_chords(patch):
    patch.setattr(forms.contact.tangent, "CHORDS", 0.0 * CHORDS)


def with_plain_gaps(patch):
    """∂(σ g)/∂u without the change of σ and of the rays."""
    whole = PairTangent._varied_gap_rows

    def less(self, state, trial, take, needs):
        at = trial.projection
        slope = None if at.share_slope is None else 0.0 * at.share_slope
        less = replace(trial, projection=replace(at, share_slope=slope))
        return whole(self, state, less, take, needs)

    patch.setattr(PairTangent, "_varied_gap_rows", less)


def without_rim(patch):
    """Open vertices at the rim have no rows."""
    kind = forms.contact.state.NormalContact
    patch.setattr(kind, "needs", lambda self: self.active)


# What is left out, whether along rays, the shift and the modulus.
TERMS = {
    "gap along rays": (without("d_gap"), True, 0.0, None),
    "normal along rays": (without("d_normal"), True, 0.0, None),
    "chords": (without_chords, True, 0.0, None),
    "fading traction": (without_function("_fading"), False, 0.3, None),
    "fading gap": (with_plain_gaps, False, 0.3, None),
    "fading film": (without_function("_film_per_cover"), False, 0.3, None),
    "film at the rim": (without_function("_film_per_cover"), False, 0.0, MODULUS),
    "open vertices at the rim": (without_rim, False, 0.0, MODULUS),
}


@pytest.mark.parametrize("name", TERMS)
def test_each_term_is_needed(request, monkeypatch, name):
    switch, rays, shift, modulus = TERMS[name]
    if rays:
        request.getfixturevalue("along_rays")
    scene, x = scene_of("Q4", "film", shift, modulus)
    assert scene.error(x) < 1e-9
    switch(monkeypatch)
    scene.term._last = None
    assert scene.error(x) > 1e-5
