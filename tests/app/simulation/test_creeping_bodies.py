"""Bodies with Maxwell branches, solved: a differential equation, energies, both solvers."""

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tests.app.checkpoint.going_on import case_of
from tests.app.checkpoint.going_on import run as run_on
from tests.solved import solved as run
from tests.tool_cases import block_mesh

ROOT = Path(__file__).parents[3]
PRONY = [(0.3, 0.1), (0.2, 1.0)]
G, K = 1e6, 1e10  # Pa: nu = 0.49995
CELL = """
boundary = [
 { surface = "rubber_bottom", displacement = { y = 0 } },
 { surface = "rubber_left", displacement = { x = 0 } },
 { surface = "rubber_top" },
]
stage = [{ name = "move" }]
[geometry]
kind = "blocks"
thickness = "1 m"
blocks = { rubber = { x = ["0 m", "1 m"], y = ["0 m", "1 m"], elements = [1, 1] } }
[bodies.rubber]
material = "neo-hookean"
G = 1e6
K = 1e10
moduli = "instantaneous"
prony = [[0.3, 0.1], [0.2, 1.0]]
"""


def cell(stretch, duration, steps, **keys: Any):
    """One cell in plane strain whose height follows ``stretch``: λ at the steps, and the run."""
    data = tomllib.loads(CELL)
    rubber = data["bodies"]["rubber"] | keys
    data["bodies"]["rubber"] = {key: value for key, value in rubber.items() if value is not None}
    times = np.linspace(0.0, duration, steps + 1)
    table = [[float(t), float(stretch(t) - 1.0)] for t in times]
    data["boundary"][2]["displacement"] = {"y": table}
    data["stage"][0] |= {"duration": duration, "steps": steps}
    data["solver"] = {"tolerance": 1e-10}
    return times, run(case_of(data, fields_every=0))


def exact(stretch, times):
    """Nominal stress, Pa, of the incompressible body, and work and loss, J/m³, at ``times``."""

    def C_of(t):
        x = stretch(t)
        return np.array([1.0 / x**2, x**2, 1.0])

    def stress(t, y):
        C, x = C_of(t), stretch(t)
        left = (1.0 - sum(g for g, _ in PRONY)) * G
        tau = left * (C[1] - C[0])
        for b, (share, _) in enumerate(PRONY):
            X = C / y[3 * b : 3 * b + 3]
            tau += share * G * (X[1] - X[0])
        return tau / x

    def rates(t, y):
        out, lost = [], 0.0
        for b, (share, tau) in enumerate(PRONY):
            X = C_of(t) / y[3 * b : 3 * b + 3]
            D = X - X.mean()
            out += list(D * y[3 * b : 3 * b + 3] / tau)
            lost += 0.5 * share * G / tau * (D**2).sum()
        speed = (stretch(t + 1e-6) - stretch(t - 1e-6)) / 2e-6
        return [*out, stress(t, y) * speed, lost]

    start = [1.0] * 6 + [0.0, 0.0]
    options = {"rtol": 1e-8, "atol": 1e-10, "max_step": times[-1] / 50}
    done = solve_ivp(rates, (0.0, times[-1]), start, t_eval=times, **options)
    return np.array([stress(t, y) for t, y in zip(times, done.y.T, strict=True)]), done.y[6:]


def pull(t):
    return 1.0 + 0.5 * min(t / 0.05, 1.0)


def cycle(t):
    return 1.0 + 0.4 * math.sin(4.0 * math.pi * t)


@pytest.mark.parametrize(
    ("stretch", "duration"), [(pull, 0.4), (cycle, 0.5)], ids=["hold", "cycle"]
)
def test_a_stretched_cell_follows_the_differential_equation(stretch, duration):
    """Two lengths of step; together within 0.5 % of the work, and first order each."""
    found = []
    for steps in (80, 160):
        times, done = cell(stretch, duration, steps)
        last = done.rows[-1]
        found.append(np.array([last.external_work, last.viscous_dissipation]))
        assert abs(last.energy_error) < 3e-3 * max(row.external_work for row in done.rows)
        lost = np.diff([row.viscous_dissipation for row in done.rows])
        assert (lost >= 0.0).all()
        assert all(row.newton_iterations <= 6 for row in done.rows)
    _, (work, loss) = exact(stretch, times)
    wanted, scale = np.array([work[-1], loss[-1]]), work.max()
    errors = [(one - wanted) / scale for one in found]
    assert np.abs(errors[0]).max() < 0.03
    np.testing.assert_allclose(2.0 * errors[1] - errors[0], 0.0, rtol=0, atol=0.005)
    assert 0.4 < np.linalg.norm(errors[1]) / np.linalg.norm(errors[0]) < 0.6


