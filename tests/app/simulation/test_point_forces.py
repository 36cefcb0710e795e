"""Forces on named points of a mesh, and supports of them, against resultants by hand."""

from typing import Any

import gmsh
import pytest

from tests.solved import built
from tribox.app.errors import InputError
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation
from tribox.geometry.meshes.gmsh_model import write_msh

LENGTH, HEIGHT, THICKNESS = 4e-3, 1e-3, 3e-3


class Beam:
    """A beam whose upper right corner is the point "tip"."""

    def build(self) -> None:
        geo = gmsh.model.geo
        at = [(0, 0), (LENGTH, 0), (LENGTH, HEIGHT), (0, HEIGHT)]
        corners = [geo.addPoint(x, y, 0) for x, y in at]
        lines = [geo.addLine(corners[k], corners[(k + 1) % 4]) for k in range(4)]
        area = geo.addPlaneSurface([geo.addCurveLoop(lines)])
        for number, line in enumerate(lines):
            geo.mesh.setTransfiniteCurve(line, (9, 4)[number % 2])
        geo.mesh.setTransfiniteSurface(area)
        geo.mesh.setRecombine(2, area)
        geo.synchronize()
        gmsh.model.addPhysicalGroup(2, [area], name="beam")
        gmsh.model.addPhysicalGroup(1, [lines[3]], name="wall")
        gmsh.model.addPhysicalGroup(0, [corners[2]], name="tip")
        gmsh.model.addPhysicalGroup(0, [corners[3]], name="above")
        gmsh.model.mesh.generate(2)


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("mesh") / "beam.msh"
    write_msh(Beam(), path)
    return str(path)


def bent(mesh: str, boundary: list[dict], **parts: Any) -> Simulation:
    data = {
        "geometry": {"mesh": mesh, "thickness": THICKNESS},
        "bodies": {"beam": {"material": "hencky", "E": 70e9, "nu": 0.33, "formulation": "q1"}},
        "boundary": boundary,
        "stage": [{"name": "bend", "duration": 1.0, "steps": 2}],
        "solver": {"tolerance": 1e-10},
    }
    return built(data | parts)


WALL = {"surface": "wall", "displacement": {"x": 0, "y": 0}}


def test_a_point_force_is_carried_by_the_wall_with_its_moment(mesh):
    force = {"x": [["0 s", 0], ["1 s", "200 N"]], "y": [["0 s", 0], ["1 s", "-300 N"]]}
    simulation = bent(mesh, [WALL, {"surface": "tip", "force": force}])
    simulation.run(Observer())
    of = simulation.state.motion.of_surface
    found = [[of(name, f"force_{axis}")[-1] for axis in "xy"] for name in ("wall", "tip")]
    assert found[1] == pytest.approx([200.0, -300.0], rel=1e-12)
    assert found[0] == pytest.approx([-200.0, 300.0], rel=1e-9)
    sunk = [of("tip", f"displacement_{axis}")[-1] for axis in "xy"]
    assert sunk[1] < -0.02 * HEIGHT
    # About the middle of the wall, with the tip where it is now.
    arm = [LENGTH + sunk[0], 0.5 * HEIGHT + sunk[1]]
    moment = arm[0] * -300.0 - arm[1] * 200.0
    assert of("wall", "moment_z")[-1] == pytest.approx(-moment, rel=1e-8)
    work, energy = (getattr(simulation.rows[-1], n) for n in ("external_work", "strain_energy"))
    assert work == pytest.approx(energy, rel=1e-2)


def test_a_prop_under_a_point_carries_what_the_force_over_its_displacement_says(mesh):
    """Betti: the prop's reaction takes back the deflection, small as it is."""
    push = {"surface": "tip", "force": {"y": -1e-3}}
    free = bent(mesh, [WALL, push])
    free.run(Observer())
    sunk = free.state.motion.of_surface("tip", "displacement_y")[-1]
    moved = {"surface": "tip", "displacement": {"y": sunk}}
    held = bent(mesh, [WALL, moved])
    held.run(Observer())
    assert held.state.motion.of_surface("tip", "force_y")[-1] == pytest.approx(-1e-3, rel=1e-7)


def test_the_fewest_supports_of_points_let_a_body_spring_back(mesh):
    """The wall is released but for one point of it; nothing is carried in the end."""
    away = {"surface": "wall", "displacement": {"y": 0}}
    points = [
        {"surface": "above", "displacement": {"y": 0}},
        {"surface": "tip", "displacement": {"x": 0, "y": [["0 s", 0], ["1 s", -1e-4]]}},
    ]
    stages = [
        {"name": "bend", "duration": 1.0, "steps": 2},
        {"name": "release", "duration": 1.0, "steps": 2, "release": ["wall"]},
    ]
    simulation = bent(mesh, [away, *points], stage=stages)
    assert not any(note.startswith("stage") for note in simulation.model.notes)
    simulation.run(Observer())
    rows = simulation.rows
    # What rounding makes of the energy of 70 GPa is 1e-9 of it.
    assert rows[-1].strain_energy < 1e-8 * rows[1].strain_energy
    of = simulation.state.motion.of_surface
    largest = abs(of("above", "force_y")[2])  # half way, with half of the wall's reactions
    assert largest > 1.0
    for name in ("wall", "above", "tip"):
        assert abs(of(name, "force_y")[-1]) < 1e-9 * largest
    assert of("tip", "displacement_y")[-1] == pytest.approx(-1e-4, rel=1e-12)


def test_a_group_has_no_area(mesh):
    with pytest.raises(InputError, match=r'boundary\.1\.pressure: "tip" is a group of points or'):
        bent(mesh, [WALL, {"surface": "tip", "pressure": 1.0}])
    with pytest.raises(InputError, match=r"boundary\.1\.surface: no surface named 'tap'; did you"):
        bent(mesh, [WALL, {"surface": "tap", "force": {"y": 1.0}}])
