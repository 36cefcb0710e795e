"""Problems without a solution: what is said, what is saved, and that nothing false is written."""

import csv
import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.errors import SolutionError
from tribox.app.results import read
from tribox.app.run.run import run_case
from tribox.forms.friction.coulomb import CoulombLaw

# Give up soon: what is tested is how.
SOON = {"min_step_fraction": 0.3, "max_iterations": 12}


def plain(text: str) -> dict:
    return tomllib.loads(text) | {"solver": dict(SOON)}


def pointwise(text: str) -> dict:
    """With the pressure point by point, so that the file of the points holds the penetration."""
    data = plain(text)
    data["contact"][0]["pressure"] = "pointwise"
    return data


def unsupported(block: str, film: str) -> dict:
    """Nothing holds the lower body: the upper one carries it along to the end."""
    data = plain(block)
    del data["boundary"][0]
    return data


def lifted(block: str, film: str) -> dict:
    """The platen presses at first, then pulls the upper body off."""
    data = pointwise(film)
    data["boundary"][1]["platen"]["pressure"] = [[0.0, 0.0], [0.5, 0.3e6], [1.0, -0.2e6]]
    data["stage"][0]["steps"] = 8
    return data


def stiff(block: str, film: str) -> dict:
    data = plain(block)
    data["contact"][0]["penalty_factor"] = 3e7
    data["solver"]["max_iterations"] = 4
    return data


def collapsing(block: str, film: str) -> dict:
    """The upper body is pressed to less than nothing."""
    data = pointwise(block)
    data["boundary"][1]["displacement"]["y"] = [[0.0, 0.0], [1.0, -6e-4]]
    data["stage"][0]["steps"] = 8
    del data["solver"]["min_step_fraction"]
    return data


def wedged(block: str, film: str) -> dict:
    """The corner of a body that cannot slide is folded under."""
    data = pointwise(block)
    data["contact"][0]["friction"]["mu"] = 5.0
    data["solver"] = {"min_step_fraction": 0.1, "max_iterations": 20}
    data["boundary"][1]["displacement"] = {
        "x": [[1.0, 0.0], [2.0, 2e-3]],
        "y": [[0.0, 0.0], [1.0, -2e-4]],
    }
    return data


def overrun(block: str, film: str) -> dict:
    """A body is slid over the end of the other, where its points lose their force at once."""
    data = pointwise(block)
    data["geometry"]["upper"]["elements"] = [30, 8]
    data["geometry"]["lower"] = {"width": 1.5e-3, "height": 5e-4, "elements": [45, 4]}
    data["boundary"][1]["displacement"]["x"] = [[1.0, 0.0], [2.0, 4e-4]]
    data["stage"][1]["steps"] = 4
    data["solver"]["max_iterations"] = 2
    return data


def pushed(block: str, film: str) -> dict:
    """A pressure on its side pushes the upper body along, harder than friction can hold it."""
    data = plain(block)
    data["geometry"]["lower"] |= {"width": 4e-3, "elements": [30, 4]}
    data["boundary"][1]["displacement"] = {"y": [[0.0, 0.0], [1.0, -5e-5]]}
    push = {"surface": "elastomer_left", "pressure": [[1.0, 0.0], [2.0, 0.8e6]]}
    data["boundary"].append(push)
    return data


def tilted(block: str, film: str) -> dict:
    """A block on an incline of 17.2 degrees, where friction holds it up to 16.7."""
    floor = {"shape": "plane", "point": [0, 0], "normal": [0, 1]}
    blocks = {"b": {"x": [0, 0.02], "y": [0, 0.005], "elements": [10, 3]}}
    body = {"material": "neo-hookean", "E": 1e6, "nu": 0.45, "density": 1000}
    coulomb = {"law": "coulomb", "mu": 0.3}
    stage = {"duration": 1, "steps": 4}
    return {
        "geometry": {"kind": "blocks", "blocks": blocks},
        "bodies": {"b": body},
        "tools": {"floor": floor},
        "contact": [{"slave": "b_bottom", "master": "floor", "friction": coulomb}],
        "gravity": {"x": [[1, 0], [2, 3.1]], "y": [[0, 0], [1, -10]]},
        "stage": [{"name": "settle"} | stage, {"name": "tilt"} | stage],
        "solver": dict(SOON),
    }


