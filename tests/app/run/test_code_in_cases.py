"""Python that a case names: run where it may be, nowhere else, and told in one line if it fails."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from tests.app.conftest import BLOCK
from tests.own_law import CLOSED, OWN, documented_law, line_of, mischief, with_law
from tests.ranks import LIMIT, command
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.case.trust import CONTAINED, TRUSTED
from tribox.app.errors import SolutionError
from tribox.app.results import read
from tribox.app.run.run import run_case

ROOT = Path(__file__).parents[3]
FEW = 'steps = 3\n[[stage]]\nname = "slide"\nduration = "1 s"\nsteps = 6'


def short(block: str) -> str:
    """The small block in two pressing steps, of which the second slips."""
    assert FEW in block
    return block.replace(FEW, "steps = 2")


@pytest.fixture
def marked(block, case_file, tmp_path, monkeypatch) -> Path:
    """A case whose law leaves a file ``ran`` when it is imported."""
    monkeypatch.delenv(TRUSTED, raising=False)
    mark = f"open({str(tmp_path / 'ran')!r}, 'w').close()\n"
    (tmp_path / "my_law.py").write_text(mark + documented_law())
    return case_file(with_law(short(block)))


def test_only_a_trusted_run_imports_a_law(marked, tmp_path, tribox):
    ran, out, law = tmp_path / "ran", tmp_path / "out", tmp_path / "my_law.py"
    checked = tribox("check", marked)
    assert checked.returncode == 0, checked.stderr
    said = f"note: contact.0: the code of the friction law {law}:MyLaw was not run; tribox check"
    assert said in checked.stdout
    for words in (["run", marked, "--out", out], ["check", "--law", marked]):
        refused = tribox(*words)
        assert refused.returncode == 2 and refused.stderr.count("\n") == 1
        assert f"makes this case code: {law} would be run" in refused.stderr
        assert "--trust" in refused.stderr and f"{TRUSTED}={tmp_path}" in refused.stderr
    assert tribox("mesh", marked, "--out", tmp_path / "mesh").returncode == 0
    assert tribox("map", marked).returncode == 2
    assert not ran.exists() and not out.exists()
    assert tribox("run", marked, "--out", out, "--trust").returncode == 0
    assert ran.exists()
    ran.unlink()
    # From here on there is an old case.toml, with a copy of the law beside it.
    assert (out / "inputs" / "my_law.py").read_text() == law.read_text()
    assert tribox("report", out).returncode == tribox("plot", out).returncode == 0
    assert read(out).case.contact[0].friction.law == "python"
    plain = tmp_path / "plain.toml"
    plain.write_text(short(BLOCK))
    again = tribox("run", plain, "--out", out, "--force")
    assert again.returncode == 0, again.stderr
    assert not ran.exists() and not (out / "inputs").exists()


def test_a_trusted_directory_is_enough(marked, tmp_path, tribox, monkeypatch):
    monkeypatch.setenv(TRUSTED, str(tmp_path))
    done = tribox("run", marked, "--out", tmp_path / "out")
    assert done.returncode == 0 and (tmp_path / "ran").exists()


@pytest.mark.long
@pytest.mark.skipif(not Path("/usr/bin/mpirun").exists(), reason="needs Debian's mpirun")
def test_the_ranks_of_a_sweeps_values_import_what_is_trusted_and_nothing_else(
    marked, tmp_path, environment
):
    """Nothing from the working directory, with the system's own mpirun."""
    for name in ("tribox", "numpy", "pydantic", "mpi4py", "dolfinx", "typer"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'wrong')!r}, 'a')\n")
    values = '[sweep]\nkey = "contact.0.friction.parameters.mu"\nvalues = [0.2]\n'
    (tmp_path / "case.toml").write_text(marked.read_text() + values)
    kept = {key: value for key, value in environment.items() if key != "PYTHONSAFEPATH"}
    done = subprocess.run(
        [sys.executable, "-P", "-m", "tribox", "run", "case.toml", "--np", "2", "--trust"],
        cwd=tmp_path,
        env=kept | {"PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "ran").exists() and not (tmp_path / "wrong").exists()
    results = tmp_path / "results" / "case"
    assert list(json.loads((results / "summary.json").read_text())["inputs"]) == ["my_law.py"]
    summary = read(results / "mu=0.2").summary
    assert (summary["status"], summary["ranks"]) == ("done", 2)


def test_check_tries_laws(marked, tmp_path, tribox):
    good = tribox("check", "--law", "--trust", marked)
    assert good.returncode == 0, good.stderr
    assert "contact.0: friction law my_law.py:MyLaw" in good.stdout
    assert "was not run" not in good.stdout
    row = re.search(r"d_traction_d_slip +(\d+) +(\S+) +1e-06", good.stdout)
    assert row and int(row[1]) > 1000 and float(row[2]) < 1e-7
    wrong = documented_law("(np.eye(dim) - outer)", "(np.eye(dim) - 0.99 * outer)")
    (tmp_path / "my_law.py").write_text(wrong)
    bad = tribox("check", "--law", "--trust", marked)
    assert bad.returncode == 2
    assert re.search(r"d_traction_d_slip .* WRONG 2D, dt|d_traction_d_slip .* WRONG 3D", bad.stdout)
    assert bad.stderr == (
        "tribox: friction laws that are not what they should be: contact.0: my_law.py:MyLaw\n"
    )


def test_a_drawing_needs_trust_outside_the_container(tmp_path, tribox, monkeypatch):
    drawing, case, ran = tmp_path / "pad.geo", tmp_path / "pad.toml", tmp_path / "ran"
    plain = 'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 1, 1};\nMesh.MeshSizeMax = 1;\n'
    plain += 'Physical Surface("pad") = {1};\nPhysical Curve("foot") = {1};\n'
    drawing.write_text(plain + f'SystemCall "touch {ran}";\n')
    case.write_text(DRAWN)
    commands = (["mesh", drawing, "--force"], ["mesh", case, "--out", tmp_path / "mesh", "--force"],
                ["check", case], ["run", case, "--out", tmp_path / "out", "--force"])  # fmt: skip
    monkeypatch.delenv(CONTAINED)
    for words in commands:
        refused = tribox(*words)
        assert refused.returncode == 2 and refused.stderr.count("\n") == 1
        said = f"{drawing} is code" if drawing in words else f"makes this case code: {drawing} wo"
        assert said in refused.stderr and "--trust" in refused.stderr
        assert not ran.exists()
    case.write_text(DRAWN.replace('"pad.geo"', f'"part.step"\nmeshed = "{drawing}"'))
    (tmp_path / "part.step").write_text("ISO-10303-21;\n")
    refused = tribox("check", case)
    assert "is a drawing; what was made of one is a mesh" in refused.stderr and not ran.exists()
    case.write_text(DRAWN)
    for words in commands:
        allowed = tribox(*words, "--trust")
        assert allowed.returncode == 0 and ran.exists(), allowed.stderr
        ran.unlink()
    monkeypatch.setenv(TRUSTED, str(tmp_path))
    for words in commands:
        assert tribox(*words).returncode == 0 and ran.exists()
        ran.unlink()
    monkeypatch.delenv(TRUSTED)
    monkeypatch.setenv(CONTAINED, "1")
    assert f"{CONTAINED}=1" in (ROOT / "Dockerfile").read_text()
    assert tribox("check", case).returncode == 0 and ran.exists()
    ran.unlink()
    monkeypatch.setenv("APPTAINER_CONTAINER", "tribox.sif")  # there it could write in homes
    assert tribox("check", case).returncode == 2 and not ran.exists()


DRAWN = """
[geometry]
mesh = "pad.geo"
scale = "mm"
[bodies.pad]
material = "neo-hookean"
E = "5 MPa"
nu = 0.3
[[boundary]]
surface = "foot"
displacement = { x = 0, y = 0 }
[[stage]]
name = "rest"
duration = "1 s"
steps = 1
[output]
figures = false
"""


# --- laws that fail ------------------------------------------------------------------------------

AT = line_of(CLOSED) + 2  # where mischief is done
FAILS = {
    "raises": ("raise KeyError('gone')", rf"my_law\.py:{AT}: KeyError: 'gone'"),
    "leaves": ("raise SystemExit(0)", rf"my_law\.py:{AT}: SystemExit: 0"),
    "nan": ("pressure = pressure * np.nan", "not finite: traction at 50 of 50 points, the first"),
    "shape": ("pressure = pressure[1:]", r"my_law\.py:\d\d: ValueError: operands could not"),
}


@pytest.mark.parametrize("name", FAILS)
def test_a_law_that_fails_in_a_run_is_one_line_and_the_state_is_saved(
    name, block, case_file, tmp_path, tribox
):
    statement, said = FAILS[name]
    (tmp_path / "my_law.py").write_text(mischief(statement))
    path, out = case_file(with_law(short(block))), tmp_path / "out"
    done = tribox("run", path, "--out", out, "--trust")
    assert done.returncode == 3
    [line] = done.stderr.splitlines()
    assert line.startswith("tribox: stage press, time 0.5 s: ") and re.search(said, line)
    assert len(read(out).history) == 1 and (out / "fields" / "000001.vtu").is_file()
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "failed" and re.search(said, summary["failure"])


def test_a_law_that_cannot_be_made_ends_before_the_run(block, case_file, tmp_path, tribox):
    (tmp_path / "my_law.py").write_text(documented_law())
    path = case_file(with_law(short(block), OWN.replace("mu =", "nu =")))
    done = tribox("run", path, "--out", tmp_path / "out", "--trust")
    assert done.returncode == 2 and not (tmp_path / "out").exists()
    [line] = done.stderr.splitlines()
    assert "contact.0.friction.parameters: MyLaw: TypeError: " in line


def explicit(directory: Path, law: str) -> Case:
    """A block that flies onto another, with a law from a file."""
    (directory / "my_law.py").write_text(law)
    text = with_law(BLOCK).split("[[boundary]]")[0].replace("nu = 0.45", MOVING)
    text = text.replace("nu = 0.33", 'nu = 0.33\ndensity = "2700 kg/m^3"') + EXPLICIT
    path = directory / "explicit.toml"
    path.write_text(text)
    return load_case(path)


MOVING = 'nu = 0.45\ndensity = "1100 kg/m^3"\nvelocity = { x = "2 m/s", y = "-2 m/s" }'
EXPLICIT = """
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0 }
[[stage]]
name = "fly"
duration = "4 us"
steps = 4
[solver]
kind = "explicit"
[output]
figures = false
"""


@pytest.mark.parametrize("statement", ["raise KeyError('gone')", "pressure = pressure * np.nan"])
def test_a_law_that_fails_in_an_explicit_run(statement, tmp_path):
    case = explicit(tmp_path, mischief(statement))
    said = f"fly, time .*: the friction law my_law.py:MyLaw (fails: .*:{AT}: Key|answers with n)"
    with pytest.raises(SolutionError, match=said):
        run_case(case, tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    history = read(tmp_path / "out").history
    assert 1 <= len(history) < 4 and history.kinetic_energy.gt(0.0).all()
    mesh = read(tmp_path / "out").fields()
    assert abs(mesh.point_data["displacement"]).max() < 1e-4  # finite, and of a few steps


def on_one_rank(comm: MPI.Comm, directory: Path) -> Any:
    """A law that fails on the last rank alone, in implicit and in explicit steps, and one
    that cannot be loaded there."""
    here = "from mpi4py import MPI\nimport numpy as np\nLAST = MPI.COMM_WORLD.rank == 1\n"
    code = mischief("if LAST: raise KeyError('gone')").replace("import numpy as np\n", here, 1)
    if comm.rank == 0:
        (directory / "my_law.py").write_text(code)
        (directory / "case.toml").write_text(with_law(short(BLOCK)))
        explicit(directory, code)
        unloadable = f"{here}if LAST: raise ImportError('not here')\n{documented_law()}"
        (directory / "load").mkdir()
        (directory / "load" / "my_law.py").write_text(unloadable)
        (directory / "load" / "case.toml").write_text(with_law(short(BLOCK)))
    comm.barrier()
    ended = []
    for name in ("case.toml", "explicit.toml", "load/case.toml"):
        out = directory / Path(name).with_suffix("").name / name.count("/").__str__()
        ended.append(command(comm, "run", directory / name, "--trust", "--out", out))
    return ended


@pytest.mark.mpi(on_one_rank, 2)
def test_a_law_that_fails_on_one_rank_ends_all(on_ranks):
    implicit, explicit_run, load = on_ranks(on_one_rank, 2)
    for codes, said in (implicit, explicit_run):
        assert codes == [3, 3]
        assert len(re.findall(r"tribox: stage .*my_law\.py:\d+: KeyError: 'gone'", said)) == 1
    assert load[0] == [2, 2]
    assert "friction.class: cannot be loaded: " in load[1] and "not here" in load[1]
