"""Tables of probes against values by hand, and through runs of every kind."""

import json
import re
import tomllib
from types import SimpleNamespace

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import fsolve

from tests.app.conftest import BLOCK, BOXES, SLID
from tests.app.read_log import read_log
from tests.forms.bodies.in_forms import forms_of
from tests.solved import built
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.errors import InputError
from tribox.app.report import write_report
from tribox.app.results.directory import check_free
from tribox.app.results.point_probes import PointProbes, arc_length
from tribox.app.results.probes import BodyProbes, ProbeRecorder
from tribox.app.results.reading import read, read_table
from tribox.app.run import run as running
from tribox.app.simulation.simulation import Simulation

PRESSURE = 0.4e6
# Two like blocks that may widen freely and carry the same pressure everywhere.
LIKE = """
bodies.elastomer = { material = "neo-hookean", E = "2 MPa", nu = 0.4 }
bodies.aluminium = { material = "neo-hookean", E = "2 MPa", nu = 0.4 }
boundary = [
 { surface = "bottom", displacement = { y = 0 } },
 { surface = "elastomer_left", displacement = { x = 0 } },
 { surface = "aluminium_left", displacement = { x = 0 } },
 { surface = "top", pressure = [["0 s", 0], ["1 s", "0.4 MPa"]] },
]
stage = [{ name = "press", duration = "1 s", steps = 2 }]
probe = [
 { name = "point", point = ["0.4 mm", "0.3 mm"] },
 { name = "line", line = { from = [0, "-0.3 mm"], to = ["1 mm", "0.2 mm"], points = 3 } },
 { name = "block", body = "elastomer" },
 { name = "all along", contact = "elastomer_contact-aluminium_contact" },
 { name = "four", contact = "elastomer_contact-aluminium_contact", points = 4 },
]
[geometry]
kind = "two-blocks"
thickness = "2 mm"
upper = { width = "1 mm", height = "0.5 mm", elements = [3, 2] }
lower = { width = "1 mm", height = "0.5 mm", elements = [3, 2] }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "frictionless" }
"""
PROBES = """
[[probe]]
name = "node"
point = ["1 mm", "0.2 mm"]
[[probe]]
name = "nearest"
point = ["0.71 mm", "0.32 mm"]
at = "node"
[[probe]]
name = "depth"
line = { from = ["0.93 mm", "0.45 mm"], to = ["1.01 mm", "-0.43 mm"], points = 6 }
[[probe]]
name = "upper"
body = "elastomer"
[[probe]]
name = "lower"
body = "aluminium"
[[probe]]
name = "along"
contact = "elastomer_contact-aluminium_contact"
[[probe]]
name = "thirteen"
contact = "elastomer_contact-aluminium_contact"
points = 13
[[probe]]
name = "shape"
surface = "elastomer_contact"
opposite = "top"
"""
SAME = 1e-8  # of each column's largest value, at a solver tolerance of 1e-11
TABLES = ("probes", "body_probes", "contact_probes")
SHAPES = ("shape_probes", "surface_probes")
# A strip whose right end is turned by an angle and let go again.
LENGTH, THICK, TURN = 8e-3, 1e-3, 0.4
STRIP = f"""
[geometry]
kind = "blocks"
[geometry.blocks.strip]
x = [0, {LENGTH}]
y = [0, {THICK}]
elements = [8, 2]
[bodies]
strip = {{ material = "neo-hookean", E = "1 MPa", nu = 0.3, formulation = "q2" }}
[[boundary]]
surface = "strip_left"
platen = {{ direction = "x", force = 0 }}
[[boundary]]
surface = "strip_right"
rotation = {{ centre = [{LENGTH}, {0.5 * THICK}], angle = [[0, 0], [1, {TURN}]] }}
[[stage]]
name = "bend"
duration = "1 s"
steps = 2
[[stage]]
name = "let go"
duration = "1 s"
steps = 2
release = ["strip_right"]
[[probe]]
name = "low"
surface = "strip_bottom"
opposite = "strip_top"
[[probe]]
name = "high"
surface = "strip_top"
straight = [["0 mm", "1 mm"], ["7 mm", "8 mm"]]
bend = ["2 mm", "6 mm"]
"""