def test_stages_without_rates_are_relaxed_and_long_term_moduli_are_those_of_them():
    elastic = cell(pull, 0.1, 2, prony=None, G=0.5e6, moduli=None)
    for keys in ({}, {"G": 0.5e6, "moduli": "long-term"}):
        data = tomllib.loads(CELL)
        data["bodies"]["rubber"] |= keys
        data["boundary"][2]["displacement"] = {"y": [[0.0, 0.0], [0.05, 0.5]]}
        data["stage"][0] |= {"duration": 0.1, "steps": 2, "rate_dependent": False}
        done = run(case_of(data, fields_every=0))
        for one, other in zip(done.rows, elastic[1].rows, strict=True):
            assert one.strain_energy == pytest.approx(other.strain_energy, rel=1e-9)
            assert one.external_work == pytest.approx(other.external_work, rel=1e-9)
            assert one.viscous_dissipation == pytest.approx(0.0, abs=1e-9 * one.external_work)
    # At once it has the instantaneous modulus: twice as much.
    sudden = cell(lambda t: 1.0 + 0.5 * t / 1e-5, 1e-5, 4)[1].rows[-1]
    assert sudden.strain_energy == pytest.approx(2.0 * other.strain_energy, rel=1e-3)


BLOCK = """
boundary = [
 { surface = "rubber_bottom", displacement = { x = 0, y = 0 } },
 { surface = "rubber_top", displacement = { x = 0, y = [["0 s", 0], ["1 ms", "-0.1 mm"]] } },
]
stage = [{ name = "press", duration = "1 ms", steps = 40 }]
[geometry]
kind = "blocks"
section = "SECTION"
blocks = { rubber = { x = ["0 mm", "1 mm"], y = ["0 mm", "1 mm"], elements = [2, 2] } }
[bodies.rubber]
material = "neo-hookean"
G = "1 MPa"
K = "20 MPa"
density = 1000
prony = [[0.4, "0.2 ms"], [0.2, "2 ms"]]
"""


def block(section, **keys: Any):
    data = tomllib.loads(BLOCK.replace("SECTION", section))
    if section == "axisymmetric":
        data["boundary"].append({"surface": "rubber_left", "displacement": {"x": 0}})
    rubber = data["bodies"]["rubber"] | keys.pop("rubber", {})
    data["bodies"]["rubber"] = {key: value for key, value in rubber.items() if value is not None}
    data["stage"][0]["steps"] = keys.pop("steps", 40)
    if "way" in keys:
        data["boundary"][1]["displacement"] = keys.pop("way")
    return run(case_of(data | keys, fields_every=0))


@pytest.mark.parametrize("section", ["plane-strain", "axisymmetric"])
def test_both_solvers_find_the_same(section):
    """Pressed a hundred times slower than sound crosses it: work, stored energy and loss."""
    slow = block(section, steps=160).rows[-1]
    fast = block(section, solver={"kind": "explicit", "damping": "2000 1/s"}).rows[-1]
    assert abs(fast.energy_error) < 1e-3 * fast.external_work
    for name in ("external_work", "strain_energy", "viscous_dissipation"):
        assert getattr(fast, name) == pytest.approx(getattr(slow, name), rel=0.02), name


@pytest.mark.parametrize(("steps", "said"), [(4, True), (80, False)])
def test_long_steps_are_said_of_branches_that_matter(steps, said, tmp_path):
    data = tomllib.loads(BLOCK.replace("SECTION", "plane-strain"))
    data["stage"][0]["steps"] = steps
    data["bodies"]["rubber"]["prony"] = [[0.4, "1 ms"], [1e-4, "1 us"]]
    run_on(case_of(data, fields_every=0), tmp_path / "out")
    log = (tmp_path / "out" / "log.txt").read_text()
    assert ("of the relaxation time of branch 1, 0.001 s" in log) == said
    assert "branch 2" not in log


