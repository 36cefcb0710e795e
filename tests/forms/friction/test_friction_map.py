"""The friction-map law along random paths: bounds, energy, tangents, invariances."""

import dataclasses
import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tribox.forms.friction.film import at_rest, threshold_speed
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import FrictionResponse, FrictionState, Regime
from tribox.forms.friction.parameters import FrictionMapParameters, with_preset

PROFILE = settings(derandomize=True, deadline=None, max_examples=30)

POINTS, STEPS = 60, 10
V_STAR, P, K_T = 1e-3, 3e6, 1e12


@dataclasses.dataclass
class Step:
    """Arguments of one update."""

    slip: np.ndarray
    dt: float
    pressure: np.ndarray
    film: np.ndarray
    area: np.ndarray

    def of(self, law: FrictionMap, state: FrictionState, **changes: Any) -> FrictionResponse:
        values = {"slip": self.slip, "pressure": self.pressure, "film": self.film} | changes
        return law.update(
            values["slip"], self.dt, values["pressure"], values["film"], state, area_ratio=self.area
        )


def parameters(**changes: Any) -> FrictionMapParameters:
    values: dict[str, Any] = {"mu_s": 0.12, "mu_d": 0.07, "A_d": 2e-7, "B": 5e5, "K_T": K_T}
    values |= {"eta_b": 0.8, "D_min": 5e-9, "D_max": 250e-9, "beta": 0.3}
    values |= {"V_star": V_STAR, "V_star_at": 50e-9}
    if "alpha" in changes:
        values.pop("beta")
    return FrictionMapParameters(**values | changes)


# Options of the film's flow: none, each alone, all.
FLOWS = {
    "newtonian": {},
    "onset": {"film_onset_pressure": 0.3 * P},
    "limit": {"tau_0": 2e4, "zeta": 0.02},
    "thinning": {"critical_rate": 1e4, "thinning_exponent": 0.4, "eta_inf": 0.05},
    "barus": {"barus": 3e-7},
    "solid-like": {"tau_0": 0.0, "zeta": 0.05, "critical_rate": 1e3, "thinning_exponent": 0.0},
}
FLOWS["all"] = {k: v for flow in list(FLOWS.values())[:-1] for k, v in flow.items()}


def with_flow(p: FrictionMapParameters, flow: str) -> FrictionMapParameters:
    return dataclasses.replace(p, **FLOWS[flow])


laws = st.builds(
    with_flow,
    st.builds(
        parameters,
        flow_rule=st.sampled_from(["weighted", "literal"]),
        switch=st.sampled_from(["implicit", "lagged"]),
        transition_width=st.sampled_from([0.0, 0.03, 0.2, 0.5]),
        beta=st.sampled_from([1.0, 0.3, 0.01, 1e-5, ((10e-9, 1.0), (30e-9, 0.01), (180e-9, 1e-5))]),
        mu_d=st.sampled_from([0.0, 0.07, 0.12]),
        B=st.sampled_from([0.0, 5e5, 2e6]),
        reset_slip_on_opening=st.booleans(),
    ),
    st.sampled_from([*["newtonian"] * 4, *FLOWS]),
).map(FrictionMap)
seeds = st.integers(0, 2**32 - 1)
dims = st.sampled_from([2, 3])


def random_path(seed: int, dim: int, n: int = POINTS) -> Iterator[Step]:
    """Steps with speeds around V*, films thinning and thickening, opening and closing."""
    rng = np.random.default_rng(seed)
    film = 10 ** rng.uniform(-8.5, -6.4, n)
    pressure = P * rng.random(n)
    for _ in range(STEPS):
        length = 10 ** rng.uniform(-8.5, -5.5)
        direction = rng.normal(size=(n, dim))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        film = np.where(rng.random(n) < 0.5, film * 10 ** rng.normal(0.0, 0.1, n), film)
        film = np.where(rng.random(n) < 0.03, 0.0, np.where(film == 0.0, 33e-9, film))
        pressure = np.where(rng.random(n) < 0.7, pressure, P * rng.random(n))
        pressure = np.where(rng.random(n) < 0.1, 0.0, np.where(pressure == 0.0, P, pressure))
        # Speeds over two decades around V* and, at four points in ten, right at it.
        at_v_star = np.sqrt(50e-9 / np.maximum(film, 1e-9)) * rng.uniform(0.95, 1.05, n)
        size = np.where(rng.random(n) < 0.4, at_v_star, 10 ** rng.uniform(-1.0, 1.0, n))
        size = length * size * (rng.random(n) > 0.05)
        yield Step(
            slip=size[:, None] * direction,
            dt=length / V_STAR,
            pressure=pressure,
            film=film,
            area=rng.uniform(0.8, 1.3, n),
        )


