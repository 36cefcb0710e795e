"""Forming cases of ``cases/forming``, reduced: each runs, and obeys what is known by hand.

Each also draws its picture in ``docs/gallery.md``. Coarse meshes and few steps, so that forces
are those of a coarse body; the pages in ``docs/forming`` have the numbers of the cases as they are.
"""

from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks.verify.test_flowing import fibre_moments
from tests.forming_pictures import draw_picture
from tribox import load_case, read, run_case
from tribox.app.results.recorder import force_balance
from tribox.app.simulation.history import energy_gap
from tribox.app.simulation.simulation import Simulation
from tribox.forms.bodies.hardening import Backstress, Swift, Voce

CASES = Path(__file__).parents[1] / "cases" / "forming"


def reduced(name: str, results: Path, **changes: str) -> Simulation:
    """A forming case with keys changed (two underscores for a dot), solved, with its picture.

    Its energies and forces add up, and none of its first three steps is cut.
    """
    changes |= {"output__figures": "false", "output__fields_every": "0"}
    overrides = [f"{key.replace('__', '.')}={value}" for key, value in changes.items()]
    case = load_case(CASES / f"{name}.toml", overrides).model_copy(update={"sweep": None})
    simulation = run_case(case, results / name, force=True, quiet=True)
    draw_picture(name, results / name)
    assert abs(energy_gap(simulation.rows)) < 1e-2
    assert force_balance(simulation) < 1e-8
    assert [row.attempts for row in simulation.rows[:3]] == [1, 1, 1]
    return simulation


def of_tool(simulation: Simulation, tool: str, column: str) -> np.ndarray:
    """History of a column of a tool."""
    columns = list(simulation.state.tools.columns)
    which, what = columns.index("tool"), columns.index(column)
    return np.array([row[what] for row in simulation.state.tools.rows if row[which] == tool])


def test_a_strip_drawn_through_a_die_takes_the_gap_and_the_work_of_its_flow(tmp_path):
    """The force is between homogeneous flow alone, and that with friction and the two shears.

    Slab: sigma = 2k (1 + B)/B (1 - r^B), B = mu cot(angle); the velocity turns by the angle, in
    the mean by half of it, where the strip enters and where it leaves: k angle more.
    """
    done = reduced(
        "ironing",
        tmp_path,
        geometry__blocks__strip__elements="[50, 3]",
        stage__0__steps="12",
        stage__1__steps="5",
        stage__2__duration='"5 s"',
        stage__2__steps="50",
        stage__3__steps="1",
        stage__3__duration='"0.05 s"',
    )
    steady = [number for number, row in enumerate(done.rows) if 3.5 < row.time < 5.5]
    pull = of_tool(done, "die", "force_x")
    edge = done.state.motion.of_surface("strip_right", "force_x")
    np.testing.assert_allclose(edge, pull, atol=1e-6 * pull.max())
    thickness, exit_height, angle, mu = 50e-3, 0.8e-3, np.radians(10.0), 0.05
    strain = 2.0 / np.sqrt(3.0) * np.log(1.0 / 0.8)
    alpha = np.linspace(0.0, strain, 2001)
    mean = np.trapezoid(Swift(201.2e6, 0.002, 0.2545).stress(alpha), alpha) / strain
    double_shear, ratio = 2.0 / np.sqrt(3.0) * mean, mu / np.tan(angle)
    slab = double_shear * (1.0 + ratio) / ratio * (1.0 - 0.8**ratio)
    measured = pull[steady].mean() / (exit_height * thickness)
    assert slab < measured < 1.05 * (slab + 0.5 * double_shear * angle)


def test_a_strip_between_pads_rubs_as_asperities_and_film_do_by_hand(tmp_path):
    """Below V* the film carries alpha of the shear, above it all: mu N and eta V A/D by hand."""
    done = reduced(
        "strip-draw",
        tmp_path,
        geometry__blocks__strip__elements="[64, 1]",
        geometry__blocks__pad__elements="[30, 4]",
        stage__1__velocities='["1e-5 m/s", "1e-3 m/s"]',
    )
    slow, fast = (
        [row for row in done.rows if row.velocity == velocity][-1] for velocity in (1e-5, 1e-3)
    )
    alpha, mu, viscosity, film = 0.039, 0.1, 0.8, 10e-9
    for row, share in ((slow, alpha), (fast, 1.0)):
        sheared = row.contact_area * row.area_ratio
        expected = (1.0 - share) * mu * row.normal_force
        expected += share * viscosity * row.velocity / film * sheared
        assert row.friction_force == pytest.approx(expected, rel=2e-3)
        assert row.normal_force == pytest.approx(3e6 * 12e-3 * 50e-3, rel=1e-6)


