"""Results do not depend on the number of ranks: in the plane, round an axis and in space."""

import json
import math
import re
import tomllib
from pathlib import Path

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from tests.app.conftest import FILM as STEADY
from tests.app.conftest import SLID
from tests.ranks import command
from tribox.app.case.case import Case
from tribox.app.results import read
from tribox.app.results.reading import read_table
from tribox.app.run.run import run_case
from tribox.app.simulation.history import PHYSICAL, RESULTANTS

SAME = 1e-9  # of each column's largest value, at a solver tolerance of 1e-11

BODIES = """
[bodies.elastomer]
material = "mooney-rivlin"
C10 = "0.738 MPa"
C01 = "0.184 MPa"
K = "10 MPa"
density = "1100 kg/m^3"
[bodies]
aluminium = { material = "hencky", E = "50 MPa", nu = 0.33, density = "2700 kg/m^3" }
[output]
figures = false
fields_every = 3
"""
COULOMB = """
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "coulomb", mu = 0.3 }
"""
FILM = """
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
film = { thickness = "30 nm" }
[contact.friction]
law = "friction-map"
preset = "friction-map"
mu_s = 0.12
mu_d = 0.10
A_d = "1 um"
B = "1e6 1/m"
K_T = "1e12 Pa/m"
alpha = 0.5
V_star = "1 mm/s"
V_star_at = "10 nm"
"""
# Without a fall of friction with slip or speed, where dynamics are chaotic: there a change of the
# speed by 1e-13 changes forces by 1e-3 after a thousand steps, and that on one rank.
STEADY_FILM = FILM.replace("mu_s = 0.12", "mu_s = 0.10").replace('"1 mm/s"', '"0.3 m/s"')
BOXES = """
[geometry]
kind = "two-boxes"
upper = { width = "1 mm", height = "0.4 mm", depth = "0.6 mm", elements = [3, 2, 2] }
lower = { width = "2 mm", height = "0.8 mm", depth = "1 mm", elements = [5, 4, 3] }
"""
BLOCKS = """
[geometry]
kind = "two-blocks"
thickness = "1 mm"
upper = { width = "1 mm", height = "0.4 mm", elements = [6, 3] }
lower = { width = "2 mm", height = "0.8 mm", elements = [8, 4] }
"""
# Pressed by a platen, dragged over a film in two regimes, and let go but for a hundredth.
PLATEN = """
boundary = [
 { surface = "bottom", displacement = { x = 0, y = 0, z = 0 } },
 { surface = "top", displacement = { x = "driven", z = 0 }, platen = { direction = "y", pressure = [
   ["0 s", 0], ["1 s", "0.5 MPa"], ["2.1 s", "0.5 MPa"], ["2.2 s", "5 kPa"]] } },
]
stage = [
 { name = "press", duration = "1 s", steps = 2, rate_dependent = false },
 { name = "slide", duration = "1 s", steps = 3, velocity = "1e-2 mm/s" },
 { name = "fast", duration = "0.1 s", steps = 2, velocity = "1 mm/s" },
 { name = "release", duration = "0.1 s", steps = 3, velocity = "1 mm/s" },
]
"""
# A pad that the other body is dragged over, askew and over its ends, by a fifth in each step.
OVER = """
boundary = [
 { surface = "top", displacement = { x = 0, y = [["0 s", 0], ["1 s", "-5 um"]], z = 0 } },
 { surface = "bottom", displacement = { x = [["1 s", 0], ["2 s", "0.4 mm"]], y = 0, z = [
   ["1 s", 0], ["2 s", "0.1 mm"]] } },
]
stage = [
 { name = "press", duration = "1 s", steps = 1, rate_dependent = false },
 { name = "slide", duration = "1 s", steps = 2 },
]
output.figures = false
[geometry]
kind = "two-boxes"
upper = { width = "1 mm", height = "0.3 mm", depth = "0.5 mm", elements = [4, 1, 2] }
lower = { width = "3 mm", height = "0.3 mm", depth = "1 mm", elements = [18, 1, 7] }
[bodies]
elastomer = { material = "neo-hookean", E = "50 MPa", nu = 0.3 }
aluminium = { material = "hencky", E = "70 GPa", nu = 0.3 }
"""
_BACK = {"elastomer_contact": "aluminium_contact", "aluminium_contact": "elastomer_contact"}
OVER += re.sub(r"\w+_contact", lambda name: _BACK[name[0]], FILM)
OVER = OVER.replace('"30 nm"', '"1 um"').replace("mu_s = 0.12", "mu_s = 0.1")
OVER += 'D_max = "1 um"\neta_b = "0.8 Pa*s"\n'
# Pressed, dragged to and fro, and lifted off altogether.
LIFTED = """
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0, z = 0 }
[[boundary]]
surface = "top"
[boundary.displacement]
x = [["1 s", "0 mm"], ["2 s", "0.1 mm"], ["3 s", "0.08 mm"]]
y = [["0 s", "0 mm"], ["1 s", "-0.03 mm"], ["3 s", "-0.02 mm"], ["4 s", "0.02 mm"]]
z = [["1 s", "0 mm"], ["2 s", "0.05 mm"]]
[[stage]]
name = "all"
duration = "4 s"
steps = 8
"""
# A ring or a sphere cannot be dragged: it spreads as it is pressed, sticks at first and slips.
PRESSED = """
boundary = [
 { surface = "bottom", displacement = { x = 0, y = 0 } },
 { surface = "top", displacement = { x = 0, y = [
   ["0 s", "0 mm"], ["2 s", "-0.1 mm"], ["4 s", "0.02 mm"]] } },
]
stage = [{ name = "all", duration = "4 s", steps = 8 }]
"""
# Pressed by a platen, dragged, and pulled off: about seven hundred time steps.
THROWN = """
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0, z = 0 }
[[boundary]]
surface = "top"
displacement = { x = "driven", z = "driven", direction = [0.8, 0, 0.6] }
[boundary.platen]
direction = "y"
[boundary.platen.pressure]
table = [["0 s", 0], ["0.1 ms", "0.3 MPa"], ["0.2 ms", "0.3 MPa"], ["0.26 ms", "-0.2 MPa"]]
ramp = "smooth"
[[stage]]
name = "all"
duration = "0.36 ms"
steps = 9
velocity = "0.3 m/s"
ramp = "0.15 ms"
[solver]
kind = "explicit"
"""
TIGHT = "[solver]\ntolerance = 1e-11\n"
# A partition that knows nothing of contact leaves ranks without any.
APART = TIGHT + 'partition = "cells"\n'
KRYLOV = TIGHT + 'linear = "krylov"\npetsc = { ksp_rtol = 1e-12, ksp_max_it = 2000 }\n'


