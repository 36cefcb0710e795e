"""Rigid tools in runs: against platens, closed forms, loads, explicit steps, units and ranks."""

import numpy as np
import pytest

from tests.solved import solved as run
from tests.tool_cases import HEIGHT, WIDTH, block_case, block_mesh, circle, plane
from tribox.app.case.case import Case
from tribox.app.errors import SolutionError
from tribox.app.results import read
from tribox.app.run.run import run_case
from tribox.app.simulation.run_state import Observer

THICKNESS = 2e-3  # m, of the slab
FREE = {"law": "frictionless"}
DRY = {"law": "coulomb", "mu": 0.3}
# Nothing holds the block sideways but one side: it is compressed evenly.
EVEN = [
    {"surface": "bottom", "displacement": {"y": 0}},
    {"surface": "left", "displacement": {"x": 0}},
]


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    return block_mesh(tmp_path_factory.mktemp("block") / "block.msh")


def last(simulation, tool="punch"):
    """The last row of a tool, by column."""
    columns = simulation.state.tools.columns
    rows = [dict(zip(columns, row, strict=True)) for row in simulation.state.tools.rows]
    return [row for row in rows if row["tool"] == tool][-1]


def down(depth="-50 um", **more):
    return {"y": [["0 s", "0 m"], ["1 s", depth]], **more}


def pushed(force):
    return {"y": [["0 s", "0 N"], ["1 s", force]]}


def rolled(**rotation):
    """A round tool pressed in and moved along by 0.2 mm, on a block that it rubs on."""
    motion = down(x=[["1 s", "0 m"], ["2 s", "200 um"]])
    return {
        "tools": {"punch": circle(displacement=motion, rotation=rotation)},
        "contact": [{"slave": "top", "master": "punch", "friction": DRY}],
        "stage": [
            {"name": "press", "duration": "1 s", "steps": 3},
            {"name": "slide", "duration": "1 s", "steps": 5},
        ],
    }


def test_a_plane_presses_as_a_platen_does(mesh):
    """Where the pressure is even, the block is the same under the same force."""
    anvil = plane(point=[0, 0], normal=[0, 1])
    below = {"slave": "bottom", "master": "anvil", "friction": FREE}
    above = {"slave": "top", "master": "punch", "friction": FREE}
    left = {"surface": "left", "displacement": {"x": 0}}
    tools = {"anvil": anvil, "punch": plane(displacement=down())}
    exact = {"solver": {"tolerance": 1e-12}}
    tool = run(block_case(mesh, boundary=[left], tools=tools, contact=[below, above], **exact))
    driven, force = last(tool), last(tool)["force_y"]
    assert force > 1.0
    assert last(tool, "anvil")["force_y"] == pytest.approx(-force, rel=1e-9)
    platen = {"direction": "y", "force": [["0 s", "0 N"], ["1 s", f"{force!r} N"]]}
    boundary = [left, {"surface": "top", "platen": platen}]
    tools = {"anvil": anvil}
    pressed = run(block_case(mesh, boundary=boundary, tools=tools, contact=[below], **exact))
    assert last(pressed, "anvil")["force_y"] == pytest.approx(-force, rel=1e-9)
    ours, theirs = (s.state.motion.of_body("block", "displacement_y")[-1] for s in (tool, pressed))
    assert ours == pytest.approx(theirs, rel=1e-9)
    assert tool.rows[-1].strain_energy == pytest.approx(pressed.rows[-1].strain_energy, rel=1e-9)
    # Beside the block there is the penetration of the penalty on both sides, and nothing else.
    penalty = [term.penalty[0] for term in tool.model.problem.contacts]
    depth = [force / (WIDTH * THICKNESS) / stiffness for stiffness in penalty]
    assert driven["displacement_y"] == pytest.approx(2.0 * (ours + depth[0]) - sum(depth), rel=1e-9)


def test_by_force_a_tool_comes_where_it_came_by_displacement(mesh):
    for shape in (plane, circle):
        tools = {"punch": shape(displacement=down())}
        moved = last(run(block_case(mesh, tools=tools)))
        # What drives it and what the block does to it are found in two ways.
        assert moved["force_y"] == pytest.approx(-moved["driving_force_y"], rel=1e-12)
        force = f"{moved['driving_force_y']!r} N"
        loaded = last(run(block_case(mesh, tools={"punch": shape(force=pushed(force))})))
        assert loaded["displacement_y"] == pytest.approx(-50e-6, rel=1e-6)
        assert loaded["driving_force_y"] == pytest.approx(moved["driving_force_y"], rel=1e-12)
        assert loaded["force_y"] == pytest.approx(moved["force_y"], rel=1e-7)