@pytest.mark.long
def test_friction_of_an_oiled_strip_falls_with_the_oil_and_the_speed(tmp_path):
    ends = []
    for number, oil in enumerate(("0.25 g/m^2", "2 g/m^2")):
        done = reduced(
            "strip-draw-oil",
            tmp_path / str(number),
            geometry__blocks__strip__x='["-3 mm", "1.5 mm"]',
            geometry__blocks__strip__elements="[90, 2]",
            contact__0__film__oil=f'"{oil}"',
            stage__2__duration='"0.02 s"',
            stage__2__steps="8",
            stage__3__duration='"0.003 s"',
            stage__3__steps="10",
        )
        assert all(row.attempts == 1 for row in done.rows)
        assert np.mean([row.newton_iterations for row in done.rows]) <= 10.0
        slow, fast = ([r for r in done.rows if r.stage == f"{v} mm/s"][-1] for v in (30, 300))
        ends.append((slow.friction_coefficient, fast.friction_coefficient))
    (slow_dry, fast_dry), (slow_wet, fast_wet) = ends
    assert slow_dry == pytest.approx(0.15, rel=0.02)  # that of the asperities
    assert slow_wet < slow_dry
    assert fast_wet < 0.7 * slow_wet
    assert fast_wet < 0.7 * fast_dry


def rolled(rotation: str, tmp_path: Path) -> tuple[Simulation, np.ndarray]:
    """The roller on a coarse layer, and the rows of its last 2 mm."""
    done = reduced(
        "roller",
        tmp_path,
        geometry__blocks__layer__elements="[38, 5]",
        tools__roller__rotation=rotation,
        stage__0__steps="10",
        stage__1__duration='"5 s"',
        stage__1__steps="25",
    )
    return done, np.array([row.time > 4.0 for row in done.rows])


def test_a_roller_that_turns_freely_goes_without_resistance_and_a_locked_one_slides(tmp_path):
    free, late = rolled("{ moment = 0 }", tmp_path)
    normal = of_tool(free, "roller", "force_y")[late].mean()
    assert abs(of_tool(free, "roller", "force_x")[late].mean()) < 5e-3 * normal
    np.testing.assert_allclose(of_tool(free, "roller", "moment_z"), 0.0, atol=1e-8 * normal * 10e-3)
    turned, way = (of_tool(free, "roller", name)[late] for name in ("rotation", "displacement_x"))
    assert -10e-3 * np.polyfit(way, turned, 1)[0] == pytest.approx(1.0, abs=0.06)
    locked, late = rolled("{ angle = 0 }", tmp_path)
    rubbed = np.array([row.normal_force for row in locked.rows])[late]
    moment = of_tool(locked, "roller", "moment_z")[late]
    np.testing.assert_allclose(np.abs(moment), 0.3 * rubbed * 10e-3, rtol=2e-3)
    assert np.abs(of_tool(locked, "roller", "force_x"))[late].min() > 0.28 * normal


def karman(entry: float, gap: float, radius: float, mu: float, curve: Swift) -> float:
    """Force on a roll, N/m, of a slab: d(h s)/dx = -p dh/dx -+ 2 mu p, with s + p = 2k.

    From the gap, where the strip is faster than the roll, and from the entry, where it is slower,
    up to where both pressures are the same.
    """
    long = np.sqrt(radius * (entry - gap) - 0.25 * (entry - gap) ** 2)
    x, wide = np.linspace(0.0, long, 4001), 2.0 / np.sqrt(3.0)
    height = gap + 2.0 * (radius - np.sqrt(radius**2 - x**2))
    shear = wide * curve.stress(wide * np.log(entry / height))
    pressures = []
    for order, sign in ((np.arange(len(x)), -1.0), (np.arange(len(x))[::-1], 1.0)):
        pull, pressure = 0.0, np.empty_like(x)
        for last, at in zip([order[0], *order[:-1]], order, strict=True):
            before = shear[last] - pull / height[last]
            pull += before * (height[last] - height[at] + 2.0 * sign * mu * (x[at] - x[last]))
            pressure[at] = shear[at] - pull / height[at]
        pressures.append(pressure)
    return float(np.trapezoid(np.minimum(*pressures), x))


