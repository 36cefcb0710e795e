"""Forces per pair, surface and body against integrals by hand, where resultants would mislead."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tests.rectangles import Rectangle, Rectangles
from tribox.app.case.case import Case
from tribox.app.results import Results, read
from tribox.app.run.run import run_case
from tribox.geometry.meshes.gmsh_model import write_msh

RUBBER = '{ material = "neo-hookean", E = "5 MPa", nu = 0.45 }'
PAD = '{ material = "neo-hookean", E = "500 MPa", nu = 0.45 }'  # hardly lets the strip tilt
METAL = '{ material = "hencky", E = "70 GPa", nu = 0.33 }'
OUTPUT = "\n[output]\nfigures = false\nfields_every = 0\n"

TUBE = f"""
boundary = [
 {{ surface = "plug_bottom", displacement = {{ x = 0, y = 0 }} }},
 {{ surface = "plug_top", displacement = {{ y = [["0 s", 0], ["1 s", "-1 mm"]] }} }},
 {{ surface = "tube_bottom", displacement = {{ y = 0 }} }},
]
stage = [{{ name = "press", duration = "1 s", steps = 5 }}]
geometry = {{ mesh = "mesh.msh", section = "axisymmetric" }}
bodies = {{ plug = {RUBBER}, tube = {METAL} }}
[[contact]]
name = "wall"
slave = "plug_right"
master = "tube_left"
friction = {{ law = "coulomb", mu = 0.1 }}
"""

STRIP = f"""
boundary = [
 {{ surface = "upper_top", displacement = {{ x = 0 }}, platen = {{ direction = "y", force = [
   ["0 s", 0], ["1 s", "20 N"]] }} }},
 {{ surface = "lower_bottom", displacement = {{ x = 0, y = 0 }} }},
 {{ surface = "strip_right", displacement = {{ x = [["1 s", 0], ["2 s", "2 mm"]] }} }},
]
stage = [
 {{ name = "press", duration = "1 s", steps = 3 }},
 {{ name = "draw", duration = "1 s", steps = 6 }},
]
geometry = {{ mesh = "mesh.msh", thickness = "10 mm" }}
[bodies]
upper = {PAD}
strip = {METAL}
lower = {PAD}
[[contact]]
name = "above"
slave = "upper_bottom"
master = "strip_top"
friction = {{ law = "coulomb", mu = 0.1 }}
[[contact]]
name = "below"
slave = "lower_top"
master = "strip_bottom"
friction = {{ law = "coulomb", mu = 0.3 }}
"""

ROLLER = f"""
boundary = [
 {{ surface = "bottom", displacement = {{ x = 0, y = [["0 s", 0], ["1 s", "0.05 mm"]] }} }},
 {{ surface = "top", rotation = {{ centre = ["0 mm", "5 mm"], angle = [
   ["1 s", "0 deg"], ["2 s", "4 deg"]] }} }},
]
stage = [
 {{ name = "press", duration = "1 s", steps = 3 }},
 {{ name = "turn", duration = "1 s", steps = 8 }},
]
bodies = {{ elastomer = {METAL}, aluminium = {RUBBER} }}
[geometry]
kind = "cylinder-on-block"
thickness = "2 mm"
contact_width = "1.6 mm"
contact_size = "60 um"
growth = 1.4
cylinder = {{ radius = "5 mm" }}
block = {{ width = "12 mm", height = "4 mm", contact_size = "50 um" }}
[[contact]]
name = "nip"
slave = "aluminium_contact"
master = "elastomer_contact"
smoothing_angle = "30 deg"
friction = {{ law = "coulomb", mu = 0.3 }}
"""


def run(text: str, directory: Path, bodies: dict[str, Rectangle] | None = None) -> Results:
    if bodies:
        write_msh(Rectangles(bodies), directory / "mesh.msh")
        text = text.replace("mesh.msh", str(directory / "mesh.msh"))
    case = Case.model_validate(tomllib.loads(text + OUTPUT))
    run_case(case, directory / "out", quiet=True, comm=MPI.COMM_SELF)
    return read(directory / "out")


def last(table, **where) -> dict:
    for name, value in where.items():
        table = table[table[name] == value]
    return table.iloc[-1].to_dict()


def sides(values: np.ndarray, x: np.ndarray) -> float:
    """The integral of nodal values over their places by the trapezoidal rule."""
    order = np.argsort(x)
    return float(np.trapezoid(values[order], x[order]))


def test_a_plug_pressed_against_a_tube(tmp_path):
    radius, height = 5e-3, 10e-3
    found = run(
        TUBE,
        tmp_path,
        {
            "plug": Rectangle(0.0, 0.0, radius, height, (8, 20)),
            "tube": Rectangle(radius, -1e-3, 7e-3, 11e-3, (3, 30)),
        },
    )
    row, pair = last(found.history), last(found.contacts, pair="wall")
    nodes = found.contact().point_data
    # By the nodes' pressures along the undeformed wall, and by Coulomb's law on all of it.
    whole = 2.0 * np.pi * radius * sides(nodes["pressure"], nodes["reference"][:, 1])
    assert row["normal_force"] == pytest.approx(whole, rel=1e-3)
    assert row["normal_force"] > 100.0
    # What goes in above and not out below is friction: no integral over the contact at all.
    above, below = (last(found.surfaces, surface=f"plug_{side}") for side in ("top", "bottom"))
    assert row["friction_force"] == pytest.approx(-above["force_y"] - below["force_y"], rel=1e-3)
    assert last(found.surfaces, surface="tube_bottom")["force_y"] == pytest.approx(
        row["friction_force"], rel=1e-3
    )
    assert 0.02 < row["friction_coefficient"] <= 0.1 * (1.0 + 1e-12)
    assert abs(row["normal_resultant"]) < 0.2 * row["normal_force"]  # what used to be shown
    assert pair["normal_force"] == row["normal_force"]
    # The glued end is drawn inwards; round the ring that cancels, but for the sum of magnitudes.
    assert below["force_x"] == 0.0 and below["moment_z"] == 0.0
    assert below["radial_force"] < -1.0
    assert above["radial_force"] == pytest.approx(0.0, abs=1e-9)
    # The free end spreads: the mean of its radial displacement weighs rings by their length.
    fields = found.fields()
    moved = fields.point_data["displacement"]
    r, z = (fields.points - moved)[:, :2].T
    top = np.isclose(z, height) & (r < radius + 1e-6) & (fields.points[:, 0] < 1.001 * radius)
    spread = sides(moved[top, 0] * 2.0 * np.pi * r[top], r[top]) / (np.pi * radius**2)
    assert above["displacement_x"] == pytest.approx(spread, rel=0.05)
    assert above["displacement_y"] == pytest.approx(-1e-3, rel=1e-12)


@pytest.mark.parametrize("slave", ["pad", "strip"])
def test_a_strip_drawn_between_two_pads(tmp_path, slave):
    """With either as slave above: points of the strip then come in over the end of the pad."""
    text = STRIP
    if slave == "strip":
        pad, strip = 'slave = "upper_bottom"', 'master = "strip_top"'
        swapped = 'slave = "strip_top"\nmaster = "upper_bottom"'
        text = text.replace(f"{pad}\n{strip}", swapped)
    found = run(
        text,
        tmp_path,
        {
            "lower": Rectangle(0.0, -2e-3, 6e-3, 0.0, (12, 4)),
            "strip": Rectangle(-8e-3, 0.0, 10e-3, 0.5e-3, (31, 2)),
            "upper": Rectangle(0.5e-3, 0.5e-3, 5.5e-3, 2.5e-3, (10, 4)),
        },
    )
    above, below = (last(found.contacts, pair=name) for name in ("above", "below"))
    for pair, mu in ((above, 0.1), (below, 0.3)):
        assert pair["normal_force"] == pytest.approx(20.0, rel=1e-3)
        assert pair["friction_force"] == pytest.approx(mu * 20.0, rel=1e-3)
        assert pair["friction_coefficient"] == pytest.approx(mu, rel=1e-9)
        assert abs(pair["tangential_force"]) == pytest.approx(pair["friction_force"], rel=1e-9)
    # Their signs are opposite, so that the sum of both would be 4 N instead of 8 N.
    row = last(found.history)
    assert row["tangential_force"] == pytest.approx(
        above["tangential_force"] + below["tangential_force"], rel=1e-12
    )
    assert row["friction_force"] == pytest.approx(8.0, rel=1e-3)
    pulled = last(found.surfaces, surface="strip_right")
    assert pulled["force_x"] == pytest.approx(8.0, rel=1e-3)
    assert pulled["velocity_x"] == pytest.approx(2e-3, rel=1e-9)
    assert pulled["centre_x"] == pytest.approx(12e-3, rel=1e-9)
    assert pulled["body"] == "strip" and pulled["displacement_x"] == pytest.approx(2e-3)
    held = {s: last(found.surfaces, surface=s)["force_x"] for s in ("upper_top", "lower_bottom")}
    assert held["upper_top"] == pytest.approx(-2.0, rel=1e-3)
    assert held["lower_bottom"] == pytest.approx(-6.0, rel=1e-3)
    assert last(found.surfaces, surface="upper_top")["force_y"] == pytest.approx(-20.0, rel=1e-9)
    log = read_log(tmp_path / "out")
    assert (
        "draw: all pairs together: N 40 N, F_T 7.9999 N, F_T/N 0.2\n  above: N 20 N, F_T 2 N, "
        in log
    )
    strip = last(found.bodies, body="strip")
    assert strip["contact_force_x"] == pytest.approx(-8.0, rel=1e-3)
    assert strip["contact_force_y"] == pytest.approx(0.0, abs=1e-6)


def test_pressures_and_shared_nodes(tmp_path, block):
    """Pressures on the sides of a block; a support that shares a corner with another."""
    data = tomllib.loads(block)
    data["stage"] = [{"name": "press", "duration": "1 s", "steps": 2}]
    data["boundary"] += [
        {"surface": "aluminium_right", "pressure": "2 MPa"},
        {"surface": "aluminium_left", "displacement": {"x": 0}},
    ]
    sums, shares = [], []
    for number, order in enumerate((1, -1)):
        case = Case.model_validate({**data, "boundary": data["boundary"][::order]})
        run_case(case, tmp_path / f"{number}", quiet=True, comm=MPI.COMM_SELF)
        table = read(tmp_path / f"{number}").surfaces
        right, left, bottom = (
            last(table, surface=name)["force_x"]
            for name in ("aluminium_right", "aluminium_left", "bottom")
        )
        assert right == pytest.approx(-2e6 * 0.5e-3 * 1e-3, rel=1e-3)
        sums.append(left + bottom)
        shares.append(left)
    # The sum balances the pressure and what little the contact drags; the corner goes to the first.
    assert sums[0] == pytest.approx(1.0, rel=1e-3) and sums[1] == pytest.approx(sums[0], rel=1e-9)
    assert shares[1] > shares[0] + 0.01


def test_a_roller_that_brakes(tmp_path):
    found = run(ROLLER, tmp_path)
    points, row = found.contact_points().point_data, last(found.history)
    assert row["friction_coefficient"] == pytest.approx(0.3, rel=1e-3)
    weight, slab = points["weight"], 2e-3
    place = found.contact_points().points[:, :2]
    normal = points["normal"][:, :2]
    # The wheel takes the friction to the right of its normal, and the pressure against it.
    right = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    on_wheel = points["tangential_traction"][:, None] * right - points["pressure"][:, None] * normal
    force = slab * (weight @ on_wheel)
    arm = place - np.array([0.0, 5e-3])
    turning = slab * (weight @ (arm[:, 0] * on_wheel[:, 1] - arm[:, 1] * on_wheel[:, 0]))
    top = last(found.surfaces, surface="top")
    assert [top["centre_x"], top["centre_y"]] == [0.0, 5e-3]
    assert -force == pytest.approx([top["force_x"], top["force_y"]], rel=1e-6)
    assert top["moment_z"] == pytest.approx(-turning, rel=1e-3)
    assert abs(top["moment_z"]) == pytest.approx(0.3 * row["normal_force"] * 5e-3, rel=3e-2)
    assert row["normal_force"] == pytest.approx(slab * (weight @ points["pressure"]), rel=1e-9)
    # On a curved surface the resultant is less than the integral.
    assert row["normal_resultant"] != pytest.approx(row["normal_force"], rel=1e-4)