def test_a_round_tool_on_a_thick_block_touches_as_hertz_says(tmp_path):
    """Half width a of a line contact: a² = 4 F R/(π E*), F per thickness."""
    mesh = block_mesh(tmp_path / "fine.msh", (40, 14), grading=4.0)
    young, ratio, radius, force = 5e6, 0.4, 2e-3, 0.02
    tools = {"punch": circle(radius, force=pushed(f"{-force} N"))}
    stage = [{"name": "press", "duration": "1 s", "steps": 2}]
    simulation = run(block_case(mesh, tools=tools, stage=stage))
    modulus = young / (1.0 - ratio**2)
    half = np.sqrt(4.0 * force / THICKNESS * radius / (np.pi * modulus))
    assert half < 0.1 * HEIGHT
    row = simulation.rows[-1]
    assert row.contact_area / THICKNESS == pytest.approx(2.0 * half, rel=0.03)
    pressure = simulation.model.problem.committed[0].nodal_pressure
    assert pressure.max() == pytest.approx(2.0 * force / THICKNESS / (np.pi * half), rel=0.03)


def test_a_free_roller_rolls_and_friction_gives_it_no_moment(mesh):
    free = last(run(block_case(mesh, **rolled(moment=0))))
    assert abs(free["moment_z"]) < 1e-8 * 0.3 * free["force_y"] * 2e-3
    # It rolls clockwise, by the way it made but for the strain of the surface below.
    assert free["rotation"] == pytest.approx(-200e-6 / 2e-3, rel=0.03)
    # Turned by hand to where it came by itself, nothing is needed to hold it there.
    angle = [["1 s", "0 rad"], ["2 s", f"{free['rotation']!r} rad"]]
    held = last(run(block_case(mesh, **rolled(angle=angle))))
    assert abs(held["driving_moment"]) < 0.02 * 0.3 * held["force_y"] * 2e-3
    stuck = last(run(block_case(mesh, **rolled(rate=0))))
    # A tool that does not turn slides: its friction is mu N, and turns it by that times R.
    assert abs(stuck["moment_z"]) > 0.9 * 0.3 * stuck["force_y"] * 2e-3
    assert stuck["moment_z"] == pytest.approx(-stuck["driving_moment"], rel=1e-9)
    assert stuck["force_x"] < -0.2 * stuck["force_y"]


@pytest.mark.parametrize("clockwise", [False, True])
def test_a_driven_rim_turns_a_round_tool_with_the_velocity_of_the_stage(mesh, clockwise):
    rim, stages = {"rim": "driven", "clockwise": clockwise}, rolled()["stage"]
    stages[1] |= {"velocity": "200 um/s"}
    turned = {"tools": {"punch": circle(displacement=down(), rotation=rim)}, "stage": stages}
    driven = run(block_case(mesh, **rolled() | turned))
    turn = 200e-6 / 2e-3 * (-1.0 if clockwise else 1.0)
    assert last(driven)["rotation"] == pytest.approx(turn, rel=1e-12)
    assert driven.rows[-1].driven_displacement == pytest.approx(200e-6, rel=1e-12)
    way = {"rim": [["1 s", "0 m"], ["2 s", f"{turn * 2e-3!r} m"]]}
    turned["tools"] = {"punch": circle(displacement=down(), rotation=way)}
    given = last(run(block_case(mesh, **rolled() | turned | {"stage": rolled()["stage"]})))
    assert last(driven)["force_x"] == pytest.approx(given["force_x"], rel=1e-9)
    assert np.sign(given["force_x"]) == np.sign(-turn) and abs(given["force_x"]) > 0.0


def test_a_roll_rubs_over_the_arc_that_it_turns_by(mesh):
    """Half a radian a step: the chord in the tangent plane would be 4 % shorter."""
    tables = rolled(angle=[["1 s", "0 rad"], ["2 s", "2.5 rad"]])
    tables["tools"]["punch"]["displacement"] = down()
    simulation = run(block_case(mesh, **tables))
    row = simulation.rows[-1]
    assert simulation.state.speed == pytest.approx(2.5 * 2e-3, rel=1e-6)  # of the rim
    assert row.slip_speed == pytest.approx(2.5 * 2e-3, rel=3e-3)
    assert abs(row.energy_error) < 1e-3 * row.external_work