def model_of(text, comm=MPI.COMM_SELF, **tables):
    return build_model(Case.model_validate(tomllib.loads(text) | tables), comm)


def followed(text, directory, comm=MPI.COMM_SELF, **tables):
    """A finished run, and its tables of probes by name; those on the first rank."""
    simulation = Simulation(model_of(text, comm, **tables))
    simulation.run(ProbeRecorder(simulation.model, directory))
    found = {}
    if comm.rank == 0:
        found = {n: read_table(directory / f"{n}.csv") for n in TABLES}
    return simulation, found


def columns(rows, *names, **chosen):
    """Columns of the rows in which other columns have the values that are asked for."""
    taken = [row for row in rows if all(row[key] == value for key, value in chosen.items())]
    return np.array([[row[name] for name in names] for row in taken])


@pytest.fixture(scope="module")
def like(tmp_path_factory):
    return followed(LIKE, tmp_path_factory.mktemp("like"))


@pytest.fixture(scope="module")
def exact():
    """Stretches (x, y), stress across, and energy density of the like blocks' homogeneous state."""
    G, K = 2e6 / 2.8, 2e6 / 0.6
    L = K - 2.0 * G / 3.0

    def stress(stretch, i):
        J = stretch[0] * stretch[1]
        return (G * (stretch[i] ** 2 - 1.0) + L * np.log(J)) / J

    def residual(s):
        return [stress(s, 0) / G, (stress(s, 1) + PRESSURE) / G]

    x, y = fsolve(residual, [1.0, 1.0])
    log = np.log(x * y)
    energy = 0.5 * G * (x**2 + y**2 - 2.0) - G * log + 0.5 * L * log**2
    return x, y, stress((x, y, 1.0), 2), energy


def test_points_in_a_homogeneous_state(like, exact):
    x, y, across, _ = exact
    rows = [row for row in like[1]["probes"] if row["step"] == 2]
    assert [(r["probe"], r["point"], r["body"]) for r in rows] == [
        ("point", 0.0, "elastomer"),
        ("line", 0.0, "aluminium"),
        ("line", 1.0, "aluminium"),
        ("line", 2.0, "elastomer"),
    ]
    mises = np.sqrt(0.5 * (PRESSURE**2 + across**2 + (across + PRESSURE) ** 2))
    expected = {
        "cauchy_xx": 0.0,
        "cauchy_yy": -PRESSURE,
        "cauchy_zz": across,
        "cauchy_xy": 0.0,
        "von_mises_stress": mises,
        "pressure": (PRESSURE - across) / 3.0,
        "log_strain_xx": np.log(x),
        "log_strain_yy": np.log(y),
        "log_strain_zz": 0.0,
        "log_strain_xy": 0.0,
        "J": x * y,
        "max_stretch": x,
    }
    for row in rows:
        for name, value in expected.items():
            scale = PRESSURE if re.search("stress|cauchy|pressure", name) else 1.0
            assert row[name] == pytest.approx(value, abs=1e-7 * scale), name
        assert row["displacement_x"] == pytest.approx((x - 1.0) * row["reference_x"], abs=1e-12)
    assert rows[1]["displacement_y"] == pytest.approx((y - 1.0) * 0.2e-3, rel=1e-7)
    assert columns(rows, "distance", probe="line")[:, 0] == pytest.approx(
        np.hypot(1e-3, 0.5e-3) * np.array([0.0, 0.5, 1.0])
    )


