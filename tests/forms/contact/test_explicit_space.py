"""The compiled loop of an explicit pair in space against the contact term of numpy."""

from typing import get_args

import numpy as np
import pytest

from tests.contact_boxes import GAP, PENALTY, Scene, nodal_forces
from tests.forms.contact.test_explicit import LAWS, NORMAL, PROJECTION, STATE, compare
from tribox.forms.contact.explicit import ExplicitContact
from tribox.forms.contact.explicit_compiled import CompiledContact, explicit_contact
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import PressureKind
from tribox.geometry.surfaces.surface import NodalVector


def path():
    """Shift, warp of both, more warp of the slave: closing, sliding, over the end, away, back."""
    yield (0.0, 0.0, 0.03), 0.0, 0.0
    yield (0.01, 0.02, -GAP - 0.03), 0.03, 0.0
    yield (0.04, 0.03, -GAP - 0.04), 0.08, 0.01
    yield (0.09, -0.02, -GAP - 0.05), 0.08, 0.02
    yield (0.02, -0.07, -GAP + 0.04), 0.05, 0.02
    yield (0.30, 0.05, -GAP - 0.03), 0.05, 0.01
    yield (0.45, 0.35, -GAP - 0.03), 0.05, 0.01
    yield (0.1, 0.2, 9.0), 0.02, 0.0
    yield (0.2, 0.1, 9.0), 0.02, 0.0
    yield (0.05, 0.05, -GAP - 0.03), 0.05, 0.02


def pairs(shape, law, kind="averaged", fine=True):
    """A contact in numpy and the same compiled, each with surfaces of its own, and the scene."""
    scenes = [Scene(shape, LAWS[law][0], fine=fine, master=3, pressure=kind) for _ in range(2)]
    terms = []
    for scene in scenes:
        surface = scene.surface
        count = surface.vertices.count if kind == "averaged" else len(surface.slave.weight)
        penalty = PENALTY * np.linspace(0.8, 1.25, count)
        terms.append(ContactTerm(surface, *_law(law, penalty), kind))
    contact = explicit_contact(terms[1])
    assert isinstance(contact, CompiledContact)
    return scenes[0], terms[0], contact


def _law(name, penalty):
    law, film = LAWS[name]
    return law, penalty, film


@pytest.mark.parametrize("kind", get_args(PressureKind))
@pytest.mark.parametrize(("shape", "law"), [("hex8", "map"), ("tet4", "coulomb")])
def test_the_same_contact_along_a_path(shape, law, kind):
    """Closest points, slip, law, loads and history, inside facets, on sides, at corners, afar."""
    scene, reference, contact = pairs(shape, law, kind)
    u, out = (NodalVector(scene.space) for _ in range(2))
    seen = dict.fromkeys(("on a side", "at a corner", "past the end", "lost", "far"), False)
    for step, (shift, bend, more) in enumerate(path()):
        x = scene.vector(shift, bend, 0.4, more)
        u.owned[:] = x.array_r
        out.owned[:] = 1.0
        expected, trial = reference.evaluate(x, 0.5), contact.evaluate(u, 0.5)
        contact.add_forces(out)
        at = expected.projection
        compare(trial.projection, at, PROJECTION, step)
        compare(
            trial.kinematics, expected.kinematics, ("closed", "slip", "way", "elastic_slip"), step
        )
        compare(trial, expected, ("position", "area_ratio", "pressure", "film", "traction"), step)
        if kind == "averaged":
            normals = trial.normal_contact, expected.normal_contact
            reference.cover(expected), contact.term.cover(trial)  # found where it is asked for
            compare(*normals, NORMAL, step)
            compare(trial.faded, expected.faded, ("share", "sunk", "lost"), step)
            seen["lost"] |= bool(expected.faded.lost.any())
        force = nodal_forces(reference, expected, len(scene.where))
        np.testing.assert_allclose(out.owned.reshape(-1, 3) - 1.0, force, atol=1e-12)
        clamped = at.clamped & at.on_surface
        seen["on a side"] |= bool((clamped & at.along.any(axis=1)).any())
        seen["at a corner"] |= bool((at.clamped & ~at.along.any(axis=1)).any())
        seen["past the end"] |= bool((~at.on_surface).any())
        seen["far"] |= bool(len(reference.surface.target.search._far))
        expected.slave_tangents = None  # explicit steps are so short that closest points serve
        reference.commit(expected)
        contact.commit()
        compare(contact.term.state, reference.state, STATE, step)
    assert all(seen[name] for name in seen if name != "lost")
    assert seen["lost"] == (kind == "averaged")


def test_film_correction_is_that_of_numpy():
    """The traction carried from step to step, its correction, its work and its loads."""
    scene, term, contact = pairs("hex8", "map")
    both = ExplicitContact(term), contact
    vectors = [[NodalVector(scene.space) for _ in range(4)] for _ in both]
    rng = np.random.default_rng(3)
    motion = rng.standard_normal((2, scene.size))
    inverse = rng.uniform(1.0, 3.0, scene.size)
    for step in range(4):
        x = scene.vector((0.02 * step, 0.01 * step, -GAP - 0.03), 0.05, 0.4)
        for pair, (u, v, a, out) in zip(both, vectors, strict=True):
            u.owned[:], v.owned[:], a.owned[:] = x.array_r, *motion
            out.owned[:] = 0.0
            pair.evaluate(u, 0.1)
            pair.refresh_compliance(inverse, a)
            a.owned[:] = motion[1]
            pair.hold_film()
            pair.add_forces(out)
            pair.correct_film(v, 0.9, a, 0.1, out)
        compare(both[1], both[0], ("film", "compliance", "film_traction"), step, 1e-11)
        compare(both[1].trial, both[0].trial, ("traction",), step, 1e-11)
        parts = [pair.trial.response.dissipation for pair in both]
        compare(*parts[::-1], ("viscous", "numerical"), step, 1e-11)
        np.testing.assert_allclose(vectors[1][3].owned, vectors[0][3].owned, atol=1e-11)
        assert np.abs(both[0].film_traction).max() > 0.1
        for pair in both:
            pair.commit()
