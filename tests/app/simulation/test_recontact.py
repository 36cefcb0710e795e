"""Contact that opens and closes again, and corners that slide over the edges of a master."""

import copy
import math
import tomllib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmarks.curved_contact.shapes import ridge
from tests.rectangles import Rectangle, Rectangles
from tests.solved import Cuts, solved
from tribox.app.simulation.history import Row
from tribox.app.simulation.simulation import Simulation
from tribox.geometry.meshes.gmsh_model import write_msh

MM = 1e-3
ROOT = Path(__file__).resolve().parents[3]


def simulate(data: dict) -> tuple[Simulation, int]:
    """The case solved with the default settings; and how often a step was cut."""
    cuts = Cuts()
    return solved(data, observer=cuts), cuts.count


# -- lift-off and re-contact ----------------------------------------------------------------------

# Corners of the path of the upper block (time in s, x and y in mm): press, slide, lift off until
# nothing touches, move on in the air, press again, slide back.
PATH = [
    (0.0, 0.0, 0.0), (1.0, 0.0, -0.05), (2.0, 0.15, -0.05), (3.0, 0.15, 0.02), (4.0, 0.25, 0.02),
    (5.0, 0.25, -0.05), (6.0, 0.1, -0.05),
]  # fmt: skip
STAGES = ("press", "slide", "lift", "move", "press again", "slide back")
# The same without the first contact: off and away at once.
FRESH = [(0.0, 0.0, 0.0), (3.0, 0.0, 0.02), *PATH[4:]]


def along(text: str, path: list[tuple[float, float, float]]) -> dict:
    data = tomllib.loads(text)
    data["boundary"][1]["displacement"] = {
        "x": [[t, x * MM] for t, x, _ in path],
        "y": [[t, y * MM] for t, _, y in path],
    }
    data["stage"] = [{"name": name, "duration": 1.0, "steps": 6} for name in STAGES]
    data["contact"][0]["quadrature_degree"] = 3  # the bounds below are those of two points a facet
    return data


@pytest.fixture(scope="module")
def lifted(block) -> tuple[Simulation, int]:
    return simulate(along(block, PATH))


def test_lift_off_and_re_contact_need_no_tuning(lifted):
    run, cuts = lifted
    assert cuts == 0
    assert max(row.newton_iterations for row in run.rows) <= 12


def test_nothing_acts_while_the_contact_is_open(lifted):
    run, _ = lifted
    touching = {row.stage for row in run.rows if row.contact_area > 0.0}
    assert "move" not in touching and "press again" in touching
    for row in run.rows:
        if row.stage == "move":
            assert row.normal_force == row.tangential_force == row.interface_energy == 0.0
            # What is left of the strain energy is round-off of the displacements.
            assert row.strain_energy <= 1e-12 * max(r.strain_energy for r in run.rows)


def test_second_contact_is_that_of_a_fresh_run(block, lifted):
    run, _ = lifted
    fresh, _ = simulate(along(block, FRESH))
    ours, theirs = ([r for r in s.rows if r.time > 4.0] for s in (run, fresh))
    assert len(ours) == len(theirs) == 12
    for name in ("normal_force", "tangential_force", "contact_area", "strain_energy"):
        a, b = (np.array([getattr(r, name) for r in rows]) for rows in (ours, theirs))
        assert np.max(np.abs(a - b)) <= 1e-7 * np.max(np.abs(b)), name
    lost = [rows[-1].dissipation - rows[0].dissipation for rows in (ours, theirs)]
    assert lost[0] == pytest.approx(lost[1], rel=1e-6)
    assert run.rows[-1].tangential_force == pytest.approx(-0.2 * run.rows[-1].normal_force, 1e-5)


@pytest.mark.parametrize("mm", [0.02, 1.0])
def test_what_only_touches_is_lifted_off_in_its_first_step(block, mm):
    """By more than its height even: it is not stretched by what touches, and nothing is left."""
    data = along(block, [(0.0, 0.0, 0.0), (1.0, 0.0, mm), (2.0, 0.0, -0.05)])
    data["stage"] = [{"name": name, "duration": 1.0, "steps": 1} for name in ("lift", "press")]
    run, cuts = simulate(data)
    assert cuts == 0 and run.rows[0].newton_iterations <= 3
    assert run.rows[0].normal_force == 0.0 < run.rows[1].normal_force


# -- edges of a master ----------------------------------------------------------------------------


def over_the_edges(
    block: str, tmp_path: Path, degrees: float, mu: float, steps: int
) -> tuple[Simulation, int]:
    """The block pressed, and slid over the edges by more than its length; and how many cuts."""
    ridge(tmp_path / "ridge.msh", degrees)
    data = copy.deepcopy(tomllib.loads(block))
    data["geometry"] = {"kind": "file", "mesh": str(tmp_path / "ridge.msh"), "thickness": MM}
    data["contact"][0]["friction"]["mu"] = mu
    data["boundary"][1]["displacement"]["x"] = [[1.0, 0.0], [2.0, 1.4 * MM]]
    data["stage"] = [
        {"name": "press", "duration": 1.0, "steps": 4},
        {"name": "slide", "duration": 1.0, "steps": steps},
    ]
    run, cuts = simulate(data)
    assert run.rows[-1].time == pytest.approx(2.0, rel=1e-12)
    assert all(b.dissipation >= a.dissipation for a, b in pairwise(run.rows))
    return run, cuts


def load_of(run: Simulation) -> float:
    """Sum of what the points carry along their normals, N."""
    (term,), (trial,) = run.model.problem.contacts, run.model.problem.committed
    return float(term.surface.slave.weight @ trial.pressure) * MM


