"""Files of options in the working directory, which may be that of anyone's case, do not count."""

import json
import os
import subprocess
import sys
from pathlib import Path

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
