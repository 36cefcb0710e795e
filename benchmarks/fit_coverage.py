"""How often the intervals of ``tribox fit --material`` hold the truth: 200 tables of each test.

    python3 -m benchmarks.fit_coverage [--draws N] [relaxation | vibration | ...]

Prints for each test and parameter how many of 200 intervals of 95 % contain the value that the
table was made with, and in how many of the first 20 tables the information criterion finds the true
number of branches, back stresses and law. 190 of 200 are expected, with a standard deviation of 3;
the parameters of one table miss together, so that of all together is that of what tables hold.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from tribox.app.fit.material_data import MaterialData
from tribox.app.fit.metal import Metal, MetalFit, fit_metal, paths, response
from tribox.app.fit.model import interval
from tribox.app.fit.prony import PronyFit, PronyProblem, Shift, fit_prony
from tribox.forms.bodies.hardening import Voce

CHOICES = 20
KINDS = ("relaxation", "vibration", "shifted", "cycles", "metal")
SERIES = {"G": 2e6, "share 1": 0.3, "share 2": 0.2, "tau 1": 0.05, "tau 2": 2.0}
SHIFT = {"C1": 9.0, "C2": 110.0}
METAL = {"E": 70e9, "yield_stress": 80e6, "saturation_stress": 120e6, "exponent": 20.0}
BACK = {"c 1": 4e9, "b 1": 100.0}
Fit = PronyFit | MetalFit


def rubber(kind: str, seed: int) -> tuple[MaterialData, Shift | None]:
    """A table of a rubber.

    The scatter is 1 % of moduli over time, 2 % of those over frequency, and 1 % of the highest
    stress of cycles.
    """
    shift, tail = None, []
    if kind == "relaxation":
        t, ones = np.geomspace(1e-3, 100.0, 60), np.ones(60)
        data = MaterialData("relaxation", ones, t, np.full(60, 0.1), modulus=ones)
    elif kind == "cycles":
        t = np.concatenate([np.arange(1, 33) * 0.0125, 0.4 + np.arange(1, 41) * 0.2])
        up = np.concatenate([np.arange(1, 33) / 8 % 2.0, np.arange(1, 41) / 20 % 2.0])
        ones = np.ones(len(t))
        data = MaterialData("cycles", ones, t, 0.35 * (1.0 - np.abs(up - 1.0)), ones)
    else:
        warm = np.repeat([263.15, 283.15, 296.15, 313.15, 333.15], 12)
        w = np.geomspace(1e-2, 1e3, 40)
        if kind == "shifted":
            w, shift, tail = (
                np.tile(np.geomspace(0.6, 60.0, 12), 5),
                Shift(296.15, warm),
                [9.0, 110.0],
            )
        ones = np.ones(len(w))
        data = MaterialData("vibration", ones, modulus=ones, loss=ones, frequency=w)
    G, g = SERIES["G"], np.array([SERIES["share 1"], SERIES["share 2"]])
    x = np.log([G * (1.0 - g.sum()), *G * g, SERIES["tau 1"], SERIES["tau 2"], *tail])
    y, _ = PronyProblem(data, shift).computed(x)
    drawn = np.random.default_rng(seed).standard_normal(len(y))
    if kind == "cycles":
        return MaterialData(
            "cycles", ones, data.time, data.strain, y + 0.01 * y.max() * drawn
        ), None
    y = y * np.exp((0.01 if kind == "relaxation" else 0.02) * drawn)
    n = len(data)
    loss = None if data.loss is None else y[n:]
    return (
        MaterialData(
            data.kind,
            ones,
            data.time,
            data.strain,
            modulus=y[:n],
            loss=loss,
            frequency=data.frequency,
        ),
        shift,
    )


def metal(seed: int) -> MaterialData:
    """A table of a metal: tension, compression, tension; scatter of 1.5 MPa."""
    strain = np.concatenate(
        [
            np.linspace(0.0, 0.05, 60)[1:],
            np.linspace(0.05, -0.05, 110)[1:],
            np.linspace(-0.05, 0.03, 90)[1:],
        ]
    )
    law = Voce(METAL["yield_stress"], METAL["saturation_stress"], METAL["exponent"])
    one = Metal(METAL["E"], law, ((BACK["c 1"], BACK["b 1"]),))
    stress, _ = response(one, strain, paths(strain))
    stress = stress + 1.5e6 * np.random.default_rng(seed).standard_normal(len(stress))
    return MaterialData("metal", np.ones(len(strain)), strain=strain, stress=stress)


def inside(fit: Fit, truth: dict[str, float]) -> list[str]:
    """Parameters whose interval holds the truth."""
    slopes, scatter = fit.slopes(), math.sqrt(fit.squares / fit.degrees)
    found = []
    for parameter in fit.parameters:
        half = slopes.half_width(parameter.name, scatter, fit.degrees)
        low, high = interval(parameter, fit.values[parameter.name], half)
        if low is None or high is None or low <= truth[parameter.name] <= high:
            found.append(parameter.name)
    return found


def count(kind: str, draws: int) -> None:
    """Print what is found for one test."""
    truth = METAL | BACK if kind == "metal" else SERIES | (SHIFT if kind == "shifted" else {})
    given: Callable[[int], Fit]
    chosen: Callable[[int], str]
    if kind == "metal":
        given = lambda seed: fit_metal(metal(seed), "voce", 1, {})[0]  # noqa: E731
        right = "voce, 1"

        def chosen(seed: int) -> str:
            one = fit_metal(metal(seed), None, None, {})[0].problem
            return f"{one.law}, {one.branches}"
    else:
        right = "2"

        def given(seed: int) -> Fit:
            data, shift = rubber(kind, seed)
            return fit_prony(data, 2, shift)[0]

        def chosen(seed: int) -> str:
            data, shift = rubber(kind, seed)
            return str(fit_prony(data, None, shift)[0].branches)

    begun = time.perf_counter()
    held: Counter[str] = Counter()
    of_table = []
    for seed in range(draws):
        found = inside(given(seed), truth)
        held.update(found)
        of_table.append(len(found))
    shown = ", ".join(f"{name} {held[name]}" for name in truth)
    total = sum(held.values())
    choices = Counter(chosen(seed) for seed in range(CHOICES))
    print(
        f"{kind}: {shown}; together {total} of {draws * len(truth)} "
        f"({total / draws / len(truth):.1%}, standard deviation "
        f"{float(np.std(of_table)) / math.sqrt(draws) / len(truth):.1%}); "
        f"criterion right in {choices[right]} of {CHOICES}; {time.perf_counter() - begun:.0f} s",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", default=list(KINDS), metavar="KIND")
    parser.add_argument("--draws", type=int, default=200)
    chosen = parser.parse_args()
    for name in chosen.kinds:
        count(name, chosen.draws)
