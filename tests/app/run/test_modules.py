"""What a run loads: libraries that it does not need take longer than the run of a small case."""

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
NOT_NEEDED = (
    *("pandas", "meshio", "rich", "gmsh", "pyvista", "adios2", "pint", "jinja2", "numba",
     "IPython"),
    *("matplotlib.pyplot", "matplotlib.animation", "mpl_toolkits.axes_grid1"),
    *("scipy.optimize", "scipy.integrate", "scipy.interpolate", "scipy.stats", "scipy.cluster"),
)  # fmt: skip
# Runs the program as `python3 -m tribox` does, and tells what has been loaded by then.
SCRIPT = f"""
import json, runpy, sys
sys.argv = ["tribox", *sys.argv[1:]]
try:
    runpy.run_module("tribox", run_name="__main__", alter_sys=True)
except SystemExit as end:
    assert not end.code, end.code
found = [name for name in {NOT_NEEDED!r} if name in sys.modules]
print(json.dumps([found, "matplotlib.figure" in sys.modules]), file=sys.stderr)
"""


def test_a_run_with_figures_loads_what_it_needs(case_file, block, tmp_path):
    out = tmp_path / "out"
    words = ["run", str(case_file(block)), "--out", str(out), "--set", "output.figures=true"]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *words], capture_output=True, text=True, cwd=ROOT
    )
    found, drew = json.loads(done.stderr.splitlines()[-1])
    assert found == []
    assert drew and (out / "figures" / "deformed.png").is_file()
    kernels = json.loads((out / "summary.json").read_text())["kernels"]
    assert {"closest_points", "plane_contact"} & kernels.keys()
    assert all(re.fullmatch("[0-9a-f]{24}", key) for key in kernels.values())


def test_little_is_loaded_before_signals_are_obeyed():
    script = (
        "import sys; import tribox.__main__, tribox.app.run.process; "
        "print(*{'ctypes', 'pathlib', 'typing'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-S", "-c", script], cwd=ROOT / "src", capture_output=True, text=True
    )
    assert (done.stdout, done.stderr) == ("\n", "")
