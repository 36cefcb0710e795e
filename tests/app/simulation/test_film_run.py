"""Runs with a film that is found: what moves over, what is kept, and how they go on."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from tests.app.checkpoint.going_on import as_killed, case_of, numbers, run
from tests.app.read_log import read_log
from tribox import load_case, read, run_case
from tribox.app.build.model import build_model
from tribox.app.errors import InputError, SolutionError
from tribox.app.implicit.globalisation import ThinnedOil
from tribox.app.results.reading import read_table
from tribox.app.simulation.film_watch import FilmWatch
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation
from tribox.forms.film.reynolds import FilmError, ReynoldsFilm

CASE = """
geometry.kind = "blocks"
geometry.thickness = "1 m"
geometry.blocks = { rubber = { x = ["-6 mm", "6 mm"], y = ["-4 mm", "0 mm"], elements = [60, 4] } }
bodies = { rubber = { material = "neo-hookean", E = "3 MPa", nu = 0.45 } }
tools.roll.shape = "circle"
tools.roll.centre = ["0 mm", "10 mm"]
tools.roll.radius = "10 mm"
tools.roll.displacement = { x = 0 }
tools.roll.force = { y = [["0 s", "0 N"], ["1 s", "-400 N"]] }
tools.roll.rotation = { rate = [["0 s", 0], ["1 s", 0], ["1.1 s", "0.1 rad/s"]] }
boundary = [{ surface = "rubber_bottom", displacement = { x = 0, y = 0 } }]
stage = [
    { name = "press", duration = "1 s", steps = 3, rate_dependent = false },
    { name = "slide", duration = "2 s", steps = 4 },
]
output = { figures = false, checkpoint_every = 1, checkpoints_kept = 100 }
[[contact]]
slave = "rubber_top"
master = "roll"
friction = { law = "frictionless" }
film.model = "reynolds"
film.sigma = "1 um"
film.oil = "flooded"
film.share = "contact"
film.eta_b = "0.8 Pa*s"
film.h_max = "0.2 mm"
"""
OIL = {"oil": "2 g/m^2", "density": "900 kg/m^3"}


def data_of(**film):
    data = tomllib.loads(CASE)
    data["contact"][0]["film"] |= film
    return data


def column(directory, name):
    return np.array([float(row[name]) for row in read_table(directory / "contacts.csv")])


@pytest.fixture(scope="module")
def flooded(tmp_path_factory):
    directory = tmp_path_factory.mktemp("flooded") / "out"
    run(case_of(data_of(steady=True)), directory)
    return directory


def test_the_film_takes_load_over_from_the_asperities(flooded):
    share = column(flooded, "asperity_force") / column(flooded, "normal_force")
    assert share[:3] == pytest.approx(1.0, rel=1e-12)
    assert np.all(np.diff(share[3:]) < 1e-3)
    assert 0.05 < share[-1] < 0.95
    assert column(flooded, "friction_coefficient")[-1] > 1e-4
    assert column(flooded, "normal_force")[-1] == pytest.approx(400.0, rel=0.01)


def test_what_the_drive_does_is_dissipated(flooded):
    last, end = read_table(flooded / "history.csv")[-2:]
    error, work = (float(end[k]) - float(last[k]) for k in ("energy_error", "external_work"))
    assert abs(error) < 1e-4 * abs(work)


def test_given_oil_is_kept(tmp_path):
    run(case_of(data_of(**OIL)), tmp_path / "out")
    oil = column(tmp_path / "out", "oil_volume")[3:]
    assert oil == pytest.approx(oil[0], rel=1e-10)
    share = column(tmp_path / "out", "asperity_force") / column(tmp_path / "out", "normal_force")
    assert share.min() < 0.9999


def test_a_run_with_a_film_goes_on_as_if_nothing_had_been(flooded, tmp_path):
    written = numbers(flooded)
    directory = as_killed(flooded, tmp_path / "out", written[int(0.65 * (len(written) - 1))])
    run(case_of(data_of(steady=True)), directory, resume=True)
    for name in ("asperity_force", "friction_force", "oil_volume"):
        there, here = column(flooded, name), column(directory, name)
        assert len(there) == len(here)
        assert np.abs(there - here).max() <= 1e-9 * np.abs(there).max()


def test_the_other_way_round_it_is_the_same(flooded, tmp_path):
    data = data_of(steady=True)
    data["tools"]["roll"]["rotation"]["rate"][-1][1] = "-0.1 rad/s"
    data["output"].pop("checkpoint_every")
    run(case_of(data), tmp_path / "out")
    for name, sign in (("tangential_force", -1.0), ("asperity_force", 1.0), ("normal_force", 1.0)):
        there, here = column(flooded, name), sign * column(tmp_path / "out", name)
        assert np.abs(there - here).max() <= 1e-9 * np.abs(there).max()


ROUGH = {
    "exponential": {},
    "greenwood-tripp": {"asperities": "greenwood-tripp", "K": 0.3},
    "table": {"asperities": "table", "table": [[-1, 3e6], [0, 1e6], [1, 3e5], [2, 5e4], [4, 0]]},
}


def in_units(length, pressure, time, film):
    """The case with rubbing asperities, three times as fast, in other units."""
    data = data_of(steady=True, **film)
    data["geometry"]["blocks"]["rubber"] |= {"x": [-6e-3 * length, 6e-3 * length]}
    data["geometry"]["blocks"]["rubber"] |= {"y": [-4e-3 * length, 0.0]}
    data["bodies"]["rubber"]["E"] = 3e6 * pressure
    roll, force = data["tools"]["roll"], -400.0 * pressure * length
    roll |= {"centre": [0.0, 1e-2 * length], "radius": 1e-2 * length}
    roll["force"] = {"y": [[0.0, 0.0], [time, force]]}
    roll["rotation"] = {"rate": [[0.0, 0.0], [time, 0.0], [1.1 * time, 0.3 / time]]}
    own = {"sigma": 1e-6 * length, "h_max": 2e-4 * length, "eta_b": 0.8 * pressure * time}
    table = data["contact"][0]["film"]
    table |= own
    if "table" in table:
        table["table"] = [[gap, p * pressure] for gap, p in table["table"]]
    data["contact"][0]["friction"] = {"law": "coulomb", "mu": 0.3}
    data["stage"][0]["duration"], data["stage"][1]["duration"] = time, 2.0 * time
    data["stage"][1]["steps"] = 2
    data["solver"] = {"tolerance": 1e-10}
    data["output"].pop("checkpoint_every")
    return data


@pytest.mark.long
@pytest.mark.parametrize("law", ROUGH)
def test_nothing_depends_on_the_units(law, tmp_path):
    found = []
    for number, units in enumerate([(1.0, 1.0, 1.0), (1e3, 1e-3, 0.1)]):
        directory = tmp_path / str(number)
        run(case_of(in_units(*units, ROUGH[law])), directory)
        names = ("friction_coefficient", "asperity_force", "film_thickness")
        scales = (1.0, units[0] * units[1], units[0])
        found.append([column(directory, n) / s for n, s in zip(names, scales, strict=True)])
    assert 0.01 < found[0][1][-1] / 400.0 < 0.9
    for one, other in zip(*found, strict=True):
        assert other[-2:] == pytest.approx(one[-2:], rel=1e-8)


def test_smooth_surfaces_need_time_to_carry_load():
    with pytest.raises(InputError, match=r"film.sigma = 0: nothing carries load in stage press"):
        build_model(case_of(data_of(sigma=0)), MPI.COMM_SELF)


def test_a_facet_of_two_points_is_refused():
    data = data_of()
    data["contact"][0]["quadrature_degree"] = 3
    with pytest.raises(InputError, match="three points on a facet, a quadrature_degree of 4"):
        build_model(case_of(data), MPI.COMM_SELF)


def first_at(velocity, way, **film):
    """The roll begins at a velocity, and slides so far in one step, which is not to be cut."""
    data = data_of(steady=True, **film)
    data["contact"][0]["friction"] = {"law": "coulomb", "mu": 0.3}
    data["tools"]["roll"]["rotation"] = {"rim": "driven"}
    stage = {"steps": 1, "velocity": velocity, "duration": way / velocity}
    data["stage"][1] |= stage
    data["solver"] = {"min_step_fraction": 0.6}
    data["output"].pop("checkpoint_every")
    return data


@pytest.mark.long
def test_a_film_is_found_at_a_first_velocity_that_is_high(tmp_path):
    velocity, way = 0.1, 1.5e-3
    at_once = first_at(velocity, way)
    slowly = first_at(velocity, way)
    speeds = [velocity * 10**power for power in np.arange(-3.0, 0.0, 0.5)]
    before = [{"name": f"{v}", "duration": way / v, "steps": 1, "velocity": v} for v in speeds]
    slowly["stage"][1:1] = before
    for data in (at_once, slowly):
        data["stage"][-1]["steps"] = 3
    done = run(case_of(at_once), tmp_path / "at_once").rows
    assert [row.attempts for row in done] == [1] * 6
    assert done[3].newton_iterations < 60
    run(case_of(slowly), tmp_path / "slowly")
    for name in ("friction_force", "asperity_force", "film_thickness"):
        there, here = (column(tmp_path / where, name)[-1] for where in ("slowly", "at_once"))
        assert here == pytest.approx(there, rel=2e-3)


def test_a_first_velocity_that_tears_the_contact_loose_is_told_and_not_to_step_shorter(
    tmp_path, monkeypatch
):
    data = first_at(0.01, 1e-3)
    failed = 1, PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT
    monkeypatch.setattr(ThinnedOil, "run", lambda *_: failed)
    data["solver"]["max_iterations"] = 12
    with pytest.raises(SolutionError) as caught:
        run(case_of(data), tmp_path / "out")
    said = str(caught.value)
    assert "the film, which carried 0 % of the load" in said and "slip faster" in said
    assert "try longer steps (slip_step), or a first velocity" in said
    assert "smaller steps" not in said


def test_a_film_that_finds_no_balance_is_a_failed_step_in_words(tmp_path, monkeypatch):
    solve = ReynoldsFilm.solve

    def only_short(film, step, start):
        if step.dt > 0.3:
            raise FilmError
        return solve(film, step, start)

    monkeypatch.setattr(ReynoldsFilm, "solve", only_short)
    data = data_of(**OIL)
    data["stage"][1] |= {"steps": 1, "duration": "0.5 s"}
    done = run(case_of(data), tmp_path / "out")
    assert [row.attempts for row in done.rows] == [1, 1, 1, 2, 1]
    why = "the mass balance of the film of contact.0 has no solution that is found"
    assert why in words_of(tmp_path / "out")


def test_an_explicit_run_is_refused_in_one_line():
    data = data_of()
    data["bodies"]["rubber"]["density"] = 1000
    data["solver"] = {"kind": "explicit"}
    data["stage"] = [{"name": "all", "duration": "1 ms", "steps": 2}]
    data["tools"]["roll"]["mass"] = "1 g"
    del data["tools"]["roll"]["rotation"]
    with pytest.raises(InputError, match=r'film.model = "reynolds" goes with .*implicit'):
        build_model(case_of(data), MPI.COMM_SELF)


# -- closed forms, in the cases that are shipped ---------------------------------------------------

FILMS = Path(__file__).parents[3] / "cases" / "film"


def shipped(name, directory, *overrides):
    quick = ("output.figures=false", "output.fields_every=0")
    run_case(load_case(FILMS / f"{name}.toml", [*overrides, *quick]), directory, quiet=True)
    return directory


def words_of(directory):
    """All that was said, in one line."""
    return " ".join((directory / "log.txt").read_text().split())


@pytest.fixture(scope="module")
def slider(tmp_path_factory):
    return shipped("slider", tmp_path_factory.mktemp("slider") / "out", "stage.0.steps=1")


def warnings_of(directory):
    return [line for line in (directory / "log.txt").read_text().splitlines() if "warning" in line]


def test_a_slider_carries_and_drags_as_reynolds_says(slider):
    load, drag = wedge(40e-6, 20e-6, 1e-2), 309.035  # (4 ln 2 - 2) η U L/h
    assert column(slider, "normal_force") == pytest.approx(load, rel=5e-3)
    assert column(slider, "friction_force") == pytest.approx(drag, rel=1e-3)
    assert column(slider, "asperity_force") == pytest.approx(0.0)
    # The pad ends where its film does: that it does not reach further is as it should be.
    assert warnings_of(slider) == []


def test_a_mesh_may_number_the_ends_of_its_facets_as_it_likes(slider, tmp_path):
    """A steady film has one speed along all of them."""
    n = 41
    points = np.array([[1e-2 * i / (n - 1), y] for y in (0.0, -1e-4) for i in range(n)])
    quads = [np.roll([i + n, i + n + 1, i + 1, i], i * i // 3) for i in range(n - 1)]
    lines = np.array([[i, i + 1] for row in (0, n) for i in range(row, row + n - 1)])
    parts = np.repeat([2, 3], n - 1), np.ones(n - 1, dtype=int)
    tags = {f"gmsh:{kind}": list(parts) for kind in ("physical", "geometrical")}
    named = {"pad": [1, 2], "pad_top": [2, 1], "pad_bottom": [3, 1]}
    mesh = meshio.Mesh(
        np.column_stack([points, np.zeros(2 * n)]),
        [("line", lines), ("quad", np.array(quads))],
        cell_data=tags,
        field_data={name: np.array(of) for name, of in named.items()},
    )
    mesh.write(tmp_path / "pad.msh", "gmsh22", binary=False)
    data = tomllib.loads((FILMS / "slider.toml").read_text())
    data["geometry"] = {"mesh": str(tmp_path / "pad.msh"), "thickness": "1 m"}
    data["stage"][0]["steps"], data["output"] = 1, {"figures": False}
    run_case(case_of(data), tmp_path / "out", quiet=True)
    for name in ("normal_force", "friction_force"):
        assert column(tmp_path / "out", name) == pytest.approx(column(slider, name), rel=1e-9)
    assert warnings_of(tmp_path / "out") == []


def test_a_film_that_ends_with_its_runner_does_not_begin_too_close(tmp_path):
    runner = 'tools.runner={shape="polyline", points=[["9 mm", "22 um"], ["1 mm", "38 um"]], '
    runner += 'velocity={x="1 m/s", y="-2 mm/s"}}'
    more = "geometry.blocks.pad.elements=[67, 1]", "stage.0.steps=1", "stage.0.duration=1 us"
    directory = shipped("slider", tmp_path / "out", runner, *more)
    # Its ends are within facets of 150 um.
    assert column(directory, "normal_force") == pytest.approx(wedge(38e-6, 22e-6, 8e-3), rel=1e-3)
    assert warnings_of(directory) == []


def wedge(first, last, length):
    """Load of a film between planes, N/m, at 1 m/s with 0.8 Pa s."""
    ratio = first / last
    scale = 6.0 * 0.8 * (length / (first - last)) ** 2
    return scale * (np.log(ratio) - 2.0 * (ratio - 1.0) / (ratio + 1.0))


@pytest.mark.parametrize("edge", ["1 mm", "1.1 mm", "1.28 mm"])
def test_a_runner_that_passes_over_a_pad_carries_what_its_whole_length_does(edge, tmp_path):
    """Wherever its ends are within the facets: they pass a ninth of one in each step."""
    start = float(edge.split()[0])
    runner = 'tools.runner={shape="polyline", velocity={x="-1 m/s", y=0}, points='
    runner += f'[["{start + 8.0} mm", "22 um"], ["{edge}", "38 um"]]}}'
    wide = 'geometry.blocks.pad.x=["0 mm", "10 mm"]', "geometry.blocks.pad.elements=[35, 1]"
    more = "stage.0.steps=12", "stage.0.duration=0.384 ms", "contact.0.film.steady=false"
    directory = shipped("slider", tmp_path / "out", runner, *wide, *more)
    load = column(directory, "normal_force")[-4:]
    assert load == pytest.approx(np.full(4, wedge(38e-6, 22e-6, 8e-3)), rel=5e-3)
    assert "lags behind" not in words_of(directory)


@pytest.mark.parametrize("way", [-1, 1], ids=["left", "right"])
@pytest.mark.parametrize(("rear", "said"), [(20, True), (50, False)])
def test_a_wedge_in_steps_that_change_its_film_is_told_by_how_much_it_is_off(
    rear, said, way, tmp_path
):
    """It carries less, by about what is said; an eightieth of it passes in a step."""
    ends = sorted([(-4.0 * way, rear), (4.0 * way, 60)], reverse=True)
    points = ", ".join(f'["{5.0 + x} mm", "{h} um"]' for x, h in ends)
    runner = f'tools.runner={{shape="polyline", velocity={{x="{way} m/s", y=0}}, '
    runner += f"points=[{points}]}}"
    pad = "geometry.blocks.pad.x=[-0.001, 0.011]", "geometry.blocks.pad.elements=[90, 1]"
    more = "stage.0.steps=6", "stage.0.duration=0.6 ms", "contact.0.film.steady=false"
    directory = shipped("slider", tmp_path / "out", runner, *pad, *more)
    off = column(directory, "normal_force")[-1] / wedge(60e-6, 1e-6 * rear, 8e-3) - 1.0
    told = re.findall(r"the load may be off by ([\d.]+) %", words_of(directory))
    assert len(told) == said
    assert -100.0 * off == pytest.approx(float(told[0]), rel=0.2) if said else abs(off) < 0.01


def test_a_slow_slider_on_metal_carries_as_much_less(tmp_path):
    """Its 300 Pa are far below what its metal could bear, and as exact."""
    slow = 'tools.runner.velocity={x="0.1 mm/s", y="-0.2 um/s"}'
    directory = shipped(
        "slider", tmp_path / "out", slow, "stage.0.steps=1", "stage.0.duration=10 s"
    )
    assert column(directory, "normal_force") == pytest.approx(31776.6e-4, rel=8e-3)


@pytest.mark.parametrize(
    "disc",
    [
        (),
        (
            "geometry.section=axisymmetric",
            'tools.plate.force.y=[["0 s", "0 N"], ["1 us", "-1413.717 N"]]',
        ),
    ],
)
def test_a_plate_sinks_through_a_film_in_the_time_of_the_closed_form(disc, tmp_path):
    directory = shipped("squeeze", tmp_path / "out", *disc)
    sinks(directory)
    assert warnings_of(directory) == []
    for row in read_table(directory / "history.csv"):  # from the first step on
        assert abs(float(row["energy_error"])) < 1e-5 * float(row["external_work"])


@pytest.mark.parametrize(
    ("section", "force"), [("plane-strain", "-30 kN"), ("axisymmetric", "-1413.717 N")]
)
def test_a_plate_that_ends_within_a_facet_sinks_as_one_on_a_pad_of_its_size(
    section, force, tmp_path
):
    plate = 'tools={plate={shape="polyline", points=[["10 mm", "0.1 mm"], ["0 mm", "0.1 mm"]], '
    plate += f'force={{y="{force}"}}}}}}'
    pad = 'geometry.blocks.pad.x=["0 mm", "14 mm"]', "geometry.blocks.pad.elements=[50, 1]"
    directory = shipped("squeeze", tmp_path / "out", f"geometry.section={section}", plate, *pad)
    sinks(directory)
    last = read_table(directory / "history.csv")[-1]
    assert abs(float(last["energy_error"])) < 1e-3 * float(last["external_work"])


PLATE = {"shape": "plane", "point": ["0 mm", "0.1 mm"], "normal": [0, -1]}
ROUND = {"shape": "circle", "centre": ["5 mm", "50.1 mm"], "radius": "50 mm"}
SPREAD = {"oil": "60 g/m^2", "density": "900 kg/m^3", "cells": 4}


@pytest.mark.parametrize(("plate", "film"), [(PLATE, {}), (ROUND, SPREAD)])
def test_half_a_film_is_half_of_the_whole(tmp_path, plate, film):
    """Nothing flows across a plane of symmetry, whatever floods the film at its ends."""
    data, found = tomllib.loads(Path("cases/film/squeeze.toml").read_text()), []
    data["stage"], data["output"] = data["stage"][:2], {"figures": False}
    data["tools"]["plate"] = plate | {"force": data["tools"]["plate"]["force"]}
    data["contact"][0]["film"] |= film
    for half in (False, True):
        if half:
            data["geometry"]["blocks"]["pad"] |= {"x": ["5 mm", "10 mm"], "elements": [20, 1]}
            data["tools"]["plate"]["force"]["y"][1][1] = "-15 kN"
            data["boundary"].append({"surface": "pad_left", "symmetry": True})
        run_case(case_of(data), tmp_path / str(half), quiet=True)
        surface = read(tmp_path / str(half)).contact()
        order = np.argsort(surface.points[:, 0])[-21:]
        found.append([surface.point_data[f"film_{n}"][order] for n in ("thickness", "pressure")])
        assert "fills the film up to its end" not in read_log(tmp_path / str(half))
    for mine, whole in zip(*found, strict=True):
        np.testing.assert_allclose(mine, whole, rtol=0.0, atol=1e-7 * whole.max())


@pytest.mark.parametrize("slides", [True, False])
def test_a_slave_that_is_held_at_its_end_is_fed_there_where_the_tool_slides(tmp_path, slides):
    data = tomllib.loads(Path("cases/film/squeeze.toml").read_text())
    data["stage"], data["output"] = data["stage"][:1], {"figures": False}
    data["boundary"].append({"surface": "pad_left", "displacement": {"x": 0}})
    if slides:
        data["tools"]["plate"]["displacement"] = {"x": [[0.0, 0.0], [1.0, 1e-3]]}
    run_case(case_of(data), tmp_path / "out", quiet=True)
    surface = read(tmp_path / "out").contact()
    pressure = surface.point_data["film_pressure"][np.argsort(surface.points[:, 0])]
    assert (pressure[0] < 0.1 * pressure.max()) == slides


def sinks(directory):
    """See whether a plate of 10 mm sinks through its film in the time of the closed form."""
    film, time = column(directory, "film_thickness"), column(directory, "time")
    assert len(film) == 4  # one step a halving, and one that takes the load up
    scale = 0.8 * 0.01**3 / (2.0 * 30e3)  # η L³/2W; 3πηR⁴/4W under the disc's load
    assert np.diff(time) == pytest.approx(scale * np.diff(film**-2.0), rel=2e-3)


def test_a_ball_that_comes_near_a_plane_is_held_off_as_in_the_closed_form(tmp_path):
    """G. Taylor's 6π η R² V/h of a ball, here less what lies beyond the pad's edge."""
    data = tomllib.loads((FILMS / "squeeze.toml").read_text())
    radius, least, speed, eta, edge = 0.01, 5e-6, 1e-3, 0.8, 1e-3
    ball = {"shape": "circle", "centre": [0.0, radius + least + speed * 1e-4], "radius": radius}
    data["tools"] = {"ball": ball | {"velocity": {"y": -speed}}}
    data["contact"][0]["master"] = "ball"
    block = {"x": [0.0, edge], "y": [-1e-4, 0.0], "elements": [40, 1]}
    data["geometry"] |= {"section": "axisymmetric", "blocks": {"pad": block}}
    data["stage"] = [{"name": "down", "duration": "0.1 ms", "steps": 6}]
    data["output"] = {"figures": False, "fields_every": 0}
    run(case_of(data), tmp_path / "out")
    far = least + edge**2 / (2.0 * radius)
    exact = 1.0 / least - 1.0 / far - (far - least) / far**2
    exact *= 6.0 * np.pi * eta * radius**2 * speed
    assert column(tmp_path / "out", "normal_force")[-1] == pytest.approx(exact, rel=1e-2)


@pytest.mark.long
def test_friction_of_a_mixed_film_is_that_of_the_half_plane(tmp_path):
    """With the facets of the case, whose inlet is half as long, and no warning of them."""
    stage = 'stage=[{name="press", duration="1 s", steps=3, rate_dependent=false},'
    stage += '{name="slide", velocity="1 mm/s", duration="3 s", steps=2}]'
    fewer = "geometry.blocks.rubber.elements=[240, 12]", "geometry.blocks.rubber.grading=[1, 0.06]"
    directory = shipped("soft-line", tmp_path / "out", stage, *fewer)
    tool = read_table(directory / "tools.csv")[-1]
    assert -float(tool["force_x"]) / 1e3 == pytest.approx(0.0436, rel=0.02)
    assert warnings_of(directory) == []


@pytest.mark.long
def test_a_jump_of_speed_is_taken_in_one_step_on_facets_of_twice_the_length(tmp_path):
    """By the oil of the last film, thinner by as much as the speed has risen, and thicker again."""
    speeds = {"31.6 um/s": 47.0, "100 um/s": 15.0, "316 um/s": 4.75}
    slides = [f'{{name="{v}", velocity="{v}", duration={t}, steps=1}}' for v, t in speeds.items()]
    press = '{name="press", duration="1 s", steps=4, rate_dependent=false}'
    stages = f"stage=[{', '.join([press, *slides])}]"
    case = load_case(
        FILMS / "soft-line.toml",
        [stages, "geometry.blocks.rubber.elements=[120, 12]", "output.figures=false"],
    )
    done = run_case(case, tmp_path / "out", quiet=True).rows
    assert [row.attempts for row in done[-3:]] == [1] * 3
    assert column(tmp_path / "out", "friction_coefficient")[-1] == pytest.approx(0.112, rel=0.01)


# -- what is said of films that come out wrong -----------------------------------------------------


def said(directory, data):
    data["output"].pop("checkpoint_every")
    run(case_of(data), directory)
    return " ".join(warnings_of(directory))


def sliding(data, *program):
    """The roll does not turn but moves along the slave."""
    del data["tools"]["roll"]["rotation"]
    data["tools"]["roll"]["displacement"]["x"] = [list(row) for row in program]
    return data


def test_cells_that_are_deep_below_the_contact_are_told(flooded):
    """They are a millimetre deep, and the contact is some two wide."""
    assert "the slave's cells below the contact are 0.001 m deep" in " ".join(warnings_of(flooded))


def test_facets_of_a_master_are_held_against_the_film(tmp_path):
    data = sliding(data_of(steady=True), ("0 s", 0), ("1 s", 0), ("3 s", "0.4 mm"))
    angles = np.radians(np.arange(20.0, -21.0, -4.0))
    places = [[0.01 * np.sin(a), 0.01 - 0.01 * np.cos(a)] for a in angles]
    roll = data["tools"]["roll"]
    data["tools"]["roll"] = {
        "shape": "polyline",
        "points": places,
        "displacement": roll["displacement"],
        "force": roll["force"],
    }
    data["stage"][1]["steps"] = 2
    assert "the master's facets are 0.0007 m long and lie up to" in said(tmp_path / "out", data)


@pytest.mark.parametrize(
    ("elements", "rise", "words"),
    [(100, "20.1 um", ""), (100, "36 um", "a corner of 0.16 rad of the master passes over facets")],
)
def test_a_stepped_master_has_corners_and_no_arc(elements, rise, words, tmp_path):
    """What it does is dissipated, on the slope too, which the normals of its slave do not see."""
    points = f'[["9 mm", "20 um"], ["6.9 mm", "20 um"], ["6.8 mm", "{rise}"], ["1 mm", "{rise}"]]'
    runner = f'tools.runner={{shape="polyline", velocity={{x="-1 m/s", y=0}}, points={points}}}'
    pad = f"geometry.blocks.pad.elements=[{elements}, 1]"
    more = "stage.0.steps=8", "stage.0.duration=0.8 ms", "contact.0.film.steady=false"
    directory = shipped("slider", tmp_path / "out", runner, pad, *more)
    told = " ".join(warnings_of(directory))
    assert "arc" not in told and words in told and ("corner" in told) == bool(words)
    last = read_table(directory / "history.csv")[-1]
    assert abs(float(last["energy_error"])) < 0.01 * float(last["external_work"])


@pytest.mark.parametrize(
    ("film", "words"),
    [
        ({"steady": True, "oil": "50 g/m^2"}, "% of the oil that is brought passes the contact"),
        ({"oil": "100 g/m^2"}, "the oil before the contact fills the film up to its end"),
    ],
)
def test_more_oil_than_passes_is_told(film, words, tmp_path):
    assert words in said(tmp_path / "out", data_of(**OIL | film))


def test_given_oil_that_fills_the_film_at_an_edge_of_its_master_is_told(tmp_path):
    """There it is shut in, and ends with the last facet that is wholly below."""
    runner = 'tools.runner={shape="polyline", velocity={x="-1 m/s", y=0}, points='
    runner += '[["9.5 mm", "22 um"], ["2 mm", "38 um"]]}'
    film = 'contact.0.film.oil="25 g/m^2"', 'contact.0.film.density="1000 kg/m^3"'
    more = "stage.0.steps=2", "stage.0.duration=0.1 ms", "contact.0.film.steady=false"
    directory = shipped("slider", tmp_path / "out", runner, *film, *more)
    assert "the oil before the contact fills the film up to its end" in words_of(directory)


def test_oil_that_flows_to_the_end_of_its_surface_is_told(tmp_path):
    words = "oil flows to the end of the slave and stays there"
    for reach, told in (("0.2 mm", False), ("4 mm", True)):
        data = data_of(**OIL | {"h_max": reach, "oil": "6 g/m^2"})
        data["stage"][1]["duration"] = "4 s"
        heard = said(tmp_path / reach, data)
        assert (words in heard) is told


def test_a_film_that_takes_all_the_oil_there_is_hears_nothing_of_it(tmp_path):
    heard = said(tmp_path / "out", data_of(**OIL | {"steady": True, "oil": "1 g/m^2"}))
    assert "oil" not in heard and "moved" not in heard and "begins" not in heard


@pytest.mark.long
def test_a_steady_film_stays_on_its_slave(tmp_path):
    data = sliding(data_of(steady=True, cells=1), ("0 s", 0), ("1 s", 0), ("3 s", "1.2 mm"))
    data["stage"][1]["steps"] = 4
    heard = said(tmp_path / "out", data)
    assert "the contact has moved 0.00089 m along the slave while it slid 0.0012 m" in heard


@pytest.mark.long
def test_oil_that_a_master_may_have_taken_along_is_told(tmp_path):
    way = ("0 s", "-1 mm"), ("1 s", "-1 mm"), ("2 s", "0.6 mm"), ("3 s", "-0.4 mm")
    data = sliding(data_of(**OIL), *way)
    data["stage"][1]["steps"] = 10
    heard = said(tmp_path / "out", data)
    assert "of the contact's surface has left it before" in heard


def test_a_flow_that_is_not_conserved_is_told():
    case = case_of(data_of(steady=True))
    model = build_model(case, MPI.COMM_SELF)
    simulation = Simulation(model)
    simulation.run(Observer())
    watch, row = FilmWatch(model.problem), simulation.rows[-1]
    watch.step(row)
    assert not any("flow changes" in line for line in watch.warnings())
    normal = model.problem.committed[0].normal_contact
    film = normal.lubrication
    flux = film.solution.flux * np.linspace(1.0, 1.01, len(film.solution.flux))
    normal.lubrication = replace(film, solution=replace(film.solution, flux=flux))
    watch.step(row)
    assert any("the flow changes by 0.99 % of itself" in line for line in watch.warnings())


# -- a soft line contact against the half plane ----------------------------------------------------

MODULUS, RADIUS, ETA, LOAD = 1e6, 0.01, 0.1, 1e-3  # E*, R, η, W/2E*R
FILMS_OF = {10.07: (20.5, 26.1), 5.589: (13.43, 17.26), 3.108: (9.03, 11.25)}  # h W'/(U R) by g


def soft_line(across):
    """A block that fills 16 half-widths a around a contact with so many facets in 2a."""
    force = 2.0 * LOAD * MODULUS * RADIUS
    a = np.sqrt(4.0 * force * RADIUS / (np.pi * MODULUS))
    speeds = {g: 4.0 * (LOAD / g) ** 2 * MODULUS * RADIUS / ETA for g in
              (2000.0, 800.0, 250.0, 80.0, 30.0, 14.0, 10.07, 7.5, 5.589, 3.108)}  # fmt: skip
    rate, time = [[0.0, 0.0], [1.0, 0.0]], 1.0
    stages = [{"name": "press", "duration": "1 s", "steps": 1, "rate_dependent": False}]
    for g, speed in speeds.items():
        way = 0.3 * a / speed
        rate += [[time + 1e-9 * way, speed / RADIUS], [time + way, speed / RADIUS]]
        stages.append({"name": f"{g}", "duration": way, "steps": 1})
        time += way
    block = {"x": [-16.0 * a, 16.0 * a], "y": [-16.0 * a, 0.0], "elements": [16 * across, 14]}
    data = data_of(steady=True, sigma="0.02 um", eta_b=ETA, h_max="1 mm")
    roll = data["tools"]["roll"] | {"rotation": {"rate": rate}}
    roll["force"] = {"y": [["0 s", "0 N"], ["1 s", f"{-force} N"]]}
    held = {"x": 0, "y": 0}
    sides = ("bottom", "left", "right")
    return data | {
        "geometry": {"kind": "blocks", "blocks": {"rubber": block | {"grading": [1.0, 1 / 30]}}},
        "bodies": {"rubber": {"material": "hencky", "E": MODULUS * (1 - 0.49**2), "nu": 0.49}},
        "tools": {"roll": roll},
        "boundary": [{"surface": f"rubber_{side}", "displacement": held} for side in sides],
        "stage": stages,
        "output": {"figures": False},
    }


@pytest.mark.long
def test_a_soft_contact_with_29_facets_has_the_film_of_the_half_plane(tmp_path):
    done = run(case_of(soft_line(29)), tmp_path / "out")
    results = read(tmp_path / "out")
    for row in done.rows:
        if row.stage == "press" or float(row.stage) not in FILMS_OF:
            continue
        assert row.newton_iterations <= 6 and row.attempts == 1
        scale = float(row.stage) ** 2 / (LOAD * RADIUS)
        nodes = results.contact(row.step).point_data
        film, p = nodes["film_thickness"] * scale, nodes["film_pressure"]
        least, middle = FILMS_OF[float(row.stage)]
        assert film[p > 1e-4 * p.max()].min() == pytest.approx(least, rel=3e-2)
        assert film[np.argmin(np.abs(nodes["reference"][:, 0]))] == pytest.approx(middle, rel=2e-2)