def pushed_on_a_film(block: str, film: str) -> dict:
    """The same where velocities do not count: the film takes half of the asperities' friction."""
    data = plain(film)
    del data["boundary"][1]["displacement"]
    push = {"surface": "elastomer_left", "pressure": [[1.0, 0.0], [2.0, 0.3e6]]}
    data["boundary"].append(push)
    stage = {"duration": 1.0, "rate_dependent": False}
    data["stage"] = [{"name": "press", "steps": 3} | stage, {"name": "slide", "steps": 6} | stage]
    return data


def firm(block: str, film: str) -> dict:
    """A fine slave on a soft coarse master, with a hundred times the default penalty."""
    data = plain(block)
    data["contact"][0]["penalty_factor"] = 3e3
    data["geometry"]["upper"]["elements"] = [20, 3]
    data["geometry"]["lower"]["elements"] = [6, 3]
    data["bodies"]["aluminium"]["E"] = 1e6
    data["solver"]["max_iterations"] = 5
    return data


def torn_loose(block: str, film: str) -> dict:
    """A thin block drawn at three times the speed at which friction falls, by short steps."""
    data = plain(block)
    data["geometry"]["upper"] = {"width": 2e-3, "height": 1e-4, "elements": [16, 2]}
    data["geometry"]["lower"] = {"width": 3e-3, "height": 3e-4, "elements": [19, 2]}
    friction = {"mu_s": 0.2, "mu_d": 0.1, "V_s": 1e-3, "K_T": 1e12}
    data["contact"][0]["friction"] = {"law": "stribeck", **friction}
    platen = {"direction": "y", "pressure": [[0.0, 0.0], [1.0, 0.5e6]]}
    data["boundary"][1] = {"surface": "top", "displacement": {"x": "driven"}, "platen": platen}
    slide = {"name": "slide", "duration": 0.013, "velocity": 3e-3, "steps": 400}
    press = {"name": "press", "duration": 1.0, "steps": 3, "rate_dependent": False}
    data["stage"] = [press, slide]
    data["solver"] = {"min_step_fraction": 0.1}
    return data


SUPPORT = "try a support there (displacement), or a load that keeps it in contact"
HOPELESS = {
    unsupported: ("slide", "body aluminium has no support in y and no contact presses", SUPPORT),
    lifted: ("press", "body elastomer has no support in y, no contact presses on it, and a load of "
     "0.0125 N in y moves it away", SUPPORT),
    stiff: ("slide", "contact.0: the penalty is 3e+07 times", "try the default penalty"),
    collapsing: ("press", "has nearly collapsed (volume ratio 0.", "try less load"),
    wedged: ("slide", "has nearly collapsed (volume ratio 0.", "less load, a rounder corner"),
    pushed: ("slide",
     "contact.0: no equilibrium: T has reached mu N everywhere: a force of 0.1795 N in x drives "
     "body elastomer now",
     "try a prescribed displacement in x instead of the force, or a spring that holds it"),
    tilted: ("tilt",
     "contact.0: no equilibrium: T has reached mu N everywhere: a force of 0.31 N in x drives "
     "body b now", "or less of it, or more normal force or friction"),
    pushed_on_a_film: ("slide", "contact.0: no equilibrium: T has reached mu N everywhere",
     "or rate_dependent = true: a film holds any force, at some speed"),
    overrun: ("slide",
     "points of elastomer_contact that pressed slide off the end of aluminium_contact at "
     "(0.0015, 0) m, undeformed", "a master surface aluminium_contact that reaches further there"),
    firm: ("press", "contact.0: the penalty is 1e+02 times the default", "= 30)"),
    torn_loose: ("slide", "contact.0: friction falls from mu_s to mu_d as the surfaces slip faster",
     "try longer steps (slip_step), or a first velocity far below V_s"),
}  # fmt: skip