@pytest.mark.parametrize("degrees", [10.0, -2.0])
def test_block_slides_over_the_edges_of_a_coarse_master(block, tmp_path, degrees):
    """Corners and points pass convex and concave edges with the default settings."""
    run, cuts = over_the_edges(block, tmp_path, degrees, 0.2, 14)
    rows: list[Row] = run.rows
    assert cuts <= 4 and sum(row.newton_iterations for row in rows) <= 340
    # All points slide: mu times their loads, whose resultant is less where normals differ.
    load = load_of(run)
    assert rows[-1].tangential_force == pytest.approx(0.2 * load, rel=5e-3)
    assert load == pytest.approx(rows[-1].normal_force, rel=1.0 - math.cos(math.radians(degrees)))
    # The surface is no longer flat: pressure, too, pushes along it.
    assert max(abs(row.drag - row.tangential_force) for row in rows) > 2e-3


@pytest.mark.long
def test_block_is_dragged_over_a_ridge_by_much_friction(block, tmp_path):
    """Where the elements of the slave bend at the kinks, its normals lead it over smoothly."""
    run, cuts = over_the_edges(block, tmp_path, 15.0, 0.5, 28)
    assert cuts <= 6 and sum(row.newton_iterations for row in run.rows) <= 400
    # In the end all points slide forwards, and the friction of all has one direction with the
    # load's: T is mu times the load to the last digit.
    assert run.rows[-1].stick_fraction == 0.0
    assert run.rows[-1].tangential_force == pytest.approx(0.5 * load_of(run), rel=1e-6)


# -- what the slip of points that come into contact is measured from -------------------------------


def test_equal_cylinders_of_meshes_that_do_not_match_hardly_rub():
    """By the normals of facets, which are off by h/2R, 0.5 % of N in one step."""
    data = tomllib.loads(Path("cases/hertz-two-cylinders.toml").read_text())
    data["geometry"] |= {"contact_size": "20 um", "growth": 2.0}
    data["geometry"]["lower"]["contact_size"] = "26 um"
    data["stage"][0]["steps"] = 1
    last = simulate(data)[0].rows[-1]
    assert last.normal_force > 0.0

    assert last.friction_force < 4e-3 * last.normal_force


FILM = """
geometry = { mesh = "MESH" }
contact = [{ slave = "strip_top", master = "pad_bottom", film = { thickness = "1 um" } }]
boundary = [
    { surface = "pad_top", displacement = { x = 0, y = [["0 s", 0], ["1 s", "-5 um"]] } },
    { surface = "strip_bottom", displacement = { x = [["1 s", 0], ["2 s", "0.6 mm"]], y = 0 } },
]
stage = [
    { name = "press", duration = "1 s", steps = 1, rate_dependent = false },
    { name = "slide", duration = "1 s", steps = 3 },
]
[bodies]
strip = { material = "hencky", E = "70 GPa", nu = 0.3 }
pad = { material = "neo-hookean", E = "50 MPa", nu = 0.3 }
[law]
law = "friction-map"
preset = "friction-map"
mu_s = 0.1
mu_d = 0.1
A_d = "1 um"
B = 1e6
K_T = "1e12 Pa/m"
alpha = 0.5
V_star = "1 mm/s"
V_star_at = "10 nm"
D_max = "1 um"
eta_b = "0.8 Pa*s"
"""


def slid_over_the_end(directory: Path, contact: dict, formulation: str = "q1-sri") -> list[Row]:
    """Rows of a strip dragged over the ends of a pad by a fifth of the contact in each step."""
    mesh = directory / "strip.msh"
    bodies = {
        "strip": Rectangle(-2e-3, -0.4e-3, 2e-3, 0.0, (40, 1)),
        "pad": Rectangle(0.0, 0.0, 1e-3, 0.3e-3, (10, 2)),
    }
    write_msh(Rectangles(bodies), mesh)
    data = tomllib.loads(FILM.replace("MESH", str(mesh)))
    data["contact"][0] |= {"friction": data.pop("law")} | contact
    for body in data["bodies"].values():
        body["formulation"] = formulation
    run, cuts = simulate(data)
    assert cuts == 0
    return run.rows


def dissipated(rows: list[Row]) -> float:
    """What is dissipated in the last two steps over the work of the last tangential force."""
    start, end = rows[-3], rows[-1]
    work = abs(end.tangential_force) * (end.time - start.time) * 0.6e-3
    return (end.dissipation - start.dissipation) / work


@pytest.mark.parametrize(
    ("contact", "formulation"),
    [({}, "q1-sri"), ({"smoothing_angle": "30 deg"}, "q1-sri"), ({}, "q2")],
    ids=["facets", "smooth", "q2"],
)
def test_a_film_acts_at_once_on_points_that_come_over_the_end(tmp_path, contact, formulation):
    """T = η_b V A/D, and its work is dissipated, in steps of a fifth of the contact."""
    rows = slid_over_the_end(tmp_path, contact, formulation)
    for row in rows[-2:]:
        film = 0.8 * 0.6e-3 * row.contact_area / 1e-6
        assert abs(row.tangential_force) == pytest.approx(film, rel=5e-3)
    assert dissipated(rows) == pytest.approx(1.0, rel=5e-3)


def test_dry_points_that_come_over_the_end_dissipate_the_work_of_the_step(tmp_path):
    """Their springs have nothing of the way up to there."""
    dry = {"friction": {"law": "coulomb", "mu": 0.2, "K_T": "1e11 Pa/m"}, "film": None}
    rows = slid_over_the_end(tmp_path, dry)
    # Those that have come over by less than the spring's give stick.
    assert rows[-1].friction_coefficient == pytest.approx(0.2, rel=1e-3)
    assert dissipated(rows) == pytest.approx(1.0, rel=5e-3)
