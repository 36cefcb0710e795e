"""A law or material of the user's own: documented examples, and one clear line for each mistake."""

import os
import py_compile
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.own_law import (
    CLOSED,
    OWN,
    documented_law,
    documented_material,
    documented_material_case,
    line_of,
    with_law,
)
from tribox.app.case.case import resolved_toml
from tribox.app.case.friction import OwnLaw
from tribox.app.case.own_code import OwnCodeError, load_own_law, load_own_material
from tribox.app.case.reading import check_case, load_case
from tribox.forms.friction.law import FrictionLaw

MU, P = 0.3, 2e6
GENT = {"G": 1e6, "K": 5e10, "Jm": 2.0}


@pytest.fixture
def example(tmp_path: Path) -> Path:
    """The law of the documentation, in a file."""
    path = tmp_path / "my_law.py"
    path.write_text(documented_law(), encoding="utf-8")
    return path


def test_the_documented_law_is_exact_and_dissipates(example: Path):
    law: FrictionLaw = load_own_law(f"{example}:MyLaw", {"mu": MU, "speed": 1e-6})
    rng = np.random.default_rng(0)
    slip, pressure = 1e-7 * rng.normal(size=(40, 3)), P * (rng.random(40) > 0.2)
    state, dt, film = law.initial_state(40, 3), 0.1, np.zeros(40)
    response = law.update(slip, dt, pressure, film, state)
    traction = np.linalg.norm(response.traction, axis=1)
    assert (traction <= MU * pressure).all() and traction.max() > 0.1 * MU * P
    work = np.einsum("qi,qi->q", response.traction, slip)
    stored = law.stored_energy(response.state) - law.stored_energy(state)
    np.testing.assert_allclose(work - stored, response.dissipation.total, rtol=1e-12, atol=1e-30)
    for j in range(3):
        h = np.zeros(3)
        h[j] = 1e-11
        ahead, back = (
            law.update(slip + c * h, dt, pressure, film, state).traction for c in (1, -1)
        )
        exact = response.d_traction_d_slip[:, :, j]
        np.testing.assert_allclose((ahead - back) / 2e-11, exact, atol=1e-6 * np.abs(exact).max())


def test_a_case_runs_with_it(example, block, case_file, tribox, tmp_path):
    path = case_file(with_law(block, OWN))
    assert path.parent == example.parent and check_case(path) == []
    case = load_case(path)
    friction = case.contact[0].friction
    assert isinstance(friction, OwnLaw) and friction.parameters == {"mu": 0.3, "speed": 1e-6}
    again = case_file(resolved_toml(case), "again.toml")
    assert load_case(again) == case
    done = tribox("run", path, "--out", tmp_path / "out", "--trust")
    assert done.returncode == 0, done.stderr
    rows = (tmp_path / "out" / "history.csv").read_text().splitlines()
    row = dict(zip(rows[0].split(","), rows[-1].split(","), strict=True))
    assert 0.0 < abs(float(row["friction_coefficient"])) <= 0.3 + 1e-9


MISTAKES = {
    "no file": (OWN.replace("my_law", "your_law"), "no such file: "),
    "no colon": (OWN.replace(":MyLaw", ""), 'must be "file.py:Class"'),
    "key": (OWN + "\nmu = 0.1", 'key "mu" in contact.0.friction does not go with law = "python"'),
    "class missing": ('law = "python"', "contact.0.friction.class: missing; file and class"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line(name, example, block, case_file):
    law, said = MISTAKES[name]
    [line] = check_case(case_file(with_law(block, law)))
    assert said in line and "\n" not in line


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("class MyLaw:\n    def update(self): ...", "no method initial_state, stored_energy, coef"),
        ("class MyLaw:\n  x = (", "cannot be loaded: {file}:2: SyntaxError: '(' was never closed"),
        ("a = 1\nimport no_such_module_at_all", "loaded: {file}:2: ModuleNotFoundError: No module"),
        ("import sys\nsys.exit(0)", "cannot be loaded: {file}:2: SystemExit: 0"),
        ("MyLaw = 3", "has no class MyLaw; there is none"),
        ("class Law: ...", "has no class MyLaw; there is Law"),
    ],
)
def test_a_file_that_is_no_law_is_one_line(code, said, tmp_path):
    file = tmp_path / "my_law.py"
    file.write_text(code, encoding="utf-8")
    with pytest.raises(OwnCodeError, match=re.escape(said.format(file=file))) as error:
        load_own_law(f"{file}:MyLaw", {})
    assert "\n" not in str(error.value) and error.value.key == "class"


