"""Rubber cords and rings squeezed between plates: Hertz, and Lindley's formula for O-rings."""

import math
from itertools import pairwise

import numpy as np
import pytest

from tests.mesh_file import write_mesh
from tests.solved import solved as run

CORD, E = 5e-3, 5e6  # m, diameter; Pa
CENTRE = 50e-3  # m, radius of the ring


def half_disc(path, cells, centre):
    """Upper half of a disc: a square of quadrilaterals that is blown up to its circle."""
    radius = 0.5 * CORD
    nodes = []
    for v in np.linspace(0.0, 1.0, cells + 1):
        for u in np.linspace(-1.0, 1.0, 2 * cells + 1):
            size = max(abs(u), v)
            angle = math.atan2(v, u)
            # Circles outside, squares inside.
            square = np.array([u, v])
            circle = size * np.array([math.cos(angle), math.sin(angle)])
            x, y = radius * (size * circle + (1.0 - size) * 0.8 * square)
            nodes.append((centre + x, y))
    wide = 2 * cells + 1

    def at(i, j):
        return 1 + i + wide * j

    outer = [(2 * cells, j) for j in range(cells + 1)]
    outer += [(i, cells) for i in range(2 * cells - 1, -1, -1)]
    outer += [(0, j) for j in range(cells - 1, -1, -1)]
    rows = [f"1 2 1 1 {at(*a)} {at(*b)}" for a, b in pairwise(outer)]
    rows += [f"1 2 2 2 {at(i, 0)} {at(i + 1, 0)}" for i in range(2 * cells)]
    rows += [
        f"3 2 3 3 {at(i, j)} {at(i + 1, j)} {at(i + 1, j + 1)} {at(i, j + 1)}"
        for j in range(cells)
        for i in range(2 * cells)
    ]
    return str(write_mesh(path, ['1 1 "outside"', '1 2 "mid"', '2 3 "ring"'], nodes, rows))


def squeezed(mesh, squeeze, steps, friction="frictionless", **geometry):
    """Force of the plate, N; friction: a law, or a coefficient.

    The path of the last steps would press the rubber by up to 700 times the force of the solution.
    """
    law = {"law": friction} if isinstance(friction, str) else {"law": "coulomb", "mu": friction}
    down = {"y": [[0.0, 0.0], [1.0, -0.5 * squeeze * CORD]]}
    plate = {"shape": "plane", "point": [0, 0.5 * CORD], "normal": [0, -1], "displacement": down}
    data = {
        "geometry": {"mesh": mesh} | geometry,
        "bodies": {"ring": {"material": "neo-hookean", "E": E, "nu": 0.499}},
        "tools": {"plate": plate},
        "contact": [{"slave": "outside", "master": "plate", "friction": law}],
        "boundary": [{"surface": "mid", "symmetry": True}],
        "stage": [{"name": "squeeze", "duration": 1.0, "steps": steps}],
    }
    simulation = run(data)
    assert max(row.newton_iterations for row in simulation.rows) <= 10
    tools = simulation.state.tools
    return float(dict(zip(tools.columns, tools.rows[-1], strict=True))["force_y"])


def test_rings_are_lindleys_and_cords_a_third_stiffer(tmp_path):
    """A ring widens and a cord cannot: 1.31 times F/(pi D d E) = 1.25 C^1.5 + 50 C^6."""
    squeeze = 0.2
    lindley = (1.25 * squeeze**1.5 + 50.0 * squeeze**6) * E * CORD
    mesh = half_disc(tmp_path / "ring.msh", 20, CENTRE)
    ring = squeezed(mesh, squeeze, 8, section="axisymmetric") / (2.0 * math.pi * CENTRE)
    assert ring == pytest.approx(lindley, rel=0.04)
    rough = squeezed(mesh, squeeze, 8, 0.2, section="axisymmetric") / (2.0 * math.pi * CENTRE)
    assert 1.1 * ring < rough < 1.5 * ring
    cord = squeezed(mesh, squeeze, 8, thickness=1.0)
    assert cord == pytest.approx(1.31 * lindley, rel=0.04)