def test_rolls_draw_a_strip_through_with_the_force_of_a_slab_and_what_its_shears_add(tmp_path):
    """No start of Newton's method lets the strip lie still while the rolls turn on."""
    done = reduced(
        "strip-rolling",
        tmp_path,
        geometry__blocks__strip__elements="[48, 2]",
        stage__0__steps="30",
        stage__1__steps="60",
    )
    rolled = np.array([row.time > 1.5 for row in done.rows])
    slab = karman(4e-3, 3.4e-3, 0.05, 0.15, Swift(139.3e6, 0.002, 0.2581))
    assert slab < of_tool(done, "roll", "force_y")[rolled].mean() < 1.1 * slab
    assert all(row.attempts == 1 for row in done.rows)
    assert np.mean([row.newton_iterations for row in done.rows]) < 6.0


def test_upsetting_takes_the_force_of_the_slab_with_friction(tmp_path):
    """p = sigma_Y (1 + 2 mu R/(3 H)) in the mean, R and H (of both halves) as they are then."""
    done = reduced(
        "upsetting", tmp_path, geometry__blocks__billet__elements="[10, 8]", stage__0__steps="15"
    )
    for row in done.rows[3:]:
        height = 7.5e-3 - 3e-3 * row.time
        radius = 10e-3 * np.sqrt(7.5e-3 / height)
        flow = 100e6 + 200e6 * np.log(7.5e-3 / height)
        slab = np.pi * radius**2 * flow * (1.0 + 2.0 * 0.1 * radius / (3.0 * 2.0 * height))
        assert row.normal_force == pytest.approx(slab, rel=0.03)
        assert row.friction_force <= 0.1 * row.normal_force * (1.0 + 1e-9)


@pytest.mark.long
def test_a_tube_fills_the_die_and_springs_back_by_little(tmp_path):
    done = reduced(
        "tube-bulge",
        tmp_path,
        geometry__blocks__tube__elements="[2, 24]",
        geometry__blocks__plug__elements="[6, 12]",
        stage__0__steps="8",
        stage__1__steps="24",
        stage__2__steps="6",
    )
    flowing = next(number for number, row in enumerate(done.rows) if row.plastic_dissipation > 0.0)
    pressed = of_tool(done, "punch", "force_y") / (np.pi * 20e-3**2)
    # A thick tube in plane strain yields first at p = sigma_0/sqrt(3) (1 - a²/b²).
    first = Swift(139.3e6, 0.002, 0.2581).stress(np.zeros(1))[0] / np.sqrt(3.0)
    first *= 1.0 - (20.0 / 21.5) ** 2
    assert pressed[flowing - 1] < 1.1 * first
    assert pressed[flowing] > 0.9 * first
    middle = done.state.motion.of_surface("tube_bottom", "displacement_x")
    end = np.array([row.stage for row in done.rows]).tolist().index("lift") - 1
    assert 3.5e-3 < middle[end] < 4.0e-3  # the outside is at 25 mm, the wall has become thinner
    assert 0.0 < middle[end] - middle[-1] < 20e-6


@pytest.mark.long
def test_a_strip_pressed_by_a_pad_stays_bent_and_keeps_stresses_in_balance(tmp_path):
    done = reduced(
        "pad",
        tmp_path,
        geometry__blocks__strip__elements="[26, 2]",
        geometry__blocks__pad__elements="[16, 4]",
        stage__1__steps="12",
    )
    end = [row.stage for row in done.rows].index("lift") - 1
    down = done.state.motion.of_surface("pad_top", "force_y")
    np.testing.assert_allclose(of_tool(done, "die", "force_y"), down, atol=1e-7 * abs(down).max())
    stored = np.array([row.strain_energy for row in done.rows])
    flowed = np.array([row.plastic_dissipation for row in done.rows])
    assert flowed[-1] == pytest.approx(flowed[end], rel=0.05)
    assert 0.0 < stored[-1] < 0.05 * stored[end]
    sunk = done.state.motion.of_body("strip", "displacement_y")
    assert sunk[-1] == pytest.approx(sunk[end], rel=0.1)


