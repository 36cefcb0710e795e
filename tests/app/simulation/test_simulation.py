"""Stages, steps that are cut, steps that cannot be solved, and runs that are interrupted."""

import copy
import json
import tomllib
import xml.etree.ElementTree as ET
from dataclasses import asdict

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from tests.solved import Cuts, solved
from tests.two_blocks import press, two_blocks
from tribox.app.case.case import Case
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.app.results.reading import read_table
from tribox.app.run.run import run_case
from tribox.app.simulation.history import PHYSICAL, Row
from tribox.app.simulation.run_state import Observer

TIGHT = {"tolerance": 1e-11}
# Between runs of the same steps, only the start of Newton's iteration differs.
SAME = 1e-9


def plain(text: str, **solver) -> dict:
    """The case as plain data, solved tightly, without figures."""
    data = tomllib.loads(text)
    data["solver"] = {**TIGHT, **solver}
    return data


def film_at_one_velocity(text: str, **solver) -> dict:
    """The film case slid for a time, its stage being cut into equal steps."""
    data = plain(text, **solver)
    # Fast enough for the film to carry a good part of the friction.
    data["stage"][1] = {"name": "slide", "velocity": 2e-4, "duration": 0.1, "steps": 4}
    return data


def assert_same_history(mine: list[Row], theirs: list[Row], tolerance: float = SAME) -> None:
    assert len(mine) == len(theirs)
    for name in PHYSICAL:
        a, b = (np.array([getattr(row, name) for row in rows]) for rows in (mine, theirs))
        largest = np.max(np.abs(b))
        # The energy error is a small difference of energies: it is compared with these.
        if name == "energy_error":
            largest = max(row.external_work for row in theirs)
        assert np.max(np.abs(a - b)) <= tolerance * largest, name


def test_a_step_that_was_cut_is_taken_in_pieces_that_grow_back(monkeypatch, block):
    """What failed attempts leave is looked at in test_invariance.py."""
    attempt, calls, spent = ImplicitStepper.attempt, [], []

    def fail_twice(stepper, dt):
        """Solve and then deny it, at the first two attempts of the fifth step."""
        result = attempt(stepper, dt)
        calls.append(dt)
        spent.append(result.iterations)
        if len(calls) in (5, 6):
            result.converged = False
        return result

    monkeypatch.setattr(ImplicitStepper, "attempt", fail_twice)
    seen = Cuts()
    run = solved(plain(block), observer=seen)
    whole = run.rows[3].dt
    assert seen.lengths == pytest.approx([whole, whole / 2])
    # Pieces grow back after an easy one: a quarter, a half, and the quarter that is left.
    assert [row.dt / whole for row in run.rows[4:7]] == pytest.approx([0.25, 0.5, 0.25])
    assert [row.attempts for row in run.rows[3:7]] == [1, 3, 1, 1]
    # Iterations of the attempts that failed count for the row that came of them.
    assert run.rows[4].newton_iterations == sum(spent[4:7])
    assert sum(row.newton_iterations for row in run.rows) == sum(spent)
    assert run.rows[-1].time == pytest.approx(2.0, rel=1e-14)


def test_stages_continue_each_other(block):
    """A stage cut in two is the same run: nothing but the time goes from one to the next."""
    data = plain(block)
    halves = copy.deepcopy(data)
    press, slide = data["stage"]
    halves["stage"] = [
        press,
        {**slide, "name": "a", "duration": 0.5, "steps": 3},
        {**slide, "name": "b", "duration": 0.5, "steps": 3},
    ]
    assert_same_history(solved(halves).rows, solved(data).rows, 1e-12)


def test_film_comes_into_play_with_the_first_stage_that_feels_rates(film):
    data = film_at_one_velocity(film)
    run = solved(data)
    assert all(row.viscous_fraction == 0.0 for row in run.rows[:3])
    # Without rate effects the film's traction is missing, and with it its share of friction.
    data["stage"][1]["rate_dependent"] = False
    carried = run.rows[-1].tangential_force / solved(data).rows[-1].tangential_force
    assert carried != pytest.approx(1.0, rel=0.05)


