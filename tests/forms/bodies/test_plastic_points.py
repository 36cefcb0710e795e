"""Plastic points: tangent against differences, invariances, bad input."""

import numpy as np
import pytest

from tests.forms.bodies import plastic_samples as given
from tribox.forms.bodies.elastoplastic import ElastoPlastic, PlasticPoints
from tribox.forms.bodies.hardening import JohnsonCook, Perzyna, Voce
from tribox.forms.bodies.materials import Hencky
from tribox.forms.bodies.point_stress import PointStress

FIELDS = ("P", "state", "A", "elastic", "dissipation", "numerical")
both = pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])


def gathered(points):
    """All samples in one batch, and their names by point."""
    found = given.samples(points)
    names = [name for name, (F, _) in found.items() for _ in F]
    F, state = (np.concatenate(arrays) for arrays in zip(*found.values(), strict=True))
    return F, state, np.array(names)


def differences(stress, F, h=3e-6):
    """dP/dF (n, p, p) of fourth order."""
    columns = []
    for direction in np.eye(F.shape[1]):
        P = [stress(F + k * h * direction) for k in (-2, -1, 1, 2)]
        columns.append((P[0] - 8.0 * P[1] + 8.0 * P[2] - P[3]) / (12.0 * h))
    return np.stack(columns, axis=2)


@pytest.mark.parametrize("rate", given.RATES)
@pytest.mark.parametrize("volumetric", [True, False], ids=["whole", "distortional"])
@both
def test_the_tangent_is_the_derivative_of_the_stress(space, volumetric, rate):
    points = PlasticPoints(given.material("voce", rate), space)
    F, state, names = gathered(points)
    update = points.update(F, state, 0.1, True, volumetric)
    flowed = update.dissipation > 0.0
    elastic = np.isin(names, ["elastic", "same stretch", "undeformed"])
    assert update.valid and flowed[~elastic].all()
    assert not flowed[elastic].any() or rate == "perzyna"
    wanted = differences(lambda x: points.update(x, state, 0.1, False, volumetric).P, F)
    largest = np.abs(update.A).max(axis=(1, 2))
    error = np.abs(update.A - wanted).max(axis=(1, 2)) / largest
    assert error.max() < 1e-7, names[np.argmax(error)]
    transposed = np.swapaxes(update.A, 1, 2)
    assert (np.abs(update.A - transposed).max(axis=(1, 2)) < 1e-14 * largest).all()


def test_a_plane_is_a_plane_in_space():
    plane, space = (PlasticPoints(given.material(), s) for s in (False, True))
    F, state, _ = gathered(plane)
    embedded = np.insert(state, 4, 0.0, axis=1)
    embedded = np.insert(embedded, 4, 0.0, axis=1)
    one = plane.update(F, state, 1.0, True)
    other = space.update(given.components(given.tensors(F), True), embedded, 1.0, True)
    rest = [2, 5, 6, 7]
    wanted = {
        "P": other.P[:, given.PLANE],
        "A": other.A[:, given.PLANE][:, :, given.PLANE],
        "state": other.state[:, [0, 1, 2, 3, 6]],
    }
    for field in FIELDS:
        b = wanted.get(field, getattr(other, field))
        np.testing.assert_allclose(getattr(one, field), b, rtol=0, atol=1e-12 * np.abs(b).max())
    assert np.abs(other.P[:, rest]).max() < 1e-14 * np.abs(other.P).max()
    assert np.abs(other.A[:, given.PLANE][:, :, rest]).max() < 1e-12 * np.abs(other.A).max()


@both
def test_elastic_points_are_those_of_hencky(space):
    points = PlasticPoints(given.material(), space)
    F = given.gradients(9, space, 3, 4e-4)
    update = points.update(given.components(F, space), points.start(9), 1.0, False)
    kirchhoff = given.tensors(update.P) @ np.swapaxes(F, 1, 2)
    section = "3D" if space else "axisymmetric"
    cauchy = PointStress(Hencky(given.SHEAR, given.BULK), section).cauchy(F)
    wanted = cauchy * np.linalg.det(F)[:, None, None]
    np.testing.assert_allclose(kirchhoff, wanted, rtol=0, atol=3e-15 * given.BULK)
    e = 0.5 * np.log(np.linalg.eigvalsh(F @ np.swapaxes(F, 1, 2)))
    deviator = ((e - e.mean(axis=1)[:, None]) ** 2).sum(axis=1)
    energy = given.SHEAR * deviator + 0.5 * given.BULK * e.sum(axis=1) ** 2
    np.testing.assert_allclose(update.elastic, energy, rtol=1e-9)
    np.testing.assert_array_equal(update.state, points.start(9))
    assert not update.dissipation.any() and not update.numerical.any()


