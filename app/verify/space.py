"""Verification in space on flat surfaces: patch test, sliding in any direction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tribox.app.results.fields import StressField
from tribox.app.verify.result import Check, Floats, Verification
from tribox.app.verify.shipped_case import solve
from tribox.geometry.compat import cell_nodes


def held(surface: str, what: str) -> str:
    """One boundary of an override, `what` being its other keys in TOML."""
    return f'{{surface="{surface}", {what}}}'


PATCH_PRESSURE = 1e5  # Pa, a fiftieth of the elastomer's modulus
_SIDES = [("left", "x"), ("right", "x"), ("front", "z"), ("back", "z")]
_WALLS = [
    held(f"{body}_{side}", f"displacement={{{axis}=0}}")
    for body in ("elastomer", "aluminium")
    for side, axis in _SIDES
]
_PRESSED = [
    held("bottom", "displacement={y=0}"),
    held("top", f"pressure={PATCH_PRESSURE}"),
    *_WALLS,
]
PATCH = (
    "geometry.lower.width=1 mm",
    "geometry.lower.depth=1 mm",
    'contact.0.friction={law="frictionless"}',
    f"boundary=[{', '.join(_PRESSED)}]",
    'stage=[{name="press", duration=1, steps=1}]',
)
MISMATCHES = ((10, 10), (9, 9), (8, 8), (7, 7), (10, 7), (5, 5), (9, 4))
"""Master facets along x and z under the slave's."""
SLAVE_FACETS = 11


@dataclass(frozen=True, slots=True)
class PatchErrors:
    """Largest errors of a patch test, relative to the pressure p.

    Attributes:
        near: |σ_yy/p + 1| at the centres of cells with a node on the interface.
        far: the same in all other cells.
        pressure: |t_N/p − 1| at the contact points.
    """

    near: float
    far: float
    pressure: float


def patch_errors(
    upper: Sequence[int], lower: Sequence[int], overrides: Sequence[str] = ()
) -> PatchErrors:
    """Press two boxes of one width and depth, held on all sides, and compare with σ_yy = −p.

    Args:
        upper: elements of the upper box along x, y, z.
        lower: of the lower box.
        overrides: further "key=value" texts.
    """
    counts = (
        f"geometry.upper.elements={list(upper)}",
        f"geometry.lower.elements={list(lower)}",
    )
    _, simulation = solve("boxes-3d", [*PATCH, *counts, *overrides])
    problem, named = simulation.model.problem, simulation.model.named
    problem.spread(simulation.stepper.x)
    field = StressField(problem.u, problem.solids)
    field.update()
    wrong = np.abs(field.stress.x.array.reshape(-1, 3, 3)[:, 1, 1] / PATCH_PRESSURE + 1.0)
    height = named.mesh.geometry.x[cell_nodes(named.mesh)][:, :, 1]
    touching = (np.abs(height) < 1e-9).any(axis=1)
    points = np.abs(problem.trials[0].pressure / PATCH_PRESSURE - 1.0)
    return PatchErrors(
        float(wrong[touching].max()), float(wrong[~touching].max()), float(points.max())
    )


def patch_space(overrides: Sequence[str] = ()) -> Verification:
    """A uniform pressure through a flat interface of boxes whose nodes do not match."""
    checks = []
    for degree, bar in ((5, 0.02), (9, 0.01)):
        found = [
            patch_errors(
                (SLAVE_FACETS, 5, SLAVE_FACETS),
                (along, 3, across),
                [f"contact.0.quadrature_degree={degree}", *overrides],
            )
            for along, across in MISMATCHES
        ]
        points = (degree + 1) // 2
        name = f"stress at {points} × {points} points, max error"
        checks += [
            Check(f"{name}, at the interface", max(e.near for e in found), bar),
            Check(f"{name}, elsewhere", max(e.far for e in found), 0.5 * bar),
        ]
    matching = (SLAVE_FACETS, 3, SLAVE_FACETS)
    same = patch_errors(matching, matching, ["contact.0.quadrature_degree=1", *overrides])
    worst = max(same.near, same.far)
    checks.append(Check("stress, matching nodes, 1 point, max error", worst, 1e-6))
    under = ", ".join(f"{along} × {across}" for along, across in MISMATCHES)
    return Verification(
        "patch-space",
        "patch test in space",
        f"The boxes of cases/boxes-3d.toml on one another, held on all sides, pressed from above "
        f"with {PATCH_PRESSURE * 1e-6:g} MPa without friction: σ_yy = −p everywhere. "
        f"{SLAVE_FACETS} × {SLAVE_FACETS} slave facets on {under}.",
        tuple(checks),
    )


DIRECTIONS = (0.0, 30.0, 45.0, 90.0)  # degrees from x towards z
QUICK_BOXES = ("geometry.upper.elements=[5, 3, 5]", "geometry.lower.elements=[7, 2, 7]")


def slide(angle: float, overrides: Sequence[str] = ()) -> tuple[Floats, float]:
    """Friction (i,) and normal force, N, of boxes slid in a direction, rad from x towards z."""
    way = f"[{math.cos(angle)!r}, 0, {math.sin(angle)!r}]"
    direction = f"boundary.1.displacement.direction={way}"
    _, simulation = solve("boxes-3d", [direction, *overrides])
    row = simulation.rows[-1]
    return np.array([row.friction_x, row.friction_y, row.friction_z]), row.normal_force


def isotropy(overrides: Sequence[str] = ()) -> Verification:
    """The same friction, whatever the direction of gross sliding."""
    angles = np.radians(DIRECTIONS)
    found = [slide(float(angle), [*QUICK_BOXES, *overrides]) for angle in angles]
    size = np.array([np.linalg.norm(friction) for friction, _ in found])
    load = np.array([normal for _, normal in found])
    way = np.array([[math.cos(a), 0.0, math.sin(a)] for a in angles])
    off = [float(np.linalg.norm(f / s - w)) for (f, _), s, w in zip(found, size, way, strict=True)]
    named = ", ".join(f"{d:g}" for d in DIRECTIONS)
    return Verification(
        "isotropy",
        "gross sliding in several directions",
        f"cases/boxes-3d.toml, coarse, slid in directions of {named} degrees from x towards z "
        "until all slides. The boxes are square: elastic deformation, which is still dying out at "
        "the end, is askew to a slide in 30 degrees.",
        (
            Check("friction by direction, largest difference", float(np.ptp(size) / size[0]), 1e-6),
            Check("T/(µN), largest error", float(np.abs(size / (0.2 * load) - 1.0).max()), 1e-6),
            Check("angle between friction and motion, max (rad)", max(off), 1e-5),
        ),
    )