def _plane(text: str) -> str:
    """The same without the third direction."""
    for part in (', z = "driven", direction = [0.8, 0, 0.6]', ", z = 0"):
        text = text.replace(part, "")
    return "\n".join(line for line in text.splitlines() if not line.startswith("z = ")) + "\n"


def _softly(contact: str) -> str:
    """The same with a penalty that does not shorten explicit steps."""
    return contact.replace("[[contact]]", "[[contact]]\npenalty_factor = 3")


_RINGS = BLOCKS.replace('thickness = "1 mm"', 'section = "axisymmetric"')
# So deep that of three ranks one has all slaves, one all masters, and one no part in the contact.
_DEEP = _RINGS.replace("[6, 3]", "[6, 4]").replace("0.8 mm", "1.6 mm").replace("[8, 4]", "[8, 12]")
_TETS = BOXES.replace('kind = "two-boxes"', 'kind = "two-boxes"\ncell = "tetrahedron"')
_SLID = SLID.replace('duration = "20 us"', 'duration = "8 us"')
CASES = {
    "plane-steady": STEADY.replace('"1e-5 m/s", ', "").replace("steps = 60", "steps = 12") + TIGHT,
    "plane-explicit": _SLID,
    "plane-film": _plane(PLATEN) + BLOCKS + BODIES + FILM + TIGHT,
    "rings": PRESSED + _DEEP + BODIES + COULOMB + APART,
    "hexes-film": PLATEN + BOXES + BODIES + FILM + TIGHT,
    "hexes-over": OVER + TIGHT,
    "hexes-lifted": BOXES + BODIES + COULOMB + LIFTED + KRYLOV,
    "tets-lifted": _TETS + BODIES + COULOMB + LIFTED + APART,
    "hexes-explicit": BOXES + BODIES + _softly(STEADY_FILM) + THROWN,
}
SLIDING = ("plane-steady", "plane-explicit", "hexes-over")  # the others lift off
# Beside one rank. Explicit steps make ranks wait for each other many times each.
_THREE = ("plane-film", "rings", "hexes-lifted")
RANKS = {case: 3 if case in _THREE else 2 for case in CASES}


# -- runs -----------------------------------------------------------------------------------------


def run_all(comm: MPI.Comm, directory: Path) -> dict:
    """Run the cases for this number of ranks, and note how the contact is shared out."""
    facets = {}
    for name, text in CASES.items():
        if comm.size not in (1, RANKS[name]):
            continue
        case = Case.model_validate(tomllib.loads(text))
        mesh = run_case(case, directory / name, quiet=True).model.named
        owned = mesh.mesh.topology.index_map(mesh.mesh.topology.dim - 1).size_local
        surfaces = [mesh.facets(f"{body}_contact") for body in case.bodies]
        facets[name] = comm.allgather([int(np.sum(surface < owned)) for surface in surfaces])
    return {"directory": str(directory), "facets": facets}