def test_parameters_that_the_class_does_not_take_are_named(example):
    said = "MyLaw: TypeError: MyLaw.__init__() got an unexpected keyword argument 'nu'"
    with pytest.raises(OwnCodeError, match=re.escape(said)) as error:
        load_own_law(f"{example}:MyLaw", {"nu": MU, "speed": 1e-6})
    assert error.value.key == "parameters"
    with pytest.raises(OwnCodeError, match=r"my_law\.py:\d+: ValueError: expected mu >= 0"):
        load_own_law(f"{example}:MyLaw", {"mu": -1.0, "speed": 1e-6})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("traction=traction,", "traction=traction[:, 0],", "traction has shape (2,) for 2 points"),
        ("= pressure > 0", "= presure > 0", f"my_law.py:{line_of(CLOSED)}: NameError: name"),
        ("zero = ", "length.max()\n        zero = ", "ValueError: zero-size array"),
        ("return np.zeros(", "return np.zeros(1 + ", "stored_energy has shape (3,) for 2 points"),
        ("self.mu * pressure", "np.nan * pressure", "traction at 2 of 2 points"),
    ],
)
@pytest.mark.parametrize("dim", [2, 3])
def test_a_law_that_cannot_run_is_told_beforehand(old, new, said, dim, example):
    example.write_text(documented_law(old, new), encoding="utf-8")
    with pytest.raises(OwnCodeError, match=re.escape(said)):
        load_own_law(f"{example}:MyLaw", {"mu": MU, "speed": 1e-6}, dim)


def test_the_source_is_run_as_it_stands_and_leaves_no_trace(example):
    """Compiled code beside a law would be run instead of what can be read there."""
    load_own_law(f"{example}:MyLaw", {"mu": MU, "speed": 1e-6})
    assert [path.name for path in example.parent.iterdir()] == ["my_law.py"]
    cache = example.parent / "__pycache__" / f"my_law.{sys.implementation.cache_tag}.pyc"
    py_compile.compile(str(example), str(cache))
    text, times = example.read_text(), example.stat()
    example.write_text(text.replace("class MyLaw", "class ByLaw"))  # of the same size
    os.utime(example, ns=(times.st_atime_ns, times.st_mtime_ns))
    with pytest.raises(OwnCodeError, match="has no class MyLaw; there is ByLaw"):
        load_own_law(f"{example}:MyLaw", {"mu": MU, "speed": 1e-6})


def test_a_law_may_hold_dataclasses_and_move_about(example, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code = documented_law().replace("import numpy as np\n", MOVES, 1)
    example.write_text("from __future__ import annotations\n" + code, encoding="utf-8")
    load_own_law(f"{example}:MyLaw", {"mu": MU, "speed": 1e-6})
    assert Path.cwd() == tmp_path


MOVES = """import os
from dataclasses import dataclass

import numpy as np

os.chdir("/")


@dataclass
class Wear:
    depth: float
"""


SPOILT = {
    "one part": ("return distortion, 0.25", "return distortion + 0.25", "must return two parts"),
    "raises": ("stretched = (k.J", "stretched = (k.F3", ": AttributeError"),
    "a vector": ("return distortion,", "return ufl.as_vector([distortion] * 2),", "two scalars"),
    "prestressed": ("- 2.0 * ufl.ln(k.J)", "- 1.9 * ufl.ln(k.J)", "undeformed body: must be 0"),
    "stiffer": ("-0.5 * c", "-0.6 * c", "the modulus G = 1.2e+06 Pa in the"),
    "no numbers": ('"K": K', '"K": [K]', "parameters(): K must be a number, found [50000000000.0]"),
    "no method": ("def energy(", "def energies(", "it has no method energy"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILT)
def test_a_mistake_in_a_material_is_one_line(name, tmp_path):
    old, new, said = SPOILT[name]
    (tmp_path / "gent.py").write_text(documented_material(old, new))
    with pytest.raises(OwnCodeError) as caught:
        load_own_material(f"{tmp_path}/gent.py:Gent", GENT, 1e6, 5e10).parameters()
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_functions_whose_values_are_not_known_are_refused(tmp_path):
    (tmp_path / "gent.py").write_text(
        documented_material("-0.5 * c", "-0.5 * ufl.cell_avg(k.J) * c")
    )
    with pytest.raises(OwnCodeError, match="a function that is not known: no values of CellAvg"):
        load_own_material(f"{tmp_path}/gent.py:Gent", GENT, 7.0, 9.0)


def test_a_case_with_a_material_of_its_own_is_code(case_file, tribox, tmp_path):
    (tmp_path / "gent.py").write_text(documented_material())
    path = case_file(documented_material_case("steps = 8", "steps = 2"))
    case = load_case(path)
    assert load_case(case_file(resolved_toml(case), "again.toml")) == case
    checked = tribox("check", path)
    assert "bodies.pad: the code of the material" in checked.stdout and checked.returncode == 0
    refused = tribox("run", path, "--out", tmp_path / "out")
    assert refused.returncode == 2 and 'bodies.pad.material = "python" makes' in refused.stderr
    done = tribox("run", path, "--out", tmp_path / "out", "--trust")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out/inputs/gent.py").read_text() == documented_material()
    assert 'class = "inputs/gent.py:Gent"' in (tmp_path / "out/case.toml").read_text()
    (tmp_path / "gent.py").write_text(documented_material("0.25 * c", "0.5 * 0.5 * c"))
    other = tribox("run", path, "--out", tmp_path / "out", "--trust", "--extend")
    assert other.returncode == 2 and "gent.py" in other.stderr
