"""Points that flow: tangent, invariances, backstress, paths, energy, bad input.

The rate equations that paths are held against know nothing of the return mapping: F_p and F_pi are
integrated with the flow rule in the intermediate configuration, and γ̇ is what keeps f at zero.
"""

import numpy as np
import pytest
from hypothesis import given as hypothesis_given
from hypothesis import settings
from hypothesis import strategies as st

from tests.forms.bodies import plastic_samples as given
from tests.forms.bodies.test_plastic_paths import YOUNG, closed_path, free_across, shear
from tribox.forms.bodies.elastoplastic import ElastoPlastic, PlasticPoints
from tribox.forms.bodies.hardening import (
    Backstress,
    JohnsonCook,
    Linear,
    Perzyna,
    Swift,
    Table,
    Voce,
)

G, K = given.SHEAR, given.BULK
branched = pytest.mark.parametrize("branches", given.BRANCHES)
HELD = ["elastic", "same stretch", "undeformed"]
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
@branched
@both
def test_the_tangent_is_the_derivative_of_the_stress(space, branches, rate):
    points = PlasticPoints(given.material("voce", rate, branches), space)
    F, state, names = gathered(points)
    held, alone = np.isin(names, HELD), branches == "none"
    for volumetric in (True, False):
        update = points.update(F, state, 0.1, True, volumetric)
        flowed = update.dissipation > 0.0
        assert update.valid and flowed[~held].all()
        assert not alone or rate == "perzyna" or not flowed[held].any()

        def stress(x, volumetric=volumetric):
            return points.update(x, state, 0.1, False, volumetric).P

        wanted, largest = differences(stress, F), np.abs(update.A).max(axis=(1, 2))
        # With a backstress elastic points lie next to the yield surface.
        smooth = alone | (names != "elastic")
        error = np.abs(update.A - wanted).max(axis=(1, 2)) / largest
        assert error[smooth].max() < 1e-7, names[smooth][np.argmax(error[smooth])]
        uneven = np.abs(update.A - np.swapaxes(update.A, 1, 2)).max(axis=(1, 2))
        assert not alone or (uneven < 1e-14 * largest).all()


def tensors(rows, pairs):
    out = np.zeros((len(rows), 3, 3))
    for k, (i, j) in enumerate(pairs):
        out[:, i, j] = out[:, j, i] = rows[:, k]
    return out