def test_a_body_in_a_homogeneous_state(like, exact):
    x, y, across, energy = exact
    simulation, tables = like
    row = tables["body_probes"][-1]
    volume = 1e-3 * 0.5e-3 * 2e-3
    assert row["volume"] == pytest.approx(volume * x * y, rel=1e-7)
    assert row["J"] == pytest.approx(x * y, rel=1e-7)
    assert row["centre_x"] == pytest.approx(0.5e-3 * x, rel=1e-7)
    assert row["cauchy_yy"] == pytest.approx(-PRESSURE, rel=1e-7)
    assert row["cauchy_zz"] == pytest.approx(across, abs=1e-7 * PRESSURE)
    assert row["max_stretch"] == pytest.approx(x, rel=1e-7)
    assert row["max_von_mises_stress"] == pytest.approx(row["von_mises_stress"], rel=1e-6)
    assert row["strain_energy"] == pytest.approx(energy * volume, rel=1e-6)
    assert 2.0 * row["strain_energy"] == pytest.approx(simulation.rows[-1].strain_energy, rel=1e-6)


def test_along_the_contact_of_a_homogeneous_state(like, exact):
    """The pressure counts per undeformed area; as many points as vertices are the vertices."""
    x, *_ = exact
    rows = like[1]["contact_probes"]
    names = ("arc_length", "position_x", "pressure")
    vertices = columns(rows, *names, step=2, probe="all along")
    expected = np.linspace(0.0, 1e-3, 4)
    np.testing.assert_allclose(vertices[:, 0], expected, atol=1e-15)
    np.testing.assert_allclose(vertices[:, 1], x * expected, atol=1e-10)
    np.testing.assert_allclose(vertices[:, 2], x * PRESSURE, rtol=1e-6)
    np.testing.assert_allclose(columns(rows, *names, step=2, probe="four"), vertices, rtol=1e-9)
    area = columns(rows, "area", step=2, probe="four")
    assert np.isnan(area).all()


@pytest.fixture(scope="module")
def slid(tmp_path_factory):
    return followed(BLOCK + PROBES, tmp_path_factory.mktemp("slid"))


def test_nodal_pressures_add_up_to_the_normal_force(slid):
    simulation, tables = slid
    for row in simulation.rows:
        area, pressure, way = columns(
            tables["contact_probes"], "area", "pressure", "arc_length", step=row.step, probe="along"
        ).T
        force = 1e-3 * area @ pressure
        assert force == pytest.approx(row.normal_force, rel=1e-9)
        assert 1e-3 * np.trapezoid(pressure, way) == pytest.approx(force, rel=1e-6)


def test_values_between_vertices_are_linear(slid):
    rows = slid[1]["contact_probes"]
    names = ("arc_length", "pressure", "slip_path")
    vertices = columns(rows, *names, step=9, probe="along")
    between = columns(rows, *names, step=9, probe="thirteen")
    assert len(between) == 13
    for column in (1, 2):
        expected = np.interp(between[:, 0], vertices[:, 0], vertices[:, column])
        np.testing.assert_allclose(between[:, column], expected, rtol=1e-9)


def test_mean_stress_is_the_moment_of_the_forces(slid):
    """v σ̄ = Σ f ⊗ x over the nodal forces that strain the body: of each body by itself."""
    simulation, tables = slid
    problem = simulation.model.problem
    x = problem.space.tabulate_dof_coordinates()[:, :2]
    x = x + problem.u.x.array.reshape(-1, 2)
    for solid, probe in zip(problem.solids, ("upper", "lower"), strict=True):
        force = sum(dolfinx.fem.assemble_vector(part.residual).array for part in forms_of(solid))
        moment = 1e-3 * force.reshape(-1, 2).T @ x
        [found] = columns(
            tables["body_probes"], "volume", "cauchy_xx", "cauchy_yy", "cauchy_xy", probe=probe
        )[-1:]
        mean = np.array([moment[0, 0], moment[1, 1], moment[0, 1]]) / found[0]
        np.testing.assert_allclose(found[1:], mean, atol=1e-9 * np.abs(mean).max())
    energies = columns(tables["body_probes"], "strain_energy", step=9)
    assert energies.sum() == pytest.approx(simulation.rows[-1].strain_energy, rel=1e-12)


