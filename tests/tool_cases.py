"""Small cases of one block and rigid tools, which tests of tools share."""

import copy
from pathlib import Path
from typing import Any

import numpy as np

from tests.mesh_file import write_mesh
from tribox.app.case.case import Case

WIDTH, HEIGHT = 4e-3, 1e-3  # m
SIDES = {"bottom": 1, "right": 2, "top": 3, "left": 4}


def block_mesh(
    path: Path,
    counts: tuple[int, int] = (8, 3),
    grading: float = 0.0,
    scale: float = 1.0,
    halves: bool = False,
) -> Path:
    """A block [0, 4] x [0, 1] mm as a gmsh file; ``halves``: with a surface right top."""
    nx, ny = counts
    x, y = np.linspace(-1.0, 1.0, nx + 1), np.linspace(-1.0, 0.0, ny + 1)
    if grading:
        x, y = (np.sinh(grading * a) / np.sinh(grading) for a in (x, y))
    x, y = 0.5 * WIDTH * (1.0 + x) * scale, HEIGHT * (1.0 + y) * scale
    nodes = [(a, b) for b in y for a in x]

    def at(i: int, j: int) -> int:
        return 1 + i + (nx + 1) * j

    lines = [(1, at(i, 0), at(i + 1, 0)) for i in range(nx)]
    lines += [(2, at(nx, j), at(nx, j + 1)) for j in range(ny)]
    lines += [(6 if halves and 2 * i >= nx else 3, at(i + 1, ny), at(i, ny)) for i in range(nx)]
    lines += [(4, at(0, j + 1), at(0, j)) for j in range(ny)]
    cells = [
        (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1))
        for j in range(ny)
        for i in range(nx)
    ]
    sides = SIDES | ({"right top": 6} if halves else {})
    names = [f'1 {tag} "{name}"' for name, tag in sides.items()] + ['2 5 "block"']
    rows = [f"1 2 {tag} {tag} {a} {b}" for tag, a, b in lines]
    rows += [f"3 2 5 5 {' '.join(map(str, cell))}" for cell in cells]
    return write_mesh(path, names, nodes, rows)


def block_case(mesh: Path, **tables: Any) -> dict[str, Any]:
    """A block of rubber on its fixed bottom, pressed by a plane from above by 50 um."""
    data = {
        "geometry": {"mesh": str(mesh), "thickness": "2 mm"},
        "bodies": {"block": {"material": "neo-hookean", "E": "5 MPa", "nu": 0.4}},
        "tools": {"punch": plane(displacement={"y": [["0 s", "0 m"], ["1 s", "-50 um"]]})},
        "contact": [{"slave": "top", "master": "punch", "friction": {"law": "frictionless"}}],
        "boundary": [{"surface": "bottom", "displacement": {"x": 0, "y": 0}}],
        "stage": [{"name": "press", "duration": "1 s", "steps": 3}],
    }
    return copy.deepcopy(data | tables)


def plane(**motion: Any) -> dict[str, Any]:
    """A plane on the block's top."""
    return {"shape": "plane", "point": [2e-3, HEIGHT], "normal": [0, -1], **motion}


def circle(radius: float = 2e-3, **motion: Any) -> dict[str, Any]:
    """A round tool that touches the middle of the block's top."""
    return {"shape": "circle", "centre": [2e-3, HEIGHT + radius], "radius": radius, **motion}


def case_of(data: dict[str, Any]) -> Case:
    """The checked case."""
    return Case.model_validate(data)