def around_backstress(metal, F, P, state, space):
    """√(3/2) |dev τ − Σ X| (n,) from what the points remember, without the return mapping."""
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))[: 6 if space else 4]
    turned, count = F.transpose(0, 2, 1), len(pairs)
    values, axes = np.linalg.eigh(F @ tensors(state[:, :count], pairs) @ turned)
    E = axes @ (values[:, :, None] ** -0.5 * axes.transpose(0, 2, 1))
    if space:
        tau = P.reshape(-1, 3, 3) @ turned
    else:
        across = np.zeros_like(F)
        across[:, :2, :2], across[:, 2, 2] = P[:, :4].reshape(-1, 2, 2), P[:, 4]
        tau = across @ turned
    for number, law in enumerate(metal.kinematic, start=1):
        inner = tensors(state[:, count * number : count * (number + 1)], pairs)
        B = E @ F @ np.linalg.inv(inner) @ turned @ E
        tau = tau - law.modulus / 3.0 * B / np.cbrt(np.linalg.det(B))[:, None, None]
    tau = tau - np.trace(tau, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    return np.sqrt(1.5 * (tau**2).sum(axis=(1, 2)))


@both
def test_steps_however_large_or_small_end_at_yield(space):
    """A backstress that fades within a large step may leave more stress than there was."""
    back = (Backstress(0.0066, 12.5), Backstress(0.65, 236.0))
    metal = ElastoPlastic(1.0, 2.6, Voce(0.0012, 0.0068, 13.3, 0.0), None, back)
    points, random = PlasticPoints(metal, space), np.random.default_rng(0)
    state, F = points.start(64), np.tile(np.eye(3), (64, 1, 1))
    for size in [0.05] * 12 + [10.0**-digits for digits in range(5, 17)]:
        change = random.normal(size=F.shape) * size
        if not space:
            change[:, 2] = change[:, :, 2] = 0.0
        F = (np.eye(3) + change) @ F
        rows = F.reshape(-1, 9)[:, slice(None) if space else [0, 1, 3, 4, 8]]
        found = points.update(rows, state, 1.0, False)
        assert found.valid
        flown, state = found.state[:, -1] > state[:, -1], found.state
        left = around_backstress(metal, F, found.P, state, space)[flown]
        wanted = metal.hardening.stress(state[flown, -1])
        assert flown.sum() > 50 or size < 1e-3
        np.testing.assert_allclose(left, wanted, rtol=1e-7)


@branched
def test_a_plane_is_a_plane_in_space(branches):
    plane, space = (PlasticPoints(given.material("swift", branches=branches), s) for s in (0, 1))
    F, state, _ = gathered(plane)
    rows = given.metrics(state, False).reshape(len(state), -1, 9)[:, :, given.PAIRS]
    embedded = np.column_stack([rows.reshape(len(state), -1), state[:, -1]])
    one = plane.update(F, state, 1.0, True)
    other = space.update(given.components(given.tensors(F), True), embedded, 1.0, True)
    kept = other.state[:, :-1].reshape(len(state), -1, 6)[:, :, :4].reshape(len(state), -1)
    wanted = {
        "P": other.P[:, given.PLANE],
        "A": other.A[:, given.PLANE][:, :, given.PLANE],
        "state": np.column_stack([kept, other.state[:, -1]]),
    }
    bound = 1e-12 if branches == "none" else 2e-12
    for field in FIELDS:
        b = wanted.get(field, getattr(other, field))
        np.testing.assert_allclose(getattr(one, field), b, rtol=0, atol=bound * np.abs(b).max())
    rest = [2, 5, 6, 7]
    assert np.abs(other.P[:, rest]).max() < 1e-14 * np.abs(other.P).max()
    assert np.abs(other.A[:, given.PLANE][:, :, rest]).max() < 1e-12 * np.abs(other.A).max()


@branched
@both
def test_rotations_of_body_and_material_rotate_the_stress(space, branches):
    """Q F: the memory stays; F Qᵀ with the memory turned: P Qᵀ, and the memory turned."""
    points = PlasticPoints(given.material("voce", "perzyna", branches), space)
    F, state, _ = gathered(points)
    Q = given.rotation(2.1) if space else given.rotation(2.1, (0.0, 0.0, 1.0))

    def turned(values):
        C = Q @ given.metrics(values, space) @ Q.T
        places = given.PAIRS if space else given.PAIRS[:4]
        rows = C.reshape(len(values), -1, 9)[:, :, places].reshape(len(values), -1)
        return np.column_stack([rows, values[:, -1]])

    still = points.update(F, state, 0.1, False)
    stress, tensor = given.tensors(still.P), given.tensors(F)
    cases = ((Q @ tensor, state, Q @ stress, still.state),)
    cases += ((tensor @ Q.T, turned(state), stress @ Q.T, turned(still.state)),)
    for at, begin, wanted, end in cases:
        found = points.update(given.components(at, space), begin, 0.1, False)
        rows = given.components(wanted, space)
        np.testing.assert_allclose(found.P, rows, rtol=0, atol=1e-12 * np.abs(rows).max())
        np.testing.assert_allclose(found.state, end, rtol=0, atol=1e-12)


@branched
@both
def test_a_point_at_yield_keeps_its_memory_and_has_the_tangent_of_loading(space, branches):
    points = PlasticPoints(given.material("linear", branches=branches), space)
    F, state = given.worked(points, 5)
    rows = given.components(F, space)
    at = points.update(rows, state, 1.0, True)
    np.testing.assert_array_equal(at.state, state)
    before, last = given.worked(points, 5)[1], given.gradients(5, space, 2, 0.03)
    onward = given.components(F + 1e-7 * (last - np.linalg.inv(last)) @ F, space)
    rise = points.update(onward, before, 1.0, False).P - at.P
    wanted = np.einsum("npq,nq->np", at.A, onward - rows)
    flows = points.update(onward, before, 1.0, False).dissipation > 0.0
    assert flows.any() and not at.dissipation.any()
    error = np.abs(rise - wanted)[flows].max()
    assert error < (1e-4 if branches == "none" else 1e-3) * np.abs(wanted).max()


@pytest.mark.parametrize("branches", ["none", "slow and fast"])
@both
def test_an_impossible_deformation_is_told_and_leaves_the_others_alone(space, branches):
    points = PlasticPoints(given.material(branches=branches), space)
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
    states[9, -2] = np.nan
    found = points.update(bad, states, 1.0, True)
    wrong = np.array([1, 3, 4, 6, 7, 8, 9])
    right = np.setdiff1d(np.arange(11), wrong)
    assert good.valid and not found.valid
    for field in FIELDS:
        a, b = getattr(found, field)[right], getattr(good, field)[right]
        bound = 0.0 if branches == "none" else 1e-13 * np.abs(b).max()
        np.testing.assert_allclose(a, b, rtol=0, atol=bound)
        if field != "state":
            assert np.isnan(getattr(found, field)[wrong]).all()
    np.testing.assert_array_equal(found.state[wrong], states[wrong])


# -- paths ------------------------------------------------------------------------------------


def pulled_to(points, ends, steps):
    """Uniaxial stress along logarithmic strains from one end to the next: τ, α at each step."""
    F, state, before = np.array([[1.0, 0.0, 0.0, 1.0, 1.0]]), points.start(1), 0.0
    found = []
    for end in ends:
        for strain in np.linspace(before, end, steps + 1)[1:]:
            F = F.copy()
            F[:, 0] = np.exp(strain)
            F, update = free_across(points, F, state, 1.0, [3, 4])
            state = update.state
            found.append((strain, update.P[0, 0] * F[0, 0], state[0, -1]))
        before = end
    return np.array(found).T


@pytest.mark.parametrize("steps", [4, 40])
def test_a_uniaxial_cycle_is_that_of_the_closed_form(steps):
    """X = (c/b)(1 − e^(−bα)) in tension, −c/b + (X₀ + c/b) e^(−bΔα) after the reversal."""
    c, b, law = 1.0, 50.0, Voce(0.06, 0.16, 12.0)
    points = PlasticPoints(ElastoPlastic(G, K, law, None, (Backstress(c, b),)), False)
    strain, tau, alpha = pulled_to(points, (0.03, -0.03, 0.03), steps)
    X = start = alpha_start = 0.0
    for part, sign in enumerate((1.0, -1.0, 1.0)):
        at = slice(part * steps, (part + 1) * steps)
        a = alpha[at]
        X = sign * c / b + (start - sign * c / b) * np.exp(-b * (a - alpha_start))
        flows = np.diff(a, prepend=alpha_start) > 1e-6
        wanted = X + sign * law.stress(a)
        assert flows.sum() > steps // 2
        np.testing.assert_allclose(tau[at][flows], wanted[flows], rtol=0, atol=1e-3 * 0.1)
        # Strain is elastic, and the plastic one in and against the direction.
        start, alpha_start = X[-1], a[-1]
    plastic = strain[-1] - tau[-1] / YOUNG
    ways = [alpha[steps - 1], alpha[2 * steps - 1], alpha[-1]]
    assert plastic == pytest.approx(ways[0] - (ways[1] - ways[0]) + ways[2] - ways[1], abs=1e-9)


def test_a_branch_that_saturates_in_one_step_bears_what_it_can():
    """c/b but for the strain of the step, where b Δα is 1000 and e^(−bΔα) is nothing."""
    c, b, law = 400.0, 2e4, Voce(0.06, 0.16, 12.0)
    points = PlasticPoints(ElastoPlastic(G, K, law, None, (Backstress(c, b),)), False)
    _, tau, alpha = pulled_to(points, (0.053,), 1)
    assert alpha[0] * b > 1000.0
    np.testing.assert_allclose(tau - law.stress(alpha), c / b, rtol=0.03)


def rate_of(F, Fp, Fpi, alpha, law, branches):
    """f/√(3/2), Pa, and for γ̇ = 1 the rates of F_p and of F_pi; all in the rate equations."""
    Fe = F @ np.linalg.inv(Fp)
    w, N = np.linalg.eigh(Fe.T @ Fe)
    e = 0.5 * np.log(w)
    M = 2.0 * G * (N * (e - e.mean())) @ N.T
    xi, inner = M.copy(), []
    for branch, Fi in zip(branches, Fpi, strict=True):
        Fpe = Fp @ np.linalg.inv(Fi)
        B, Ce = Fpe @ Fpe.T, Fpe.T @ Fpe
        mu = branch.modulus / 3.0
        xi = xi - mu * (B - np.trace(B) / 3.0 * np.eye(3))
        # d_pi = b/(2 mu) alpha' times the deviator of mu C_pe, in the inner configuration
        rate = np.sqrt(2.0 / 3.0) * 0.5 * branch.recovery
        inner.append(rate * (Ce - np.trace(Ce) / 3.0 * np.eye(3)) @ Fi)
    size = max(np.linalg.norm(xi), 1e-12)
    return size - np.sqrt(2.0 / 3.0) * law.stress(alpha), xi / size @ Fp, inner


def integrated(path, ends, count, law, branches):
    """Kirchhoff stress (3, 3) after F = path(s), s from end to end in ``count`` steps (Heun)."""
    Fp, Fpi, alpha, s = np.eye(3), [np.eye(3)] * len(branches), 0.0, 0.0
    for end in ends:
        ds = (end - s) / count
        for _ in range(count):
            first = flow_rate(path, s, ds, Fp, Fpi, alpha, law, branches)
            mid = [x + ds * y for x, y in zip((Fp, *Fpi, alpha), first, strict=True)]
            last = flow_rate(path, s + ds, ds, mid[0], mid[1:-1], mid[-1], law, branches)
            new = [
                x + 0.5 * ds * (y + z)
                for x, y, z in zip((Fp, *Fpi, alpha), first, last, strict=True)
            ]
            Fp, Fpi, alpha, s = new[0], new[1:-1], new[-1], s + ds
    Fe = path(s) @ np.linalg.inv(Fp)
    w, N = np.linalg.eigh(Fe @ Fe.T)
    e = 0.5 * np.log(w)
    return (N * (2.0 * G * (e - e.mean()) + K * e.sum())) @ N.T, alpha


def flow_rate(path, s, ds, Fp, Fpi, alpha, law, branches):
    """d/ds of F_p, F_pi and α where f stays zero, or is brought back to it within the step."""
    F, h = path(s), 1e-6
    f, dFp, dFpi = rate_of(F, Fp, Fpi, alpha, law, branches)
    rise = (rate_of(path(s + h * ds), Fp, Fpi, alpha, law, branches)[0] - f) / h
    ahead = [Fi + h * 1e-2 * d for Fi, d in zip(Fpi, dFpi, strict=True)]
    more = alpha + h * 1e-2 * np.sqrt(2.0 / 3.0)
    fall = (rate_of(F, Fp + h * 1e-2 * dFp, ahead, more, law, branches)[0] - f) / (h * 1e-2)
    gamma = max(-(f + rise) / fall, 0.0) / ds if f + rise > 0.0 else 0.0
    return gamma * dFp, *(gamma * d for d in dFpi), gamma * np.sqrt(2.0 / 3.0)


def stretched(s):
    """Tension and compression at constant volume, along axes that are not the coordinates'."""
    Q = given.rotation(0.6, (0.0, 0.0, 1.0))
    return Q @ np.diag(np.exp([s, -0.5 * s, -0.5 * s])) @ Q.T


PATHS = {
    "tension and compression": (stretched, (0.15, -0.1)),
    "reversed simple shear": (shear, (0.4, -0.3)),
}


@pytest.mark.parametrize("branches", ["one", "linear"])
@pytest.mark.parametrize("name", PATHS)
def test_reversed_paths_go_to_the_solution_of_the_rate_equations(name, branches):
    """To .5 % of the stress, at finite strain; in shear the whole tensor, normal stresses too."""
    path, ends = PATHS[name]
    law, kinds = given.LAWS["voce"], given.BRANCHES[branches]
    points = PlasticPoints(ElastoPlastic(G, K, law, None, kinds), False)
    wanted, alpha = integrated(path, ends, 500, law, kinds)
    state, s = points.start(1), 0.0
    for end in ends:
        for at in np.linspace(s, end, 201)[1:]:
            update = points.update(given.components(path(at)[None], False), state, 1.0, False)
            state = update.state
        s = end
    tau = given.tensors(update.P)[0] @ path(s).T
    assert np.abs(tau - wanted).max() < 5e-3 * np.linalg.norm(wanted)
    assert state[0, -1] == pytest.approx(alpha, rel=5e-3)


@settings(deadline=None, max_examples=25)
@hypothesis_given(
    seed=st.integers(0, 2**31),
    space=st.booleans(),
    law=st.sampled_from(sorted(given.LAWS)),
    rate=st.sampled_from(sorted(given.RATES)),
    branches=st.sampled_from(sorted(given.BRANCHES)),
)
def test_on_any_path_volumes_stay_and_energy_is_only_lost(seed, space, law, rate, branches):
    """There and back: det C_p = det C_pi = 1, dissipation ≥ 0 in each step, and the balance."""
    points = PlasticPoints(given.material(law, rate, branches), space)
    ends = np.random.default_rng(seed).uniform(-0.15, 0.15, (3, 4, 3, 3))
    ends = np.concatenate([ends if space else given.in_plane(ends), np.zeros((1, 4, 3, 3))])
    coarse, fine = (np.abs(closed_path(points, ends, steps)) for steps in (10, 80))
    error, share = (0.02, 0.25) if branches == "none" else (0.03, 0.3)
    assert fine.max() < error and fine.max() < share * coarse.max()


# -- Hencky points, units, layouts and bad input ---------------------------------------------------


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


# -- The end of a step lies on the yield surface, whatever the law, the rate and the step ----------


def tens(low, high):
    """Powers of ten between two exponents."""
    return st.floats(low, high).map(lambda x: 10.0**x)


def tables(rises):
    """A table with rises of strain and stress in pairs."""
    return Table(np.cumsum([(0.0, 1.0), *rises], axis=0))


LAWS = st.one_of(
    st.builds(Linear, st.just(1.0), st.one_of(st.just(0.0), tens(-3, 3))),
    st.builds(
        lambda gain, exponent, modulus: Voce(1.0, 1.0 + gain, exponent, modulus),
        tens(-3, 1),
        tens(-1, 5),
        st.one_of(st.just(0.0), tens(-3, 2)),
    ),
    st.builds(Swift, st.just(1.0), tens(-8, 0), st.floats(0.0, 1.0)),
    st.lists(st.tuples(tens(-5, 0), st.one_of(st.just(0.0), tens(-3, 1))), max_size=6).map(tables),
)
RATES = st.one_of(
    st.none(),
    st.builds(JohnsonCook, tens(-4, 0), tens(-6, 6)),
    st.builds(Perzyna, tens(-6, 6), tens(-1.3, 0)),
)


@settings(deadline=None, max_examples=100)
@hypothesis_given(
    law=LAWS,
    rate=RATES,
    dt=tens(-3, 3),
    strains=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    size=tens(-3, 0),
    space=st.booleans(),
)
def test_the_stress_after_a_step_is_the_flow_stress(law, rate, dt, strains, size, space):
    points = PlasticPoints(ElastoPlastic(300.0, 800.0, law, rate), space)
    F = np.diag(np.exp(size * np.array(strains)))
    stretches = F.reshape(1, 9) if space else F.reshape(1, 9)[:, [0, 1, 3, 4, 8]]
    update = points.update(stretches, points.start(1), dt, False, volumetric=False)
    tau = update.P[0, ::4] * np.diag(F) if space else update.P[0, [0, 3, 4]] * np.diag(F)
    mises, alpha = np.sqrt(1.5 * tau @ tau), update.state[:, -1]
    factor = 1.0 if rate is None else rate.factor(alpha / dt)
    trial = 2.0 * 300.0 * np.sqrt(1.5) * np.linalg.norm(size * (strains - np.mean(strains)))
    roundoff = 1e-12 * trial + 4e-15 * 600.0  # of the strain, which is of order 1
    assert update.valid and tau.sum() == pytest.approx(0.0, abs=roundoff)
    if alpha > 0.0:
        assert mises == pytest.approx(law.stress(alpha) * factor, abs=roundoff)
        assert mises == pytest.approx(trial - 900.0 * alpha, abs=roundoff)
    else:
        assert trial <= law.stress(alpha) * (1.0 + 2e-11)
        assert mises == pytest.approx(trial, abs=roundoff)