@both
def test_the_distortional_part_is_what_the_bulk_modulus_does_not_change(space):
    """P − P_dev is K ln J F⁻ᵀ, and the memory is the same."""
    points = PlasticPoints(given.material(), space)
    F, state, _ = gathered(points)
    whole, part = (points.update(F, state, 1.0, False, v) for v in (True, False))
    tensor = given.tensors(F)
    volume = given.BULK * np.log(np.linalg.det(tensor))
    wanted = volume[:, None, None] * np.swapaxes(np.linalg.inv(tensor), 1, 2)
    difference = given.tensors(whole.P - part.P)
    np.testing.assert_allclose(difference, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    np.testing.assert_array_equal(whole.state, part.state)
    np.testing.assert_allclose(
        whole.elastic - part.elastic, 0.5 * volume**2 / given.BULK, rtol=0, atol=1e-14
    )


@pytest.mark.parametrize("rate", [None, "johnson-cook", "perzyna"])
def test_units_change_nothing(rate):
    """GPa and s against Pa and ms."""
    pascal, milli = 1e9, 1e3
    law = given.LAWS["voce"]
    scaled = Voce(law.yield_stress * pascal, law.saturation_stress * pascal, 12.0, 0.05 * pascal)
    rates = {
        None: (None, None),
        "johnson-cook": (JohnsonCook(0.015, 0.01), JohnsonCook(0.015, 0.01 / milli)),
        "perzyna": (Perzyna(50.0, 0.25), Perzyna(50.0 / milli, 0.25)),
    }[rate]
    first = PlasticPoints(ElastoPlastic(given.SHEAR, given.BULK, law, rates[0]), False)
    moduli = given.SHEAR * pascal, given.BULK * pascal
    second = PlasticPoints(ElastoPlastic(*moduli, scaled, rates[1]), False)
    F, state, _ = gathered(first)
    one = first.update(F, state, 0.1, True)
    other = second.update(F, state, 0.1 * milli, True)
    for field in FIELDS:
        a, b = getattr(one, field), getattr(other, field)
        b = b if field == "state" else b / pascal
        np.testing.assert_allclose(b, a, rtol=0, atol=1e-12 * np.abs(a).max())


@both
def test_a_point_at_yield_has_the_tangent_of_loading(space):
    """At the committed deformation, where a step begins; the memory stays to the last bit."""
    points = PlasticPoints(given.material("linear"), space)
    F, state = given.worked(points, 5)
    rows = given.components(F, space)
    at = points.update(rows, state, 1.0, True)
    np.testing.assert_array_equal(at.state, state)
    stress = given.tensors(at.P) @ np.swapaxes(F, 1, 2)
    h = 1e-7
    more = F + h * (stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)) @ F
    onward = given.components(more, space)
    rise = points.update(onward, state, 1.0, False).P - at.P
    wanted = np.einsum("npq,nq->np", at.A, onward - rows)
    np.testing.assert_allclose(rise, wanted, rtol=0, atol=1e-4 * np.abs(wanted).max())
    assert not at.dissipation.any()


@both
def test_an_impossible_deformation_is_told_and_leaves_the_others_alone(space):
    points = PlasticPoints(given.material(), space)
    F, state = given.worked(points, 11)
    F = given.components(given.gradients(11, space, 8) @ F, space)
    good = points.update(F, state, 1.0, True)
    bad, states = F.copy(), state.copy()
    bad[1] *= -1.0
    bad[3] = 0.0
    bad[4, 1] = np.nan
    bad[6, 0] = np.inf
    bad[7] *= 1e200
    bad[8, -1] = -bad[8, -1] if not space else np.nan
    states[9, 1] = np.nan
    found = points.update(bad, states, 1.0, True)
    wrong = np.array([1, 3, 4, 6, 7, 8, 9])
    right = np.setdiff1d(np.arange(11), wrong)
    assert good.valid and not found.valid
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(found, field)[right], getattr(good, field)[right])
        if field != "state":
            assert np.isnan(getattr(found, field)[wrong]).all()
    np.testing.assert_array_equal(found.state[wrong], states[wrong])


@both
def test_no_points_and_arrays_of_any_layout(space):
    points = PlasticPoints(given.material(), space)
    p = points.components
    none = points.update(np.zeros((0, p)), points.start(0), 1.0, True)
    assert none.valid and none.P.shape == (0, p) and none.A.shape == (0, p, p)
    assert none.state.shape == (0, len(points.first)) and none.elastic.shape == (0,)
    F, state, _ = gathered(points)
    wanted = points.update(F, state, 1.0, True)
    F, state = np.asfortranarray(F), np.repeat(state, 2, axis=0)[::2]
    F.flags.writeable = state.flags.writeable = False
    before = F.copy(), state.copy()
    found = points.update(F, state, 1.0, True)
    for field in FIELDS:
        a, b = getattr(found, field), getattr(wanted, field)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-13 * np.abs(b).max())
    np.testing.assert_array_equal(F, before[0])
    np.testing.assert_array_equal(state, before[1])


@pytest.mark.parametrize(
    ("F", "state", "dt", "rate", "words"),
    [
        (np.zeros((2, 9)), np.zeros((2, 5)), 1.0, "no rate", r"\(2, 9\), \(2, 5\), not"),
        (np.zeros((2, 5)), np.zeros((3, 5)), 1.0, "no rate", r"\(3, 5\)"),
        (np.zeros((2, 5)), np.zeros((2, 5)), 0.0, "perzyna", "dt is 0.0"),
        (np.zeros((2, 5)), np.zeros((2, 5)), float("nan"), "johnson-cook", "dt is nan"),
    ],
)
def test_wrong_shapes_and_steps_are_refused(F, state, dt, rate, words):
    with pytest.raises(ValueError, match=words):
        PlasticPoints(given.material("linear", rate), False).update(F, state, dt, False)