@pytest.mark.long
def test_a_pad_closes_round_the_sheet_and_forms_the_recess(tmp_path):
    """Rubber keeps its volume: what its top sweeps, recess and step round the sheet take."""
    done = reduced(
        "recess",
        tmp_path,
        geometry__size='"4 mm"',
        geometry__sizes=(
            '{ sheet = "0.6 mm", "sheet top" = "0.4 mm", "pad face" = "0.5 mm", '
            '"pad side" = "2 mm" }'
        ),
        stage__1__duration='"0.02 s"',
        stage__1__steps="1",
    )
    top = done.state.motion.of_surface("pad top", "force_y")
    np.testing.assert_allclose(of_tool(done, "die", "force_y"), top, atol=1e-7 * abs(top).max())
    line = read(tmp_path / "recess").probes
    line = line[(line["probe"] == "sheet") & (line["step"] == len(done.rows) - 1)]
    sunk = -line["displacement_y"].to_numpy()
    assert sunk[0] == pytest.approx(2e-3, abs=10e-6)  # on the floor
    place = (line["reference_x"] + line["displacement_x"]).to_numpy()
    half, high, stroke = 24e-3, 16e-3, 1.1e-3
    edge = place[-1] + 0.5e-3  # the line ends that much before the sheet
    pressure = abs(top[-2]) / half
    assert 5e6 < pressure < 20e6
    taken = np.trapezoid(sunk, place) + (half - edge) * 1.01e-3 + half * high * pressure / 1150e6
    assert taken == pytest.approx(half * stroke, rel=0.03)


@pytest.mark.long
def test_a_strip_that_rollers_have_bent_and_bent_back_curls_as_its_fibres_do(tmp_path):
    """Fibres with the upper side's own curvatures are left straight to 4 % of the curl.

    Fibres without backstress are so too: their moments differ by 1 % of the curl, whose sign hangs
    on how the strip snaps at its lift, and that on the processor.
    """
    way, up = '[["1 s", "0 mm"], ["2 s", "10 mm"]]', '[["2 s", "0 mm"], ["3 s", "-6 mm"]]'
    down = '[["0 s", "0 mm"], ["1 s", "-0.8 mm"], ["2 s", "-0.8 mm"], ["3 s", "6 mm"]]'
    less = {"geometry__blocks__strip__x": '["0 mm", "31 mm"]', "stage__0__steps": "4"}
    less |= {"geometry__blocks__strip__elements": "[62, 2]", "stage__1__steps": "15"}
    less |= {"probe__0__bend": '["13 mm", "20 mm"]'}
    less |= {"stage__2__steps": "4", "tools__middle__displacement": f"{{ x = {way}, y = {down} }}"}
    for tool in ("left", "right"):
        less[f"tools__{tool}__displacement"] = f"{{ x = {way}, y = {up} }}"
    # Forces of rolls balance each other: what is left is that of the solver's tolerance.
    reduced("bend-unbend", tmp_path, **less, solver__tolerance="1e-9")
    rows = read(tmp_path / "bend-unbend").surface_probes
    worked = rows[(rows["arc_length"] > 15e-3) & (rows["arc_length"] < 16.5e-3)]
    history = worked.groupby("step")["curvature"].mean().to_numpy()
    law = Voce(31.5e6, 178.76e6, 13.33)
    back = Backstress(173.25e6, 12.519), Backstress(17.25e9, 236.06)
    moment = fibre_moments(history, law, back, steps=100, young=70e9)[-1]
    left = moment / (70e9 / (1.0 - 0.33**2) * 1e-9 / 12.0)
    assert history.max() > 60.0 and history[-1] < -15.0
    assert abs(left) < 0.04 * abs(history[-1])


