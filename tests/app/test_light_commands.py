"""Commands that solve nothing start without the solver's libraries."""

import csv
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from dolfinx import jit
from mpi4py import MPI

from tests.app.figures.made_results import write_strip
from tests.flowing import SOFT_METAL
from tests.ranks import LIMIT
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.precompile import compile_forms
from tribox.app.results.fields import StressField
from tribox.app.simulation.history import COLUMNS
from tribox.geometry.compat import compiler_cache

ROOT = Path(__file__).parents[2]
DATA = ROOT / "cases" / "data" / "tribometer-synthetic.csv"
PULLED = DATA.with_name("metal-cycle-synthetic.csv")
HEAVY = ("dolfinx", "petsc4py", "mpi4py")
# Figures are made without pyplot, which would keep each of them open until it is told to close it.
PYPLOT = "matplotlib.pyplot"
SLOW = ("pint", "rich", "scipy")  # nor do these start where there are no units, fits or terminals
# Runs one command line after another and prints after each which of the modules it has loaded.
SCRIPT = f"""
import json, sys
from tribox.app.cli import main
for line in json.loads(sys.argv[1]):
    sys.argv = ["tribox", *line]
    code = 0
    try:
        main()
    except SystemExit as end:
        code = end.code or 0
    loaded = [name for name in {(*HEAVY, PYPLOT)!r} if name in sys.modules]
    slow = [name for name in {SLOW!r} if name in sys.modules]
    print(json.dumps([line[0], code, loaded, slow]), file=sys.stderr)
"""


def results(directory: Path, case: str) -> Path:
    """A results directory with as much in it as figures are drawn from."""
    (directory / "figures").mkdir(parents=True)
    (directory / "case.toml").write_text(case)
    row = dict.fromkeys(COLUMNS, 1.0) | {"stage": "slide"}
    with (directory / "history.csv").open("w", newline="") as stream:
        out = csv.DictWriter(stream, COLUMNS)
        out.writeheader()
        out.writerows(row | {"step": step, "time": float(step)} for step in (1, 2, 3))
    summary = {"load_steps": [{"label": "slide", "steady": None, **row}]}
    (directory / "summary.json").write_text(json.dumps(summary))
    return directory


def test_commands_that_solve_nothing_load_no_solver(tmp_path, block):
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(block.replace("mu = 0.2", "nu = 0.2", 1))
    right = tmp_path / "right.toml"
    right.write_text(block)
    strip = write_strip(tmp_path / "strip", outputs=(1, 5))
    lines = [
        *(["--version"], ["map", "--out", str(tmp_path / "map")], ["--help"], ["schema"]),
        *(["materials"], ["materials", "AA1050-O"], ["check", str(wrong)]),
        *(["plot", str(strip), "--animate"], ["report", str(strip)]),
        ["init", "own-mesh", str(tmp_path / "starter")],
        ["fit", str(DATA), "--parameters", "mu_s,eta_b", "--out", str(tmp_path / "fit")],
        [*"fit --law linear --branches 0 --out".split(), str(tmp_path / "metal"), "--material",
         str(PULLED)],
        ["check", str(right)],
    ]  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, json.dumps(lines)],
        capture_output=True, text=True, cwd=ROOT, timeout=LIMIT,
    )  # fmt: skip
    told = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("[")]
    wanted = [[line[0], 2 if str(wrong) in line else 0, []] for line in lines[:-1]]
    assert [one[:3] for one in told] == [*wanted, ["check", 0, list(HEAVY)]], done.stderr
    assert [one[3] for one in told[:2]] == [[], []]
    assert (strip / "figures" / "history.png").is_file()
    assert (strip / "figures" / "deformed.png").is_file()
    assert (strip / "figures" / "animation.gif").is_file()
    assert (tmp_path / "map" / "summary.json").is_file()
    assert (tmp_path / "fit" / "fit.json").is_file()
    assert (tmp_path / "metal" / "figures" / "fit.png").is_file()