def test_velocities_end_when_steady_or_say_that_they_are_not(film):
    data = plain(film)
    load_steps = []

    class LoadSteps(Observer):
        def load_step(self, simulation, load_step, row, steady):
            load_steps.append((load_step.label, row.step, steady))

    solved(data, observer=LoadSteps())
    assert [(label, steady) for label, _, steady in load_steps] == [
        ("press", None),
        ("slide 1e-05 m/s", True),
        ("slide 0.002 m/s", True),
    ]
    assert load_steps[2][1] - load_steps[1][1] >= 5  # min_steps
    load_steps.clear()
    data["stage"][1] |= {"max_steps": 5, "steady_tolerance": 1e-13}
    solved(data, observer=LoadSteps())
    assert [steady for _, _, steady in load_steps] == [None, False, False]
    assert [step for _, step, _ in load_steps] == [3, 8, 13]


# -- files ----------------------------------------------------------------------------------------

POINT_DATA = {
    *("reference", "pair", "gap", "cover", "slip_increment", "slip_path", "film_thickness"),
    *("slip_rate", "pressure", "tangential_traction", "alpha", "regime", "dissipation"),
    *("weight", "normal"),
}
NODE_DATA = (POINT_DATA - {"regime", "weight"}) | {"area"}


def outputs(directory, index="contact_points.pvd") -> list[tuple[float, str]]:
    sets = ET.parse(directory / index).getroot().iter("DataSet")
    return [(float(s.attrib["timestep"]), s.attrib["file"]) for s in sets]


def test_results_agree_with_the_history(block, tmp_path):
    data = plain(block)
    data["contact"][0]["quadrature_degree"] = 3
    out = tmp_path / "out"
    run = run_case(Case.model_validate(data), out, quiet=True, comm=MPI.COMM_SELF)
    rows = read_table(out / "history.csv")
    assert all(np.isnan(row.pop("velocity")) for row in rows)  # nothing is driven
    expected = [{key: asdict(r)[key] for key in rows[0]} for r in run.rows]
    assert rows == expected and len(rows[0]) == len(asdict(run.rows[0])) - 1
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "done" and summary["ranks"] == 1 and summary["steps"] == 9
    assert [load_step["label"] for load_step in summary["load_steps"]] == ["press", "slide"]
    assert {k: summary["load_steps"][1][k] for k in rows[-1]} == rows[-1]
    assert summary["newton_iterations"] == sum(row["newton_iterations"] for row in rows)
    assert {"assembly", "contact", "linear solve", "run"} <= set(summary["seconds"])
    assert {"tribox", "dolfinx", "petsc"} <= set(summary["versions"])
    assert summary["memory_MiB_per_rank"][0] > 10.0
    (cells,), (points,) = summary["cells_per_rank"], summary["contact_points_per_rank"]
    assert cells == run.model.named.mesh.topology.index_map(2).size_global
    assert points == 2 * len(run.model.named.facets("elastomer_contact"))

    assert [time for time, _ in outputs(out)] == [row["time"] for row in rows]
    assert [time for time, _ in outputs(out, "fields.pvd")] == [row["time"] for row in rows]
    points = meshio.read(out / outputs(out)[-1][1])
    got = points.point_data
    assert POINT_DATA <= set(got)
    # Two Gauss points on each slave segment: each stands for half of it.
    weight = got["weight"]
    assert weight == pytest.approx(1e-3 / len(points.points))
    assert len(points.points) == 20
    assert np.array_equal(got["cover"] > 0.0, got["pressure"] > 0.0)
    assert weight @ got["cover"] * 1e-3 == pytest.approx(rows[-1]["contact_area"])
    assert weight @ got["tangential_traction"] * 1e-3 == pytest.approx(rows[-1]["tangential_force"])
    assert np.all(np.diff(got["reference"][:, 0]) > 0.0)

    assert [time for time, _ in outputs(out, "contact.pvd")] == [row["time"] for row in rows]
    nodes = meshio.read(out / outputs(out, "contact.pvd")[-1][1])
    got = nodes.point_data
    assert set(got) == NODE_DATA
    assert nodes.cells_dict["line"].tolist() == [[i, i + 1] for i in range(10)]
    assert got["area"].sum() == pytest.approx(1e-3)
    assert np.max(-got["gap"]) == pytest.approx(rows[-1]["max_penetration"])
    [[penalty, same]] = summary["penalty"]
    # Linear between the vertices, and shown in the mean over each of them.
    s = penalty * np.maximum(-got["gap"], 0.0)
    half = 1e-4 / 6.0 * np.stack([2.0 * s[:-1] + s[1:], s[:-1] + 2.0 * s[1:]])
    force = np.append(half[0], 0.0) + np.append(0.0, half[1])
    assert got["pressure"] == pytest.approx(force / got["area"])
    assert penalty == pytest.approx(same)
    for name, column in (
        ("pressure", "normal_force"),
        ("tangential_traction", "tangential_force"),
        ("cover", "contact_area"),
    ):
        assert got["area"] @ got[name] * 1e-3 == pytest.approx(rows[-1][column])
    assert np.all(np.diff(got["reference"][:, 0]) > 0.0)
    assert not list(out.rglob("*.part*"))