def test_a_roll_that_turns_too_far_in_a_step_is_warned_of(mesh, tmp_path):
    tables = rolled(angle=[["1 s", "0 rad"], ["2 s", "7.5 rad"]])
    tables["tools"]["punch"]["displacement"] = down()
    run_case(Case.model_validate(block_case(mesh, **tables)), tmp_path / "out", quiet=True)
    results = read(tmp_path / "out")
    short = np.sin(1.5) / 1.5
    assert results.history.slip_speed.iloc[-1] == pytest.approx(short * 7.5 * 2e-3, rel=3e-3)
    (said,) = [line for line in results.summary["warnings"] if "turns by 1.5 rad" in line]
    assert said.startswith("tool punch ") and "time 1.2 s, stage slide" in said


def braked(moment):
    """A roll that is pressed on a pad of rubber by 30 N, moved by more than its radius, braked."""
    brake = {"moment": [["1 s", "0 N*m"], ["1.2 s", moment]]}
    return {
        "geometry": {
            "kind": "blocks",
            "section": "plane-strain",
            "thickness": "10 mm",
            "blocks": {
                "pad": {"x": ["-10 mm", "10 mm"], "y": ["0 m", "4 mm"], "elements": [20, 4]}
            },
        },
        "bodies": {"pad": {"material": "NR-60A"}},
        "tools": {
            "punch": {
                "shape": "circle",
                "centre": ["-4 mm", "9 mm"],
                "radius": "5 mm",
                "displacement": {"x": [["1 s", "0 m"], ["2 s", "6 mm"]]},
                "force": {"y": [["0 s", "0 N"], ["1 s", "-30 N"]]},
                "rotation": brake,
            }
        },
        "contact": [{"slave": "pad_top", "master": "punch", "friction": DRY}],
        "boundary": [{"surface": "pad_bottom", "displacement": {"x": 0, "y": 0}}],
        "stage": [
            {"name": "press", "duration": "1 s", "steps": 1},
            {"name": "roll", "duration": "1 s", "steps": 4},
        ],
    }


def test_a_braked_roll_turns_by_its_way_and_not_by_whole_turns_more():
    """Its rim is at the same places after each turn: 32 rad in one step solve it as well."""
    rolls = last(run(braked("0.02 N*m")))
    assert rolls["rotation"] == pytest.approx(-6.0 / 5.0, rel=0.03)  # but for what the pad strains
    assert rolls["driving_moment"] == pytest.approx(0.02, rel=1e-9)


def test_a_brake_that_friction_cannot_hold_is_told():
    case = braked("0.1 N*m") | {"solver": {"min_step_fraction": 0.1}}
    with pytest.raises(SolutionError, match=r"mu N everywhere: a moment of 0\.0\d* N m turns tool"):
        run(case)


def test_the_work_of_a_tool_is_balanced_turned_or_moved(mesh):
    tables = rolled(angle=[["1 s", "0 rad"], ["2 s", "0.3 rad"]])
    tables["stage"] = [{"name": "all", "duration": "2 s", "steps": 40}]
    simulation = run(block_case(mesh, **tables))
    row, columns = simulation.rows[-1], simulation.state.tools.columns
    power = [r[columns.index("power")] for r in simulation.state.tools.rows]
    assert sum(power) * 0.05 == pytest.approx(row.external_work, rel=0.1)
    assert row.dissipation > 0.2 * row.external_work
    assert abs(row.energy_error) < 0.02 * row.external_work
    still = simulation.state.motion.force_balance(["all"])
    assert still is not None and still < 1e-8


def test_one_tool_is_the_master_of_two_pairs(tmp_path, mesh):
    halves = block_mesh(tmp_path / "halves.msh", halves=True)
    one = {"master": "punch", "friction": FREE}
    pairs = [{"slave": "top", **one}, {"slave": "right top", **one}]
    for tools in ({"punch": plane(displacement=down())}, {"punch": plane(force=pushed("-3 N"))}):
        whole = last(run(block_case(mesh, boundary=EVEN, tools=tools)))
        both = run(block_case(halves, boundary=EVEN, tools=tools, contact=pairs))
        split = last(both)
        assert split["force_y"] == pytest.approx(whole["force_y"], rel=1e-9)
        assert split["displacement_y"] == pytest.approx(whole["displacement_y"], rel=1e-9)
        forces = [m.force[1] * THICKNESS for m in both.state.resultants]
        assert -sum(forces) == pytest.approx(split["force_y"], rel=1e-12)
        assert forces[0] == pytest.approx(forces[1], rel=1e-6)


