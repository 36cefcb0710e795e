"""The press and slide of cases/block-slide.toml on a rigid plane, by FElupe.

``python3 felupe_slide.py REPORT.json [LEVEL]``, by a Python that has FElupe. It imports nothing of
tribox. The aluminium block, 14 000 times as stiff, is a plane here: FElupe has node-to-plane
contact only. Millimetres, newtons, megapascals; the slab is 1 mm thick.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import felupe as fem
import numpy as np

WIDTH, HEIGHT, ELEMENTS = 1.0, 0.5, (40, 20)
E, NU, FRICTION = 5.0, 0.45, 0.2
PRESSED, SLID, PRESS_STEPS, SLIDE_STEPS = 0.05, 0.3, 10, 30
SHEAR, LAME = E / (2.0 * (1.0 + NU)), E * NU / ((1.0 + NU) * (1.0 - 2.0 * NU))
PENALTY, STICK = 30.0 * 10.0 * SHEAR, 10.0 * SHEAR  # MPa, over the length of a facet: tribox' own
TOLERANCE = 1e-8


def slide(level: int) -> tuple[list[dict[str, object]], int]:
    """Solve; returns forces on the plane, N, and Newton iterations by step, and the unknowns."""
    counts = [count * level for count in ELEMENTS]
    mesh = fem.Rectangle(a=(0.0, 0.0), b=(WIDTH, HEIGHT), n=tuple(n + 1 for n in counts))
    bottom = np.flatnonzero(mesh.y < 1e-9)
    mesh.add_points([0.5 * WIDTH, 0.0])
    field = fem.FieldContainer([fem.FieldPlaneStrain(fem.RegionQuad(mesh), dim=2)])
    body = fem.SolidBody(fem.NeoHookeCompressible(mu=SHEAR, lmbda=LAME), field)
    # A node at the end of the side stands for half a facet, which FElupe does not know.
    plane = fem.ContactRigidPlane(
        field,
        bottom,
        -1,
        [0.0, 1.0],
        friction=FRICTION,
        multiplier=PENALTY,
        multiplier_tangential=STICK,
    )
    held = {
        "plane": fem.Boundary(field[0], mask=np.arange(mesh.npoints) == mesh.npoints - 1),
        "along": fem.Boundary(field[0], fy=HEIGHT, skip=(0, 1)),
        "down": fem.Boundary(field[0], fy=HEIGHT, skip=(1, 0)),
    }
    down = -PRESSED * np.arange(1, PRESS_STEPS + 1) / PRESS_STEPS
    along = SLID * np.arange(1, SLIDE_STEPS + 1) / SLIDE_STEPS
    steps = [
        fem.Step([body, plane], {held["down"]: down, held["along"]: 0.0 * down}, held),
        fem.Step([body, plane], {held["down"]: 0.0 * along - PRESSED, held["along"]: along}, held),
    ]
    rows: list[dict[str, object]] = []

    def keep(context: Any, state: Any) -> None:
        force = fem.tools.force(field, context.substep.fun, held["plane"])
        rows.append({"forces": force.tolist(), "iterations": int(context.substep.iterations)})

    # Newton's method fails at the onset of slip; with a line search beside the cutback it takes
    # longer, with the line search alone it fails as well.
    plugins = [fem.CutbackPlugin(), keep]
    fem.Job(steps, plugins=plugins).evaluate(tol=TOLERANCE, verbose=0)
    return rows, field[0].values.size


if __name__ == "__main__":
    found, dofs = slide(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    facts = {"version": fem.__version__, "dofs": dofs, "steps": found}
    Path(sys.argv[1]).write_text(json.dumps(facts))
