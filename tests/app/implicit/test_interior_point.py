"""Contacts that are found from inside: flush sheets, on which Newton's method chatters."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from tests.contact_boxes import Scene
from tests.tool_cases import run
from tribox.app.implicit import interior_point
from tribox.app.implicit.interior_point import (
    CLOSE,
    EASED,
    EASY,
    GAINED,
    LIMIT_CENTRAL,
    MOST_WAY,
    NEAR,
    NEARER,
    OPENINGS,
    OPENINGS_FLOWING,
    PATIENCE,
    PATIENCE_CENTRAL,
    REACH,
    SHRINKS,
    SHRINKS_FAST,
    SHRINKS_FLOWING,
    FromInside,
    approached,
    followed,
)
from tribox.app.implicit.newton import Inside
from tribox.app.implicit.predictor import Attempt
from tribox.forms.friction.coulomb import FrictionlessLaw

E, NU = 70e9, 0.33
WIDTH = 0.1  # m, of the slab


FRICTIONLESS = {"law": "frictionless"}


ELASTIC = {"material": "hencky", "E": E, "nu": NU}


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
            {
                "slave": f"strip_{side.get(name, 'top')}",
                "master": name,
                "friction": friction,
            }
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
    assert len(rows) == 3 and iterations[0] <= 15 and max(iterations[1:]) <= 3
    each = E / (1.0 - NU**2) * 1e-4 * 0.02 * WIDTH
    # The total of all pairs: the lid's force and the bed's. The clamped end adds a little.
    assert rows[-1].normal_force == pytest.approx(2.0 * each, rel=0.02)
    assert rows[0].normal_force == pytest.approx(rows[-1].normal_force / 3.0, rel=1e-4)


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
    rows = run(strip([80, 2], 0.06, bending(6e-4), 4, friction, metal)).state.rows
    assert len(rows) == 4 and max(row.newton_iterations for row in rows) <= most
    assert abs(rows[-1].energy_error) <= 0.01 * rows[-1].external_work


def test_metal_that_is_bent_and_rubs_is_followed_along_the_central_path():
    """Linear laws pull at what wants to open, and fail; from then on the path does it."""
    friction = {"law": "coulomb", "mu": 0.1}
    tools, metal = bending(2.4e-3), {"material": "AA1050-O"}
    simulation = run(strip([80, 2], 0.06, tools, 8, friction, metal))
    rows = simulation.state.rows
    assert [row.attempts for row in rows] == [1] * 8
    assert sum(row.newton_iterations for row in rows) <= 180
    inside = simulation.stepper.newton.inside
    assert inside.last and OPENINGS_FLOWING[inside.opening].central


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
    ends = {
        "left": {"x": [[t, -v] for t, v in on], "y": down_},
        "right": {"x": back, "y": up},
    }
    belt = {"x": [-HALF, HALF], "y": [0, HEIGHT], "elements": [80, 2]}
    simulation = run(
        {
            "geometry": {"kind": "blocks", "thickness": WIDTH, "blocks": {"belt": belt}},
            "bodies": {"belt": {"material": "neo-hookean", "E": 5e6, "nu": 0.45}},
            "tools": {"drum": {"shape": "circle", "centre": [0, -RADIUS], "radius": RADIUS}},
            "contact": [
                {
                    "slave": "belt_bottom",
                    "master": "drum",
                    "friction": {"law": "coulomb", "mu": MU},
                }
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


class Script:
    """An attempt whose residuals are given, from inside and of the exact law; notes what is done.

    The last residual given stays.
    """

    def __init__(self, monkeypatch, inside, exact=(1.0,), flows=False):
        self.done, self.inside, self.exact = [], list(inside), list(exact)
        self.solutions, self.assembled, self.before = [], 0, []
        vector = SimpleNamespace(array=np.zeros(1), array_r=np.zeros(1))
        newton = SimpleNamespace(
            problem=SimpleNamespace(flows=flows, contacts=[]),
            options=SimpleNamespace(max_iterations=100),
            inside=Inside(),
            trial=vector,
            begin=lambda x: None,
            residual_of=self.residual_of,
            step=lambda step, falling: self.done.append("falling" if falling else "step"),
            step_to_least_energy=self.step_to_least_energy,
            solve=lambda step: self.solutions.pop(0),
            solver=SimpleNamespace(assemble=lambda *given: self.done.append("assembled")),
        )
        step = SimpleNamespace(inside=lambda points: "inside")
        predictor = SimpleNamespace(restart=lambda *given: 1)
        self.attempt = Attempt(newton, predictor, vector, step, True, SimpleNamespace())
        monkeypatch.setattr(interior_point, "starting_points", lambda attempt, barrier: [])
        monkeypatch.setattr(interior_point, "shortest_facet", lambda problem: 1.0)
        monkeypatch.setattr(interior_point, "_advanced", self.advanced)

    def step_to_least_energy(self, step, first, near):
        assert near == EASED
        self.done.append("least energy")
        return self.before.pop(0) if self.before else 1.0

    def residual_of(self, step):
        left = self.inside if step == "inside" else self.exact
        return left.pop(0) if len(left) > 1 else left[0]

    def advanced(self, problem, points, shrinks, kept):
        self.done.append(shrinks)
        return points


@pytest.mark.parametrize(
    ("flows", "done"),
    [
        (False, ["step", "falling", 1.0, "step", SHRINKS, "step", SHRINKS]),
        (
            True,
            [
                *(1.0, "least energy"),
                *(1.0, "least energy"),
                *(1.0, "least energy"),
                *(SHRINKS_FLOWING, "least energy"),
                SHRINKS_FLOWING,
            ],
        ),
    ],
)
def test_pressures_wait_for_bodies_unless_these_flow(monkeypatch, flows, done):
    """Which then yield wherever points that want to open hold them; and energy limits the steps."""
    script = Script(monkeypatch, [3.0, 2.0, 0.5, 0.2, 1e-3], [0.5 * NEAR], flows)
    assert approached(script.attempt, OPENINGS[0]) == (5, True)
    assert script.done == done


def test_bodies_that_do_not_settle_are_left_to_another_opening(monkeypatch):
    script = Script(monkeypatch, [2.0])
    assert approached(script.attempt, OPENINGS[0]) == (PATIENCE, False)


CENTRAL = OPENINGS_FLOWING[0]


def test_the_barrier_of_a_central_path_waits_for_a_gain_and_falls_fast_at_the_end(monkeypatch):
    """It begins at the prediction, and ends where the exact law is nearly solved."""
    inside = [2.0 * EASED, 0.9 * EASED, 0.8 * EASED, 0.9 * EASY, 0.9 * NEARER**0.5]
    script = Script(monkeypatch, inside, [0.9 * NEARER], flows=True)
    before = [inside[1] / (0.9 * GAINED), inside[2] / (1.1 * GAINED), inside[3] / (0.9 * GAINED)]
    script.attempt.start, script.before = np.array([7.0]), before
    assert followed(script.attempt, CENTRAL) == (4, True)
    shrinks = [1.0, SHRINKS_FLOWING, 1.0, SHRINKS_FAST]
    each = [one for shrink in shrinks for one in (shrink, "least energy")]
    assert script.done == [*each, SHRINKS_FAST]
    assert script.attempt.trial.array[0] == 7.0


@pytest.mark.parametrize(
    ("left", "iterations"),
    [(1.1 * EASED, PATIENCE_CENTRAL), (0.9 * EASED, LIMIT_CENTRAL)],
)
def test_a_central_path_that_bodies_do_not_come_to_is_left(monkeypatch, left, iterations):
    script = Script(monkeypatch, [left], flows=True)
    script.attempt.start = np.zeros(1)
    assert followed(script.attempt, CENTRAL) == (iterations, False)


@pytest.mark.parametrize(
    ("flows", "pressed", "last", "tried"),
    [
        (False, True, 1, [OPENINGS[1], OPENINGS[0], OPENINGS[2]]),
        (True, True, 0, [*OPENINGS_FLOWING]),
        (True, True, 1, [*OPENINGS_FLOWING]),
        (True, False, 0, [OPENINGS[2], OPENINGS[0]]),
    ],
)
def test_bodies_that_flow_may_take_the_central_path_once_they_press(
    monkeypatch, flows, pressed, last, tried
):
    """It comes first then; a prediction knows nothing of a first contact.

    Elastic bodies take first what worked last.
    """
    script, seen = Script(monkeypatch, [1.0], flows=flows), []
    script.attempt.pressed, script.attempt.newton.inside.opening = pressed, last

    def fails(attempt, opening):
        seen.append(opening)
        return 1, False

    for way in ("approached", "followed"):
        monkeypatch.setattr(interior_point, way, fails)
    assert FromInside().run(script.attempt) == (len(tried), -6) and seen == tried
    seen.clear()
    assert FromInside("last").run(script.attempt) == (1, -6)
    assert FromInside("others").run(script.attempt) == (len(tried) - 1, -6) and seen == tried


@pytest.mark.parametrize(
    ("exact", "iterations", "found"),
    [
        ([0.9 * CLOSE, 0.85 * CLOSE], 2, True),  # friction that weakens: the exact law stays off
        ([0.9 * CLOSE, 0.5 * CLOSE, 0.5 * NEAR], 3, True),
        ([2.0 * CLOSE], interior_point.LIMIT, False),
    ],
)
def test_the_exact_law_goes_on_where_it_is_near_or_comes_no_nearer(
    monkeypatch, exact, iterations, found
):
    script = Script(monkeypatch, [1e-6], exact)
    assert approached(script.attempt, OPENINGS[0]) == (iterations, found)


def test_the_opening_that_works_is_remembered_and_the_exact_tangent_kept(monkeypatch):
    """A solution without an iteration has no tangent of the exact law yet."""
    script = Script(monkeypatch, [1e-6], [0.5 * NEAR])
    script.solutions = [(4, -6), (0, 3)]
    assert FromInside().run(script.attempt) == (6, 3)
    assert script.attempt.newton.inside.opening == 1
    assert script.done[-1] == "assembled" and script.done.count("assembled") == 1
    script.solutions = [(2, 3)]
    assert FromInside("last").run(script.attempt) == (3, 3)
    assert script.done.count("assembled") == 1 and not script.solutions


def starting_point(gap, pressure="averaged", comm=None, way=1.0, barrier=1e-2):
    """Of a flat pair, all of it at a gap (m; negative: pressed)."""
    scene = Scene("Q4", FrictionlessLaw(), pressure=pressure)
    term, trial = scene.term, scene.term.evaluate(scene.moved(np.zeros_like, -gap), 1.0)
    if comm is not None:
        term.surface.vertices = replace(term.surface.vertices, comm=comm)
    return term, interior_point._starting_point(term, trial, way, barrier)


@pytest.mark.parametrize("gap", [0.0, 20.0])
def test_surfaces_feel_each_other_over_twice_the_gap_between_them(gap):
    term, at = starting_point(gap)
    facet = term.surface.facet_length
    assert at.reach == pytest.approx(max(REACH * facet, 2.0 * gap), rel=1e-9)


class AnotherRank:
    """Beside this rank one whose points are pressed ten times as much."""

    def allreduce(self, value, op=MPI.SUM):
        if op == MPI.SUM:
            squares, sums = value
            return np.array([101.0 * squares, 11.0 * sums])
        return value


def test_points_of_all_ranks_give_the_barrier():
    depth, barrier = 0.01, 1e-2
    term, at = starting_point(-depth, "pointwise", AnotherRank(), barrier=barrier)
    mean = term.penalty.max() * depth * 101.0 / 11.0
    way = MOST_WAY * term.surface.facet_length
    assert at.barrier == pytest.approx(barrier * mean * way, rel=1e-9)