@pytest.mark.parametrize("loaded", ["force", "spring"])
def test_explicit_steps_come_to_the_implicit_state(mesh, loaded):
    slow_way = {"table": [["0 s", "0 m"], ["0.5 ms", "-50 um"]], "ramp": "smooth"}
    if loaded == "force":
        motion = {"force": pushed("-0.5 N")}
        table = [["0 s", "0 N"], ["0.5 ms", "-0.5 N"]]
        slow = {"force": {"y": {"table": table, "ramp": "smooth"}}, "mass": "10 mg"}
    else:
        spring = {"direction": "y", "stiffness": "20 N/mm"}
        motion = {"spring": {**spring, "end": down()["y"]}}
        slow = {"spring": {**spring, "end": slow_way}, "mass": "10 mg"}
    still = last(run(block_case(mesh, tools={"punch": circle(**motion)}, contact=SOFT)))
    data = block_case(mesh, tools={"punch": circle(**slow)}, contact=SOFT)
    data["bodies"]["block"]["density"] = 1000
    data["solver"] = {"kind": "explicit", "damping": "2e4 1/s"}
    data["stage"] = [{"name": "all", "duration": "1.25 ms", "steps": 5}]
    moved = run(data)
    there = last(moved)
    assert there["force_y"] == pytest.approx(still["force_y"], rel=1e-3)
    assert there["displacement_y"] == pytest.approx(still["displacement_y"], rel=1e-3)
    assert abs(moved.rows[-1].energy_error) < 0.01 * moved.rows[-1].external_work


def test_units_of_length_and_stress_do_not_matter(tmp_path, mesh):
    """The same numbers in mm and MPa as if they were m and Pa: the forces stay the same."""
    large = block_mesh(tmp_path / "large.msh", scale=1e3)
    plain = rolled(moment=0)
    scaled = rolled(moment=0)
    scaled["tools"]["punch"] = {
        "shape": "circle",
        "centre": [2.0, 3.0],
        "radius": 2.0,
        "displacement": {"y": [[0, 0], [1, -0.05]], "x": [[1, 0], [2, 0.2]]},
        "rotation": {"moment": 0},
    }
    scaled["geometry"] = {"mesh": str(large), "thickness": 2.0}
    scaled["bodies"] = {"block": {"material": "neo-hookean", "E": 5.0, "nu": 0.4}}
    ours, theirs = last(run(block_case(mesh, **plain))), last(run(block_case(large, **scaled)))
    assert theirs["force_y"] == pytest.approx(ours["force_y"], rel=1e-7)
    assert theirs["force_x"] == pytest.approx(ours["force_x"], rel=1e-6)
    assert theirs["rotation"] == pytest.approx(ours["rotation"], rel=1e-7)


def test_a_tool_that_acts_in_some_stages_is_left_by_the_block(mesh):
    tools = {"punch": plane(displacement=down(), stages=["press"])}
    stages = [{"name": name, "duration": "1 s", "steps": 2} for name in ("press", "rest")]
    simulation = run(block_case(mesh, tools=tools, stage=stages))
    forces = [row.normal_force for row in simulation.rows]
    assert forces[1] > 1.0
    assert abs(forces[3]) < 1e-6


def of_tool(simulation, column, tool="punch"):
    """Values of a column for a tool, row by row."""
    columns, rows = simulation.state.tools.columns, simulation.state.tools.rows
    which, at = columns.index("tool"), columns.index(column)
    return np.array([row[at] for row in rows if row[which] == tool])


# With a penalty that does not shorten explicit steps.
SOFT = [{"slave": "top", "master": "punch", "friction": FREE, "penalty_factor": 3}]


def stages(*names, steps=2):
    return [{"name": name, "duration": "1 s", "steps": steps} for name in names]