AFTER_A_STEP = (lifted, stiff, collapsing, wedged, tilted, pushed_on_a_film, torn_loose)


def rows_of(directory: Path) -> list[dict[str, str]]:
    with (directory / "history.csv").open() as stream:
        return list(csv.DictReader(stream))


def summary_of(directory: Path) -> dict[str, Any]:
    return json.loads((directory / "summary.json").read_text())


def last_displacement(directory: Path) -> np.ndarray:
    """Displacements (n, 3) of the last output."""
    return np.asarray(read(directory).fields().point_data["displacement"])


@pytest.mark.parametrize("problem", HOPELESS, ids=lambda p: p.__name__)
def test_hopeless_problem_says_why_and_keeps_its_last_state(block, film, tmp_path, problem):
    stage, what, cure = HOPELESS[problem]
    out = tmp_path / "out"
    output = {"fields_every": 0, "figures": problem in (collapsing, unsupported)}
    case = Case.model_validate(problem(block, film) | {"output": output})
    with pytest.raises(SolutionError) as caught:
        run_case(case, out, quiet=True)
    text = str(caught.value)
    rows = rows_of(out)
    time = float(rows[-1]["time"]) if rows else 0.0
    assert text.startswith(f"stage {stage}, time {time:.6g} s: ")
    assert what in text and cure in text and "\n" not in text
    squeezed = [w for w in summary_of(out)["warnings"] if "has nearly collapsed" in w]
    assert len(squeezed) == (problem in (collapsing, wedged))
    if problem is collapsing:  # not cut for as long as steps may be
        assert "no solution even with a step of 0.0625 s" in text
    if problem is not wedged:  # whose corner may be past the end when it collapses, or not yet
        assert ("off the end" in text) is (problem is overrun)
    assert ("no support" in text) is (problem in (unsupported, lifted))
    summary = summary_of(out)
    assert (summary["status"], summary["failure"]) == ("failed", text)
    assert summary["steps"] == len(rows)
    assert f"failed: {text}" in read_log(out)
    if rows and problem is not unsupported:
        name = "contact_points" if case.contact[0].pressure == "pointwise" else "contact"
        saved = meshio.read(out / name / f"{len(rows):06d}.vtu").point_data
        deepest = float(rows[-1]["max_penetration"])
        assert np.nanmax(-saved["gap"]) == pytest.approx(deepest, rel=1e-12) and deepest > 0.0
        moved = last_displacement(out)
        assert np.all(np.isfinite(moved)) and 1e-7 < np.max(np.abs(moved)) < 2e-3
    assert bool(rows) is (problem in (*AFTER_A_STEP, overrun, pushed, unsupported))
    # Where a run fails, its figures are wanted most; without a step there is nothing to draw.
    drawn = {path.name for path in out.glob("figures/*")}
    wanted = problem in (collapsing, unsupported)
    assert drawn >= {"deformed.png", "history.png"} if wanted else not drawn


FOAM = """
geometry.kind = "blocks"
geometry.blocks.foam = { x = [0, 1e-2], y = [0, 1e-2], elements = [10, 10] }
bodies.foam = { material = "neo-hookean", E = "0.1 MPa", nu = 0.05 }
tools.bed = { shape = "plane", point = [0, 0], normal = [0, 1] }
tools.lid.displacement.y = [[0, 0], [1, -8.8e-3]]
tools.lid.normal = [0, -1]
tools.lid.point = [0, 1e-2]
tools.lid.shape = "plane"
contact = [
    { slave = "foam_bottom", master = "bed", friction = { law = "coulomb", mu = 0.3 } },
    { slave = "foam_top", master = "lid", friction = { law = "coulomb", mu = 0.3 } },
]
boundary = [{ surface = "foam_left", symmetry = true }]
stage = [{ name = "press", duration = 1, steps = 6 }]
output = { fields_every = 0, figures = false }
"""