def test_a_branch_is_measured_by_its_own_body(tmp_path):
    """A second body that stores a thousand times as much hides no long step."""
    data = tomllib.loads(BLOCK.replace("SECTION", "plane-strain"))
    data["stage"][0]["steps"] = 4
    beside = {"x": ["2 mm", "3 mm"], "y": ["0 mm", "1 mm"], "elements": [2, 2]}
    data["geometry"]["blocks"]["stiff"] = beside
    data["bodies"]["stiff"] = {"material": "neo-hookean", "G": "1 GPa", "K": "20 GPa"}
    supports = data["boundary"]
    data["boundary"] = supports + [
        support | {"surface": support["surface"].replace("rubber", "stiff")} for support in supports
    ]
    run_on(case_of(data, fields_every=0), tmp_path / "out")
    log = (tmp_path / "out" / "log.txt").read_text()
    assert "body rubber: steps of 0.00025 s are 1.2 of the relaxation time of branch 1" in log


def rolling_resistance(zeta):
    """Moment over load and a, load (of 2/3) and a_0 of the bed of springs and dashpots, a = 1."""

    def pressure(x):
        memory = (x + zeta) - (1.0 + zeta) * np.exp(-(1.0 - x) / zeta)
        return 0.5 * (1.0 - x * x) + zeta * memory

    x = np.linspace(brentq(pressure, -1.0, 1.0 - 1e-6), 1.0, 20001)
    load, moment = (np.trapezoid(pressure(x) * weight, x) for weight in (1.0, x))
    return moment / load, load, (1.5 * load) ** (1.0 / 3.0)


@pytest.mark.long
def test_a_cylinder_rolls_on_a_thin_layer_as_on_springs_and_dashpots():
    """The shipped case at one of its speeds, that of the peak: within 3 % of the closed form."""
    data = tomllib.loads((ROOT / "cases" / "rolling.toml").read_text())
    data["geometry"]["blocks"]["layer"] |= {"x": ["-1.6 mm", "4 mm"], "elements": [140, 1]}
    data["stage"][1] |= {"velocities": [0.03], "min_steps": 110, "max_steps": 110}
    done = run(case_of(data, fields_every=0))
    factor, _, _ = rolling_resistance(0.3)
    last = done.rows[-1]
    assert abs(last.force_x / last.force_y) == pytest.approx(factor * 1e-3 / 1.0, rel=0.03)
    energy = done.rows[-1]
    assert abs(energy.energy_error) < 1e-3 * energy.external_work


def linear_slide(V, G, G1, tau, K, height, radius, depth, spacing=20e-6, reach=80e-3):
    """Load, N/m, and hysteretic friction over it of a rigid cylinder in steady sliding.

    Linear viscoelasticity of a layer on a rigid ground, without friction: of a wave of pressure
    of the number k that travels at V the compliance is that of the elastic layer with the complex
    modulus at the frequency k V; the contact is where pressures are positive.
    """
    n = 2 * round(reach / spacing / 2)
    k = 2.0 * math.pi * np.fft.rfftfreq(n, spacing)[1:]
    lag = -1j * k * V * tau
    g = G + G1 * lag / (1.0 + lag)
    nu, m = (3.0 * K - 2.0 * g) / (2.0 * (3.0 * K + g)), np.minimum(k * height, 50.0)
    kappa = 3.0 - 4.0 * nu
    below = kappa * np.cosh(2.0 * m) + 2.0 * m**2 + 5.0 - 12.0 * nu + 8.0 * nu**2
    compliance = (1.0 - nu) / (g * k) * (kappa * np.sinh(2.0 * m) - 2.0 * m) / below
    kernel = np.fft.irfft(np.concatenate([[height / (K + 4.0 / 3.0 * G)], compliance]), n)
    place = np.arange(-round(1.5e-3 / spacing), round(1.5e-3 / spacing) + 1)
    influence, x = kernel[(place[:, None] - place[None, :]) % n], place * spacing
    gap = depth - x**2 / (2.0 * radius)
    touching = gap > 0.0
    for _ in range(100):
        p = np.zeros_like(x)
        p[touching] = np.linalg.solve(influence[np.ix_(touching, touching)], gap[touching])
        now = (touching & (p >= 0.0)) | (~touching & (gap - influence @ p > 1e-9 * depth))
        if (now == touching).all():
            break
        touching = now
    return p.sum() * spacing, (p @ x) / p.sum() / radius


