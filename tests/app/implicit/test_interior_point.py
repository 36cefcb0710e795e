"""Contacts that are found from inside: flush sheets, on which Newton's method chatters."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from petsc4py import PETSc

from tests.solved import solved as run
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit import interior_point
from tribox.app.implicit.interior_point import OPENINGS_FLOWING, linear_gaps, order

E, NU = 70e9, 0.33
WIDTH = 0.1  # m, of the slab


FRICTIONLESS = {"law": "frictionless"}


ELASTIC = {"material": "hencky", "E": E, "nu": NU}
FILM_MAP = {
    "preset": "friction-map",
    "mu_s": 0.1,
    "K_T": "1e11 Pa/m",
    "V_star": "0.1 mm/s",
    "V_star_at": "30 nm",
}


def strip(cells, length, tools, stroke_steps, friction=FRICTIONLESS, metal=ELASTIC):
    """A strip of aluminium 1 mm high, symmetric at its left end."""
    side = {"bed": "bottom", "die": "bottom"}
    return {
        "geometry": {
            "kind": "blocks",
            "thickness": WIDTH,
            "blocks": {"strip": {"x": [0, length], "y": [0, 1e-3], "elements": cells}},
        },
        "bodies": {"strip": metal},
        "tools": {name: {"shape": "polyline", **keys} for name, keys in tools.items()},
        "contact": [
            {"slave": f"strip_{side.get(name, 'top')}", "master": name, "friction": friction}
            for name in tools
        ],
        "boundary": [{"surface": "strip_left", "symmetry": True}],
        "stage": [{"name": "press", "duration": "1 s", "steps": stroke_steps}],
    }


def down(stroke):
    return {"y": [[0, 0], [1, -stroke]]}


@pytest.mark.parametrize("cells", [40, 120])
def test_a_flush_flat_takes_no_more_iterations_on_a_finer_mesh(cells):
    """The right half is clamped by 0.1 µm; a third flat touches the left half, at no gap.

    Half the load has the same contact: further steps follow from the first, and the force is that
    of plane compression, E/(1 − ν²) of the strain.
    """
    tools = {
        "bed": {"points": [[0.02, 0], [0.05, 0]]},
        "lid": {"points": [[0.05, 1e-3], [0.02, 1e-3]], "displacement": down(1e-7)},
        "third": {"points": [[0.018, 1e-3], [-0.001, 1e-3]]},
    }
    rows = run(strip([cells, 2], 0.04, tools, 3)).state.rows
    iterations = [row.newton_iterations for row in rows]
    assert len(rows) == 3 and iterations[0] <= 8 and max(iterations[1:]) <= 3
    each = E / (1.0 - NU**2) * 1e-4 * 0.02 * WIDTH
    # The total of all pairs: the lid's force and the bed's. The clamped end adds a little.
    assert rows[-1].normal_force == pytest.approx(2.0 * each, rel=0.02)
    assert rows[0].normal_force == pytest.approx(rows[-1].normal_force / 3.0, rel=1e-4)


@pytest.mark.parametrize("friction", [FRICTIONLESS, {"law": "coulomb", "mu": 0.5}])
def test_a_strip_is_lifted_off_the_floor_that_its_weight_presses_it_on(friction):
    """Pressures from inside began at 100 times the weight's, and lost their way: 4224 iterations.

    Of the weight w per length a length a hangs free, a/2 on the tip: H = w a⁴/24EI (Euler).
    """
    rubber, height, lift = {"E": 1e7, "nu": 0.3, "density": 1100.0}, 1e-3, 2e-3
    data = strip([100, 1], 0.1, {"bed": {"points": [[-1, 0], [1, 0]]}}, 1, friction)
    data["geometry"]["groups"] = {"tip": ["strip_right", "strip_bottom"]}
    data["bodies"]["strip"] = {"material": "hencky", "formulation": "q2", **rubber}
    data["gravity"] = {"y": -9.81}
    data["boundary"].append({"surface": "tip", "displacement": {"y": [[0, 0], [1, 0], [2, lift]]}})
    data["stage"].append({"name": "lift", "duration": 1, "steps": 4})
    rows = run(data).state.rows
    assert len(rows) == 5 and sum(row.newton_iterations for row in rows) <= 250
    weight = rubber["density"] * 9.81 * height
    bending = rubber["E"] / (1.0 - rubber["nu"] ** 2) * height**3 / 12.0
    free = (24.0 * bending * lift / weight) ** 0.25
    assert rows[-1].normal_force == pytest.approx(weight * WIDTH * (0.1 - free / 2.0), rel=2e-3)


def bending(stroke):
    """A punch that bends a strip over a die, by a stroke, m."""
    return {
        "die": {
            "points": [[0.0201, -0.04], [0.0201, 0], [0.08, 0]],
            "fillet_radius": 5e-3,
            "continued": [True, True],
        },
        "punch": {
            "points": [[0.0185, 0.04], [0.0185, 1e-3], [-0.005, 1e-3]],
            "fillet_radius": 2.5e-3,
            "continued": [True, True],
            "displacement": down(stroke),
        },
    }


@pytest.mark.parametrize("metal", [ELASTIC, {"material": "AA1050-O"}])
def test_what_touches_nothing_stays_where_it_is(metal):
    """A plate 0.5 mm above the strip, held by nothing: pressures from inside threw it 100 mm up."""
    data = strip([40, 2], 0.06, bending(1.5e-4), 3, metal=metal)
    plate = {"x": [0.03, 0.05], "y": [1.5e-3, 2.5e-3], "elements": [10, 1]}
    data["geometry"]["blocks"]["plate"], data["bodies"]["plate"] = plate, ELASTIC
    above = {"slave": "plate_bottom", "master": "strip_top", "friction": FRICTIONLESS}
    data["contact"].append(above)
    data["boundary"].append({"surface": "plate_left", "displacement": {"x": 0}})
    data["solver"] = {"tolerance": 1e-9}  # of the contacts' norm, many times their resultant
    model = run(data).model
    nodes = np.unique(model.problem.space.dofmap.list[model.named.cells("plate")])
    assert np.abs(model.problem.u.x.array.reshape(-1, 2)[nodes]).max() < 1e-9


@pytest.mark.parametrize(
    ("metal", "friction", "most"),
    [
        (ELASTIC, FRICTIONLESS, 25),
        (ELASTIC, {"law": "coulomb", "mu": 0.1}, 25),
        ({"material": "AA1050-O"}, FRICTIONLESS, 60),
    ],
    ids=["elastic", "friction", "flowing"],
)
def test_a_strip_that_lies_flush_on_a_die_is_bent_without_a_cut(metal, friction, most):
    data = strip([80, 2], 0.06, bending(6e-4), 4, friction, metal)
    data["solver"] = {"tolerance": 1e-9}  # of the contacts' norm, many times their resultant
    rows = run(data).state.rows
    assert len(rows) == 4 and max(row.newton_iterations for row in rows) <= most
    assert abs(rows[-1].energy_error) <= 0.01 * rows[-1].external_work


def test_pressures_follow_the_gaps_that_the_tangent_expects():
    """A strip that is pushed 0.5 mm along the fillet of a die, far beyond its penetration."""
    rubbing = {"law": "coulomb", "mu": 0.1}
    case = strip([80, 2], 0.06, bending(6e-4), 4, rubbing) | {"solver": {"tolerance": 1e-10}}
    problem = run(case).model.problem
    start, step = problem.new_vector(), StepMode.of_stage(1.0, problem.contacts)
    start.array[:] = problem.u.x.array[: problem.owned]
    trial = start.copy()
    trial.array[::2] += 5e-4
    problem.residual(None, trial, trial.duplicate(), step)
    found = linear_gaps(problem, step, start, trial)
    for term, gap in zip(problem.contacts, found, strict=True):
        here = term.evaluate(start, 1.0)
        there = term.evaluate(trial, 1.0).normal_contact.gap
        pressed = here.normal_contact.nodal_pressure > 0.0
        rows = term.linearised.vertex_sides(term.state, here)[1]
        moved = (trial - start).array.reshape(-1, 2)[term.surface.nodes].reshape(-1)
        expected = here.normal_contact.gap + rows @ moved / term.linearised.area_of(here)
        np.testing.assert_allclose(gap[pressed], expected[pressed], rtol=0, atol=1e-9)
        assert pressed.any() and np.abs(there - gap)[pressed].max() > 1e-7
        # Friction begins below its threshold, also where that has fallen.
        begun = interior_point._starting_point(term, here, 1e-4, 1e-2, 0.0)
        lighter = replace(begun, pressure=0.5 * begun.pressure)
        slip = interior_point._starting_slip(term, here, lighter, begun.pressure.max(), 1e-6)
        elastic = np.linalg.norm(here.response.state.elastic_slip, axis=1)
        assert np.count_nonzero(elastic > 1.1 * slip.threshold) >= 4
        assert (np.linalg.norm(slip.elastic, axis=1) < slip.threshold).all()
        assert (slip.permanent > 0.0).all()


def test_metal_that_is_bent_and_rubs_is_followed_along_the_central_path():
    """Linear laws pull at what wants to open, and fail; a smooth path does not."""
    friction = {"law": "coulomb", "mu": 0.1}
    tools, metal = bending(2.4e-3), {"material": "AA1050-O"}
    simulation = run(strip([80, 2], 0.06, tools, 8, friction, metal))
    rows = simulation.state.rows
    assert [row.attempts for row in rows] == [1] * 8
    assert sum(row.newton_iterations for row in rows) <= 180
    inside = simulation.stepper.newton.inside
    assert inside.last and OPENINGS_FLOWING[inside.opening].central


def test_metal_that_slides_on_a_film_is_bent_without_a_cut():
    """On the way from inside the film covers what gaps close, and in the end rubs as it does."""
    data = strip([80, 2], 0.06, bending(2.4e-3), 2, FILM_MAP, {"material": "AA1050-O"})
    data["stage"][0]["duration"] = "0.25 s"
    for pair in data["contact"]:
        pair["film"] = {"thickness": "30 nm"}
    rows = run(data).state.rows
    assert [row.attempts for row in rows] == [1, 1]
    assert sum(row.newton_iterations for row in rows) <= 40


@pytest.mark.parametrize(
    ("pressed", "last", "central"),
    [(True, 0, [True, True]), (True, 1, [True]), (True, 3, [True]), (False, 1, [])],
    ids=["predicted", "linear", "lost", "first-contact"],
)
def test_once_the_predicted_path_was_lost_it_begins_at_the_linear_step(pressed, last, central):
    inside = SimpleNamespace(opening=last)
    newton = SimpleNamespace(problem=SimpleNamespace(flows=True), inside=inside)
    tried = [OPENINGS_FLOWING[n] for n in order(SimpleNamespace(newton=newton, pressed=pressed))]
    paths = [opening for opening in tried if opening.central]
    assert paths == tried[: len(paths)] and [path.central for path in paths] == central
    assert [path.linear for path in paths] == ([False, True] if last == 0 and pressed else central)
    assert len(tried) - len(paths) == 2


@pytest.mark.parametrize(
    ("pressed", "continued", "tried", "kept"),
    [(True, True, [0, 1, 2], 2), (True, False, [0, 2], 2), (False, True, [2], 0)],
    ids=["continued", "linear-already", "first-contact"],
)
def test_no_path_is_tried_twice_and_a_first_contact_says_nothing_of_them(
    monkeypatch, pressed, continued, tried, kept
):
    """Only the first of the linear laws finds the step here."""
    asked = []

    def way(attempt, opening):
        asked.append(OPENINGS_FLOWING.index(opening))
        return 1, not opening.central

    for name in ("followed", "approached"):
        monkeypatch.setattr(interior_point, name, way)
    inside, vector = SimpleNamespace(opening=0), SimpleNamespace(array=np.zeros(1), array_r=0.0)
    newton = SimpleNamespace(problem=SimpleNamespace(flows=True), inside=inside)
    newton.begin, newton.solve = lambda x: None, lambda step: (1, 1)
    attempt = SimpleNamespace(
        newton=newton, pressed=pressed, continued=continued, trial=vector, x=vector, step=None
    )
    attempt.bodies, attempt.adrift = SimpleNamespace(directions=()), ()
    iterations, reason = interior_point.FromInside().run(attempt)
    assert (asked, inside.opening) == (tried, kept)
    assert iterations == len(tried) + 1 and reason > 0


@pytest.mark.parametrize(
    ("way", "left", "exact", "comes_to"),
    [
        ("approached", [9.0], [], (12, False)),
        ("approached", [9.0] * 12 + [0.5], [], (20, False)),
        ("approached", [1e-2], [9e-3, 8e-3, 7.9e-3], (2, True)),
        ("approached", [1e-2], [2e-2], (20, False)),
        ("approached", [1e-2], [9e-3, 5e-4], (1, True)),
        ("followed", [0.2], [], (24, False)),
        ("followed", [0.2] * 24 + [0.05], [], (32, False)),
        ("followed", [1e-4], [9e-3, 8e-3, 7.9e-3, 7.8e-3], (3, True)),
        ("followed", [1e-4], [2e-2], (32, False)),
        ("followed", [1e-4], [9e-3, 5e-7], (1, True)),
    ],
)
def test_a_path_has_patience_and_an_end_where_the_exact_law_stalls_near_it(
    monkeypatch, way, left, exact, comes_to
):
    """Residuals on the path and of the exact law, iteration by iteration, the last for ever."""
    for name in ("starting_points", "linear_gaps", "_advanced"):
        monkeypatch.setattr(interior_point, name, lambda *_: [])
    monkeypatch.setattr(interior_point, "shortest_facet", lambda problem: 1.0)
    asked = {
        True: iter([*left[:-1], *[left[-1]] * 99]),
        False: iter([*exact[:-1], *exact[-1:] * 99]),
    }
    vector = SimpleNamespace(copy=lambda to=None: vector)
    newton = SimpleNamespace(
        problem=SimpleNamespace(flows=False, trials=[], contacts=[]),
        options=SimpleNamespace(max_iterations=99),
        residual_of=lambda step: next(asked[step == "inside"], 1.0),
        step=lambda step, falling: None,
        step_to_least_energy=lambda step, first, eased: 1.0,
    )
    attempt = SimpleNamespace(
        newton=newton,
        trial=vector,
        x=vector,
        continued=True,
        loads=np.zeros(0),
        step=SimpleNamespace(inside=lambda points: "inside"),
        return_to_start=lambda: None,
    )
    assert getattr(interior_point, way)(attempt, interior_point.Opening(1e-2)) == comes_to


def test_a_gap_that_passes_the_end_of_its_master_has_no_rate():
    start, trial = (PETSc.Vec().createWithArray(np.array([x])) for x in (0.0, 1.0))

    def evaluate(x, dt, mode):
        place = x.array_r[0]
        gaps = np.array([5.0 - 1.5 * place, 0.0 if place == 0.0 else 1e6])
        return SimpleNamespace(normal_contact=SimpleNamespace(gap=gaps))

    step = SimpleNamespace(dt=1.0, pairs=lambda terms: [(term, None) for term in terms])
    there = SimpleNamespace(normal_contact=SimpleNamespace(gap=np.array([9.0, 7.0])))
    problem = SimpleNamespace(contacts=[SimpleNamespace(evaluate=evaluate)], trials=[there])
    [gaps] = linear_gaps(problem, step, start, trial)
    np.testing.assert_allclose(gaps, [3.5, 7.0], rtol=1e-8)


MU, RADIUS, HEIGHT, HALF = 0.3, 0.01, 5e-4, 0.04


def path_of_an_end():
    """Programs x and y, m, of the right end of a belt that is laid around a drum, and pulled on.

    It is kept taut: the end moves as that of a thread, stretched by 3 %, which leaves the drum at
    45 degrees in the end. From 1 s to 2 s it moves along the belt by 3 mm.
    """
    radius, way = RADIUS + 0.5 * HEIGHT, 3e-3 / math.sqrt(2.0)
    x, y = [], []
    for time in np.linspace(0.0, 1.0, 11):
        angle = 0.25 * math.pi * time
        free = HALF * (1.0 + 0.03 * min(1.0, 4.0 * time)) - radius * angle
        x.append([time, radius * math.sin(angle) + free * math.cos(angle) - HALF])
        y.append([time, radius * (math.cos(angle) - 1.0) - free * math.sin(angle)])
    there = [[*x, [2.0, x[-1][1] + side * way]] for side in (-1.0, 1.0)]
    down = [[*y, [2.0, y[-1][1] + side * way]] for side in (1.0, -1.0)]
    return there, down


def test_a_belt_that_slides_around_a_drum_is_pulled_as_euler_and_eytelwein_say():
    """T2/T1 = exp(mu theta), theta 90 degrees; it is laid around without a cut."""
    (back, on), (up, down_) = path_of_an_end()
    ends = {"left": {"x": [[t, -v] for t, v in on], "y": down_}, "right": {"x": back, "y": up}}
    belt = {"x": [-HALF, HALF], "y": [0, HEIGHT], "elements": [80, 2]}
    simulation = run(
        {
            "geometry": {"kind": "blocks", "thickness": WIDTH, "blocks": {"belt": belt}},
            "bodies": {"belt": {"material": "neo-hookean", "E": 5e6, "nu": 0.45}},
            "tools": {"drum": {"shape": "circle", "centre": [0, -RADIUS], "radius": RADIUS}},
            "contact": [
                {"slave": "belt_bottom", "master": "drum", "friction": {"law": "coulomb", "mu": MU}}
            ],
            "boundary": [{"surface": f"belt_{side}", "displacement": ends[side]} for side in ends],
            "stage": [
                {"name": "lay", "duration": 1.0, "steps": 10},
                {"name": "pull", "duration": 1.0, "steps": 1},
            ],
            "solver": {"tolerance": 1e-9},
        }
    )
    rows, motion = simulation.state.rows, simulation.state.motion
    assert len(rows) == 11 and max(row.newton_iterations for row in rows[:-1]) <= 25
    assert rows[-1].stick_fraction == 0.0
    last = [dict(zip(motion.surface_columns, row, strict=True)) for row in motion.surface_rows[-2:]]
    pulls = {row["surface"]: math.hypot(row["force_x"], row["force_y"]) for row in last}
    assert pulls["belt_left"] / pulls["belt_right"] == pytest.approx(
        math.exp(0.5 * math.pi * MU), rel=5e-3
    )
