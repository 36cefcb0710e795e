"""What it costs to evaluate bodies that remember: ``python3 -m benchmarks.points_that_remember``.

Time per cell of a tangent (moduli of all points, matrix), of a residual (update of all points,
forces) and of an explicit step (residual and commit), beside those of the elastic body on the same
mesh: two branches beside the neo-Hookean body, J2 with hardening beside Hencky's, one backstress
beside J2. All of the metal flows. Matrices are added to in place, as in a run.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from benchmarks.verify.flowing import FlowingBody, Shape, rectangle
from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.pattern import cell_matrix
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Backstress, Linear, Voce
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.materials import Hencky, Material, NeoHookean
from tribox.forms.bodies.memory_solid import MemorySolid
from tribox.forms.bodies.solid import Formulation
from tribox.forms.bodies.viscous_points import Branch, Viscoelastic

G, K = 1.0, 20.0
RUBBER = NeoHookean(G, K)
VOCE, LINEAR = Voce(0.01, 0.03, 20.0, 0.05), Linear(0.01, 0.05)
BACK = (Backstress(0.05, 5.0),)
MATERIALS: dict[str, tuple[Material, str]] = {
    "neo-Hooke": (RUBBER, "neo-Hooke"),
    "two branches": (Viscoelastic(RUBBER, (Branch(0.5, 1.0), Branch(0.3, 10.0))), "neo-Hooke"),
    "Hencky": (Hencky(G, K), "Hencky"),
    "J2, linear": (ElastoPlastic(G, K, LINEAR), "Hencky"),
    "J2, Voce": (ElastoPlastic(G, K, VOCE), "Hencky"),
    "backstress, linear": (ElastoPlastic(G, K, LINEAR, None, BACK), "J2, linear"),
    "backstress, Voce": (ElastoPlastic(G, K, VOCE, None, BACK), "J2, Voce"),
}
KINDS: tuple[tuple[Formulation, Section], ...] = (
    ("q1-sri", "plane-strain"),
    ("q1", "plane-strain"),
    ("q1-sri", "axisymmetric"),
    ("q1-sri", "3D"),
)
CALLS = ("tangent", "residual", "explicit step")


def body(material: Material, formulation: Formulation, section: Section, cells: int) -> FlowingBody:
    """A square or cube of about so many cells, sheared and stretched so far that it flows."""
    dim = 3 if section == "3D" else 2
    side = round(cells ** (1.0 / dim))
    low = (1e-2,) + (0.0,) * (dim - 1)
    place = rectangle(low, tuple(value + 1e-2 for value in low))
    made = FlowingBody(Shape((side,) * dim, place, section, formulation), material)
    gradient = 0.02 * np.array([[0.5, 1.0, 0.3], [0.2, -0.8, 0.1], [0.4, 0.0, 0.3]])[:dim, :dim]
    random = np.random.default_rng(1).standard_normal(made.X.shape)
    made.u.x.array[:] = (made.X @ gradient.T + 1e-5 / side * random).reshape(-1)
    return made


def calls(made: FlowingBody) -> dict[str, Callable[[], object]]:
    """What is timed; before each the displacement moves by a hair and the body is as new."""
    solid, u = made.solid, made.u
    bodies = Bodies(u, [solid])
    A = cell_matrix(u.function_space)
    out = np.zeros_like(u.x.array)
    first = solid.points.committed if isinstance(solid, MemorySolid) else None

    def anew() -> None:
        u.x.array[0] += 1e-15
        if isinstance(solid, MemorySolid):
            solid.points.committed, solid.points.last = first, None

    def tangent() -> None:
        solid.evaluate(1.0, tangent=True)
        bodies.add_tangent(A, 0, 1, False)

    def residual() -> None:
        solid.evaluate(1.0)
        bodies.add_forces(out)

    def step() -> None:
        bodies.evaluate(u.x.array, out, 1.0)
        solid.commit()

    def known() -> None:
        anew()
        solid.evaluate(1.0)

    return {"tangent": tangent, "residual": residual, "explicit step": step} | {
        "before tangent": known,  # the residual at the same place comes first in Newton's method
        "before residual": anew,
        "before explicit step": anew,
    }


def shortest(of: dict[str, dict[str, Callable[[], object]]], repeat: int) -> dict[str, list[float]]:
    """Seconds of each call, the shortest of many; taken in turn, since machines are shared."""
    best = {name: [float("inf")] * len(CALLS) for name in of}
    for _ in range(repeat):
        for name, one in of.items():
            for number, call in enumerate(CALLS):
                one[f"before {call}"]()
                start = time.perf_counter()
                one[call]()
                best[name][number] = min(best[name][number], time.perf_counter() - start)
    return best


def rows(cells: int, repeat: int) -> list[str]:
    """The table: ns per cell, and over the body that each is compared with."""
    lines = ["| elements | material | over | tangent | residual | explicit step |"]
    lines.append("|---|---|---|---|---|---|")
    for formulation, section in KINDS:
        made = {
            name: body(material, formulation, section, cells)
            for name, (material, _) in MATERIALS.items()
        }
        best = shortest({name: calls(one) for name, one in made.items()}, repeat)
        for name, (_, other) in MATERIALS.items():
            number = len(made[name].solid.cells)
            parts = [
                f"{1e9 * mine / number:.0f} ns"
                + (f", **{mine / its:.2f}**" if other != name else "")
                for mine, its in zip(best[name], best[other], strict=True)
            ]
            lines.append(f"| {formulation}, {section} | {name} | {other} | {' | '.join(parts)} |")
    return lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=5_000)
    parser.add_argument("--repeat", type=int, default=20)
    chosen = parser.parse_args()
    print("\n".join(rows(chosen.cells, chosen.repeat)))


if __name__ == "__main__":
    main()
