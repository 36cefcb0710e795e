"""Rubber that rubs round corners and over rods, in few iterations."""

import pytest

from tests.mesh_file import write_mesh
from tests.solved import Cuts, solved

MM = 1e-3
RUBBER = {"material": "NR-60A"}


def stopper(path, across=10, along=24):
    """A stopper of 8 to 10 mm of radius over its 20 mm, as a gmsh file."""

    def at(i, j):
        return 1 + i + (across + 1) * j

    heights = [j / along for j in range(along + 1)]
    nodes = [((8 + 2 * y) * i / across, 20 * y) for y in heights for i in range(across + 1)]
    rows = [f"1 2 1 1 {at(i + 1, along)} {at(i, along)}" for i in range(across)]
    rows += [f"1 2 2 2 {at(across, j)} {at(across, j + 1)}" for j in range(along)]
    for j in range(along):
        for i in range(across):
            rows.append(f"3 2 3 3 {at(i, j)} {at(i + 1, j)} {at(i + 1, j + 1)} {at(i, j + 1)}")
    write_mesh(path, ['1 1 "top"', '1 2 "side"', '2 3 "rubber"'], nodes, rows)
    return {"mesh": str(path), "scale": "mm", "section": "axisymmetric"}


def test_a_stopper_of_rubber_is_pushed_into_a_neck(tmp_path):
    """It rests on the round edge of the neck by two or three vertices, which open in turn."""
    way = {"y": [[0.0, 0.0], [0.05, -6.1 * MM], [1.0, -11.0 * MM]]}
    neck = {
        "shape": "polyline",
        "points": [[9 * MM, -40 * MM], [9 * MM, 5 * MM], [14 * MM, 5 * MM]],
        "fillet_radius": 1.5 * MM,
    }
    case = {
        "geometry": stopper(tmp_path / "stopper.msh"),
        "bodies": {"rubber": RUBBER},
        "tools": {"neck": neck},
        "contact": [{"slave": "side", "master": "neck", "friction": {"law": "coulomb", "mu": 0.3}}],
        "boundary": [{"surface": "top", "displacement": way}],
        "stage": [{"name": "in", "duration": 1.0, "steps": 20}],
    }
    seen = Cuts()
    assert solved(case, observer=seen).rows[-1].normal_force > 0.0
    # 369; soft contacts that began without pressures took 670 and a cut.
    assert seen.count == 0 and seen.iterations <= 450


@pytest.mark.long
def test_a_rod_is_dragged_over_rubber():
    """Where vertices snap from it one by one, the next equilibrium is far away."""
    way = {
        "x": [[0.0, 0.0], [1.0, 0.0], [1.75, 3.75 * MM]],
        "y": [[0.0, 0.0], [1.0, -1.0 * MM]],
    }
    rod = {"shape": "circle", "centre": [3 * MM, 5.5 * MM], "radius": 1.5 * MM}
    block = {"x": [0.0, 12 * MM], "y": [0.0, 4 * MM], "elements": [16, 6]}
    case = {
        "geometry": {"kind": "blocks", "thickness": 10 * MM, "blocks": {"pad": block}},
        "bodies": {"pad": {"material": "neo-hookean", "E": 3.2e6, "nu": 0.45}},
        "tools": {"rod": {**rod, "displacement": way}},
        "contact": [
            {"slave": "pad_top", "master": "rod", "friction": {"law": "coulomb", "mu": 0.5}}
        ],
        "boundary": [{"surface": "pad_bottom", "displacement": {"x": 0, "y": 0}}],
        "stage": [
            {"name": "press", "duration": 1.0, "steps": 5},
            {"name": "drag", "duration": 0.75, "steps": 9},
        ],
    }
    seen = Cuts()
    assert solved(case, observer=seen).rows[-1].time == pytest.approx(1.75)
    assert seen.iterations <= 1000  # 728
