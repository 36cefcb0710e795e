"""Films that are found against closed forms, in the cases that are shipped."""

import re
import tomllib
from pathlib import Path

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from tests.app.checkpoint.going_on import case_of, run
from tests.app.read_log import read_log
from tests.app.simulation.film_runs import (
    FILMS,
    column,
    data_of,
    shipped,
    warnings_of,
    words_of,
)
from tribox import read, run_case
from tribox.app.build.model import build_model
from tribox.app.errors import InputError
from tribox.app.results.reading import read_table


@pytest.fixture(scope="module")
def slider(tmp_path_factory):
    return shipped("slider", tmp_path_factory.mktemp("slider") / "out", "stage.0.steps=1")


def test_a_slider_carries_and_drags_as_reynolds_says(slider):
    load, drag = wedge(40e-6, 20e-6, 1e-2), 309.035  # (4 ln 2 - 2) η U L/h
    assert column(slider, "normal_force") == pytest.approx(load, rel=5e-3)
    assert column(slider, "friction_force") == pytest.approx(drag, rel=1e-3)
    assert column(slider, "asperity_force") == pytest.approx(0.0)
    # The pad ends where its film does: that it does not reach further is as it should be.
    assert warnings_of(slider) == []


def test_the_pull_of_pressure_at_the_inlet_is_no_friction_of_a_slider(tmp_path):
    """Where the gap narrows to a fifth the shear changes its sign before the outlet."""
    runner = 'tools.runner={shape="plane", point=["10 mm", "5 um"], normal=[-0.002, -1], '
    runner += 'velocity={x="0.1 m/s", y="-0.2 mm/s"}}'
    directory = shipped("slider", tmp_path / "out", runner, "stage.0.steps=1")
    drag = (np.log(5.0) - 1.0) * 0.8 * 0.1 * 0.01 / 5e-6  # (4 ln a - 6k/(a + 1))/k η U L/h
    for name in ("friction_force", "tangential_force"):
        assert column(directory, name) == pytest.approx(drag, rel=2e-3)


def test_a_steady_film_that_changes_on_its_slave_is_told(tmp_path):
    """The runner does not move along itself: behind it the film would not carry at all."""
    directory = shipped("slider", tmp_path / "out", 'tools.runner.velocity={x="1 m/s", y=0}')
    assert "at one speed the film changes by what takes 1.4e+02 % of its flow" in words_of(
        directory
    )


