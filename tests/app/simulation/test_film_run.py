"""Runs with a film that is found: what moves over, what is kept, and how they go on."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from tests.app.checkpoint.going_on import as_killed, case_of, numbers, run
from tests.app.simulation.film_runs import OIL, column, data_of, shipped, warnings_of, words_of
from tribox.app.build.model import build_model
from tribox.app.errors import InputError, SolutionError
from tribox.app.implicit.globalisation import ThinnedOil
from tribox.app.results.reading import read_table
from tribox.app.simulation.film_watch import FilmWatch
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation
from tribox.forms.film.reynolds import FilmError, ReynoldsFilm


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


def in_units(length, pressure, time):
    """The case with rubbing asperities, three times as fast, in other units."""
    data = data_of(steady=True)
    data["geometry"]["blocks"]["rubber"] |= {"x": [-6e-3 * length, 6e-3 * length]}
    data["geometry"]["blocks"]["rubber"] |= {"y": [-4e-3 * length, 0.0]}
    data["bodies"]["rubber"]["E"] = 3e6 * pressure
    roll, force = data["tools"]["roll"], -400.0 * pressure * length
    roll |= {"centre": [0.0, 1e-2 * length], "radius": 1e-2 * length}
    roll["force"] = {"y": [[0.0, 0.0], [time, force]]}
    roll["rotation"] = {"rate": [[0.0, 0.0], [time, 0.0], [1.1 * time, 0.3 / time]]}
    own = {"sigma": 1e-6 * length, "h_max": 2e-4 * length, "eta_b": 0.8 * pressure * time}
    data["contact"][0]["film"] |= own
    data["contact"][0]["friction"] = {"law": "coulomb", "mu": 0.3}
    data["stage"][0]["duration"], data["stage"][1]["duration"] = time, 2.0 * time
    data["stage"][1]["steps"] = 2
    data["solver"] = {"tolerance": 1e-10}
    data["output"].pop("checkpoint_every")
    return data


@pytest.mark.long
def test_nothing_depends_on_the_units(tmp_path):
    found = []
    for number, units in enumerate([(1.0, 1.0, 1.0), (1e3, 1e-3, 0.1)]):
        directory = tmp_path / str(number)
        run(case_of(in_units(*units)), directory)
        names = ("friction_coefficient", "asperity_force", "film_thickness")
        scales = (1.0, units[0] * units[1], units[0])
        found.append([column(directory, n) / s for n, s in zip(names, scales, strict=True)])
    assert 0.01 < found[0][1][-1] / 400.0 < 0.9
    for one, other in zip(*found, strict=True):
        assert other[-2:] == pytest.approx(one[-2:], rel=1e-8)


def test_smooth_surfaces_need_time_to_carry_load():
    with pytest.raises(InputError, match=r"film.sigma = 0: nothing carries load in stage press"):
        build_model(case_of(data_of(sigma=0)), MPI.COMM_SELF)


@pytest.mark.parametrize("drawn", [1.3, 3.0])
def test_a_smooth_film_carries_a_force_from_the_first_step_on(drawn, tmp_path):
    """W = 2.4475 eta U R/h of a rigid roll that is flooded (Martin, with the exit of Reynolds)."""
    data = data_of(sigma=0, steady=True, h_max="1 mm")
    data["geometry"]["blocks"]["rubber"] = {
        **{"x": ["-2.5 mm", "2.5 mm"], "y": ["-0.1 mm", "0 mm"]},
        "elements": [60, 1],
    }
    data["bodies"]["rubber"]["E"] = "70000 GPa"
    least = 2.4475 * 0.8 * 1.0 * 0.01 / 20e3
    roll = {"centre": ["0 mm", 0.01 + drawn * least], "force": {"y": "-20 kN"}}
    data["tools"]["roll"] |= roll | {"rotation": {"rate": "100 rad/s"}}
    data["stage"] = [{"name": "slide", "duration": "1 ms", "steps": 2}]
    run(case_of(data), tmp_path / "out")
    rows = read_table(tmp_path / "out" / "tools.csv")
    assert len(rows) == 2  # one for each step: none is cut
    found = drawn * least + float(rows[-1]["displacement_y"])
    assert found == pytest.approx(least, rel=0.03)  # 1.1 % with facets of half the length


def test_a_platen_presses_a_film_that_rubs_as_its_roll_does(tmp_path):
    data, carried = data_of(), []
    data["contact"][0]["friction"] = {"law": "coulomb", "mu": 0.3}
    data["stage"] = data["stage"][:1]
    for way in "roll", "platen":
        run(case_of(data), tmp_path / way)
        carried.append(column(tmp_path / way, "asperity_force")[-1])
        data["tools"]["roll"] |= {"displacement": {"x": 0, "y": 0}}
        data["tools"]["roll"].pop("force", None)
        force = [["0 s", "0 N"], ["1 s", "400 N"]]
        platen = {"surface": "rubber_bottom", "platen": {"direction": "y", "force": force}}
        data["boundary"] = [{"surface": "rubber_bottom", "displacement": {"x": 0}}, platen]
    assert carried[1] == pytest.approx(carried[0], rel=1e-6) and carried[0] > 390.0


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
    assert "smaller steps" not in said and "penalty" not in said


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
    model = build_model(case_of(data_of(steady=True)), MPI.COMM_SELF)
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
    film.solution.pressure[:] = 50e6  # exp(0.75)
    watch.step(row)
    assert any("2.1 times as viscous as eta_b: film.barus" in line for line in watch.warnings())
