"""Case files: defaults, presets, sweeps and round trips."""

import re
import time
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.app.conftest import BLOCK, BOXES, FILM
from tribox.app.case.bodies import formulations
from tribox.app.case.case import Case, given_keys, resolved_toml
from tribox.app.case.reading import check_case, load_case
from tribox.app.case.toml_files import KeyPathError, set_value

ROOT = Path(__file__).parents[3]
BLOCK_SLIDE = ROOT / "cases" / "block-slide.toml"

FILM_CASE = """
title = "film"
[geometry]
kind = "two-blocks"
upper = { width = "1.0 mm", height = "0.1 mm", size = "0.02 mm" }
lower = { width = "2.0 mm", height = "0.5 mm", elements = [61, 15] }
[bodies]
elastomer = { material = "mooney-rivlin", C10 = "0.474 MPa", C01 = "0.118 MPa", K = "1 GPa" }
aluminium = { material = "hencky", E = "70 GPa", nu = 0.33 }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
film = { thickness = "30 nm" }
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


def test_defaults_that_follow_from_other_keys(film):
    case = load_case(film, [f"{MAP}.mu_d=0.12"])
    assert case.geometry.offset == 5e-4
    assert case.geometry.shape().offset == 5e-4
    assert formulations(case.bodies, case.geometry.cell)["elastomer"] == "q1-sri"
    assert case.contact[0].penalty_factor == 30.0 and case.contact[0].penalty is None
    triangles = load_case(film, ["geometry.cell=triangle"])
    chosen = formulations(triangles.bodies, triangles.geometry.cell)
    assert set(chosen.values()) == {"q1"}
    assert load_case(film, ["contact.0.penalty=1e13 Pa/m"]).contact[0].penalty_factor is None
    friction = load_case(film, [PRESET]).contact[0].friction
    assert friction.mu_d == friction.mu_s == 0.1


def test_preset_fills_what_is_not_given(film):
    friction = load_case(film, [PRESET]).contact[0].friction
    assert friction.law == "friction-map"
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
    assert label == "mesh=own.msh" and swept.geometry.mesh == case.geometry.mesh
    assert reloaded(case, tmp_path) == case
    (tmp_path / "meshes" / "own.msh").unlink()
    [line] = check_case(path)
    assert line.startswith(f'{path}: geometry.mesh = "meshes/own.msh": no such file')


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


@pytest.mark.parametrize("path", sorted((ROOT / "cases").rglob("*.toml")), ids=lambda p: p.stem)
def test_resolved_cases_read_back_equal(tmp_path, path):
    """All that are shipped: in the plane, in space, of revolution; with tools, films, metals."""
    case = load_case(path)
    again = reloaded(case, tmp_path)
    assert again == case and resolved_toml(again) == resolved_toml(case)


def test_resolved_case_keeps_a_sweep_open(film, tmp_path):
    sweep = 'sweep={ key = "geometry.lower.width", values = ["2 mm", "3.5 mm"] }'
    case = load_case(film, [sweep, PRESET])
    text = resolved_toml(case)
    assert "# offset = " in text and "# gap = " in text and "# eta_b = " in text
    again = reloaded(case, tmp_path)
    assert again == case
    assert again.sweep_cases() == case.sweep_cases()


TITLES = st.text(st.characters(exclude_categories=("C", "Zl", "Zp")), max_size=20)
POSITIVE = st.floats(min_value=1e-12, max_value=1e12)
OPTIONS = st.dictionaries(
    st.sampled_from(["ksp_rtol", "ksp_max_it", "sub_ksp_atol", "mat_mumps_icntl_14"]),
    st.integers(-(10**9), 10**9) | st.floats(-1e9, 1e9) | st.sampled_from(["1e-8", "+.5"]),
    max_size=3,
)


@settings(max_examples=60, deadline=None)
@given(
    TITLES, POSITIVE, POSITIVE, st.floats(-0.99, 0.49), OPTIONS,
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


def test_pairs_have_names_of_their_own():
    data = tomllib.loads(BLOCK_SLIDE.read_text(encoding="utf-8"))
    [first] = data["contact"]
    again = {**first, "slave": "aluminium_left", "name": "elastomer_contact-aluminium_contact"}
    with pytest.raises(ValidationError, match=r"is what contact\.0 is called already"):
        Case.model_validate({**data, "contact": [first, again]})
    found = Case.model_validate({**data, "contact": [first, {**again, "name": "side"}]})
    assert [pair.label for pair in found.contact][1] == "side"


# -- Which keys of a case were given ---------------------------------------------------------------


def test_given_keys_are_those_of_the_file(case_file):
    keys = given_keys(load_case(case_file(FILM), ["contact.0.friction.D_max=100 nm"]))
    assert {"title", "geometry.upper.elements", "contact.0.film.thickness"} < set(keys)
    assert {"contact.0.friction.D_max", "boundary.1.platen.pressure"} < set(keys)
    assert "contact.0.friction.eta_b" not in keys  # of the preset
    assert "contact.0.penalty_factor" not in keys and "solver.tolerance" not in keys


def test_of_a_resolved_case_all_keys_are_given(case_file):
    case = Case.model_validate(tomllib.loads(resolved_toml(load_case(case_file(FILM)))))
    assert "contact.0.friction.eta_b" in given_keys(case)


# -- Sizes that are surely mistakes are refused before a mesh is made of them ----------------------

ROUND = re.sub(r"\[geometry\].*?\n\[bodies", "{}\n[bodies", BLOCK, count=1, flags=re.DOTALL)
CYLINDER = """[geometry]
kind = "cylinder-on-block"
contact_width = "4 mm"
contact_size = "SIZE"
cylinder = { radius = "RADIUS" }
block = { width = "20 mm", height = "5 mm" }
"""
SPHERE = """[geometry]
kind = "sphere-on-block"
contact_width = "4 mm"
contact_size = "SIZE"
sphere = { radius = "RADIUS" }
block = { radius = "20 mm", height = "5 mm" }
"""


def made(geometry: str, size: str, radius: str) -> str:
    return ROUND.replace("{}", geometry.replace("SIZE", size).replace("RADIUS", radius), 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (re.sub(r"elements = \[\d+, \d+\]", "elements = [3000, 3000]", BLOCK),
         "geometry.max_cells = 5000000: the mesh would have 1.8e+07 cells; make it coarser by "
         "elements or size of upper and lower, or raise this"),
        (re.sub(r"elements = \[\d+, \d+, \d+\]", "elements = [200, 200, 200]", BOXES),
         "geometry.max_cells = 5000000: the mesh would have 1.6e+07 cells"),
        (made(CYLINDER, "0.1 um", "10 mm"),
         "cells; make it coarser by contact_size or growth, or raise this"),
        (made(CYLINDER, "1e-30 m", "10 mm"), "contact_size = 1e-30 m is not allowed"),
        (made(CYLINDER, "1 mm", "1e30 m"), "radius = 1e+30 m is not allowed"),
        (made(SPHERE, "1e-30 m", "10 mm"), "contact_size = 1e-30 m is not allowed"),
        (made(SPHERE, "1 mm", "1e30 m"), "radius = 1e+30 m is not allowed"),
    ],
    ids=["blocks", "boxes", "zone", "zone-size", "cylinder", "sphere-size", "sphere"],
)  # fmt: skip
def test_absurd_sizes_are_refused_at_once(case_file, text, said):
    begin = time.process_time()
    lines = check_case(case_file(text))
    assert time.process_time() - begin < 1.0
    assert any(said in line for line in lines), lines


def test_the_limit_is_the_users(case_file):
    limited = BLOCK.replace('kind = "two-blocks"', 'kind = "two-blocks"\nmax_cells = {}')
    [line] = check_case(case_file(limited.replace("{}", "2")))
    cells = int(re.search(r"would have (\d+) cells", line)[1])
    assert check_case(case_file(limited.replace("{}", str(cells)))) == []
    assert check_case(case_file(limited.replace("{}", str(cells - 1)))) != []