def test_a_tool_goes_on_by_force_from_where_its_displacement_led(mesh):
    """Held at the force it reached it stays; by a given force it comes where that leads."""
    press = {"displacement": down(), "displacement_stages": ["press"]}
    held = run(
        block_case(
            mesh,
            tools={"punch": circle(**press, hold_force=["y"])},
            stage=stages("press", "hold", steps=1),
        )
    )
    force, place = (of_tool(held, f"{what}_y").tolist() for what in ("force", "displacement"))
    assert force[1] == pytest.approx(force[0], rel=1e-8) and place[1] == pytest.approx(place[0])
    # In a first step that is cut it is held so from the first piece on.
    held.model.set_loads(1.25, 0.0, 0.25)
    loads = [one.factor * np.sum(one.shares) for one in held.model.problem.nodal_loads]
    assert sum(loads) * held.model.thickness == pytest.approx(-force[0], rel=1e-8)
    # From force to velocity and to the force so reached; the punch slides on in x.
    table = [["0 s", "0 N"], ["1 s", f"{-force[0]!r} N"]]
    mixed = {"velocity": {"y": "-10 um/s"}, "displacement_stages": ["push"], "force": {"y": table}}
    mixed["displacement"] = {"x": [["2 s", "0 m"], ["3 s", "1 um"]]}
    tools = {"punch": circle(**mixed, hold_force=["y"])}
    moved = run(block_case(mesh, tools=tools, stage=stages("press", "push", "hold", steps=1)))
    assert of_tool(moved, "displacement_y") == pytest.approx([-50e-6, -60e-6, -60e-6], rel=1e-5)
    assert of_tool(moved, "displacement_x") == pytest.approx([0.0, 0.0, 1e-6], abs=1e-12)
    force = of_tool(moved, "force_y")
    assert force[2] == pytest.approx(force[1], rel=1e-8) and force[1] > 1.1 * force[0]
    assert of_tool(moved, "driving_force_y") == pytest.approx(-force, rel=1e-8)
    work = moved.rows[-1].external_work
    assert abs(moved.rows[-1].energy_error) < 0.2 * work  # three steps in all


def test_a_tool_goes_on_by_force_in_explicit_steps_too(mesh):
    """Let go at a smaller force than it had, it comes to rest where that force leads."""
    program = {"table": [["0 s", "0 m"], ["0.5 ms", "-50 um"]], "ramp": "smooth"}
    switched = {
        "displacement": {"y": program},
        "displacement_stages": ["press"],
        "force": {"y": "-0.5 N"},
        "mass": "10 mg",
    }
    data = block_case(mesh, tools={"punch": circle(**switched)}, contact=SOFT)
    data["bodies"]["block"]["density"] = 1000
    data["solver"] = {"kind": "explicit", "damping": "2e4 1/s"}
    data["stage"] = [{"name": name, "duration": "0.9 ms", "steps": 3} for name in ("press", "load")]
    moved = run(data)
    pushed_on = {"punch": circle(force=pushed("-0.5 N"))}
    still = last(run(block_case(mesh, tools=pushed_on, contact=SOFT)))
    assert last(moved)["displacement_y"] == pytest.approx(still["displacement_y"], rel=1e-3)
    assert last(moved)["force_y"] == pytest.approx(0.5, rel=1e-3)
    assert abs(moved.rows[-1].energy_error) < 0.01 * moved.rows[-1].external_work


def test_a_holder_presses_with_its_force_from_first_touch_on(tmp_path):
    """Block and holder are apart from what they lie on, and from each other: only contact holds.

    With 2 N on 8 mm² the block is pressed by σ(1 − ν²)/E, and more as it widens.
    """
    mesh = block_mesh(tmp_path / "block.msh", (8, 2))
    gap = 30e-6
    tools = {
        "table": plane(point=[0, -gap], normal=[0, 1]),
        "punch": plane(point=[2e-3, HEIGHT + gap], force={"y": "-2 N"}),
    }
    pairs = [
        {"slave": slave, "master": master, "friction": FREE}
        for slave, master in (("bottom", "table"), ("top", "punch"))
    ]
    left = {"surface": "left", "displacement": {"x": 0}}
    data = block_case(mesh, tools=tools, contact=pairs, boundary=[left], stage=stages("hold"))
    simulation = run(data)
    assert of_tool(simulation, "force_y") == pytest.approx([2.0, 2.0], rel=1e-7)
    assert of_tool(simulation, "force_y", "table") == pytest.approx([-2.0, -2.0], rel=1e-7)
    strain = 2.0 / (WIDTH * THICKNESS) * (1.0 - 0.4**2) / 5e6
    moved = -of_tool(simulation, "displacement_y") - 2.0 * gap
    assert moved == pytest.approx([strain * HEIGHT] * 2, rel=0.05)
    assert sum(row.newton_iterations for row in simulation.rows) <= 15