def test_fields_only_at_the_end_of_each_load_step(block, tmp_path):
    data = plain(block) | {"output": {"fields_every": 0, "figures": False}}
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    assert [name for _, name in outputs(tmp_path / "out")] == [
        "contact_points/000003.vtu",
        "contact_points/000009.vtu",
    ]


# -- units ----------------------------------------------------------------------------------------


def in_units(kind: str, length: float, time: float, force: float) -> dict:
    """A case in bare numbers; the arguments are how many units make 1 m, 1 s and 1 N."""
    m, s, stress = length, time, force / length**2
    friction: dict = {"law": "coulomb", "mu": 0.2, "K_T": 2e12 * stress / m}
    along, down = [[1.0 * s, 0.0], [2.0 * s, 1.5e-4 * m]], [[0.0, 0.0], [1.0 * s, -5e-5 * m]]
    top: dict = {"displacement": {"x": along, "y": down}}
    slide: dict = {"name": "slide", "duration": 1.0 * s, "steps": 6}
    if kind == "film":
        friction = {"law": "friction-map", "mu_s": 0.12, "mu_d": 0.1, "alpha": 0.5}
        friction |= {"A_d": 1e-6 * m, "B": 1e6 / m, "K_T": 1e12 * stress / m}
        friction |= {"eta_b": 0.8 * stress * s, "D_max": 250e-9 * m}
        friction |= {"V_star": 1e-3 * m / s, "V_star_at": 10e-9 * m}
        pressure = [[0.0, 0.0], [1.0 * s, 0.5e6 * stress]]
        top = {"displacement": {"x": "driven"}, "platen": {"direction": "y", "pressure": pressure}}
        slide = {"name": "slide", "velocities": [1e-4 * m / s, 2e-3 * m / s]}
        slide |= {"slip_step": 4e-6 * m, "max_steps": 12}
    rubber = {"material": "mooney-rivlin", "C10": 0.74e6 * stress, "C01": 0.18e6 * stress}
    return two_blocks(
        ((1e-3 * m, 2e-4 * m, [10, 4]), (2e-3 * m, 5e-4 * m, [15, 4])),
        (
            rubber | {"K": 20e6 * stress},
            {"material": "hencky", "E": 70e9 * stress, "nu": 0.33},
        ),
        {"friction": friction} | ({"film": {"thickness": 30e-9 * m}} if kind == "film" else {}),
        [{"surface": "top", **top}],
        [press(duration=1.0 * s, steps=3), slide],
        {"thickness": 1e-3 * m},
        solver=dict(TIGHT),
    )


# Powers of length, time and force in each column; those with a factor of 1 are left out.
DIMENSIONS = {
    **dict.fromkeys(("time", "dt"), (0, 1, 0)),
    **dict.fromkeys(("velocity", "slip_speed"), (1, -1, 0)),
    **dict.fromkeys(("driven_displacement", "film_thickness", "max_penetration"), (1, 0, 0)),
    **dict.fromkeys(("normal_force", "friction_force", "tangential_force"), (0, 0, 1)),
    **dict.fromkeys(("normal_resultant", "drag"), (0, 0, 1)),
    "effective_viscosity": (-2, 1, 1),
    "contact_area": (2, 0, 0),
    **dict.fromkeys(("strain_energy", "interface_energy", "dissipation"), (1, 0, 1)),
    **dict.fromkeys(("plastic_dissipation", "viscous_dissipation"), (1, 0, 1)),
    "numerical_dissipation": (1, 0, 1),
    **dict.fromkeys(("external_work", "energy_error"), (1, 0, 1)),
}


@pytest.mark.parametrize(
    ("kind", "units"), [("coulomb", (1e3, 1.0, 1.0)), ("film", (1e6, 1e3, 1e-3))]
)
def test_history_does_not_depend_on_the_units(kind, units):
    si = solved(in_units(kind, 1.0, 1.0, 1.0)).rows
    other = solved(in_units(kind, *units)).rows
    assert [row.newton_iterations for row in other] == [row.newton_iterations for row in si]
    for row in other:
        for name, powers in DIMENSIONS.items():
            factor = np.prod([u**p for u, p in zip(units, powers, strict=True)])
            setattr(row, name, getattr(row, name) / factor)
    assert_same_history(other, si, 1e-8)
