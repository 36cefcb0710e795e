"""What a run loads: libraries that it does not need take longer than the run of a small case."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
NOT_NEEDED = (
    *(
        "pandas",
        "meshio",
        "rich",
        "gmsh",
        "pyvista",
        "adios2",
        "pint",
        "jinja2",
        "numba",
        "IPython",
    ),
    *("matplotlib.pyplot", "matplotlib.animation", "mpl_toolkits.axes_grid1"),
    *("scipy.optimize", "scipy.integrate", "scipy.interpolate", "scipy.stats", "scipy.cluster"),
)
# Runs the program as `python3 -m tribox` does, and tells what has been loaded by then.
SCRIPT = f"""
import json, runpy, sys
sys.argv = ["tribox", *sys.argv[1:]]
try:
    runpy.run_module("tribox", run_name="__main__", alter_sys=True)
except SystemExit as end:
    assert not end.code, end.code
late = __import__("tribox.app.run.late_modules", fromlist=["LATE"]).LATE
waiting = [n for n in late if type(sys.modules.get(n)).__name__ == "_LazyModule"]
found = [name for name in {NOT_NEEDED!r} if name in sys.modules]
print(json.dumps([found, sorted(waiting), "matplotlib.figure" in sys.modules]), file=sys.stderr)
"""


def test_a_run_with_figures_loads_what_it_needs(case_file, block, tmp_path):
    out = tmp_path / "out"
    words = ["run", str(case_file(block)), "--out", str(out), "--set", "output.figures=true"]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *words], capture_output=True, text=True, cwd=ROOT
    )
    found, waiting, drew = json.loads(done.stderr.splitlines()[-1])
    assert found == []
    assert drew and (out / "figures" / "deformed.png").is_file()
    kernels = json.loads((out / "summary.json").read_text())["kernels"]
    assert {"closest_points", "plane_contact"} & kernels.keys()
    assert all(re.fullmatch("[0-9a-f]{24}", key) for key in kernels.values())
    assert {"numpy.f2py", "scipy.sparse.csgraph", "scipy.spatial.transform"} <= set(waiting)


def test_little_is_loaded_before_signals_are_obeyed():
    script = (
        "import sys; import tribox.__main__, tribox.app.run.process; "
        "print(*{'ctypes', 'pathlib', 'typing'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-S", "-c", script], cwd=ROOT / "src", capture_output=True, text=True
    )
    assert (done.stdout, done.stderr) == ("\n", "")


def test_what_waits_is_there_when_it_is_asked_for():
    script = """
from tribox.app.run.late_modules import LATE, load_late
load_late()
import sys
import numpy, scipy.sparse, scipy.spatial
import scipy.sparse.linalg
from scipy.sparse.csgraph import dijkstra
graph = scipy.sparse.csr_matrix([[0.0, 2.0], [0.0, 0.0]])
assert dijkstra(graph, directed=False, indices=0).tolist() == [0.0, 2.0]
found = scipy.sparse.linalg.spsolve(scipy.sparse.csc_matrix([[2.0, 0.0], [0.0, 4.0]]), [2.0, 4.0])
assert found.tolist() == [1.0, 1.0]
assert scipy.spatial.transform.Rotation.identity().as_matrix().tolist()[0] == [1.0, 0.0, 0.0]
assert numpy.polynomial.Polynomial([1.0, 2.0])(3.0) == 7.0
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