def test_a_force_moves_a_tool_as_far_as_its_stop_and_back(mesh):
    """On the stop the block feels what a displacement as far does, and the blocks bear the rest.

    Nothing is left at the end, where nothing presses and no force says where the tool is.
    """
    driven = run(block_case(mesh, tools={"punch": plane(displacement=down())}))
    force = float(of_tool(driven, "force_y")[-1])
    table = [[f"{t} s", f"{-share * force!r} N"] for t, share in enumerate((0.0, 3.0, 0.5, 0.0))]
    stopped = {"punch": plane(force={"y": table}, stop={"y": "-50 um"})}
    there_and_back = run(
        block_case(mesh, tools=stopped, stage=stages("on", "off", "back", steps=1))
    )
    place = of_tool(there_and_back, "displacement_y")
    assert place[0] == pytest.approx(-50e-6, abs=1.1e-6 * np.hypot(WIDTH, HEIGHT))
    assert place[1] > place[0] and place[2] == pytest.approx(0.0, abs=1e-9)
    on = of_tool(there_and_back, "force_y")
    assert on[0] == pytest.approx(force, rel=1e-3)
    assert on[1:] == pytest.approx([0.5 * force, 0.0], abs=1e-7 * force)
    assert of_tool(there_and_back, "driving_force_y") == pytest.approx(-on, abs=1e-7 * force)
    work = there_and_back.rows[0].external_work  # the blocks under the tool take the rest
    assert work == pytest.approx(driven.rows[-1].external_work, rel=0.05)
    assert [row.attempts for row in there_and_back.rows] == [1, 1, 1]
    assert sum(row.newton_iterations for row in there_and_back.rows) <= 40


def test_a_tool_is_let_go_by_a_force_that_ends_at_nothing(mesh):
    """Once all is open no line search comes nearer: whole steps do."""
    table = {"y": [["0 s", "0 N"], ["1 s", "-2 N"], ["2 s", "0 N"]]}
    off = run(block_case(mesh, tools={"punch": plane(force=table)}, stage=stages("on", "off")))
    assert of_tool(off, "force_y") == pytest.approx([1.0, 2.0, 1.0, 0.0], abs=1e-7)
    assert of_tool(off, "displacement_y")[-1] == pytest.approx(0.0, abs=1e-9)
    assert [row.attempts for row in off.rows] == [1] * 4
    assert sum(row.newton_iterations for row in off.rows) <= 30


@pytest.mark.parametrize("gap", [0.0, 50e-6])
def test_a_tool_that_is_pressed_and_drawn_at_once_finds_the_contact(mesh, gap):
    """It is held sideways until it presses: friction carries nothing before."""
    force = {"x": [["0 s", "0 N"], ["1 s", "0.4 N"]], "y": [["0 s", "0 N"], ["1 s", "-2 N"]]}
    tools = {"punch": circle(centre=[0.5 * WIDTH, HEIGHT + 5e-3 + gap], radius=5e-3, force=force)}
    contact = [{"slave": "top", "master": "punch", "friction": {"law": "coulomb", "mu": 0.5}}]
    held = [{"surface": "bottom", "displacement": {"x": 0, "y": 0}}]
    stage = [{"name": "both", "duration": "1 s", "steps": 3}]
    simulation = run(block_case(mesh, tools=tools, contact=contact, boundary=held, stage=stage))
    driven = last(simulation)
    assert driven["force_x"] == pytest.approx(-0.4, rel=1e-7)
    assert driven["force_y"] == pytest.approx(2.0, rel=1e-7)
    assert len(simulation.rows) == 3
    assert max(row.newton_iterations for row in simulation.rows) <= 25