def test_a_node_is_the_mean_of_the_elements_around_it(slid):
    """And the largest stress of a body is not below that of any point in it."""
    simulation, tables = slid
    problem = simulation.model.problem
    around = model_of(
        BLOCK,
        probe=[
            {"name": f"{i}", "point": [1e-3 + dx, 0.2e-3 + dy]}
            for i, (dx, dy) in enumerate(
                [(-1e-9, -1e-9), (1e-9, -1e-9), (-1e-9, 1e-9), (1e-9, 1e-9)]
            )
        ],
    )
    around.problem.u.x.array[:] = problem.u.x.array
    probes = PointProbes(around, around.probes)
    at = probes.columns.index("cauchy_xx")
    corners = np.array([row[at : at + 4] for row in probes.rows()], dtype=float)
    names = ("cauchy_xx", "cauchy_yy", "cauchy_zz", "cauchy_xy")
    [node] = columns(tables["probes"], *names, probe="node", step=9)
    np.testing.assert_allclose(corners.mean(axis=0), node, rtol=1e-4)
    assert np.ptp(corners[:, 1]) > 0.01 * abs(node[1])


@pytest.mark.parametrize("formulation", ["q1", "q1-sri"])
def test_selective_integration_has_one_pressure_in_an_element(formulation):
    """A Hencky body's pressure is all volumetric; with full integration it differs within one."""
    data = tomllib.loads(BLOCK)
    data["bodies"]["elastomer"] |= {"material": "hencky", "formulation": formulation}
    ends = {"from": [0.81e-3, 0.22e-3], "to": [0.88e-3, 0.27e-3], "points": 3}
    data["probe"] = [{"name": "inside", "line": ends}]
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    nodal = model.problem.u.x.array
    nodal[:] = 1e-6 * np.random.default_rng(2).uniform(-1.0, 1.0, len(nodal))
    probes = PointProbes(model, model.probes)
    found = [dict(zip(probes.columns, row, strict=True)) for row in probes.rows()]
    spread = np.ptp([row["pressure"] for row in found]) / abs(found[0]["pressure"])
    assert spread < 1e-12 if formulation == "q1-sri" else spread > 0.05
    assert np.ptp([row["J"] for row in found]) > 1e-4  # that of the point itself


def homogeneous(model, gradient):
    """Put a displacement gradient (i, i) on every node of a model."""
    u, dim = model.problem.u, model.problem.dim
    place = model.problem.space.tabulate_dof_coordinates()[:, :dim]
    u.x.array[:] = (place @ np.asarray(gradient).T).reshape(-1)


