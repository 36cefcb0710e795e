"""A round die of two second-order facets presses as a cylinder does; straight ones have corners."""

import gmsh
import numpy as np
import pytest

from tests.geometry.meshes.test_mesh import group, write_built
from tests.ranks import command
from tribox.app.figures.body_shapes import read_bodies
from tribox.app.results import read

RADIUS = 10e-3  # m
CASE = """
geometry = { mesh = "die.msh", scale = "mm", thickness = "1 mm" }
bodies."round die" = { material = "neo-hookean", E = "70 GPa", nu = 0.3 }
bodies."pad block" = { material = "neo-hookean", E = "5 MPa", nu = 0.3 }
contact = [{ slave = "pad face", master = "die face", friction = { law = "frictionless" } }]
boundary = [
 { surface = "pad bottom", displacement = { y = 0 } },
 { surface = "pad axis", displacement = { x = 0 } },
 { surface = "die axis", displacement = { x = 0 } },
 { surface = "die top", displacement = { y = [["0 s", "0 mm"], ["1 s", "-0.3 mm"]] } },
]
stage = [{ name = "press", duration = "1 s", steps = 2 }]
output = { figures = false }
"""


def die_on_pad():
    """Half of a half cylinder and of a block, in mm; two facets of 8.6 degrees near the contact."""
    occ, model = gmsh.model.occ, gmsh.model
    corners = [(0, 10), (0, 0), (10 * np.sin(0.3), 10 - 10 * np.cos(0.3)), (10, 10)]
    c, a, m, b = [occ.addPoint(x, y, 0) for x, y in corners]
    arcs = occ.addCircleArc(a, c, m), occ.addCircleArc(m, c, b)
    sides = [occ.addLine(c, a), *arcs, occ.addLine(b, c)]
    die = occ.addPlaneSurface([occ.addCurveLoop(sides)])
    points = [occ.addPoint(x, y, 0) for x, y in ((0, 0), (3, 0), (20, 0), (20, -20), (0, -20))]
    edges = [occ.addLine(p, q) for p, q in zip(points, (*points[1:], points[0]), strict=True)]
    pad = occ.addPlaneSurface([occ.addCurveLoop(edges)])
    occ.synchronize()
    group(2, [die], "round die")
    group(2, [pad], "pad block")
    names = ("die axis", "die face", "die top"), (sides[0], sides[1], sides[3])
    more = ("pad face", "pad bottom", "pad axis"), (edges[0], edges[3], edges[4])
    for name, curve in (*zip(*names, strict=True), *zip(*more, strict=True)):
        group(1, [curve], name)
    model.mesh.setTransfiniteCurve(sides[1], 3)
    model.mesh.setTransfiniteCurve(edges[0], 11)
    for option, value in (
        *(("MeshSizeMax", 3.0), ("MeshSizeFromPoints", 0), ("RecombineAll", 1)),
        *(("RecombinationAlgorithm", 3), ("ElementOrder", 2), ("SecondOrderIncomplete", 0)),
    ):
        gmsh.option.setNumber(f"Mesh.{option}", value)
    model.mesh.generate(2)


def pressed(comm, directory):
    """Force, N, and pressures, Pa, over x, m."""
    path = directory / "die.toml"
    write_built(die_on_pad, directory / "die.msh")
    path.write_text(CASE)
    command(comm, "run", path, "--out", directory / "out")
    found = read(directory / "out")
    nodes = found.contact()
    return {
        "force": float(found.history["normal_force"].iloc[-1]),
        "formulations": {body.formulation for body in found.case.bodies.values()}.pop(),
        "x": nodes.points[:, 0].tolist(),
        "pressure": nodes.point_data["pressure"].tolist(),
        "balance": found.summary["force_balance_relative"],
        "sides": read_bodies(found.fields(), ("die", "pad"), "pressure").polygons.shape[1],
    }


def test_two_curved_facets_press_as_a_cylinder_does(on_ranks):
    """Hertz: p = 2P/(πa) √(1 − x²/a²), a² = 4PR/(πE*); the block is 15 half-widths large."""
    found = on_ranks(pressed, 1)
    assert found["formulations"] == "q2"
    assert found["sides"] == 8  # curved cells are drawn so
    assert found["balance"] < 1e-8
    line = 2.0 * found["force"] / 1e-3
    half = np.sqrt(4.0 * line * RADIUS * (1.0 - 0.3**2) / (np.pi * 5e6))
    x, pressure = np.array(found["x"]), np.array(found["pressure"])
    within = x < 0.75 * half
    hertz = 2.0 * line / (np.pi * half) * np.sqrt(1.0 - (x[within] / half) ** 2)
    # Facets between the same corners that are straight press 1.64 times as much at x = 0.
    assert pressure[within] == pytest.approx(hertz, rel=0.06)
