"""Figures of the friction law for its documentation.

``python3 -m benchmarks.law_figures DIRECTORY`` draws them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tribox.app.figures.style import COLOURS, RED, STYLE, colour_of, dashes_of
from tribox.forms.friction.friction_map import Floats, FrictionMap
from tribox.forms.friction.parameters import FrictionMapParameters, Reentry
from tribox.forms.friction.stribeck import StribeckParameters

PRESSURE, FILM = 3e6, 30e-9
BASE: dict[str, Any] = {
    "mu_s": 0.1,
    "K_T": 1e12,
    "eta_b": 0.8,
    "D_max": 250e-9,
    "alpha": 0.5,
    "V_star": 1e-3,
    "V_star_at": FILM,
}
FLOWS: dict[str, dict[str, float]] = {
    "Newtonian": {},
    "limit: τ_0 = 20 kPa, ζ = 0.02": {"tau_0": 2e4, "zeta": 0.02},
    "thinning: from 1e4 1/s, n = 0.5": {"critical_rate": 1e4, "thinning_exponent": 0.5},
    "Barus: a = 3e-7 1/Pa": {"barus": 3e-7},
}


@dataclass(frozen=True, slots=True)
class Jumps:
    """A point whose speed jumps over V* and back, step by step.

    Attributes:
        slip: (n,), m, so far. traction: (n,), Pa.
        dissipated: (n,), J/m^2, so far, without the time integration's own part.
        least: J/m^2, smallest of a single step.
    """

    slip: Floats
    traction: Floats
    dissipated: Floats
    least: float


def velocity_jumps(reentry: Reentry, cycles: int = 4, steps: int = 60) -> Jumps:
    """Slow and fast sliding in turn, each for ``steps`` steps, ``cycles`` times."""
    law = FrictionMap(FrictionMapParameters(**BASE | {"reentry": reentry}))
    state, parts, tractions, increments = law.initial_state(1, 1), [], [], []
    for _ in range(cycles):
        for speed, step in ((1e-5, 1e-8), (3e-3, 1e-8)):
            for _ in range(steps):
                response = law.update(
                    np.array([[step]]),
                    step / speed,
                    np.array([PRESSURE]),
                    np.array([FILM]),
                    state,
                )
                state = response.state
                lost = response.dissipation
                parts.append(float((lost.total - lost.numerical)[0]))
                tractions.append(float(response.traction[0, 0]))
                increments.append(step)
    return Jumps(
        slip=np.cumsum(increments),
        traction=np.array(tractions),
        dissipated=np.cumsum(parts),
        least=min(parts),
    )


def film_stress(speed: Floats, **flow: float) -> Floats:
    """Traction of a film that carries all, Pa, over the speed, m/s."""
    law = FrictionMap(FrictionMapParameters(**BASE | flow))
    n = len(speed)
    film = np.full(n, law.parameters.D_max)
    slip, pressure = speed[:, None], np.full(n, PRESSURE)
    return law.update(slip, 1.0, pressure, film, law.initial_state(n, 1)).traction[:, 0]


def traction_over_pressure(onset: float, pressure: Floats) -> Floats:
    """Traction in steady sliding at 0.5 mm/s, Pa, over the contact pressure, Pa."""
    law = FrictionMap(FrictionMapParameters(**BASE | {"film_onset_pressure": onset}))
    n = len(pressure)
    slip = np.full((n, 1), 1e-4)
    response = law.update(slip, 0.2, pressure, np.full(n, FILM), law.initial_state(n, 1))
    return response.traction[:, 0]


def draw_second_law(axes: Sequence[Axes]) -> None:
    """Traction and dissipation through jumps of the speed, under both re-entry rules."""
    rules: tuple[tuple[Reentry, str], ...] = (("consistent", COLOURS[0]), ("literal", RED))
    for reentry, colour in rules:
        jumps = velocity_jumps(reentry)
        low = f"{reentry}: least step {1e3 * jumps.least:.3g} mJ/m²"
        axes[0].plot(1e6 * jumps.slip, jumps.traction / 1e3, color=colour, label=reentry)
        axes[1].plot(1e6 * jumps.slip, 1e3 * jumps.dissipated, color=colour, label=low)
    axes[0].set(xlabel="slip (µm)", ylabel="traction (kPa)")
    axes[1].set(xlabel="slip (µm)", ylabel="dissipated so far (mJ/m²)")


def draw_film(axes: Sequence[Axes]) -> None:
    """Stress of the film over the speed, and the traction of a point that opens."""
    speed: Floats = np.asarray(np.geomspace(1e-4, 1.0, 200), dtype=np.float64)
    for number, (name, flow) in enumerate(FLOWS.items()):
        stress = film_stress(speed, **flow) / 1e3
        axes[0].loglog(speed, stress, color=colour_of(number), ls=dashes_of(number), label=name)
    axes[0].set(xlabel="speed (m/s), D = 250 nm", ylabel="stress of the film (kPa)")
    pressure = np.concatenate([[0.0, 1e-6], np.linspace(50.0, 2e4, 400)])
    for number, onset in enumerate((0.0, 1e4)):
        label = f"film_onset_pressure = {onset / 1e3:g} kPa"
        axes[1].plot(pressure / 1e3, traction_over_pressure(onset, pressure) / 1e3, label=label,
                     color=colour_of(number), ls=dashes_of(number))  # fmt: skip
    axes[1].set(xlabel="contact pressure (kPa)", ylabel="traction at 0.5 mm/s (kPa)")


def draw_coefficients(axes: Sequence[Axes]) -> None:
    """Coefficient of friction over the slip path, and over the speed."""
    path: Floats = np.asarray(np.linspace(0.0, 10e-6, 400), dtype=np.float64)
    for number, rate in enumerate((3e5, 1e6, 1e7)):
        weakening = FrictionMapParameters(**BASE | {"mu_d": 0.05, "A_d": 1e-6, "B": rate}).friction
        axes[0].plot(1e6 * path, weakening.coefficient(path), label=f"B = {rate / 1e6:g} 1/µm",
                     color=colour_of(number), ls=dashes_of(number))  # fmt: skip
    axes[0].set(xlabel="permanent slip (µm), A_d = 1 µm", ylabel="coefficient of friction")
    speed: Floats = np.asarray(np.geomspace(1e-6, 1e-1, 400), dtype=np.float64)
    for number, delta in enumerate((0.5, 1.0, 2.0)):
        law = StribeckParameters(mu_s=0.1, mu_d=0.05, V_s=1e-3, delta=delta, K_T=1e12)
        axes[1].semilogx(speed, law.coefficient(speed)[0], label=f"δ = {delta:g}",
                         color=colour_of(number), ls=dashes_of(number))  # fmt: skip
    axes[1].set(xlabel="speed (m/s), V_s = 1 mm/s", ylabel="coefficient of friction")


FIGURES: dict[str, Callable[[Sequence[Axes]], None]] = {
    "law_second_law": draw_second_law,
    "law_film": draw_film,
    "law_coefficients": draw_coefficients,
}


def draw_law(directory: Path) -> list[Path]:
    """Draw every figure of the law's documentation."""
    directory.mkdir(parents=True, exist_ok=True)
    files = []
    for name, draw in FIGURES.items():
        with rc_context(STYLE):
            figure = Figure(figsize=(9.0, 3.6), layout="constrained")
            axes = figure.subplots(1, 2)
            draw(axes)
            for one in axes:
                one.legend(fontsize="small")
            files.append(directory / f"{name}.png")
            figure.savefig(files[-1], dpi=130)
    return files


if __name__ == "__main__":
    for file in draw_law(Path(sys.argv[1])):
        print(file)