@pytest.mark.parametrize(
    ("text", "changes", "point"),
    [
        (BOXES, {}, [0.6e-3, 0.2e-3, 0.7e-3]),
        (BOXES, {"geometry": {"cell": "tetrahedron"}}, [0.6e-3, 0.2e-3, 0.7e-3]),
        (BLOCK, {"geometry": {"section": "axisymmetric", "offset": 0.0}}, [0.6e-3, 0.2e-3]),
        (BLOCK, {"bodies": {"formulation": "q2"}}, [0.6e-3, 0.2e-3]),
    ],
    ids=["hexahedra", "tetrahedra", "axisymmetric", "q2"],
)
def test_every_section_and_element(text, changes, point):
    """Stress, strain and volume of a homogeneous state, of points and of bodies."""
    data = tomllib.loads(text)
    data["geometry"] |= changes.get("geometry", {})
    if data["geometry"].get("section"):
        del data["geometry"]["thickness"]
    for body in data["bodies"].values():
        body |= changes.get("bodies", {})
    data["probe"] = [{"name": "point", "point": point}, {"name": "body", "body": "elastomer"}]
    if "section" in data["geometry"]:
        data["boundary"][1]["displacement"].pop("x")
        data["boundary"][1]["displacement"]["x"] = 0
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    homogeneous(model, np.diag(np.array([1.1, 0.8, 1.2])[: model.problem.dim] - 1.0))
    across = {"plane-strain": 1.0, "axisymmetric": 1.1, "3D": 1.2}[model.section]
    all_three = np.array([1.1, 0.8, across])
    E, nu = (5e6, 0.49) if text is BOXES else (5e6, 0.45)
    G, K = E / (2.0 + 2.0 * nu), E / (3.0 - 6.0 * nu)
    J = all_three.prod()
    stress = (G * (all_three**2 - 1.0) + (K - 2.0 * G / 3.0) * np.log(J)) / J
    for probes in (PointProbes(model, model.probes), BodyProbes(model, [("body", "elastomer")])):
        [row] = probes.rows()
        found = dict(zip(probes.columns, row, strict=True))
        for axis, sigma, one in zip("xyz", stress, all_three, strict=True):
            assert found[f"cauchy_{axis * 2}"] == pytest.approx(sigma, rel=1e-9)
            assert found[f"log_strain_{axis * 2}"] == pytest.approx(np.log(one), abs=1e-12)
        assert found["J"] == pytest.approx(J) and found["max_stretch"] == pytest.approx(
            max(all_three)
        )
    upper = data["geometry"]["upper"]
    width, height = upper["width"].split()[0], upper["height"].split()[0]
    area = float(width) * float(height) * 1e-6
    depth = {"3D": 1e-3, "axisymmetric": np.pi * 1e-3, "plane-strain": 1e-3}[model.section]
    assert found["volume"] == pytest.approx(area * depth * J)


def test_explicit_rows(tmp_path):
    """A point of the driven surface moves with it, at the rows of the history."""
    text = SLID + (
        '[[probe]]\nname = "top"\npoint = ["0.5 mm", "0.05 mm"]\n'
        '[[probe]]\nname = "layer"\nbody = "elastomer"\n'
        '[[probe]]\nname = "film"\ncontact = "elastomer_contact-aluminium_contact"\n'
    )
    simulation, tables = followed(text, tmp_path)
    rows = simulation.rows
    moved = columns(tables["probes"], "displacement_x")[:, 0]
    assert moved == pytest.approx([row.driven_displacement for row in rows], abs=1e-15)
    assert moved[-1] == pytest.approx(4e-6)
    energy = columns(tables["body_probes"], "strain_energy")[:, 0]
    assert 0.9 < energy[-1] / rows[-1].strain_energy <= 1.0
    film = columns(tables["contact_probes"], "film_thickness", step=len(rows))
    assert film == pytest.approx(30e-9)


def test_what_was_followed_before_an_interruption_is_written(tmp_path, monkeypatch):
    class Stops(running.Interruption):
        def step(self, state, row, result):
            if row.step == 2:
                raise KeyboardInterrupt

    monkeypatch.setattr(running, "Interruption", Stops)
    case = Case.model_validate(tomllib.loads(BLOCK + PROBES))
    with pytest.raises(KeyboardInterrupt):
        running.run_case(case, tmp_path, quiet=True, comm=MPI.COMM_SELF, force=True)
    assert json.loads((tmp_path / "summary.json").read_text())["status"] == "interrupted"
    for name in (*TABLES, "history"):
        assert {row["step"] for row in read_table(tmp_path / f"{name}.csv")} == {1.0, 2.0}
    found = read(tmp_path)
    assert len(found.probes) == 2 * (2 + 6) and len(found.body_probes) == 2 * 2
    assert found.contact_probes["area"].isna().sum() == 2 * 13
    # They are results: another run may clear them.
    check_free(tmp_path, True)


