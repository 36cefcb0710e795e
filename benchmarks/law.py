"""``tribox bench law``: the friction-map law against a plain numpy Coulomb return mapping.

Other numbers of points or dimensions: ``python3 -m benchmarks.law --points 100000 --dim 3``.

All update the same random points, most of them sliding, tangents included; the ratio is of the CPU
time of the fastest of some repetitions each, to the faster of two ways to write Coulomb friction.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.parameters import FrictionMapParameters, with_preset

Floats = NDArray[np.float64]
LIMIT = 8.0
MU, K_T, PRESSURE, FILM, DT = 0.12, 1e12, 3e6, 30e-9, 1e-3

VARIANTS: dict[str, dict[str, Any]] = {
    "constant coefficient": {"mu_d": MU},
    "slip weakening": {"mu_d": 0.1, "A_d": 1e-7, "B": 1e5},
    "every option of the film": {
        "mu_d": 0.1,
        "A_d": 1e-7,
        "B": 1e5,
        "tau_0": 1e6,
        "zeta": 0.05,
        "critical_rate": 1e4,
        "thinning_exponent": 0.5,
        "barus": 1e-8,
        "film_onset_pressure": 1e4,
    },
}


def coulomb(
    slip: Floats, pressure: Floats, elastic: Floats, path: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """A plain Coulomb return mapping: traction, dT/dslip, dT/dpressure, elastic slip, path.

    Written the way one writes it in numpy, vectors as (q, i).
    """
    trial = elastic + slip
    length = np.linalg.norm(trial, axis=1)
    direction = trial / np.where(length > 0.0, length, 1.0)[:, None]
    threshold = MU * pressure
    sliding = K_T * length > threshold
    size = np.where(sliding, threshold, K_T * length)
    traction = size[:, None] * direction
    across = np.where(sliding, threshold / np.where(length > 0.0, length, 1.0), K_T)
    along = np.where(sliding, 0.0, K_T)
    projector = direction[:, :, None] * direction[:, None, :]
    tangent = across[:, None, None] * (np.eye(slip.shape[1]) - projector)
    tangent += along[:, None, None] * projector
    d_pressure = np.where(sliding, MU, 0.0)[:, None] * direction
    kept = traction / K_T
    return traction, tangent, d_pressure, kept, path + np.linalg.norm(trial - kept, axis=1)


def lean_coulomb(
    slip: Floats, pressure: Floats, elastic: Floats, path: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """The same as quickly as numpy does it: vectors as (i, q), nothing computed twice."""
    trial = elastic.T + slip.T
    dim, n = trial.shape
    length = np.sqrt(sum(x * x for x in trial))
    threshold = MU * pressure
    sliding = K_T * length > threshold
    size = np.where(length > 0.0, length, 1.0)
    across = np.where(sliding, threshold / size, K_T)
    traction = across * trial
    direction = trial / size
    excess = np.where(sliding, -across, 0.0)
    tangent = np.empty((dim, dim, n))
    for i in range(dim):
        scaled = excess * direction[i]
        for j in range(i + 1):
            tangent[i, j] = tangent[j, i] = scaled * direction[j]
        tangent[i, i] += across
    d_pressure = np.where(sliding, MU, 0.0) * direction
    share = across / K_T
    return traction, tangent, d_pressure, share * trial, path + (1.0 - share) * length


def fastest(run: Callable[[], object], repeat: int) -> float:
    """CPU time of the fastest of some runs, s."""
    times = []
    for _ in range(repeat):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def measure(points: int, dim: int, repeat: int) -> dict[str, float]:
    """Seconds of each law, by name."""
    rng = np.random.default_rng(0)
    slip = 4e-7 * rng.normal(size=(points, dim))
    pressure = PRESSURE * rng.uniform(0.5, 1.5, points)
    film = np.full(points, FILM)
    elastic, path = 1e-7 * rng.normal(size=(points, dim)), 1e-6 * rng.random(points)
    seconds = {
        "Coulomb, plain": fastest(lambda: coulomb(slip, pressure, elastic, path), repeat),
        "Coulomb, lean": fastest(lambda: lean_coulomb(slip, pressure, elastic, path), repeat),
    }
    for name, options in VARIANTS.items():
        values = {"mu_s": MU, "K_T": K_T, "V_star": 1e-3, "V_star_at": 10e-9} | options
        law = FrictionMap(FrictionMapParameters(**with_preset("friction-map", values)))
        state = law.initial_state(points, dim)
        state.elastic_slip, state.slip_path = elastic, path
        state.alpha[:], state.closed[:] = 0.9967, True
        update = partial(law.update, slip, DT, pressure, film, state)
        seconds[name] = fastest(update, repeat)
    return seconds


def ratio(seconds: dict[str, float]) -> float:
    """Cost of the friction map with slip weakening over that of the faster Coulomb."""
    plain = min(seconds["Coulomb, plain"], seconds["Coulomb, lean"])
    return seconds["slip weakening"] / plain


def lines(points: int = 1_000_000, dim: int = 2, repeat: int = 5) -> Iterator[str]:
    """Measure; lines of the report, as Markdown."""
    seconds = measure(points, dim, repeat)
    plain = min(seconds["Coulomb, plain"], seconds["Coulomb, lean"])
    yield f"{points} points, {dim}D, fastest of {repeat}, CPU time:"
    yield ""
    yield "| law | s | ns per point | over the faster Coulomb |"
    yield "|---|---|---|---|"
    for name, taken in seconds.items():
        yield f"| {name} | {taken:.3f} | {1e9 * taken / points:.0f} | {taken / plain:.2f} |"
    yield ""
    yield (
        f"friction map with slip weakening over the faster Coulomb: {ratio(seconds):.2f} "
        f"(limit {LIMIT:g})"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--dim", type=int, choices=(2, 3), default=2)
    parser.add_argument("--repeat", type=int, default=5)
    chosen = parser.parse_args()
    print("\n".join(lines(chosen.points, chosen.dim, chosen.repeat)))


if __name__ == "__main__":
    main()