def test_what_a_force_drives_stays_where_it_is_while_it_touches_nothing(mesh):
    tools = {"punch": plane(force=pushed("-3 N"), stages=["press"])}
    simulation = run(block_case(mesh, tools=tools, stage=stages("press", "rest")))
    place, force = of_tool(simulation, "displacement_y"), of_tool(simulation, "force_y")
    assert place[2:] == pytest.approx([place[1]] * 2, rel=1e-12)
    assert force == pytest.approx([1.5, 3.0, 0.0, 0.0], abs=1e-6)


def test_a_tool_that_has_left_touches_again_in_a_later_stage(mesh):
    way = [["0 s", "0 m"], ["1 s", "-50 um"], ["2 s", "10 um"], ["3 s", "-50 um"]]
    tools = {"punch": plane(displacement={"y": way}, stages=["press", "again"])}
    simulation = run(block_case(mesh, tools=tools, stage=stages("press", "rest", "again")))
    force = of_tool(simulation, "force_y")
    assert force[2:4] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert force[5] == pytest.approx(force[1], rel=1e-6)


def test_a_tool_on_a_spring_is_in_balance_between_spring_and_block(mesh):
    """k (end − u) is the force; a stiff spring is a displacement; work is in spring and block."""
    end = {"direction": "y", "end": [["0 s", "0 m"], ["1 s", "-50 um"]]}
    soft = run(block_case(mesh, tools={"punch": circle(spring={"stiffness": "20 N/mm", **end})}))
    force, place = (float(of_tool(soft, f"{w}_y")[-1]) for w in ("force", "displacement"))
    assert force == pytest.approx(20e3 * (50e-6 + place), rel=1e-7)
    assert place == pytest.approx(-30e-6, abs=15e-6)
    assert of_tool(soft, "driving_force_y")[-1] == pytest.approx(-force, rel=1e-7)
    assert not any("only contact holds" in note for note in soft.model.notes)
    loaded = last(run(block_case(mesh, tools={"punch": circle(force=pushed(f"{-force!r} N"))})))
    assert loaded["displacement_y"] == pytest.approx(place, rel=1e-6)
    stiff = last(run(block_case(mesh, tools={"punch": circle(spring={"stiffness": 1e10, **end})})))
    moved = last(run(block_case(mesh, tools={"punch": circle(displacement=down())})))
    assert stiff["force_y"] == pytest.approx(moved["force_y"], rel=1e-5)


def facts(comm, directory):
    """A roller on a spring, a plane that a force moves to a stop, and is released: rows, work.

    And the work on a block of one cell, of which a rank may own nothing.
    """
    mesh, cell = directory / "ranks.msh", directory / "cell.msh"
    if comm.rank == 0:
        block_mesh(mesh)
        block_mesh(cell, (1, 1))
    comm.barrier()
    small = block_case(cell, tools={"punch": plane(force=pushed("-0.1 N"))})
    tables = rolled(moment=0)
    wall = {"force": {"x": "-0.1 N"}, "stop": {"x": "-0.2 um"}}
    tables["tools"]["wall"] = plane(point=[WIDTH, 0], normal=[-1, 0], **wall)
    wall = {"slave": "right", "master": "wall", "friction": FREE}
    tables["contact"].append(wall)
    del tables["tools"]["punch"]["displacement"]["y"]
    end = [["0 s", "0 m"], ["1 s", "-60 um"]]
    spring = {"direction": "y", "stiffness": "0.1 N/um", "end": end}
    tables["tools"]["punch"]["spring"] = spring
    tables["stage"][1]["steps"] = 3
    tables["stage"].append({"name": "end", "duration": "1 s", "steps": 2, "release": ["wall"]})
    simulation = run(block_case(mesh, **tables), comm, Observer())
    columns = simulation.state.tools.columns
    rows = [row[4:] for row in simulation.state.tools.rows]
    every = simulation.rows + run(small, comm, Observer()).rows
    return {"columns": columns, "rows": rows, "work": [row.external_work for row in every]}


@pytest.mark.mpi(facts, 3)
def test_ranks_do_not_matter(on_ranks):
    alone = on_ranks(facts, 1)
    whole = np.array(alone["rows"])
    size = np.abs(whole).max(axis=0)
    assert size.min() > 0.0
    found = on_ranks(facts, 3)
    apart = np.abs(np.array(found["rows"]) - whole) / size
    # Loads are balanced to the tolerance of the solver.
    assert apart.max() < 1e-6, apart.max(axis=0)
    np.testing.assert_allclose(found["work"], alone["work"], rtol=1e-6)