def pad_of_a_mesh(file, angle=0.0):
    """Write the slider's pad, turned by an angle, its facets numbered either way round."""
    n = 41
    points = np.array([[1e-2 * i / (n - 1), y] for y in (0.0, -1e-4) for i in range(n)])
    points = points @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    quads = [np.roll([i + n, i + n + 1, i + 1, i], i * i // 3) for i in range(n - 1)]
    lines = [[i, i + 1] for row in (0, n) for i in range(row, row + n - 1)]
    lines = np.array([*lines, [0, n]])
    parts = np.array([*np.repeat([2, 3], n - 1), 4]), np.ones(n - 1, dtype=int)
    tags = {f"gmsh:{kind}": list(parts) for kind in ("physical", "geometrical")}
    named = {"pad": [1, 2], "pad_top": [2, 1], "pad_bottom": [3, 1], "pad_left": [4, 1]}
    mesh = meshio.Mesh(
        np.column_stack([points, np.zeros(2 * n)]),
        [("line", lines), ("quad", np.array(quads))],
        cell_data=tags,
        field_data={name: np.array(of) for name, of in named.items()},
    )
    mesh.write(file, "gmsh22", binary=False)


def test_a_mesh_may_number_the_ends_of_its_facets_as_it_likes(slider, tmp_path):
    """A steady film has one speed along all of them."""
    pad_of_a_mesh(tmp_path / "pad.msh")
    data = tomllib.loads((FILMS / "slider.toml").read_text())
    data["geometry"] = {"mesh": str(tmp_path / "pad.msh"), "thickness": "1 m"}
    data["stage"][0]["steps"], data["output"] = 1, {"figures": False}
    run_case(case_of(data), tmp_path / "out", quiet=True)
    for name in ("normal_force", "friction_force"):
        assert column(tmp_path / "out", name) == pytest.approx(column(slider, name), rel=1e-9)
    assert warnings_of(tmp_path / "out") == []


def test_half_a_film_at_an_oblique_plane_of_symmetry_is_refused(tmp_path):
    pad_of_a_mesh(tmp_path / "pad.msh", angle=0.5)
    data = tomllib.loads((FILMS / "squeeze.toml").read_text())
    data["geometry"] = {"mesh": str(tmp_path / "pad.msh"), "thickness": "1 m"}
    data["boundary"] = [{"surface": f"pad_{s}", "symmetry": True} for s in ("left", "bottom")]
    data["tools"]["plate"]["point"][1] = "5 mm"
    with pytest.raises(InputError, match="plane of symmetry that is across no axis"):
        build_model(case_of(data), MPI.COMM_SELF)


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


@pytest.mark.parametrize("edge", ["1 mm", "1.28 mm"])
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


@pytest.mark.parametrize(("rear", "said", "way"), [(20, True, -1), (20, True, 1), (50, False, 1)])
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


def test_a_slider_so_slow_that_its_reservoirs_bear_a_part_is_told(tmp_path):
    slow = 'tools.runner.velocity={x="1 um/s", y="-2 nm/s"}', "stage.0.duration=1000 s"
    directory = shipped("slider", tmp_path / "out", *slow, "stage.0.steps=1")
    more = column(directory, "normal_force") / 31776.6e-6 - 1.0
    told = re.findall(r"modulus: ([\d.]+) % of what the film carries", words_of(directory))
    assert float(told[0]) == pytest.approx(100.0 * more / (1.0 + more), rel=0.2)
    assert "shear warms" not in words_of(directory)


def test_a_slider_so_fast_that_its_oil_warms_is_told(tmp_path):
    fast = 'tools.runner.velocity={x="5 m/s", y="-10 mm/s"}', "stage.0.duration=10 us"
    close = "stage.0.steps=1", "solver.tolerance=1e-9"
    directory = shipped("slider", tmp_path / "out", *fast, *close)
    told = re.findall(r"warms the middle of the film by ([\d.]+) K", words_of(directory))
    assert [float(one) for one in told] == pytest.approx([0.8 * 5.0**2 / (8.0 * 0.14)], rel=0.01)


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


@pytest.mark.parametrize(
    ("plate", "film", "held"), [(PLATE, {}, {"velocity": {"x": 0}}), (ROUND, SPREAD, {})]
)
def test_half_a_film_is_half_of_the_whole(tmp_path, plate, film, held):
    """Nothing flows across a plane of symmetry, whatever floods the film at its ends."""
    data, found = tomllib.loads(Path("cases/film/squeeze.toml").read_text()), []
    data["stage"], data["output"] = data["stage"][:2], {"figures": False}
    data["tools"]["plate"] = plate | {"force": data["tools"]["plate"]["force"]}
    data["contact"][0]["film"] |= film
    for half in (False, True):
        if half:
            data["geometry"]["blocks"]["pad"] |= {"x": ["5 mm", "10 mm"], "elements": [20, 1]}
            data["tools"]["plate"]["force"]["y"][1][1] = "-15 kN"
            data["tools"]["plate"] |= held
            data["boundary"].append({"surface": "pad_left"} | (held or {"symmetry": True}))
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
    fewer = "geometry.blocks.rubber.elements=[240, 9]", "geometry.blocks.rubber.grading=[1, 0.04]"
    directory = shipped("soft-line", tmp_path / "out", stage, *fewer)
    tool = read_table(directory / "tools.csv")[-1]
    assert -float(tool["force_x"]) / 1e3 == pytest.approx(0.0436, rel=0.02)
    assert warnings_of(directory) == []


# -- a soft line contact against the half plane ----------------------------------------------------

MODULUS, RADIUS, ETA, LOAD = 1e6, 0.01, 0.1, 1e-3  # E*, R, η, W/2E*R
FILMS_OF = {10.07: (20.5, 26.1), 5.589: (13.43, 17.26), 3.108: (9.03, 11.25)}  # h W'/(U R) by g


def soft_line(across):
    """A block that fills 16 half-widths a around a contact with so many facets in 2a."""
    force = 2.0 * LOAD * MODULUS * RADIUS
    a = np.sqrt(4.0 * force * RADIUS / (np.pi * MODULUS))
    speeds = {g: 4.0 * (LOAD / g) ** 2 * MODULUS * RADIUS / ETA for g in
              (2000.0, 500.0, 100.0, 25.0, 14.0, 10.07, 5.589, 3.108)}  # fmt: skip
    rate, time = [[0.0, 0.0], [1.0, 0.0]], 1.0
    stages = [{"name": "press", "duration": "1 s", "steps": 1, "rate_dependent": False}]
    for g, speed in speeds.items():
        way = 0.3 * a / speed
        rate += [[time + 1e-9 * way, speed / RADIUS], [time + way, speed / RADIUS]]
        stages.append({"name": f"{g}", "duration": way, "steps": 1})
        time += way
    block = {"x": [-16.0 * a, 16.0 * a], "y": [-16.0 * a, 0.0], "elements": [16 * across, 10]}
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
