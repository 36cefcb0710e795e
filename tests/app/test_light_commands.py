"""Commands that solve nothing start without the solver's libraries."""

import csv
import json
import subprocess
import sys
from pathlib import Path

from tests.app.figures.made_results import write_strip
from tests.ranks import LIMIT
from tribox.app.simulation.history import COLUMNS

ROOT = Path(__file__).parents[2]
DATA = ROOT / "cases" / "data" / "tribometer-synthetic.csv"
PULLED = DATA.with_name("metal-cycle-synthetic.csv")
HEAVY = ("dolfinx", "petsc4py", "mpi4py")
# Figures are made without pyplot, which would keep each of them open until it is told to close it.
PYPLOT = "matplotlib.pyplot"
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
    print(json.dumps([line[0], code, loaded]), file=sys.stderr)
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
    out, strip = results(tmp_path / "out", block), write_strip(tmp_path / "strip")
    lines = [
        ["--version"],
        ["--help"],
        ["schema"],
        ["materials"],
        ["materials", "AA1050-O"],
        ["check", str(wrong)],
        ["plot", str(out)],
        ["plot", str(strip), "--animate"],
        ["report", str(out)],
        ["init", "own-mesh", str(tmp_path / "starter")],
        ["map", "--out", str(tmp_path / "map")],
        ["fit", str(DATA), "--parameters", "mu_s,eta_b", "--out", str(tmp_path / "fit")],
        ["fit", "--material", str(PULLED), "--law", "linear", "--out", str(tmp_path / "metal")],
    ]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, json.dumps(lines)],
        capture_output=True, text=True, cwd=ROOT, timeout=LIMIT,
    )  # fmt: skip
    told = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("[")]
    codes = {"check": 2}
    assert told == [[line[0], codes.get(line[0], 0), []] for line in lines], done.stderr
    assert (out / "figures" / "history.png").is_file()
    assert (strip / "figures" / "deformed.png").is_file()
    assert (strip / "figures" / "animation.gif").is_file()
    assert (tmp_path / "map" / "summary.json").is_file()
    assert (tmp_path / "fit" / "fit.json").is_file()
    assert (tmp_path / "metal" / "figures" / "fit.png").is_file()


def test_the_case_that_runs_loads_the_solver(tmp_path, block):
    right = tmp_path / "right.toml"
    right.write_text(block)
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, json.dumps([["check", str(right)]])],
        capture_output=True, text=True, cwd=ROOT, timeout=LIMIT,
    )  # fmt: skip
    assert json.loads(done.stderr.splitlines()[-1]) == ["check", 0, list(HEAVY)]


def test_commands_without_a_terminal_load_neither_rich_nor_units(tmp_path):
    lines = [["--version"], ["map", "--out", str(tmp_path / "map")]]
    script = SCRIPT.replace(repr(HEAVY), repr((*HEAVY, "pint", "rich", "scipy")))
    done = subprocess.run(
        [sys.executable, "-c", script, json.dumps(lines)],
        capture_output=True, text=True, cwd=ROOT, timeout=LIMIT,
    )  # fmt: skip
    told = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("[")]
    assert told == [["--version", 0, []], ["map", 0, []]]


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