def test_reading_results_loads_no_solver(tmp_path, block):
    out = results(tmp_path / "out", block)
    script = f"""
import sys
from tribox.app.results import read
found = read({str(out)!r})
assert "pandas" not in sys.modules
assert len(found.history) == 3 and found.surfaces.empty
assert len(found.load_steps) == 1 and found.case.title == "small block"
assert found.steps.tolist() == []
from tribox.app.results import read as again
assert again is read
heavy = [name for name in {(*HEAVY, "basix", PYPLOT)!r} if name in sys.modules]
print(heavy)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, timeout=LIMIT
    )
    assert done.stdout == "[]\n", done.stderr


# -- What the image compiles beforehand is all that runs need --------------------------------------


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    """A cache of this test's own, with all that is compiled already: other tests fill theirs."""
    for path in compiler_cache().glob("*"):
        (tmp_path / path.name).symlink_to(path)
    monkeypatch.setitem(jit.DOLFINX_DEFAULT_JIT_OPTIONS, "cache_dir", (str(tmp_path), ""))
    assert compiler_cache() == tmp_path
    return tmp_path


def test_runs_compile_nothing_that_has_not_been_compiled(cache, block, film):
    def compiled() -> set[str]:
        return {path.name for path in cache.glob("*.so")}

    lines = list(compile_forms())
    assert len(lines) == len(set(lines)) >= 10
    before = compiled()
    assert before
    pushed = block.replace("[boundary.displacement]", 'pressure = "1 kPa"\n[boundary.displacement]')
    cases = [tomllib.loads(text) for text in (block, film, pushed)]
    triangles = tomllib.loads(film)
    triangles["geometry"]["cell"] = "triangle"
    full = tomllib.loads(film)
    full["bodies"]["elastomer"]["formulation"] = "q1"
    full["contact"][0]["quadrature_degree"] = 5
    ring = tomllib.loads(block.replace('thickness = "1 mm"', 'section = "axisymmetric"'))
    ring["boundary"][1]["displacement"]["x"] = 0
    boxes = tomllib.loads(block.replace('thickness = "1 mm"', ""))
    boxes["geometry"]["kind"] = "two-boxes"
    for name in ("upper", "lower"):
        boxes["geometry"][name] |= {"depth": "1 mm", "elements": [2, 1, 2]}
    tetrahedra = {**boxes, "geometry": {**boxes["geometry"], "cell": "tetrahedron"}}
    for data in (*cases, triangles, full, ring, boxes, tetrahedra):
        model = build_model(Case.model_validate(data), MPI.COMM_SELF)
        StressField(model.problem.u, model.problem.solids).evaluate()
    for data in (full, ring, boxes):
        data["bodies"]["aluminium"] = SOFT_METAL
        data["bodies"]["elastomer"]["prony"] = [[0.5, "1 s"]]
        model = build_model(Case.model_validate(data), MPI.COMM_SELF)
        assert any(solid.flows for solid in model.problem.solids)
        assert all(solid.remembers for solid in model.problem.solids)
        for solid in model.problem.solids:
            solid.evaluate(tangent=True)
    assert compiled() == before


# -- Files of options in the working directory, which may be that of anyone's case, do not count ---

SAY = """
import json
import tribox.app
import tribox.app.build.model
import dolfinx, ffcx
from petsc4py import PETSc
found = [PETSc.Options().getAll(), dolfinx.jit.get_options(), ffcx.get_options()]
print(json.dumps(found, default=str))
"""


def test_option_files_of_the_working_directory_are_not_read(tmp_path):
    for name in (".petscrc", "petscrc"):
        (tmp_path / name).write_text("-malloc_view leak.txt\n-log_view :leak.txt\n")
    flags = {"cffi_extra_compile_args": ["-wrapper", "touch,leak.txt"]}
    (tmp_path / "dolfinx_jit_options.json").write_text(json.dumps(flags))
    (tmp_path / "ffcx_options.json").write_text(json.dumps({"epsilon": 0.5}))
    before = {path.name for path in tmp_path.iterdir()}
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root / "src"), "PETSC_OPTIONS": "-mine 1"}
    done = subprocess.run(
        [sys.executable, "-c", SAY], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    petsc, jit, ffcx = json.loads(done.stdout.splitlines()[0])
    assert petsc == {"skip_petscrc": None, "mine": "1"}
    assert "-wrapper" not in jit["cffi_extra_compile_args"]
    assert ffcx["epsilon"] != 0.5
    assert {path.name for path in tmp_path.iterdir()} == before
