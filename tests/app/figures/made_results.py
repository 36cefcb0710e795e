"""Results directories made by hand: numbers are simple functions of step and place."""

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from tribox.app.simulation.history import COLUMNS

STRIP = """
title = "strip between punch and die"
geometry = { kind = "file", mesh = "strip.msh", section = "SECTION" }
bodies.punch = { material = "neo-hookean", E = "200 MPa", nu = 0.3 }
bodies.strip = { material = "neo-hookean", E = "20 MPa", nu = 0.4 }
bodies.die = { material = "neo-hookean", E = "400 MPa", nu = 0.3 }
stage = [
 { name = "press", duration = "1 s", steps = 2 },
 { name = "slide", duration = "1 s", velocity = "0.2 mm/s", steps = 3 },
]
[[contact]]
name = "upper"
slave = "strip_upper"
master = "punch_face"
friction = { law = "coulomb", mu = 0.1 }
[[contact]]
name = "lower"
slave = "strip_lower"
master = "die_face"
friction = { law = "coulomb", mu = 0.2 }
[[boundary]]
surface = "die_bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "punch_top"
displacement = { x = "driven", y = [["0 s", "0 mm"], ["1 s", "-0.05 mm"]] }
"""
STAGES = ("press", "press", "slide", "slide", "slide")
STEPS = tuple(range(1, 6))
PAIRS = ("upper", "lower")
HIGHEST = 3  # step with the largest normal force


def normal_force(step: int, pair: int) -> float:
    """N, of a pair of the strip."""
    return (10.0 + 2.0 * pair) * (1.0 - 0.1 * (step - HIGHEST) ** 2)


def friction_force(step: int, pair: int) -> float:
    """F_T, of a pair of the strip."""
    return normal_force(step, pair) * (0.1 + 0.1 * pair) * step / 5.0