def history(law: FrictionMap, steps: Iterator[Step]) -> Iterator[tuple[Step, Any, Any]]:
    """Each step with the state before it and the response."""
    state: FrictionState | None = None
    for step in steps:
        state = state or law.initial_state(*step.slip.shape)
        response = step.of(law, state)
        yield step, state, response
        state = response.state


def inner(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("qi,qi->q", a, b)


# Bounds and energy


@settings(PROFILE, max_examples=60)
@given(laws, seeds, dims, st.sampled_from(["consistent", "literal"]))
def test_the_threshold_bounds_and_the_work_is_stored_or_dissipated(law, seed, dim, reentry):
    """And no part of the dissipation is negative, but for the literal re-entry rule."""
    law = FrictionMap(dataclasses.replace(law.parameters, reentry=reentry))
    p = law.parameters
    for step, before, response in history(law, random_path(seed, dim)):
        state = response.state
        solid = 1.0 - state.alpha
        elastic = (solid * p.K_T)[:, None] * state.elastic_slip
        omega = solid if p.flow_rule == "weighted" else 1.0
        threshold = omega * p.friction.coefficient(state.slip_path) * step.pressure
        if reentry == "consistent":
            assert (np.linalg.norm(elastic, axis=1) <= threshold * (1 + 1e-12)).all()
        wet = step.film > p.D_min
        thickness = np.where(wet, step.film, 1.0)
        rate = np.linalg.norm(step.slip, axis=1) / step.dt / thickness
        eta = p.viscosity(rate, step.pressure / step.area).value
        film = np.where(wet, state.alpha * eta / thickness, 0.0) * step.area / step.dt
        film *= np.minimum(step.pressure / (p.film_onset_pressure or 1e-30), 1.0)
        np.testing.assert_allclose(
            response.traction, elastic + film[:, None] * step.slip, rtol=1e-9, atol=1e-9 * P
        )
        size = np.linalg.norm(response.traction, axis=1) * np.linalg.norm(step.slip, axis=1)
        stored = [law.stored_energy(one) for one in (before, state)]
        parts = response.dissipation
        scale = size + sum(stored) + np.abs(dataclasses.astuple(parts)).sum(axis=0)
        work = inner(response.traction, step.slip)
        assert (np.abs(work - (stored[1] - stored[0]) - parts.total) <= 1e-12 * scale).all()
        for field in dataclasses.fields(parts) if reentry == "consistent" else ():
            bar = -1e-12 * (size + sum(stored))
            assert (getattr(parts, field.name) >= bar).all(), field.name


def test_literal_reentry_breaks_the_second_law():
    """Fast, then slow: alpha falls and the elastic slip would gain energy from nowhere."""
    for reentry in ("consistent", "literal"):
        law = FrictionMap(parameters(reentry=reentry, B=0.0, mu_d=0.12))
        slip, pressure, film = np.array([[1e-6, 0.0]]), np.array([P]), np.array([30e-9])
        fast = law.update(slip, 1e-4, pressure, film, law.initial_state(1, 2))
        slow = law.update(1e-9 * slip, 1.0, pressure, film, fast.state)
        assert fast.state.alpha[0] == 1.0 and slow.state.alpha[0] < 1.0
        if reentry == "consistent":
            assert slow.dissipation.total[0] >= 0.0
        else:
            # The elastic slip mu p/K_T it kept while the film carried all.
            gained = 0.5 * K_T * (1.0 - slow.state.alpha[0]) * (0.12 * P / K_T) ** 2
            assert slow.dissipation.switching[0] == pytest.approx(-gained, rel=1e-9)
            assert slow.dissipation.total[0] < -0.99 * gained


def test_the_part_of_the_time_integration_falls_as_one_over_the_steps():
    law = FrictionMap(parameters(alpha=0.4))
    reach = 0.9 * 0.12 * P / K_T
    parts = []
    for n in (10, 20):
        state, part = law.initial_state(1, 2), 0.0
        for _ in range(n):
            slip = np.array([[reach / n, 0.0]])
            response = law.update(slip, 1.0, np.array([P]), np.array([30e-9]), state)
            state = response.state
            part += response.dissipation.numerical[0]
        parts.append(part)
        assert response.regime[0] == Regime.STICK
    assert parts[0] / parts[1] == pytest.approx(2.0, rel=1e-9)
    assert parts[0] == pytest.approx(0.5 * 0.6 * K_T * reach**2 / 10, rel=1e-9)


def test_opening_loses_the_elastic_slip_and_may_forget_the_path():
    for reset in (False, True):
        law = FrictionMap(parameters(reset_slip_on_opening=reset))
        slip, film = np.array([[1e-6, 0.0]]), np.array([30e-9])
        closed = law.update(slip, 1.0, np.array([P]), film, law.initial_state(1, 2))
        stored = law.stored_energy(closed.state)
        opened = law.update(slip, 1.0, np.zeros(1), film, closed.state)
        assert stored[0] > 0.0
        np.testing.assert_allclose(opened.dissipation.opening, stored, rtol=1e-14)
        np.testing.assert_allclose(opened.dissipation.total, stored, rtol=1e-14)
        assert not opened.state.elastic_slip.any() and not opened.state.closed.any()
        for name in ("traction", "slip", "elastic", "pressure", "film"):
            name = name if name == "traction" else f"d_traction_d_{name}"
            assert not getattr(opened, name).any()
        assert closed.state.slip_path[0] > 0.0
        kept = 0.0 if reset else closed.state.slip_path[0]
        assert opened.state.slip_path[0] == kept
        assert opened.regime[0] == Regime.OPEN and opened.state.speed[0] == 0.0


# Tangents


def signature(
    law: FrictionMap, step: Step, state: FrictionState, response: FrictionResponse
) -> np.ndarray:
    """Which branches of the law the points are on, (b, q)."""
    p = law.parameters
    lagged = p.switch == "lagged"
    speed = state.speed if lagged else np.linalg.norm(step.slip, axis=1) / step.dt
    ratio = speed / threshold_speed(p, step.film)
    edges = np.array([1.0 - p.transition_width, 1.0 + p.transition_width])
    rows = p.beta if isinstance(p.beta, tuple) else ()
    stiffness = p.K_T * (1.0 - response.state.alpha if p.flow_rule == "literal" else 1.0)
    carried = stiffness * np.linalg.norm(response.state.elastic_slip, axis=1)
    threshold = law.coefficient(response.state) * step.pressure
    return np.array(
        [
            response.regime,
            carried < (1.0 - 1e-9) * threshold,
            np.digitize(ratio, edges),
            np.sign(response.state.alpha - state.alpha),
            response.state.slip_path > p.A_d,
            np.digitize(step.film, [p.D_min, p.D_max]),
            np.digitize(step.film, [row[0] for row in rows]),
            step.pressure < p.film_onset_pressure,
        ]
    )


def moved(
    step: Step, state: FrictionState, moves: list[tuple[str, int, np.ndarray]]
) -> tuple[Step, FrictionState]:
    """All points once for each move: component j of one input moved by so much, (q,)."""

    def copies(parts: object) -> dict[str, np.ndarray]:
        names = [f.name for f in dataclasses.fields(parts) if f.name != "dt"]
        return {name: np.concatenate([getattr(parts, name)] * len(moves)) for name in names}

    inputs, before = copies(step), copies(state)
    for number, (name, j, by) in enumerate(moves):
        points = slice(number * len(by), (number + 1) * len(by))
        old = before["elastic_slip"] if name == "elastic" else inputs[name]
        old.reshape(len(old), -1)[points, j] += by
    return Step(dt=step.dt, **inputs), dataclasses.replace(state, **before)


def sizes(law: FrictionMap, step: Step, state: FrictionState) -> dict[str, np.ndarray]:
    """By how much to move each input: little against every length that matters, (q,)."""
    p = law.parameters
    width = 5e-4 * max(p.transition_width, 0.03)
    moved = np.linalg.norm(step.slip, axis=1)
    bend = np.linalg.norm(state.elastic_slip, axis=1)
    trial = moved + bend
    within = np.where(bend > 0.0, np.minimum(10.0 * bend, 1e-7), 1e-7)  # a kink where it is zero
    room = np.minimum(np.abs(step.film - p.D_min), np.abs(step.film - p.D_max))
    return {
        "slip": width * np.where(moved > 0.0, np.minimum(moved, 1e-6), 1e-11),
        "elastic": 5e-4 * np.minimum(np.where(trial > 0.0, trial, 1e-9), within),
        "pressure": 2e-4 * step.pressure,
        "film": width * np.minimum(step.film, room),
    }


def check_tangent(law: FrictionMap, step: Step, state: FrictionState) -> dict[str, int]:
    """Compare every derivative with differences of two sizes; count the points compared.

    The error allowed is 1e-7 of the largest entry, beside the round-off of the difference: that of
    the traction, which grows with 1/(1 - alpha) as alpha has a round-off of its own. The law is
    evaluated once, at all points that five-point differences take, and those near a kink left out.
    """
    response = step.of(law, state)
    solid = 1.0 - response.state.alpha
    noise = (1e-13 + 1e-15 / np.where(solid > 0.0, solid, 1.0)) * np.linalg.norm(
        response.traction, axis=1
    )
    wanted = [
        (name, j, part)
        for name, h in sizes(law, step, state).items()
        for j in range(step.slip.shape[1] if name in ("slip", "elastic") else 1)
        for part in (h, h / 8.0)
    ]
    moves = [(name, j, by * h) for name, j, h in wanted for by in (-2.0, -1.0, 1.0, 2.0)]
    many, before = moved(step, state, moves)
    found = many.of(law, before)
    here = signature(law, step, state, response)
    there = signature(law, many, before, found).reshape(len(here), len(wanted), 4, -1)
    values = found.traction.reshape(len(wanted), 4, *response.traction.shape)
    slopes = values[:, 0] - 8.0 * values[:, 1] + 8.0 * values[:, 2] - values[:, 3]
    smooth = (there == here[:, None, None]).all(axis=(0, 2))
    counts: dict[str, int] = {}
    agrees = np.zeros(len(noise), dtype=bool)
    for number, (name, j, h) in enumerate(wanted):
        exact = getattr(response, f"d_traction_d_{name}").reshape(*response.traction.shape, -1)
        size, off = np.where(h > 0.0, h, 1.0), ~smooth[number] | (h == 0.0)
        error = np.abs(slopes[number] / (12.0 * size)[:, None] - exact[:, :, j]).max(axis=1)
        allowed = 1e-7 * np.abs(exact).max(axis=(1, 2))
        agrees = (agrees & (number % 2 > 0)) | off | (error <= allowed + noise / size)
        if number % 2:
            assert agrees.all(), (name, j, np.flatnonzero(~agrees))
            counts[name] = counts.get(name, 0) + int((~off).sum())
    return counts


OPTIONS = itertools.product(
    ["weighted", "literal"],
    ["consistent", "literal"],
    ["implicit", "lagged"],
    [(0.03, ((10e-9, 1.0), (60e-9, 0.05), (180e-9, 1e-2))), (0.3, 0.3)],
)


@pytest.mark.parametrize(("flow_rule", "reentry", "switch", "width_and_beta"), OPTIONS)
def test_tangents_are_exact(flow_rule, reentry, switch, width_and_beta):
    width, beta = width_and_beta
    law = FrictionMap(
        parameters(
            flow_rule=flow_rule, reentry=reentry, switch=switch, transition_width=width, beta=beta
        )
    )
    counts: dict[str, int] = {}
    regimes: set[int] = set()
    inside = falling = 0
    for step, state, response in history(law, random_path(5, 3 if width > 0.1 else 2)):
        for name, count in check_tangent(law, step, state).items():
            counts[name] = counts.get(name, 0) + count
        regimes |= set(response.regime.tolist())
        rest = 1.0 - at_rest(law.parameters, step.film).solid
        inside += int(((response.state.alpha > rest + 1e-3) & (response.state.alpha < 1)).sum())
        falling += int((response.state.alpha < state.alpha).sum())
    # The comparison is worth something: most points were off the kinks, on every branch.
    total = POINTS * STEPS
    assert counts["film"] > 0.6 * total and counts["pressure"] > 0.6 * total
    assert min(counts["slip"], counts["elastic"]) > 2 * 0.6 * total
    assert regimes == set(Regime)
    assert falling > 50 and inside > 50


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("switch", ["implicit", "lagged"])
def test_tangents_are_exact_whatever_the_film_flows_like(flow, switch):
    law = FrictionMap(with_flow(parameters(switch=switch, transition_width=0.3), flow))
    counts: dict[str, int] = {}
    for step, state, _ in itertools.islice(history(law, random_path(11, 3)), 5):
        for name, count in check_tangent(law, step, state).items():
            counts[name] = counts.get(name, 0) + count
    assert counts["film"] > 150 and counts["pressure"] > 150
    assert min(counts["slip"], counts["elastic"]) > 450


@settings(PROFILE, max_examples=15)
@given(laws, seeds, dims)
def test_tangents_are_exact_on_random_paths(law, seed, dim):
    path = itertools.islice(history(law, random_path(seed, dim)), 0, STEPS, 3)
    for step, state, _ in path:
        check_tangent(law, step, state)


def test_one_sided_tangent_at_rest_and_at_the_onset():
    law = FrictionMap(parameters(alpha=0.25))
    state = law.initial_state(2, 2)
    # First point: no slip at all. Second: exactly at the threshold, which still sticks.
    onset = 0.25 * K_T / K_T * 0.12 * P * 4.0 / K_T
    slip = np.array([[0.0, 0.0], [onset * (1 - 1e-15), 0.0]])
    response = law.update(slip, 1.0, np.full(2, P), np.full(2, 30e-9), state)
    assert response.regime.tolist() == [Regime.STICK, Regime.STICK]
    film = 0.25 * 0.8 / 30e-9
    for block in response.d_traction_d_slip:
        np.testing.assert_allclose(block, (0.75 * K_T + film) * np.eye(2), rtol=1e-12)
    assert np.isfinite(response.d_traction_d_film).all()


# Invariances


@PROFILE
@given(laws, seeds, dims)
def test_rotated_inputs_give_rotated_outputs(law, seed, dim):
    rotation = np.linalg.qr(np.random.default_rng(seed).normal(size=(dim, dim)))[0]
    for step, state, response in history(law, random_path(seed, dim)):
        turned_state = dataclasses.replace(state, elastic_slip=state.elastic_slip @ rotation.T)
        turned = step.of(law, turned_state, slip=step.slip @ rotation.T)
        atol = 1e-9 * P
        for name in ("traction", "d_traction_d_film", "d_traction_d_pressure"):
            expected = getattr(response, name) @ rotation.T
            scale = np.abs(expected).max(initial=1e-300)
            np.testing.assert_allclose(getattr(turned, name), expected, atol=1e-9 * scale)
        for name in ("d_traction_d_slip", "d_traction_d_elastic"):
            expected = rotation @ getattr(response, name) @ rotation.T
            scale = np.abs(expected).max()
            np.testing.assert_allclose(getattr(turned, name), expected, atol=1e-9 * scale)
        np.testing.assert_allclose(turned.dissipation.total, response.dissipation.total, atol=atol)


# -- The friction-map law in its three regimes, and what its options do ----------------------------


def steady(law: FrictionMap, speed: float, film: np.ndarray, step: float = 1e-3) -> Any:
    """The response after long steady sliding at one speed, for several film thicknesses."""
    n = len(film)
    state = law.initial_state(n, 2)
    for _ in range(20):
        slip = np.tile([0.6 * step, -0.8 * step], (n, 1))
        response = law.update(slip, step / speed, np.full(n, P), film, state)
        state = response.state
    return response


PRINTED = {
    # V: (literal at 10, 30, 180 nm), (weighted at 10, 30, 180 nm); Pa s, mu = 0.1, p = 3 MPa
    1e-8: ((3.0e5, 9.0e5, 5.4e6), (2.88e5, 2971.0, 540.8)),
    1e-6: ((3000.0, 9001.0, 5.4e4), (2883.0, 30.5, 6.20)),
    1e-4: ((30.0, 90.8, 540.8), (28.9, 1.094, 0.854)),
    1e-2: ((0.331, 1.70, 6.20), (0.320, 0.800, 0.801)),
}


@pytest.mark.parametrize("speed", PRINTED)
def test_effective_viscosity_of_steady_sliding(speed):
    film = np.array([10e-9, 30e-9, 180e-9])
    values = {"mu_s": 0.1, "K_T": K_T, "V_star": 10.0, "V_star_at": 10e-9}
    found = {}
    for rule, expected in zip(("literal", "weighted"), PRINTED[speed], strict=True):
        law = FrictionMap(
            FrictionMapParameters(**with_preset("friction-map", values | {"flow_rule": rule}))
        )
        traction = np.linalg.norm(steady(law, speed, film).traction, axis=1)
        found[rule] = traction * film / speed
        np.testing.assert_allclose(found[rule], expected, rtol=5e-3)
    # The thin film is on top, as in a friction map, under the weighted rule only
    # (and where friction, not the film, makes the most of the traction).
    assert (np.diff(found["literal"]) > 0).all()
    if speed < 1e-2:
        assert (np.diff(found["weighted"]) < 0).all()


def test_a_film_up_to_D_min_is_dry_at_every_speed_without_a_warning():
    law = FrictionMap(parameters(D_min=5e-9, B=0.0))
    with np.errstate(all="raise"):
        for speed in (1e-8, 1e3):
            dry = steady(law, speed, np.array([0.0, 5e-9]))
            np.testing.assert_allclose(np.linalg.norm(dry.traction, axis=1), 0.12 * P, rtol=1e-12)
            assert (dry.regime == Regime.SLIP).all() and not dry.state.alpha.any()


def test_elastic_slip_and_path_stay_defined_where_the_film_carries_all():
    law = FrictionMap(parameters(alpha=0.5, B=0.0, mu_d=0.12))
    slip, film = np.array([[1e-6, 0.0]]), np.array([30e-9])
    response = law.update(slip, 1e-6, np.array([P]), film, law.initial_state(1, 2))
    assert response.state.alpha[0] == 1.0
    assert response.state.elastic_slip[0, 0] == pytest.approx(0.12 * P / K_T, rel=1e-12)
    assert response.state.slip_path[0] == pytest.approx(1e-6 - 0.12 * P / K_T, rel=1e-12)
    assert response.dissipation.coulomb[0] == 0.0


def test_a_step_without_rate_effects_does_not_know_the_time():
    law = FrictionMap(parameters(alpha=0.4))
    slip, film = np.array([[1e-6, 0.0]]), np.array([30e-9])
    responses = [
        law.update(slip, dt, np.array([P]), film, law.initial_state(1, 2), rate_dependent=False)
        for dt in (0.0, 1e-9, 1.0)
    ]
    for response in responses:
        np.testing.assert_array_equal(response.traction, responses[0].traction)
        assert response.state.alpha[0] == pytest.approx(0.4)
        assert response.state.speed[0] == 0.0 and response.dissipation.viscous[0] == 0.0
        mu = law.parameters.friction.coefficient(response.state.slip_path)
        np.testing.assert_allclose(response.traction[:, 0], 0.6 * mu * P, rtol=1e-12)


def test_the_lagged_switch_takes_the_last_converged_speed():
    laws = {name: FrictionMap(parameters(switch=name)) for name in ("implicit", "lagged")}
    slip, film = np.array([[1e-6, 0.0]]), np.array([30e-9])
    dt = 1e-6 / (10 * V_STAR)
    alphas = {}
    for name, law in laws.items():
        first = law.update(slip, dt, np.array([P]), film, law.initial_state(1, 2))
        second = law.update(slip, dt, np.array([P]), film, first.state)
        alphas[name] = first.state.alpha[0], second.state.alpha[0]
        assert first.state.speed[0] == pytest.approx(10 * V_STAR)
    rest = 1.0 - at_rest(laws["lagged"].parameters, film).solid[0]
    assert alphas == {"implicit": (1.0, 1.0), "lagged": (pytest.approx(rest), 1.0)}