def test_without_probes_there_are_no_tables(tmp_path):
    simulation = Simulation(model_of(BLOCK))
    simulation.run(ProbeRecorder(simulation.model, tmp_path))
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    """Results of the strip, and its log."""
    directory = tmp_path_factory.mktemp("strip") / "out"
    case = Case.model_validate(tomllib.loads(STRIP))
    running.run_case(case, directory, quiet=True, comm=MPI.COMM_SELF)
    return directory


def test_a_strip_bent_to_a_circle_has_its_angle_and_radius(strip):
    """Pure bending: a middle line of the length L, turned by θ, has the radius L/θ."""
    rows = read_table(strip / "shape_probes.csv")
    low, high = ([r for r in rows if r["probe"] == n and r["step"] == 2] for n in ("low", "high"))
    radius = LENGTH / TURN
    for [row], outwards in ((low, 0.5), (high, -0.5)):
        assert row["radius"] == pytest.approx(radius + outwards * THICK, rel=4e-3)
        assert row["off_circle"] < 2e-3 * THICK
    # The section that is turned keeps its shape, so that the tangent at its corner is a little off.
    assert low[0]["angle"] == pytest.approx(TURN, rel=0.02)
    assert high[0]["angle"] == pytest.approx(TURN * 7.0 / 8.0, rel=3e-3)  # between 0.5 and 7.5 mm
    assert low[0]["length"] == pytest.approx(LENGTH + 0.5 * THICK * TURN, rel=1e-3)
    assert low[0]["mean_thickness"] == pytest.approx(THICK, rel=3e-3)
    assert low[0]["min_thickness"] <= low[0]["mean_thickness"] <= low[0]["max_thickness"]
    assert np.isnan(high[0]["mean_thickness"])
    nodes = [r for r in read_table(strip / "surface_probes.csv") if r["step"] == 2]
    bottom = [r for r in nodes if r["probe"] == "low"]
    assert len(bottom) == 17  # of q2, those between the corners too
    way, angle = (np.array([r[key] for r in bottom]) for key in ("arc_length", "tangent_angle"))
    assert angle[:-1] == pytest.approx(TURN * way[:-1] / LENGTH, abs=5e-3 * TURN)
    inner = [r["curvature"] for r in bottom[4:-4]]
    assert inner == pytest.approx([1.0 / (radius + 0.5 * THICK)] * 9, rel=0.01)


def test_what_springs_back_of_an_elastic_strip_is_all(strip):
    """In summary, log and report, with nothing left of the angle and a line without radius."""
    shapes = json.loads((strip / "summary.json").read_text())["shapes"]
    assert shapes["low"]["springback"] == pytest.approx(TURN, rel=0.02)
    assert abs(shapes["low"]["bend_angle"]) < 1e-6 * TURN
    assert shapes["low"]["mean_thickness"] == pytest.approx(THICK, rel=1e-7)
    assert shapes["high"]["mean_thickness"] is None
    log = read_log(strip)
    assert re.search(r"probe high: bent by \S+ deg, springback 20.0\d* deg, straight\n", log)
    assert "thickness 0.001 to 0.001 m" in log
    page = write_report(strip).read_text(encoding="utf-8")
    assert "Shape of surfaces: angle, radius and thickness" in page
    frame = read(strip).shape_probes
    assert len(frame) == 2 * 4 and len(read(strip).surface_probes) == 2 * 4 * 17


@pytest.mark.parametrize(
    ("probe", "said"),
    [
        ({"surface": "strip_botom"}, 'surface = "strip_botom": no such surface; there are '),
        ({"surface": "strip_top", "opposite": "no"}, 'opposite = "no": no such surface'),
        ({"surface": "strip_top", "bend": [0, 1e-3]}, "bend: 0 m to 0.001 m holds"),
        ({"surface": "strip_top", "bend": [0, 9e-3]}, "bend: ends at 0.009 m; the line is 0.008"),
        (
            {"surface": "strip_top", "straight": [[0, 1e-4], [4e-3, 5e-3]]},
            "straight: 0 m to 0.0001 m holds 1 of the nodes of the line, which is 0.008 m long; 2",
        ),
    ],
)
def test_a_line_that_is_none_is_told_before_the_run(probe, said):
    data = tomllib.loads(STRIP)
    data["bodies"]["strip"]["formulation"] = "q1"
    data["probe"] = [{"name": "a", **probe}]
    with pytest.raises(InputError, match=re.escape(said)):
        build_model(Case.model_validate(data), MPI.COMM_SELF)