def write_rows(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a table."""
    found = list(rows)
    with path.open("w", newline="") as stream:
        out = csv.DictWriter(stream, list(found[0]))
        out.writeheader()
        out.writerows(found)


def history_row(step: int, **values: Any) -> dict[str, Any]:
    """A row of the history: ones but for what is given."""
    row = dict.fromkeys(COLUMNS, 1.0) | {"step": step, "time": 0.5 * step, "dt": 0.5}
    return row | {"velocity": 0.0, "driven_displacement": 0.0} | values


def write_index(directory: Path, steps: Sequence[int]) -> None:
    """The index of the field outputs."""
    sets = "".join(f'<DataSet timestep="{0.5 * s}" file="fields/{s:06d}.vtu"/>' for s in steps)
    text = (
        f'<?xml version="1.0"?><VTKFile type="Collection"><Collection>{sets}</Collection></VTKFile>'
    )
    (directory / "fields.pvd").write_text(text)


def write_strip(
    directory: Path,
    outputs: Sequence[int] = STEPS,
    status: str = "done",
    section: str = "plane-strain",
) -> Path:
    """A run of the strip: tables of five steps, and fields of some of them."""
    directory.mkdir(parents=True)
    (directory / "case.toml").write_text(STRIP.replace("SECTION", section))
    (directory / "strip.msh").touch()  # that the case names, and no figure reads
    rows, pairs, surfaces = [], [], []
    for step, stage in zip(STEPS, STAGES, strict=True):
        sliding = stage == "slide"
        forces = {
            "normal_force": sum(normal_force(step, k) for k in (0, 1)),
            "friction_force": sum(friction_force(step, k) for k in (0, 1)),
        }
        driven = {"velocity": 2e-4 * sliding, "driven_displacement": 1e-4 * max(step - 2, 0)}
        rows.append(history_row(step, stage=stage, **forces, **driven))
        common = {"step": step, "time": 0.5 * step, "stage": stage}
        for k, name in enumerate(PAIRS):
            own = {"normal_force": normal_force(step, k), "friction_force": friction_force(step, k)}
            pairs.append(common | {"pair": name} | own | {"contact_area": 2e-6})
        for name, moved in (("die_bottom", 0.0), ("punch_top", 1.0)):
            motion = {
                "displacement_x": moved * driven["driven_displacement"],
                "displacement_y": -2.5e-5 * moved * min(step, 2),
                "velocity_x": 0.0, "velocity_y": 0.0,
                "force_x": moved * 0.1 * step, "force_y": -moved * normal_force(step, 0),
                "moment_z": 0.0,
            }  # fmt: skip
            surfaces.append(common | {"surface": name} | motion)
    for name, table in (("history", rows), ("contacts", pairs), ("surfaces", surfaces)):
        write_rows(directory / f"{name}.csv", table)
    for kind in ("fields", "contact", "contact_points"):
        (directory / kind).mkdir()
    write_index(directory, outputs)
    for step in outputs:
        strip_fields(step).write(directory / f"fields/{step:06d}.vtu")
        strip_contact(step).write(directory / f"contact/{step:06d}.vtu")
        strip_points(step).write(directory / f"contact_points/{step:06d}.vtu")
    ends = [{"label": r["stage"], "steady": None, **r} for r in (rows[1], rows[-1])]
    summary = {"status": status, "load_steps": ends, "bodies": ["punch", "strip", "die"]}
    (directory / "summary.json").write_text(json.dumps(summary))
    return directory


# Left and right end, lower and upper side in m, columns and rows of elements: punch, strip, die.
BLOCKS = (
    (1e-3, 3e-3, 0.2e-3, 1.0e-3, 4, 2),
    (0.0, 4e-3, 0.0, 0.2e-3, 8, 1),
    (0.0, 4e-3, -0.8e-3, 0.0, 6, 2),
)
CELLS = tuple(columns * rows for *_, columns, rows in BLOCKS)


def strip_fields(step: int) -> meshio.Mesh:
    """The three blocks after a step: the punch moved, with one stress for each block."""
    points, cells, body = [], [], []
    for number, (left, right, low, high, columns, rows) in enumerate(BLOCKS):
        x, y = np.meshgrid(np.linspace(left, right, columns + 1), np.linspace(low, high, rows + 1))
        first = sum(len(p) for p in points)
        points.append(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1))
        corner = np.add.outer(np.arange(rows) * (columns + 1), np.arange(columns)).ravel() + first
        cells.append(corner[:, None] + np.array([0, 1, columns + 2, columns + 1]))
        body.append(np.full(len(corner), number))
    place, of = np.concatenate(points), np.concatenate(body)
    moved = np.zeros_like(place)
    moved[: len(points[0]), 0] = 1e-4 * max(step - 2, 0)
    stress = 1e6 * step * (1.0 + of)
    return meshio.Mesh(
        place + moved,
        [("quad", np.concatenate(cells))],
        point_data={"displacement": moved},
        cell_data={
            "body": [of],
            "von_mises_stress": [stress],
            "cauchy_stress": [np.outer(stress, np.arange(9.0))],
        },
    )


def strip_contact(step: int) -> meshio.Mesh:
    """Both sides of the strip, pressed under the punch; their facets in no order."""
    x = np.linspace(0.0, 4e-3, 9)
    facets = np.stack([np.arange(8), np.arange(1, 9)], axis=1)[[3, 0, 7, 5, 1, 2, 6, 4]]
    reference = np.concatenate([np.stack([x, np.full(9, y), 0 * x], axis=1) for y in (0.2e-3, 0.0)])
    pressed = (reference[:, 0] > 0.9e-3) & (reference[:, 0] < 3.1e-3)
    pair = np.repeat([0.0, 1.0], 9)
    pressure = np.where(pressed, 1e6 * step * (1.0 + pair), 0.0)
    return meshio.Mesh(
        reference,
        [("line", np.concatenate([facets, facets + 9]))],
        point_data={
            "reference": reference, "pair": pair, "pressure": pressure,
            "tangential_traction": 0.1 * pressure, "area": np.full(18, 5e-4),
        },
    )  # fmt: skip


def strip_points(step: int) -> meshio.Mesh:
    """One contact point in the middle of each facet."""
    nodes = strip_contact(step)
    middle = nodes.points[nodes.cells[0].data].mean(axis=1)
    pair = nodes.point_data["pair"][nodes.cells[0].data[:, 0]]
    pressure = np.full(len(middle), 1e6 * step)
    return meshio.Mesh(
        middle,
        [("vertex", np.arange(len(middle))[:, None])],
        point_data={
            "reference": middle, "pair": pair, "pressure": pressure,
            "tangential_traction": 0.1 * pressure,
        },
    )  # fmt: skip