def test_a_foam_is_pressed_flat_though_its_corners_fold(tmp_path):
    """To .12 of its height, by steps that are cut twice beside a corner at J = .06."""
    run_case(Case.model_validate(tomllib.loads(FOAM)), tmp_path / "out", quiet=True)
    summary = summary_of(tmp_path / "out")
    assert summary["status"] == "done"
    [line] = [w for w in summary["warnings"] if "has nearly collapsed" in w]
    assert "body foam" in line and "stage press" in line


def held_by_displacement(data: dict) -> None:
    data["boundary"].pop()
    data["boundary"][1]["displacement"]["x"] = [[1.0, 0.0], [2.0, 3e-4]]


def feeling_rates(data: dict) -> None:
    data["stage"][1]["rate_dependent"] = True


def reaching_further(data: dict) -> None:
    data["geometry"]["lower"]["width"] = 2e-3
    data["geometry"]["offset"] = 0.25e-3


def of_default_penalty(data: dict) -> None:
    del data["contact"][0]["penalty_factor"]


def slowly_first(data: dict) -> None:
    slow = {"name": "begin", "duration": 0.9, "velocity": 3e-5, "steps": 10}
    data["stage"].insert(1, slow)
    data["stage"][2]["steps"] = 20


CURES = [
    (pushed, held_by_displacement), (pushed_on_a_film, feeling_rates), (overrun, reaching_further),
    (firm, of_default_penalty), (torn_loose, slowly_first),
]  # fmt: skip


@pytest.mark.parametrize(("problem", "cure"), CURES, ids=lambda part: part.__name__)
def test_what_a_message_says_to_try_helps(block, film, tmp_path, problem, cure):
    """Each problem above fails; with the cure that its message names it is solved."""
    data = problem(block, film) | {"output": {"fields_every": 0, "figures": False}}
    cure(data)
    case = Case.model_validate(data)
    simulation = run_case(case, tmp_path / "out", quiet=True)
    assert simulation.rows[-1].time == pytest.approx(sum(s.duration or 0.0 for s in case.stage))


def test_command_ends_with_code_3_and_one_line(tribox, case_file, block):
    text = block.replace('"-0.05 mm"', '"-0.6 mm"')
    text += "[solver]\nmin_step_fraction = 0.3\nmax_iterations = 12\n"
    done = tribox("run", case_file(text), "--out", "out")
    assert done.returncode == 3
    [line] = done.stderr.splitlines()
    assert re.match(
        r"tribox: stage press, time \S+ s: no solution even with a step of \S+ s: .*, residual \S+ "
        r"of the contact force after \d+ iterations, largest at \(\S+, \S+\) m, undeformed; .*try ",
        line,
    )
    steps = len(rows_of(case_file("").parent / "home" / "out"))
    assert f"the last converged state, step {steps} at time " in done.stdout
    assert f"fields/{steps:06d}.vtu, contact/{steps:06d}.vtu" in done.stdout


# -- penalties ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("factor", "deep"), [(3e-8, True), (0.3, True), (30.0, False)])
def test_penetration_is_warned_of_from_a_share_of_the_element_on(block, tmp_path, factor, deep):
    data = plain(block)
    data["contact"][0]["penalty_factor"] = factor
    run = run_case(Case.model_validate(data), tmp_path / "out", quiet=True)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    [share] = summary["penetration_over_facet"]
    assert share == pytest.approx(max(row.max_penetration for row in run.rows) / 1e-4)
    assert (share > 0.02) is deep
    found = [line for line in summary["warnings"] if "penetration up to" in line]
    assert len(found) == deep
    if deep:
        assert f"up to {share:.2g} of the local slave facet's length" in found[0]
        assert "raise the penalty" in found[0]


@pytest.mark.parametrize(("steps", "warned"), [(1, True), (8, False)])
def test_energy_that_does_not_add_up_is_warned_of(block, tmp_path, steps, warned):
    """A block lifted off in one step: the trapezium under its force is far from the work."""
    data = plain(block)
    data["boundary"][1]["displacement"] = {"x": 0.0, "y": [[0.0, 0.0], [1.0, -5e-5], [2.0, 5e-5]]}
    data["stage"][1]["steps"] = steps
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    found = [line for line in summary["warnings"] if "energy is balanced only to" in line]
    assert len(found) == warned == sum("facets of a curved master" in line for line in found)
    assert (abs(summary["energy_error_relative"]) > 0.01) is warned