def test_a_surface_in_two_pieces_or_closed_is_no_line(tmp_path):
    """Of a mesh: both sides of a block as one surface, and the whole outline."""
    from tests.tool_cases import block_case, block_mesh, case_of

    path = block_mesh(tmp_path / "block.msh", (2, 1))
    text = path.read_text()
    for tag, said in ((4, "in 2 pieces"), (0, "closes on itself")):
        changed = re.sub(r"^(\d+ 1 2) 2 2", rf"\1 {tag or 1} {tag or 1}", text, flags=re.M)
        if not tag:
            changed = re.sub(r"^(\d+ 1 2) [34] [34]", r"\1 1 1", changed, flags=re.M)
        path.write_text(changed)
        data = block_case(path, probe=[{"name": "a", "surface": "left" if tag else "bottom"}])
        if not tag:
            data |= {"contact": [], "tools": {}}
        with pytest.raises(InputError, match=said):
            build_model(case_of(data), MPI.COMM_SELF)


def numbers(comm, directory):
    """The tables of a run with probes on sides, on a node, through both bodies and round them."""
    data = tomllib.loads(BLOCK + PROBES)
    data["solver"] = {"tolerance": 1e-11}
    data["stage"][1] |= {"steps": 2}
    simulation = built(data, comm)
    recorder = ProbeRecorder(simulation.model, directory)
    with pytest.MonkeyPatch.context() as patch:
        # What a rank does not fill must not be used: it may be a number, or none.
        filled = vars(np) | {"empty_like": lambda like: np.full_like(like, np.nan)}
        patch.setattr("tribox.app.results.point_probes.np", SimpleNamespace(**filled))
        simulation.run(recorder)
    if comm.rank:
        return None
    found = {name: read_table(directory / f"{name}.csv") for name in (*TABLES, *SHAPES)}
    for name, key in (("shape_probes", "radius"), ("surface_probes", "curvature")):
        for row in found[name]:  # second differences of places, and those are compared
            assert np.isfinite(row.pop(key))
    return found


@pytest.mark.mpi(numbers, 3)
def test_tables_do_not_depend_on_the_ranks(on_ranks):
    alone, shared = on_ranks(numbers, 1), on_ranks(numbers, 3)
    for name, rows in alone.items():
        assert len(rows) == len(shared[name])
        for key, first in rows[0].items():
            one, other = ([row[key] for row in table] for table in (rows, shared[name]))
            if isinstance(first, str):
                assert one == other
                continue
            vector = re.fullmatch(r"(.*_)[xyz]+", key)  # components are compared together
            names = [k for k in rows[0] if vector and k.startswith(vector[1])] or [key]
            scale = np.nanmax(np.abs(columns(rows, *names)))
            np.testing.assert_allclose(other, one, rtol=0, atol=SAME * scale, err_msg=key)


def test_arc_length_of_pieces_and_of_a_ring():
    place = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0], [3.0, 0.0], [3.0, 4.0]])
    order, way = arc_length(np.array([[4, 3], [2, 1], [1, 0]]), place)
    assert order.tolist() == [0, 1, 2, 3, 4]
    assert way.tolist() == [0.0, 1.0, 3.0, 3.0, 7.0]
    order, way = arc_length(np.array([[0, 1], [1, 2], [2, 0]]), place)
    assert order.tolist() == [0, 1, 2, 0]
    assert way[-1] == pytest.approx(3.0 + np.sqrt(5.0))