@pytest.mark.long
def test_a_drive_pays_for_the_interface_and_for_the_bulk():
    """The shipped slide with a film, coarse, at the peak of the bulk's loss: all of the work."""
    data = tomllib.loads((ROOT / "cases" / "viscoelastic-slide.toml").read_text())
    del data["sweep"]
    data["geometry"]["blocks"]["rubber"] |= {"x": ["-6 mm", "9 mm"], "elements": [120, 4]}
    slide = {"velocities": [0.03], "slip_step": "0.1 mm", "min_steps": 40, "max_steps": 40}
    data["stage"] = [data["stage"][0] | {"steps": 2}, {"name": "slide"} | slide]
    done = run(case_of(data, fields_every=0))
    first, last = done.rows[-11], done.rows[-1]

    def spent(name):
        return getattr(last, name) - getattr(first, name)

    work, interface, bulk = map(spent, ("external_work", "dissipation", "viscous_dissipation"))
    # What the track holds still falls by 1 % of the work.
    stored, numerical = spent("strain_energy"), spent("numerical_dissipation")
    assert interface + bulk + stored - numerical == pytest.approx(work, rel=1e-3)
    assert abs(stored) < 0.02 * work and bulk > 20.0 * interface > 0.0
    load, friction = linear_slide(0.03, 1e6, 1.5e6, 0.01, 50e6, 2e-3, 8e-3, 80e-6)
    assert last.force_y == pytest.approx(-load * 10e-3, rel=0.05)
    taken = work - interface + numerical
    assert taken / (1e-3 * -last.force_y) == pytest.approx(friction, rel=0.08)


OWN = """
import ufl

class Rubber:
    def __init__(self, G, K):
        self.given = {"G": G, "L": K - 2.0 / 3.0 * G}

    def parameters(self):
        return self.given

    def energy(self, k, c):
        log_j = ufl.ln(k.J)
        return 0.5 * c["G"] * (k.I1 - 3.0) - c["G"] * log_j, 0.5 * c["L"] * log_j**2
"""


def carried(how, path):
    """The pulled cell as another case: of the same stress everywhere."""
    data = tomllib.loads(CELL)
    rubber, [stage] = data["bodies"]["rubber"], data["stage"]
    rubber["K"] = 2e7
    data["boundary"][2]["displacement"] = {"y": [[0.0, 0.0], [0.4, 0.4]]}
    stage |= {"duration": 0.4, "steps": 8}
    data["solver"] = {"tolerance": 1e-11}
    if how == "in space":
        data["geometry"] = {
            "kind": "blocks",
            "blocks": {"rubber": {axis: ["0 m", "1 m"] for axis in "xyz"} | {"elements": [1] * 3}},
        }
        data["boundary"] += [
            {"surface": f"rubber_{side}", "displacement": {"z": 0}} for side in ("front", "back")
        ]
    elif how == "tied":
        half = {"x": ["0 m", "1 m"], "elements": [2, 1]}
        data["geometry"]["blocks"] = {
            "rubber": half | {"y": ["0 m", "0.5 m"]},
            "upper": half | {"y": ["0.5 m", "1 m"], "elements": [3, 1]},
        }
        data["bodies"]["upper"] = dict(rubber)
        data["contact"] = [{"slave": "upper_bottom", "master": "rubber_top", "tied": True}]
        data["contact"][0]["penalty"] = "1e11 Pa/m"
        data["boundary"][2]["surface"] = "upper_top"
        data["boundary"].append({"surface": "upper_left", "displacement": {"x": 0}})
    elif how == "own mesh":
        mesh = block_mesh(path / "block.msh", (4, 2), scale=1e3)  # 4 m x 1 m
        data["geometry"] = {"mesh": str(mesh), "thickness": "0.25 m"}
        data["bodies"] = {"block": rubber}
        for boundary in data["boundary"]:
            boundary["surface"] = boundary["surface"].removeprefix("rubber_")
    elif how == "own energy":
        (path / "rubber.py").write_text(OWN)
        moduli = {"G": 5e5, "K": 2e7}
        rubber |= moduli | {"material": "python", "class": f"{path}/rubber.py:Rubber"}
        rubber |= {"parameters": moduli, "moduli": "long-term"}
    return run(case_of(data, fields_every=0)).rows[-1]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return carried("plain", tmp_path_factory.mktemp("plain"))


@pytest.mark.parametrize("how", ["in space", "tied", "own mesh", "own energy"])
def test_whatever_carries_the_branches_they_cost_the_same(how, plain, tmp_path):
    """A tie gives way by the penalty."""
    found = carried(how, tmp_path)
    bar = 1e-4 if how == "tied" else 1e-8
    for name in ("external_work", "strain_energy", "viscous_dissipation"):
        assert getattr(found, name) == pytest.approx(getattr(plain, name), rel=bar), name
    assert plain.viscous_dissipation > 0.1 * plain.external_work