def test_energy_of_bodies_without_contact_is_no_matter_of_facets(tmp_path):
    """Rubber that softens is pulled and let go in two steps."""
    data = {
        "geometry": {"kind": "blocks", "blocks": {"bar": {"x": [0, 1], "y": [0, 1]}}},
        "bodies": {"bar": {"material": "neo-hookean", "G": 1e6, "K": 1e7}},
        "boundary": [{"surface": "bar_bottom", "displacement": {"x": 0, "y": 0}}],
        "stage": [{"name": "pull and let go", "duration": 2, "steps": 2}],
    }
    data["geometry"]["blocks"]["bar"]["elements"] = [1, 1]
    data["bodies"]["bar"]["mullins"] = {"r": 1.5, "m": 1e4}
    pull = {"y": [[0, 0], [1, 0.5], [2, 0]]}
    data["boundary"].append({"surface": "bar_top", "displacement": {"x": 0} | pull})
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    [line] = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
    assert line.startswith("energy is balanced only to") and "facets" not in line


def test_energy_of_an_overlap_at_the_start_is_no_matter_of_steps(tmp_path):
    """A block drawn half a per cent of a facet inside a floor, that a light load presses on."""
    blocks = {"b": {"x": [0, 1], "y": [0, 1], "elements": [2, 2]}}
    data = {
        "geometry": {"kind": "blocks", "blocks": blocks},
        "bodies": {"b": {"material": "neo-hookean", "G": 1e6, "K": 1e7}},
        "tools": {"floor": {"shape": "plane", "point": [0, 0.0025], "normal": [0, 1]}},
        "contact": [{"slave": "b_bottom", "master": "floor", "friction": {"law": "frictionless"}}],
        "boundary": [
            {"surface": "b_left", "symmetry": True},
            {"surface": "b_top", "force": {"y": [[0, 0], [1, -1e3]]}},
        ],
        "stage": [{"name": "load", "duration": 1, "steps": 4}],
    }
    done = run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    # What the contact stores counts from the start on, K_N 0.0025²/2: it gives nearly all of it up.
    penalty = done.model.problem.contacts[0].penalty
    assert done.rows[0].interface_energy == pytest.approx(-0.5 * penalty[0] * 0.0025**2, rel=0.01)
    # A fit that grows over the overlap: the work of its first step is with that pressure.
    data["contact"][0]["interference"] = [[0, 0], [1, 0.1]]
    data["boundary"][1] = {"surface": "b_top", "displacement": {"y": 0}}
    run_case(Case.model_validate(data), tmp_path / "fit", quiet=True, comm=MPI.COMM_SELF)
    for name, cure in (("out", "smaller steps change nothing"), ("fit", "or a short first step")):
        warnings = json.loads((tmp_path / name / "summary.json").read_text())["warnings"]
        [line] = [line for line in warnings if line.startswith("energy is balanced only to")]
        assert "overlap at the start" in line and cure in line


def test_bodies_that_never_press_are_warned_of(block, tmp_path):
    data = plain(block)
    del data["boundary"][1]
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"] == "done"
    [line] = [w for w in summary["warnings"] if "never pressed on each other" in w]
    assert line.startswith("contact.0: ") and "point into the body" in line


def under_a_lid(at, friction, **motion):
    """A square block of 1 m under a plane that moves."""
    lid = {"shape": "plane", "point": [0, at], "normal": [0, -1]} | motion
    block = {"a": {"x": [0, 1], "y": [0, 1], "elements": [2, 2]}}
    data = {
        "geometry": {"kind": "blocks", "section": "plane-strain", "blocks": block},
        "bodies": {"a": {"material": "neo-hookean", "E": 5e6, "nu": 0.3}},
        "tools": {"lid": lid},
        "contact": [{"slave": "a_top", "master": "lid", "friction": friction}],
        "boundary": [{"surface": "a_bottom", "displacement": {"x": 0, "y": 0}}],
        "stage": [{"name": "press", "duration": 1, "steps": 2}],
    }
    return Case.model_validate(data)


