"""Paths of one plastic point against closed forms and against ordinary differential equations.

The equations are integrated by scipy from the rate form of the model, which knows nothing of the
return mapping: Ċ_p⁻¹ = −2γ̇ F⁻¹ n bᵉ F⁻ᵀ with the unit deviator n of the stress; γ̇ from ḟ = 0,
2G n:d / (2G + ⅔ σ_Y'), or from the overstress.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.forms.bodies import plastic_samples as given
from tribox.forms.bodies.elastoplastic import ElastoPlastic, PlasticPoints
from tribox.forms.bodies.hardening import Perzyna

G, K = given.SHEAR, given.BULK
YOUNG = 9.0 * K * G / (3.0 * K + G)
POISSON = (3.0 * K - 2.0 * G) / (6.0 * K + 2.0 * G)


def free_across(points, F, state, dt, free):
    """Update (n points) with the stretches ``free`` such that their stresses vanish."""
    for _ in range(12):
        update = points.update(F, state, dt, True)
        rest = update.P[:, free]
        if np.abs(rest).max() < 3e-15 * K:
            return F, update
        F = F.copy()
        F[:, free] -= np.linalg.solve(update.A[:, free][:, :, free], rest[:, :, None])[:, :, 0]
    raise AssertionError(f"lateral stress {np.abs(rest).max()} after 12 iterations")


def pulled(points, strains, dt=1.0, steps=1):
    """Uniaxial tension of points to logarithmic strains (n,): F (n, p) and the last update."""
    axial, free = (0, [4, 8]) if points.space else (0, [3, 4])
    state = points.start(len(strains))
    F = given.components(np.tile(np.eye(3), (len(strains), 1, 1)), points.space)
    for k in range(1, steps + 1):
        F = F.copy()
        F[:, axial] = np.exp(strains * k / steps)
        F[:, free] = np.exp(-0.5 * strains * k / steps)[:, None]
        F, update = free_across(points, F, state, dt / steps, free)
        state = update.state
    return F, update


@pytest.mark.parametrize("law", given.LAWS)
@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
def test_uniaxial_tension_and_compression_are_exact_in_one_step(space, law):
    """The direction of flow does not change: e = τ/E + α along, −ντ/E − α/2 across."""
    points = PlasticPoints(given.material(law), space)
    strains = np.array([0.4, 0.01, -0.15, -0.7, 0.0005])
    F, update = pulled(points, strains)
    alpha, sign = update.state[:, -1], np.sign(strains)
    tau = update.P[:, 0] * F[:, 0]
    assert (alpha[:-1] > 0.0).all() and alpha[-1] == 0.0
    stress = sign[:-1] * given.LAWS[law].stress(alpha[:-1])
    np.testing.assert_allclose(tau[:-1], stress, rtol=1e-11)
    np.testing.assert_allclose(tau / YOUNG + sign * alpha, strains, rtol=1e-11)
    across = np.log(F[:, [4, 8]] if space else F[:, [3, 4]])
    wanted = -POISSON * tau / YOUNG - 0.5 * sign * alpha
    np.testing.assert_allclose(across, np.stack([wanted, wanted], 1), rtol=1e-11)


def shear(amount):
    """F (3, 3) of simple shear."""
    F = np.eye(3)
    F[0, 1] = amount
    return F


def integrated_shear(law, end, rate=None):
    """Kirchhoff stress (3, 3) and α at a shear, from the rate equations; unit speed of shear."""
    velocity = np.zeros((3, 3))
    velocity[0, 1] = 1.0

    def trial(C, F):
        values, axes = np.linalg.eigh(F @ C @ F.T)
        e = 0.5 * np.log(values)
        return axes, 2.0 * G * (e - e.mean()), K * e.sum()

    def slope(time, y):
        C, F, alpha = y[:9].reshape(3, 3), shear(time), y[9]
        axes, s, _ = trial(C, F)
        n = (axes * (s / np.linalg.norm(s))) @ axes.T
        if rate is None:
            flow = 2.0 * G * np.sum(n * velocity) / (2.0 * G + 2.0 / 3.0 * law.slope(alpha))
        else:
            over = np.sqrt(1.5) * np.linalg.norm(s) / law.stress(alpha) - 1.0
            flow = np.sqrt(1.5) * rate.reference_rate * max(over, 0.0) ** (1.0 / rate.exponent)
        change = -2.0 * flow * np.linalg.inv(F) @ n @ F @ C
        return np.r_[change.ravel(), np.sqrt(2.0 / 3.0) * flow]

    def over_yield(amount):
        return np.linalg.norm(trial(np.eye(3), shear(amount))[1]) - np.sqrt(2 / 3) * law.stress(0.0)

    first = brentq(over_yield, 0.0, end)
    start = np.r_[np.eye(3).ravel(), 0.0]
    method = "DOP853" if rate is None else "LSODA"
    found = solve_ivp(slope, (first, end), start, method, rtol=1e-9, atol=1e-12).y[:, -1]
    axes, s, volume = trial(found[:9].reshape(3, 3), shear(end))
    return (axes * (s + volume)) @ axes.T, found[9]


def stepped_shear(material, end, steps):
    """The same by steps: stress, α, and the relative error of the energy balance."""
    points = PlasticPoints(material, False)
    state, work, dissipated, numerical = points.start(1), 0.0, 0.0, 0.0
    F = before = given.components(shear(0.0)[None], False)
    P = np.zeros_like(F)
    for amount in np.linspace(0.0, end, steps + 1)[1:]:
        F = given.components(shear(amount)[None], False)
        update = points.update(F, state, end / steps, False)
        work += 0.5 * np.sum((update.P + P) * (F - before))
        dissipated, numerical = dissipated + update.dissipation, numerical + update.numerical
        state, P, before = update.state, update.P, F
    tau = given.tensors(P)[0] @ shear(end).T
    return tau, state[0, -1], (update.elastic + dissipated - work) / work, numerical / work


def test_simple_shear_with_a_rate_goes_to_the_solution_of_the_overstress_equations():
    law, rate = given.LAWS["voce"], Perzyna(5.0, 0.25)
    wanted, alpha = integrated_shear(law, 0.5, rate)
    tau, end, _, _ = stepped_shear(ElastoPlastic(G, K, law, rate), 0.5, 400)
    assert wanted[0, 1] > 1.5 * law.stress(alpha) / np.sqrt(3.0)
    assert np.abs(tau - wanted).max() < 1e-3 * np.linalg.norm(wanted)
    assert end == pytest.approx(alpha, abs=1e-4)


def closed_path(points, ends, steps):
    """Energy balance (n,) over straight lines between F − I (n, 3, 3); checks each step."""
    n, space = ends.shape[1], points.space
    state, position = points.start(n), np.zeros((n, 3, 3))
    before, P = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3, 3))
    work = dissipated = np.zeros(n)
    for end in ends:
        for k in range(1, steps + 1):
            F = np.eye(3) + position + (end - position) * k / steps
            update = points.update(given.components(F, space), state, 0.5 / steps, False)
            assert update.valid and (update.dissipation >= 0.0).all()
            assert points.material.kinematic or (update.numerical >= 0.0).all()
            assert (update.state[:, -1] >= state[:, -1]).all()
            stress = given.tensors(update.P)
            work = work + 0.5 * ((stress + P) * (F - before)).sum(axis=(1, 2))
            dissipated = dissipated + update.dissipation
            state, P, before = update.state, stress, F
        position = end
    volumes = np.linalg.det(given.metrics(state, space))
    np.testing.assert_allclose(volumes, 1.0, rtol=0, atol=1e-12)
    assert (work > 0.0).all()
    return (update.elastic + dissipated - work) / work