def sharing(cases) -> list:
    """Cases, each with the number of ranks to be held against one, as parameters of a test."""
    return [
        pytest.param(case, n, marks=pytest.mark.mpi(run_all, n), id=f"{case}-{n}")
        for case, n in RANKS.items()
        if case in cases
    ]


@pytest.fixture(scope="module")
def results(on_ranks):
    """A function that gives the results of a case on a number of ranks."""

    def find(case: str, ranks: int) -> Path:
        return Path(on_ranks(run_all, ranks)["directory"]) / case

    return find


def rows_of(results, case: str, ranks: int = 1) -> list[dict]:
    return read_table(results(case, ranks) / "history.csv")


def largest(rows: list[dict], name: str) -> float:
    """What differences in a column are held against: its largest value, or that of the force."""
    same = (name,)
    if name in RESULTANTS:
        same = tuple(other for other in RESULTANTS if other.startswith("force"))
    lever = 1e-3 if name == "twist_moment" else 1.0  # m, about half the width
    return lever * max(abs(row[other]) for row in rows for other in same)


@pytest.mark.parametrize(("case", "ranks"), sharing(CASES))
def test_history(results, case, ranks):
    """All physical columns, also the resultants in space, agree row by row with those of a rank."""
    alone, rows = rows_of(results, case), rows_of(results, case, ranks)
    assert [row["stage"] for row in rows] == [row["stage"] for row in alone]
    apart = {
        name: max(abs(a[name] - b[name]) for a, b in zip(rows, alone, strict=True))
        for name in (*PHYSICAL, *RESULTANTS)
    }
    assert {n: v for n, v in apart.items() if v > SAME * largest(alone, n)} == {}
    if case.endswith("explicit"):  # the stable step, and what limits it
        one, found = (
            json.loads((results(case, n) / "summary.json").read_text())["explicit"]
            for n in (1, ranks)
        )
        assert found["stable_step"] == pytest.approx(one["stable_step"], rel=SAME)
        assert found["limited_by"] == one["limited_by"]


def test_a_film_acts_at_once_on_points_that_come_over_an_end_in_space(results):
    """T = η_b V A/D in steps of a fifth of the contact."""
    speed = math.hypot(0.4e-3, 0.1e-3)
    for row in rows_of(results, "hexes-over")[-2:]:
        film = 0.8 * speed * row["contact_area"] / 1e-6
        assert row["friction_force"] == pytest.approx(film, rel=5e-3)


@pytest.mark.parametrize("case", [case for case in CASES if case not in SLIDING])
def test_the_cases_stick_slide_and_lift_off(results, case):
    rows = rows_of(results, case)
    area = [row["contact_area"] for row in rows]
    assert max(row["stick_fraction"] for row in rows) > 0.2
    assert any(0.0 < row["stick_fraction"] < 0.5 for row in rows)
    assert rows[-1]["dissipation"] > 0.0
    if not case.endswith("film"):
        assert area[-1] < 1e-9 * max(area)
    else:
        # Points stay closed, and nodes press, up to a facet beyond the last vertex that is closed.
        nodes = meshio.read(max((results(case, 1) / "contact").glob("*.vtu"))).point_data
        opened = nodes["area"] @ ~(nodes["gap"] < 0.0) / nodes["area"].sum()
        assert 0.3 < opened < 1.0
        assert max(row["viscous_fraction"] for row in rows) > 0.8


@pytest.mark.mpi(run_all, 2, 3)
def test_a_rank_may_own_no_contact_facet(on_ranks):
    """One rank has neither slave nor master facets; another has slaves and no masters."""
    found = [on_ranks(run_all, ranks)["facets"] for ranks in (2, 3)]
    shares = [tuple(share) for one in found for shares in one.values() for share in shares]
    assert (0, 0) in shares
    assert any(slave > 0 and master == 0 for slave, master in shares)
    assert any(slave == 0 and master > 0 for slave, master in shares)
    alone = on_ranks(run_all, 1)["facets"]
    for one in found:
        for case, shares in one.items():
            assert np.sum(shares, axis=0).tolist() == alone[case][0], case


@pytest.mark.parametrize(("case", "ranks"), sharing(["plane-film", "hexes-film", "hexes-explicit"]))
def test_all_ranks_write_one_output(results, case, ranks):
    """Fields, contact points and motion hold all of the bodies, whoever computed them."""
    alone, found = (_outputs(results(case, n)) for n in (1, ranks))
    assert found.keys() == alone.keys()
    for name, expected in alone.items():
        # The last digit of single precision may be rounded the other way.
        share = np.finfo(np.float32).eps if expected.dtype == np.float32 else 1e-8
        atol = share * np.abs(expected).max()
        np.testing.assert_allclose(
            found[name], expected, rtol=0, atol=atol, err_msg=f"{name} {ranks}"
        )