def test_a_force_along_what_it_presses_on_is_not_said_to_move_it_away(tmp_path):
    """Four times the friction, from the first step on."""
    force = {"x": [[0, 0], [1, 60e3]], "y": [[0, 0], [1, -50e3]]}
    case = under_a_lid(1, {"law": "coulomb", "mu": 0.3}, force=force)
    with pytest.raises(SolutionError) as error:
        run_case(case, tmp_path / "out", quiet=True)
    said = str(error.value)
    assert "N in x drives it along what it is pressed on" in said and "moves it away" not in said
    assert said.count("a prescribed displacement in x") == 1


def test_a_tool_that_stops_short_is_told_by_how_much(tmp_path):
    way = {"y": [[0, 0], [0.5, -0.25], [1, 0]]}
    case = under_a_lid(1.5, {"law": "frictionless"}, displacement=way)
    run_case(case, tmp_path / "out", quiet=True)
    warnings = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
    [line] = [w for w in warnings if "never pressed on each other" in w]
    assert "came no nearer than 0.25 m (time 0.5 s, stage press)" in line


def test_forces_of_a_body_that_only_moves_are_no_imbalance(block, tmp_path):
    """Carried off without touching: what rounding leaves has nothing to add up to zero with."""
    data = plain(block)
    data["boundary"][1]["displacement"] = {"x": 0.0, "y": [[0.0, 0.0], [1.0, 5e-5]]}
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["force_balance_relative"] is None
    assert not [line for line in summary["warnings"] if "forces on a body" in line]


@pytest.mark.parametrize(
    ("penalty", "said"),
    [
        ({"penalty_factor": 3e7},
         "3e+07 times the stiffness max(10 G, M/10)/h of the softer body's elements beside it: "
         "Newton"),
        ({"penalty_factor": 3e-8},
         "3e-08 times the stiffness max(10 G, M/10)/h of the softer body's elements beside it: "
         "the bodies overlap"),
        ({"penalty": 1e8}, "0.00058 times"), ({}, None),
    ],
)  # fmt: skip
def test_absurd_penalties_are_noted_before_the_run(block, penalty, said):
    data = plain(block)
    data["contact"][0] |= penalty
    notes = build_model(Case.model_validate(data), MPI.COMM_SELF).notes
    if said is None:
        assert notes == []
    else:
        [note] = notes
        assert note.startswith("contact.0: the penalty is ") and said in note


# -- numbers that are none ------------------------------------------------------------------------


def sick(monkeypatch, calls_well: int, part: str) -> None:
    """Let Coulomb's law answer with a number that is none after so many calls."""
    update = CoulombLaw.update
    calls = []

    def broken(law, *arguments, **options):
        calls.append(1)
        response = update(law, *arguments, **options)
        if len(calls) <= calls_well:
            return response
        if part == "traction":
            return replace(response, traction=np.where(response.traction, np.nan, 0.0))
        lost = replace(response.dissipation, coulomb=0.0 * response.dissipation.coulomb + np.nan)
        return replace(response, dissipation=lost)

    monkeypatch.setattr(CoulombLaw, "update", broken)


@pytest.mark.parametrize("part", ["traction", "dissipation"])
def test_numbers_that_are_none_end_the_run_and_are_not_written(monkeypatch, block, tmp_path, part):
    sick(monkeypatch, 20, part)
    with pytest.raises(SolutionError) as caught:
        run_case(Case.model_validate(plain(block)), tmp_path / "out", quiet=True)
    if part == "dissipation":
        assert "contact.0: dissipated = nan" in str(caught.value)
    rows = rows_of(tmp_path / "out")
    assert rows
    # Nothing moves in this stage, and what does not move has no speed to tell.
    told = set(rows[0]) - {"stage", "velocity"}
    numbers = [float(row[key]) for row in rows for key in told]
    assert np.all(np.isfinite(numbers))
    assert "NaN" not in (tmp_path / "out" / "summary.json").read_text()
