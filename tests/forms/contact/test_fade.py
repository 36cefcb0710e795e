"""Pressure that fades over a stated length before the open end of a master."""

from dataclasses import replace

import numpy as np
import pytest

from tests.contact_boxes import take_all_for_kinked
from tests.forms.contact.test_tangent import STATES, prepared


def leaving(shape, name, length=0.3):
    dim = 3 if shape in ("tet4", "hex8", "hex27") else 2
    before, now = [0.37] + [0.02] * (dim - 2) + [-0.12], [0.4] + [0.03] * (dim - 2) + [-0.14]
    padded = [
        [*way[:-1], *[0.0] * (3 - dim), way[-1]] if dim == 2 else way for way in (before, now)
    ]
    state = replace(STATES[name], before=tuple(padded[0]), now=tuple(padded[1]))
    scene, x = prepared(shape, state, bend=0.1, fine=True, degree=5, fade_length=length)
    scene.term.modulus = 5.0
    return scene, x


@pytest.mark.parametrize("shape", ["T3", "Q9", "tet4", "hex8"])
@pytest.mark.parametrize("name", ["slip", "stick", "film"])
def test_tangent_where_the_pressure_fades(shape, name):
    scene, x = leaving(shape, name)
    trial = scene.residual(x)[1]
    at = trial.projection
    fading = (at.share > 0.0) & (at.share < 1.0) & (trial.pressure > 0.0)
    assert np.count_nonzero(fading) > 3 and not at.on_surface.all()
    assert scene.error(x) < 1e-8


def test_tangent_where_it_fades_along_rays(monkeypatch):
    take_all_for_kinked(monkeypatch)
    scene, x = leaving("Q4", "slip")
    assert scene.residual(x)[1].projection.rays is not None
    assert scene.error(x) < 1e-9


@pytest.mark.parametrize("name", ["slip", "stick", "film"])
def test_tangent_where_another_master_begins(name):
    """Points past the end press by what is left of their share, which is not none."""
    scene, x = leaving("Q4", name, length=None)
    surface, term = scene.surface, scene.term
    ends = surface.master.position[np.argmax(surface.master.position[:, 0])][None]
    surface.slave.reach *= 4.0
    surface.target.ends.join(ends, 1e-6)
    term.rule.others = 0.6 * surface.vertices.area
    trial = scene.residual(x)[1]
    at = trial.projection
    past = at.on_surface & (surface.target.shape.excess(at.xi) > 0.0) & (at.share > 0.0)
    grows = trial.normal_contact.grows & trial.normal_contact.active
    assert past.any() and grows.any()
    assert scene.error(x) < 1e-9
