"""Case files: defaults, presets, sweeps, round trips, and one clear line for each mistake."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.case.bodies import formulations
from app.case.case import Case, resolved_toml
from app.case.friction import Coulomb, FrictionMap
from app.case.overrides import KeyPathError, set_value
from app.case.reading import check_case, load_case
from app.case.schema import json_schema
from app.case.time_tables import TimeTable
from app.errors import InputError

ROOT = Path(__file__).parents[3]
BLOCK_SLIDE = ROOT / "cases" / "block-slide.toml"

FILM_CASE = """
title = "film"
[geometry]
kind = "two-blocks"
upper = { width = "1.0 mm", height = "0.1 mm", size = "0.02 mm" }
lower = { width = "2.0 mm", height = "0.5 mm", elements = [61, 15] }
[bodies.elastomer]
material = "mooney-rivlin"
C10 = "0.474 MPa"
C01 = "0.118 MPa"
K = "1 GPa"
[bodies.aluminium]
material = "hencky"
E = "70 GPa"
nu = 0.33
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
[contact.film]
thickness = "30 nm"
[contact.friction]
law = "friction-map"
mu_s = 0.12
mu_d = 0.10
K_T = "1e12 Pa/m"
eta_b = "0.8 Pa*s"
D_max = "250 nm"
alpha = 0.039
V_star = "1 mm/s"
V_star_at = "10 nm"
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "top"
displacement = { x = "driven" }
platen = { direction = "y", pressure = [["0 s", "0 MPa"], ["1 s", "3 MPa"]] }
[[stage]]
name = "press"
duration = "1 s"
rate_dependent = false
[[stage]]
name = "slide"
velocities = ["1e-8 m/s", "-1e-7 m/s"]
slip_step = "0.5 um"
"""

MAP = "contact.0.friction"
PRESET = f'{MAP}={{ preset = "paper-printed", mu_s = 0.1, K_T = "1e12 Pa/m" }}'


@pytest.fixture
def film(tmp_path: Path) -> Path:
    path = tmp_path / "film.toml"
    path.write_text(FILM_CASE)
    return path


def reloaded(case: Case, folder: Path) -> Case:
    path = folder / "resolved.toml"
    path.write_text(resolved_toml(case), encoding="utf-8")
    return load_case(path)


# --- what a case becomes -------------------------------------------------------------------------


def test_block_slide_is_the_reference_problem():
    case = load_case(BLOCK_SLIDE)
    assert case.source == BLOCK_SLIDE
    assert case.geometry.thickness == 1e-3
    assert (case.geometry.upper.width, case.geometry.upper.elements) == (1e-3, (40, 20))
    assert (case.geometry.lower.width, case.geometry.lower.elements) == (2e-3, (61, 15))
    assert case.geometry.offset == 3.5e-4
    assert {body.formulation for body in case.bodies.values()} == {"q1"}
    assert {body.material for body in case.bodies.values()} == {"neo-hookean"}
    friction = case.contact[0].friction
    assert isinstance(friction, Coulomb) and friction.mu == 0.2 and friction.K_T is None
    assert [(s.duration, s.steps) for s in case.stage] == [(1.0, 10), (3.0, 30)]
    top = next(b for b in case.boundary if b.surface == "top").displacement
    assert [top.y(t) for t in (0.0, 0.5, 1.0, 4.0)] == [0.0, -2.5e-5, -5e-5, -5e-5]
    assert [top.x(t) for t in (0.0, 1.0, 2.5, 4.0)] == pytest.approx([0.0, 0.0, 1.5e-4, 3e-4])


def test_defaults_that_follow_from_other_keys(film):
    case = load_case(film, [f"{MAP}.mu_d=0.12"])
    assert case.geometry.offset == 5e-4
    assert case.geometry.shape().left() == 5e-4
    assert formulations(case.bodies, case.geometry.cell)["elastomer"] == "q1-sri"
    assert case.contact[0].penalty_factor == 30.0 and case.contact[0].penalty is None
    triangles = load_case(film, ["geometry.cell=triangle"])
    chosen = formulations(triangles.bodies, triangles.geometry.cell)
    assert set(chosen.values()) == {"q1"}
    assert load_case(film, ["contact.0.penalty=1e13 Pa/m"]).contact[0].penalty_factor is None
    friction = load_case(film, [PRESET]).contact[0].friction
    assert friction.mu_d == friction.mu_s == 0.1


def test_elastic_constants(film):
    bodies = load_case(film).bodies
    assert bodies["elastomer"].shear_modulus == pytest.approx(2 * 0.592e6)
    assert bodies["elastomer"].bulk_modulus == 1e9
    assert bodies["aluminium"].shear_modulus == pytest.approx(70e9 / 2.66)
    assert bodies["aluminium"].bulk_modulus == pytest.approx(70e9 / 1.02)
    pair = 'bodies.aluminium={ material = "neo-hookean", G = "26 GPa", K = "68 GPa" }'
    body = load_case(film, [pair]).bodies["aluminium"]
    assert (body.shear_modulus, body.bulk_modulus) == (26e9, 68e9)


def test_values_cannot_be_changed(film):
    case = load_case(film)
    with pytest.raises(ValueError, match="frozen"):
        case.geometry.thickness = 2.0


def test_programs(film):
    case = load_case(film)
    bottom, top = case.boundary
    assert bottom.displacement.x == TimeTable.constant(0.0)
    assert list(top.driven_keys()) == [("displacement", "x")]
    assert list(bottom.driven_keys()) == []
    assert top.platen.pressure(0.5) == 1.5e6
    assert [stage.is_driven for stage in case.stage] == [False, True]
    assert case.stage[1].velocities == (1e-8, -1e-7)


def test_preset_fills_what_is_not_given(film):
    friction = load_case(film, [PRESET]).contact[0].friction
    assert isinstance(friction, FrictionMap)
    assert friction.law == "friction-map"
    assert (friction.eta_b, friction.D_max, friction.gamma) == (0.8, 250e-9, 4e-25)
    assert friction.beta == ((1e-8, 1.0), (3e-8, 0.01), (1.8e-7, 1e-5))
    assert friction.flow_rule == "literal"
    changed = load_case(
        film,
        [PRESET, f"{MAP}.alpha=0.5", f"{MAP}.eta_b=0.4", f"{MAP}.V_star=1 mm/s",
         f"{MAP}.V_star_at=10 nm"],
    ).contact[0].friction  # fmt: skip
    assert (changed.alpha, changed.beta, changed.eta_b, changed.gamma) == (0.5, None, 0.4, None)


def test_the_law_takes_the_parameters(film):
    parameters = load_case(film).contact[0].friction.parameters()
    assert (parameters.mu_s, parameters.mu_d, parameters.alpha) == (0.12, 0.10, 0.039)
    assert parameters.threshold_constant == pytest.approx(1e-6 * 1e-8)
    assert load_case(film, [PRESET]).contact[0].friction.parameters().reentry == "literal"


def test_mesh_is_found_beside_the_case(tmp_path, monkeypatch):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "own.msh").write_text("")
    data = FILM_CASE.replace('kind = "two-blocks"', 'mesh = "meshes/own.msh"')
    data = "\n".join(line for line in data.splitlines() if not line.startswith(("upper", "lower")))
    path = tmp_path / "own.toml"
    path.write_text(data + '\n[sweep]\nkey = "geometry.mesh"\nvalues = ["meshes/own.msh"]\n')
    monkeypatch.chdir("/")
    case = load_case(path)
    assert case.geometry.mesh == tmp_path / "meshes" / "own.msh"
    assert case.bodies["elastomer"].formulation is None
    assert case.bodies["elastomer"].formulation_for("triangle") == "q1"
    [(label, swept)] = case.sweep_cases()
    assert label == "mesh=meshes_own.msh" and swept.geometry.mesh == case.geometry.mesh
    assert reloaded(case, tmp_path) == case
    (tmp_path / "meshes" / "own.msh").unlink()
    [line] = check_case(path)
    assert line.startswith(f'{path}: geometry.mesh = "meshes/own.msh": no such file')


def test_reading_a_case_loads_nothing_heavy():
    script = (
        "import sys; from pathlib import Path; from app.case.reading import load_case;"
        f"load_case(Path({str(BLOCK_SLIDE)!r}));"
        "print([m for m in ('pint', 'ufl', 'dolfinx', 'gmsh', 'scipy') if m in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True, cwd=ROOT
    )
    assert run.stdout.strip() == "[]"


# --- overrides, sweeps, round trips --------------------------------------------------------------


def test_overrides_replace_and_add(film):
    case = load_case(
        film,
        ["contact.0.film.thickness=10 nm", "stage.0.steps=3", "output.figures=false",
         "geometry.lower.elements=[10, 5]", "solver.petsc.ksp_type=preonly", 'title="a = b"'],
    )  # fmt: skip
    assert case.contact[0].film.thickness == 1e-8
    assert case.stage[0].steps == 3
    assert case.output.figures is False
    assert case.geometry.lower.elements == (10, 5)
    assert case.solver.petsc == {"ksp_type": "preonly"}
    assert case.title == "a = b"


def test_set_value_reads_quoted_names():
    data = {"bodies": {"a.b": {}}, "list": [{"x": 1}]}
    set_value(data, 'bodies."a.b".E', 3)
    set_value(data, "list.0.x", 2)
    set_value(data, "new.table.key", 1)
    assert data == {
        "bodies": {"a.b": {"E": 3}}, "list": [{"x": 2}], "new": {"table": {"key": 1}}
    }  # fmt: skip
    for key in ("list.1.x", "list.x", "list.0.x.y", "a b", "", "a = 1\nb"):
        with pytest.raises(KeyPathError):
            set_value(data, key, 0)


def test_sweep_derives_defaults_for_each_value(film):
    sweep = 'sweep={ key = "geometry.lower.width", values = ["2 mm", "3.5 mm"] }'
    cases = load_case(film, [sweep]).sweep_cases()
    assert [label for label, _ in cases] == ["width=2mm", "width=3.5mm"]
    assert [case.geometry.offset for _, case in cases] == pytest.approx([5e-4, 1.25e-3])
    assert all(case.sweep is None and case.source == film for _, case in cases)
    penalty = 'sweep={ key = "contact.0.penalty", values = ["1e13 Pa/m"] }'
    [(_, case)] = load_case(film, [penalty]).sweep_cases()
    assert (case.contact[0].penalty, case.contact[0].penalty_factor) == (1e13, None)
    assert load_case(film).sweep_cases() == []


@pytest.mark.parametrize(
    ("key", "value", "label"),
    [
        ("contact.0.film.thickness", "10 nm", "thickness=10nm"),
        ("contact.0.friction.eta_b", "0.8 N s/m^2", "eta_b=0.8N_s_m_2"),
        ("contact.0.friction.mu_s", 0.3, "mu_s=0.3"),
        ("geometry.lower.elements", [10, 5], "elements=10x5"),
        ("output.figures", False, "figures=false"),
        ("geometry.cell", "triangle", "cell=triangle"),
    ],
)
def test_sweep_labels_are_directory_names(film, key, value, label):
    path = film.parent / "sweep.toml"
    shown = {True: "true", False: "false"}.get(value) if isinstance(value, bool) else repr(value)
    path.write_text(f'{FILM_CASE}\n[sweep]\nkey = "{key}"\nvalues = [{shown}]\n')
    [(found, _)] = load_case(path).sweep_cases()
    assert found == label


def test_resolved_case_reads_back_equal(film, tmp_path):
    for case in (load_case(BLOCK_SLIDE), load_case(film), load_case(film, [PRESET])):
        text = resolved_toml(case)
        assert tomllib.loads(text)["geometry"]["gap"] == "0.0 m"
        again = reloaded(case, tmp_path)
        assert again == case
        assert resolved_toml(again) == text
    assert load_case(BLOCK_SLIDE) != load_case(BLOCK_SLIDE, ["contact.0.friction.mu=0.3"])


def test_resolved_case_keeps_a_sweep_open(film, tmp_path):
    sweep = 'sweep={ key = "geometry.lower.width", values = ["2 mm", "3.5 mm"] }'
    case = load_case(film, [sweep, PRESET])
    text = resolved_toml(case)
    assert "# offset = " in text and "# gap = " in text and "# eta_b = " in text
    again = reloaded(case, tmp_path)
    assert again == case
    assert again.sweep_cases() == case.sweep_cases()


POSITIVE = st.floats(min_value=1e-12, max_value=1e12)
OPTIONS = st.dictionaries(
    st.text(min_size=1, max_size=8),
    st.text() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False),
    max_size=3,
)


@settings(max_examples=60, deadline=None)
@given(
    st.text(max_size=20), POSITIVE, POSITIVE, st.floats(-0.99, 0.49), OPTIONS,
    st.lists(st.tuples(POSITIVE, st.floats(-1e9, 1e9)), min_size=1, max_size=4,
             unique_by=lambda row: row[0]),
)  # fmt: skip
def test_round_trip_of_any_values(tmp_path_factory, title, width, E, nu, options, rows):
    data = tomllib.loads(FILM_CASE)
    data["title"] = title
    data["geometry"]["thickness"] = width
    data["bodies"]["aluminium"] |= {"E": E, "nu": nu}
    data["boundary"][1]["platen"]["pressure"] = sorted(map(list, rows))
    data["solver"] = {"petsc": options}
    case = Case.model_validate(data)
    assert case.geometry.thickness == width and case.bodies["aluminium"].E == E
    assert reloaded(case, tmp_path_factory.mktemp("case")) == case


# --- mistakes ------------------------------------------------------------------------------------

DRIVEN = '{ surface = "bottom", displacement = { x = "driven" } }'
TWICE = '{ surface = "top", displacement = { x = 0 } }'

MISTAKES = [
    # keys
    ("contact.0.frction=3", 'unknown key "frction" in contact.0; did you mean "friction"?'),
    (f"{MAP}.viscosty=3", f'unknown key "viscosty" in {MAP}; did you mean "eta_b"?'),
    (f"{MAP}.mu=3", f'key "mu" in {MAP} does not go with law = "friction-map"'),
    ("contact.0.thickness=3", '"thickness" in contact.0; did you mean "film.thickness"?'),
    ("solvr.tolerance=1", 'unknown key "solvr"; did you mean "solver"?'),
    ("output.zzz=1", 'unknown key "zzz" in output; valid keys: fields_every, figures'),
    ("boundary.0.velocity.w=0", '"w" in boundary.0.velocity; valid keys: x, y, z'),
    ("bodies.elastomer.E=1", 'does not go with material = "mooney-rivlin"'),
    ("geometry.mesh=a.msh", 'key "mesh" in geometry does not go with kind = "two-blocks"'),
    ('bodies.elastomer={ material = "hencky" }', "give E and nu, or G and K; found none of them"),
    # values
    ("contact.0.film.thickness=-3 nm", 'contact.0.film.thickness = "-3 nm": must be >= 0 m'),
    ("contact.0.film.thickness=3 s", 'thickness = "3 s": "s" has the wrong dimension'),
    ("contact.0.film.thickness=3 nmm", 'unknown unit "nmm"'),
    ("contact.0.film.thickness=nan", "contact.0.film.thickness = nan: must be finite"),
    ("contact.0.film.thickness=thin", "must be a number (in m) or text with a unit"),
    ("bodies.aluminium.nu=0.5", "bodies.aluminium.nu = 0.5: must be > -1 and < 0.5"),
    ("bodies.aluminium.E=70 GPa m", '"GPa m" has the wrong dimension'),
    ("bodies.elastomer.C10=-1 MPa", "must be > 0 Pa (half the shear modulus)"),
    ("bodies.aluminium.material=steel", 'bodies.aluminium.material = "steel": must be one of'),
    ("bodies.aluminium.formulation=q3", 'formulation = "q3": must be "q1", "q1-sri" or "q2"'),
    ("bodies.aluminium={}", 'bodies.aluminium.material: missing; one of "neo-hookean", "hencky"'),
    ("bodies.elastomr.E=1", 'bodies.elastomr: no such body; did you mean "elastomer"?'),
    ("geometry={}", 'geometry.kind: missing; one of "two-blocks", "cylinder-on-block"'),
    ("geometry.kind=spheres", 'geometry.kind = "spheres": must be one of'),
    ("geometry.upper.elements=[3]", "geometry.upper.elements.1: missing entry"),
    ("geometry.lower.elements=[3, 2.5]", "elements.1 = 2.5: must be a whole number"),
    ("geometry.lower.elements=[3, 0]", "elements.1 = 0: must be >= 1"),
    ("geometry.lower.grading=0", "geometry.lower.grading = 0: must be > 0"),
    ("contact.0.quadrature_degree=0", "quadrature_degree = 0: must be >= 1"),
    ("output.figures=1", "output.figures = 1: must be true or false"),
    ("title=3", "title = 3: must be text, in quotes"),
    ('stage.0.name=""', 'stage.0.name = "": must not be empty'),
    ("contact={}", "contact: must be an array of tables: write [[contact]]"),
    ("contact=[]", "contact = []: must have at least 1 entry"),
    ("solver=3", "solver = 3: must be a table"),
    ("solver.petsc.mat=[1]", "solver.petsc.mat = [1]: must be text, a number, true or false"),
    ("solver.kind=explicit;bodies.elastomer.density=1e3",
     "bodies.aluminium.density: missing; explicit dynamics needs the mass of each body"),
    ("solver.damping=1", 'solver.damping: goes with kind = "explicit" only'),
    ("stage.0.solver=explicit", 'stage.0.solver = "explicit": needs solver.kind = "explicit"'),
    ("stage.0.relax=true", "stage.0.relax: goes with explicit stages only"),
    ("stage.0.ramp=1 ms", "stage.0.ramp = 0.001: goes with velocity or velocities only"),
    ("bodies.elastomer.velocity.x=1", "bodies.elastomer.velocity: goes with solver.kind = "),
    ("boundary.1.platen.mass=1 g", "boundary.1.platen.mass = 0.001: goes with solver.kind"),
    ("boundary.1.platen.pressure={ table = [[0, 1]], rmp = 1 }", 'pressure: unknown key "rmp"'),
    ("boundary.1.platen.pressure={ ramp = 'smooth' }", "pressure.table: must be [[time, value]"),
    ("boundary.1.platen.pressure={ table = [[0, '1 m']] }", 'table.0.1 = "1 m": "m" has the wrong'),
    ("boundary.1.platen.pressure={ table = [[0, 1]], ramp = 'cos' }",
     'pressure.ramp = "cos": must be "linear" or "smooth"'),
    ("boundary.1.spring={ direction = 'x', stiffness = 1, end = 0 }",
     '"top" is already moved in x by boundary.1.displacement.x'),
    ("boundary.1.spring={ direction = 'x', end = 0 }", "boundary.1.spring.stiffness: missing"),
    ("solver.tolerance=0", "solver.tolerance = 0: must be > 0 and < 1"),
    ("boundary.1.platen.pressure=[[0, 1], [0, 2]]", "pressure.1.0 = 0: the time must increase"),
    ("boundary.1.platen.pressure=[[0, 1], [1]]", "pressure.1 = [1]: must be a pair [time, value]"),
    ("boundary.1.platen.pressure=[[0, '1 m']]", 'pressure.0.1 = "1 m": "m" has the wrong'),
    ("boundary.1.displacement.x=drivn", '[[time, value], ...], or "driven"'),
    # geometry
    ("geometry.upper.elements=[3, 2]", "geometry.upper: give either elements or size"),
    ('geometry.lower={ width = 1, height = 1 }', "geometry.lower: give either elements or size"),
    ("geometry.offset=2 mm", "geometry.offset = 0.002: must lie between -0.001 m and 0.002 m"),
    ("geometry.upper.size=1e-12", "geometry: size = 1e-12 m is not allowed"),
    # film and law
    (f"{MAP}.eta_b=0", f"{MAP}.eta_b = 0.0: a film thicker than D_min (3e-08 m > 0 m) needs"),
    (f"{MAP}.beta=1", f"{MAP}: give either alpha or beta, found both"),
    (f'{MAP}={{ preset = "friction-map", mu_s = 0.1, K_T = 1 }}', "or gamma, found neither"),
    (f"{MAP}.gamma=1e-25", f"{MAP}: give either V_star (with V_star_at) or gamma, found both"),
    (f"{MAP}.D_max=0.0 nm", 'D_max = "0.0 nm": must be > 0 m'),
    (f"{MAP}.D_min=250 nm", f"{MAP}.D_max = 2.5e-07: must be > D_min = 2.5e-07 m"),
    (f"{MAP}.mu_d=0.2", f"{MAP}.mu_d = 0.2: must be <= mu_s = 0.12"),
    (f"{MAP}.alpha=[['10 nm', 0.1], ['10 nm', 0.2]]", "alpha.1.0 = \"10 nm\": the film thickness"),
    (f"{MAP}.alpha=1.5", f"{MAP}.alpha = 1.5: must be >= 0 and <= 1"),
    (f"{MAP}.preset=paper", f'{MAP}.preset = "paper": must be "paper-printed", "paper-swapped"'),
    (f"{MAP}.law=stribek", f'{MAP}.law = "stribek": must be one of "friction-map", "coulomb"'),
    ('contact.0.friction={ law = "coulomb" }', f"{MAP}.mu: missing; coefficient of friction"),
    (f'{MAP}={{ law = "friction-map", mu_s = 0.1, D_max = 1 }}',
     f"{MAP}.K_T: missing; tangential stiffness of the asperities, in Pa/m"),
    # surfaces
    ("contact.0.master=elastomer_contact", "contact.0.master = \"elastomer_contact\": must differ"),
    ("contact.0.slave=elastomer_contct", 'no such surface; did you mean "elastomer_contact"?'),
    ("boundary.1.surface=zzz", 'boundary.1.surface = "zzz": no such surface; there are'),
    ("bodies.aluminium.formulation=q1-sri;geometry.cell=triangle", '"q1-sri" needs quadrilaterals'),
    ("contact.0.penalty=1e13 Pa/m;contact.0.penalty_factor=10", "either penalty or penalty_factor"),
    # boundaries
    ('boundary.0={ surface = "bottom" }', "boundary.0: does nothing; give displacement"),
    ("boundary.0.displacement={}", "boundary.0: does nothing"),
    (f"boundary=[{TWICE}, {TWICE}, {DRIVEN}]",
     '"top" is already moved in x by boundary.0.displacement.x'),
    ("boundary.1.velocity.x=1", "boundary.1.velocity.x: \"top\" is already moved in x"),
    ("boundary.1.displacement.y=0", "boundary.1.platen.direction: \"top\" is already moved in y"),
    ("boundary.1.platen.force=1 N", "boundary.1.platen: give either pressure or force, found both"),
    ('boundary.1.platen={ direction = "y" }', "pressure or force, found neither"),
    # stages
    ('stage.0={ name = "a" }', "stage.0: give either duration (with steps) or velocities"),
    ("stage.1.velocities=[1e-8, 0]", "stage.1.velocities.1 = 0: must not be 0"),
    ("stage.1.velocities=[1e-8, inf]", "stage.1.velocities.1 = inf: must be finite"),
    ("stage.1.velocities=[]", "stage.1.velocities = []: must hold at least one velocity"),
    ("stage.1.duration=1 s", "stage.1.duration: does not go with velocities"),
    ("stage.1.min_steps=300", "stage.1.max_steps = 200: must be >= min_steps = 300"),
    ("stage.0.slip_step=1 um", "stage.0.slip_step: goes with velocities only"),
    ('stage.1={ name = "b", velocities = [1] }', "stage.1.slip_step: missing"),
    ("stage.1.name=press", 'stage.1.name = "press": two stages have this name'),
    ("boundary.1.displacement.x=0", "stage.1.velocities: moves nothing: no boundary has"),
    ('stage=[{ name = "a", duration = 1 }]', "boundary.1.displacement.x = \"driven\": never moves"),
    # sweeps
    ('sweep={ key = "contact.0.film.thicknes", values = [1] }',
     'sweep.key = "contact.0.film.thicknes": unknown key "thicknes" in contact.0.film; did you'),
    ('sweep={ key = "contact.1.mu", values = [1] }', 'contact has no entry "1"; entries are'),
    ('sweep={ key = "title.a", values = [1] }', "sweep.key = \"title.a\": title is no table"),
    ('sweep={ key = "a b", values = [1] }', 'sweep.key = "a b": not a dotted key'),
    ('sweep={ key = "contact.0.film.thickness", values = ["1 nm", "-3 nm"] }',
     'sweep.values.1 = "-3 nm": must be >= 0 m'),
    ('sweep={ key = "contact.0.friction.mu_s", values = [0.05] }',
     f"sweep.values.0 = 0.05: {MAP}.mu_d = 0.1: must be <= mu_s = 0.05"),
    ('sweep={ key = "contact.0.film.thickness", values = ["1 nm", "1  nm"] }',
     'sweep.values.1 = "1  nm": is in the list twice'),
    ('sweep={ key = "contact.0.film.thickness", values = [] }', "must have at least 1 entry"),
    # overrides
    ("contact.7.slave=a", '"contact.7.slave=a": contact has no entry "7"'),
    ("stage.0", '"stage.0": an override is written key=value'),
    ("a b=3", "not a dotted key"),
]  # fmt: skip


@pytest.mark.parametrize(("overrides", "expected"), MISTAKES, ids=[m[0] for m in MISTAKES])
def test_a_mistake_gives_one_clear_line(film, overrides, expected):
    with pytest.raises(InputError) as error:
        load_case(film, overrides.split(";"))
    message = str(error.value)
    assert expected in message
    assert "\n" not in message and "pydantic" not in message and len(message) < 300
    lines = check_case(film, overrides.split(";"))
    assert message == lines[0], "each of these cases has exactly one mistake"
    assert len(lines) == 1


def test_the_example_errors_of_the_documentation(film):
    shown = (ROOT / "docs" / "case-file.md").read_text().replace("cases/x.toml", str(film))
    for override in ("contact.0.film.thickness=-3 nm", f"{MAP}.viscosty=3"):
        [line] = check_case(film, [override])
        assert line in shown


def test_several_mistakes_are_counted_and_listed(film):
    overrides = ["contact.0.film.thickness=-3 nm", "stage.0.steps=0", "output.figurs=true"]
    lines = check_case(film, overrides)
    assert [line.removeprefix(f"{film}: ") for line in lines] == [
        'unknown key "figurs" in output; did you mean "figures"?',
        'contact.0.film.thickness = "-3 nm": must be >= 0 m',
        "stage.0.steps = 0: must be >= 1",
    ]
    with pytest.raises(InputError) as error:
        load_case(film, overrides)
    assert str(error.value) == f"{lines[0]} (and 2 more; tribox check lists them)"
    assert check_case(film) == []


def test_a_film_law_without_film(film):
    film.write_text(FILM_CASE.replace('[contact.film]\nthickness = "30 nm"\n', ""))
    [line] = check_case(film)
    assert 'contact.0.film.thickness: missing; law = "friction-map" needs the film' in line


def test_a_missing_body(film):
    film.write_text(FILM_CASE.replace("[bodies.aluminium]", "[bodies.aluminum]"))
    lines = check_case(film)
    assert lines[0].endswith('bodies.aluminum: no such body; did you mean "aluminium"?')
    assert "bodies.aluminium: missing" in lines[1]


def test_files_that_cannot_be_read(tmp_path):
    gone = tmp_path / "gone.toml"
    assert check_case(gone) == [f"{gone}: no such file"]
    assert check_case(tmp_path)[0].startswith(f"{tmp_path}: cannot be read (")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    assert check_case(binary) == [f"{binary}: not a text file in UTF-8"]
    broken = tmp_path / "broken.toml"
    broken.write_text('title = "a"\nsteps = = 3\n')
    [line] = check_case(broken)
    assert line.startswith(f"{broken}:2: not valid TOML: ")
    with pytest.raises(InputError) as error:
        load_case(gone)
    assert error.value.exit_code == 2


# --- schema and documentation --------------------------------------------------------------------

DOCUMENTED = {
    "Top level": ("",),
    "`[geometry]`": (
        "BlocksGeometry",
        "CylinderOnBlockGeometry",
        "TwoCylindersGeometry",
        "BoxesGeometry",
        "SphereGeometry",
        "MeshGeometry",
    ),
    "`upper` and `lower`": ("BlockSize", "BoxSize"),
    "`sphere`": ("SphereSize",),
    "`block` under a sphere": ("RoundBlockSize",),
    "`cylinder` and the `upper` and `lower` of two cylinders": ("CylinderSize",),
    "`block`": ("FlatSize",),
    "`[bodies.NAME]`": ("NeoHookeanBody", "HenckyBody", "MooneyRivlinBody"),
    "`[bodies.NAME.velocity]`": ("BodyVelocity",),
    "`[[contact]]`": ("Contact",),
    "`[contact.film]`": ("Film",),
    "`[contact.friction]`": ("FrictionMap", "Coulomb", "Stribeck", "OwnLaw", "Frictionless"),
    "`[[boundary]]`": ("Boundary",),
    "`displacement` and `velocity`": ("Displacement", "Velocity"),
    "`platen`": ("Platen",),
    "`rotation`": ("Rotation",),
    "`spring`": ("Spring",),
    "`[[stage]]`": ("Stage",),
    "`[solver]`": ("Solver",),
    "`mass_scaling`": ("MassScaling",),
    "`[output]`": ("Output",),
    "`[sweep]`": ("Sweep",),
}


def test_schema_describes_every_key():
    schema = json_schema()
    assert set(schema["$defs"]) == {name for names in DOCUMENTED.values() for name in names} - {""}
    for table in (schema, *schema["$defs"].values()):
        assert table["additionalProperties"] is False
        for key, field in table["properties"].items():
            assert field["description"], key
            assert "null" not in str(field)
    thinnest = schema["$defs"]["FrictionMap"]["properties"]["D_min"]
    assert thinnest["anyOf"] == [{"type": "number", "minimum": 0.0}, {"type": "string"}]
    assert thinnest["description"] == "thickness up to which friction is purely Coulomb [m]"
    assert schema["$defs"]["FrictionMap"]["properties"]["transition_width"]["default"] == 0.03
    assert schema["$defs"]["FrictionMap"]["required"] == ["mu_s", "K_T"]


def test_documentation_lists_every_key_with_its_unit():
    text = (ROOT / "docs" / "case-file.md").read_text()
    sections = dict(re.findall(r"^###? (.+?)\n(.*?)(?=^##|\Z)", text, re.M | re.S))
    schema = json_schema()
    for heading, names in DOCUMENTED.items():
        rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \|", sections[heading], re.M))
        fields: dict[str, dict] = {}
        for name in names:
            fields |= (schema["$defs"][name] if name else schema)["properties"]
        assert set(rows) == set(fields), heading
        for key, field in fields.items():
            if (unit := field.get("x-unit", field.get("items", {}).get("x-unit"))) is not None:
                assert unit.replace("1", "–", unit == "1") in rows[key].split(" or "), key


def test_the_python_example_of_the_documentation(monkeypatch, capsys):
    text = (ROOT / "docs" / "case-file.md").read_text()
    [example] = re.findall(r"```python\n(.*?)```", text, re.S)
    monkeypatch.chdir(ROOT)
    exec(example, {})
    assert capsys.readouterr().out.startswith("0.3 17241")