def _outputs(directory: Path) -> dict[str, np.ndarray]:
    """Numbers of the last output, in the order of the files."""
    fields = read(directory).fields()
    out = {**fields.point_data, **{name: values[0] for name, values in fields.cell_data.items()}}
    out["place"], out["cells"] = fields.points, fields.cells[0].data
    series = sorted((directory / "contact_points").glob("*.vtu"))
    points = meshio.read(series[-2])  # the last one may have no contact left
    out["points"] = points.points
    out |= {name: np.asarray(points.point_data[name]) for name in ("pressure", "slip_path")}
    nodes = meshio.read(sorted((directory / "contact").glob("*.vtu"))[-2])
    out["vertices"], out["facets"] = nodes.points, nodes.cells[0].data
    out |= {
        f"nodal {name}": np.nan_to_num(nodes.point_data[name])
        for name in ("pressure", "tangential_traction", "slip_path", "gap", "area")
    }
    for table in ("surfaces", "bodies", "contacts"):
        rows = read_table(directory / f"{table}.csv")
        for kind in ("displacement", "velocity", "force", "moment"):
            names = [name for name in rows[0] if kind in name]
            if names and (table, kind) != ("contacts", "moment"):  # they do not twist
                out[f"{table} {kind}"] = np.array([[row[name] for name in names] for row in rows])
    return out


# -- failures -------------------------------------------------------------------------------------


FAILURES = [
    ("hexes-lifted", '[[boundary]]\nsurface = "elastomer_left"\ndisplacement = { x = "0.1 mm" }\n',
     (), 2, '"top" and "elastomer_left" share a node'),
    ("hexes-lifted", "", ("solver.min_step_fraction=0.6", "solver.max_iterations=2"), 3,
     "no solution even with a step of"),
    ("hexes-explicit", "", ("bodies.elastomer.velocity={ y = -300, z = -50 }",), 3,
     "an element has been turned inside out at ("),
]  # fmt: skip


def fail(comm: MPI.Comm, directory: Path) -> list:
    """What each failing run ends with on each rank, and says."""
    ends = []
    for number, (case, more, changes, _, _) in enumerate(FAILURES):
        path, out = directory / f"{number}.toml", directory / f"{number}"
        if comm.rank == 0:
            path.write_text(CASES[case] + more, encoding="utf-8")
        comm.barrier()
        words = [word for change in changes for word in ("--set", change)]
        ends.append(command(comm, "run", path, "--out", out, *words))
    return [str(directory), ends]


@pytest.mark.mpi(fail, 3)
@pytest.mark.parametrize("number", range(len(FAILURES)))
def test_ranks_fail_together(on_ranks, number):
    """One line, the exit code, and an end: no rank is left waiting for one that gave up."""
    _, _, _, code, expected = FAILURES[number]
    directory, ends = on_ranks(fail, 3)
    codes, said = ends[number]
    out = Path(directory) / f"{number}"
    assert codes == 3 * [code], said
    [line] = [line for line in said.splitlines() if line.startswith("tribox: ")]
    assert expected in line and "Traceback" not in said
    assert out.exists() == (code == 3)
    if code == 3:
        assert json.loads((out / "summary.json").read_text())["status"] == "failed"


# -- bodies that only contact holds ---------------------------------------------------------------

# Its top can move sideways: before it touches anything, the tangent is singular.
_LOOSE = """
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "top"
displacement = { y = [["0 s", "0 mm"], ["1 s", "-0.04 mm"]] }
[[stage]]
name = "press"
duration = "1 s"
steps = 3
"""
LOOSE = BLOCKS + BODIES + COULOMB + _LOOSE + TIGHT


def press_loose(comm: MPI.Comm, directory: Path) -> tuple[float, float]:
    """Normal force, and how far the top has moved sideways."""
    case = Case.model_validate(tomllib.loads(LOOSE))
    simulation = run_case(case, directory / "loose", quiet=True)
    way = np.abs(simulation.model.problem.u.x.array.reshape(-1, 2)[:, 0]).max(initial=0.0)
    return simulation.rows[-1].normal_force, comm.allreduce(float(way), op=MPI.MAX)


@pytest.mark.mpi(press_loose, 3)
def test_a_body_that_only_friction_holds_stays_on_ranks_too(on_ranks):
    """What sums to nothing over the ranks but for rounding is no load that springs carry."""
    force, way = on_ranks(press_loose, 3)
    alone, _ = on_ranks(press_loose, 1)
    assert force == pytest.approx(alone, rel=1e-7)
    assert way < 4e-5