@pytest.mark.long
def test_a_sheet_drawn_to_a_u_springs_back_as_its_fibres_do(tmp_path):
    """The moments of fibres with the sheet's curvatures, taken off, turn its bend by as much."""
    done = reduced(
        "u-bend",
        tmp_path,
        geometry__blocks__sheet__x='["0 mm", "45 mm"]',
        geometry__blocks__sheet__elements="[56, 2]",
        tools__punch__displacement='{ y = [["0 s", "0 mm"], ["1 s", "-5 mm"]] }',
        stage__0__steps="12",
        stage__1__steps="2",
        solver__tolerance="1e-9",
    )
    held = of_tool(done, "holder", "force_y")
    np.testing.assert_allclose(held[:12], 5e3, rtol=2e-3)  # from the first step on
    assert abs(held[-1]) < 1e-3
    rows, half = read(tmp_path / "u-bend").surface_probes, 0.5e-3
    bend = rows[(rows["arc_length"] > 4.3e-3) & (rows["arc_length"] < 19e-3)]
    outside = bend.pivot(index="step", columns="arc_length", values="curvature")
    middle = (outside / (1.0 - half * outside)).iloc[:12]
    law, stiffness = Swift(392.9e6, 0.002, 0.2561), 70e9 / (1.0 - 0.33**2) * 1e-9 / 12.0
    nodes = middle.columns[::3]
    moments = [fibre_moments(middle[at], law, (), steps=10, young=70e9)[-1] for at in nodes]
    turn = bend.pivot(index="step", columns="arc_length", values="tangent_angle")
    turn = turn[nodes[-1]] - turn[nodes[0]]
    back = turn.iloc[11] - turn.iloc[-1]
    assert turn.iloc[11] > np.radians(15.0)
    assert np.trapezoid(moments, nodes) / stiffness == pytest.approx(back, rel=0.06)


def drawing_force(rim: float, law: Swift, mu: float, holder: float) -> float:
    """Largest force of a punch on a cup of 51.2 mm, N, by a slab of constant thickness, 1 mm.

    Tresca's condition from the rim to the wall, friction of both sides of the flange at the rim,
    bending and straightening over the die's fillet, and its wrap of a quarter turn (E. Siebel).
    """
    wall, fillet, thick, forces = 25.6e-3, 6.5e-3, 1e-3, []
    for now in np.linspace(rim, 32.2e-3, 40):
        radius = np.linspace(wall, now, 400)
        stress = law.stress(np.log(np.sqrt(1.0 + (rim**2 - now**2) / radius**2)))
        drawn = np.trapezoid(stress / radius, radius) + 2 * mu * holder / (2 * np.pi * now * thick)
        bent = 4.0 / np.sqrt(3.0) * stress[0] * thick / (4.0 * fillet)
        forces.append(2.0 * np.pi * wall * thick * (drawn + bent) * np.exp(0.5 * np.pi * mu))
    return max(forces)


@pytest.mark.long
def test_a_cup_is_drawn_by_the_force_of_its_flange_until_the_holder_rests(tmp_path):
    """The rim thickens as metal does that is compressed along it alone."""
    done = reduced(
        "cup",
        tmp_path,
        geometry__blocks__blank__elements="[56, 2]",
        tools__punch__displacement='{ y = [["0 s", "0 mm"], ["1 s", "-23 mm"]] }',
        stage__0__steps="40",
        solver__tolerance="1e-9",
    )
    law = Swift(392.9e6, 0.002, 0.2561)
    force, held = (of_tool(done, tool, "force_y") for tool in ("punch", "holder"))
    by_hand = drawing_force(42e-3, law, 0.05, 5e3)
    assert force.max() == pytest.approx(by_hand, rel=0.1), (force.max(), by_hand)
    np.testing.assert_allclose(held[:20], 5e3, rtol=1e-4)
    assert abs(held[-1]) < 1.0
    assert abs(of_tool(done, "holder", "displacement_y")[-1]) < 1e-6
    rows = read(tmp_path / "cup").surface_probes
    rim = rows[rows["step"] == 1 + np.argmax(force)].sort_values("arc_length").iloc[-2]
    shrunk = 1.0 + rim["displacement_x"] / rim["reference_x"]
    assert shrunk < 0.9
    assert rim["thickness"] == pytest.approx(1e-3 / np.sqrt(shrunk), rel=0.01)
