"""What a run reads beside its case file lies in its results, which can be run again from there."""

import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import pytest
from mpi4py import MPI

from tests.own_law import documented_law, with_law
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError
from tribox.app.results.directory import sha256_of
from tribox.app.results.inputs import input_files, keep_inputs, write_case
from tribox.app.run.run import run_case
from tribox.geometry.meshes.gmsh_model import write_msh


@pytest.fixture
def made(block: str, tmp_path: Path) -> Path:
    """A case with a mesh and a law in files of their own, in a directory ``made``."""
    there = tmp_path / "made"
    (there / "meshes").mkdir(parents=True)
    (there / "case.toml").write_text(block)
    write_msh(load_case(there / "case.toml").geometry.shape(), there / "meshes" / "two.msh")
    (there / "my_law.py").write_text(documented_law())
    data = with_law(block).split("[bodies.elastomer]")
    text = f'[geometry]\nmesh = "meshes/two.msh"\n[bodies.elastomer]{data[1]}'
    path = there / "own.toml"
    path.write_text(text.replace("steps = 3", "steps = 1").replace("steps = 6", "steps = 2"))
    return path


def run(case_file: Path, out: Path) -> None:
    run_case(load_case(case_file), out, quiet=True, comm=MPI.COMM_SELF)


def test_a_results_directory_alone_gives_the_same_history(made, tmp_path):
    first, moved = tmp_path / "first", tmp_path / "elsewhere" / "first"
    run(made, first)
    text = (first / "case.toml").read_text()
    assert 'mesh = "inputs/two.msh"' in text and 'class = "inputs/my_law.py:MyLaw"' in text
    assert str(tmp_path) not in text
    sums = json.loads((first / "summary.json").read_text())["inputs"]
    kept = [path for path in (first / "inputs").iterdir() if path.name != "SHA256SUMS"]
    assert sums == {path.name: sha256_of(path) for path in kept} and len(sums) == 2
    subprocess.run(["sha256sum", "--check", "SHA256SUMS"], cwd=first / "inputs", check=True)
    assert sums["my_law.py"] == hashlib.sha256(documented_law().encode()).hexdigest()
    shutil.rmtree(made.parent)
    shutil.move(first, moved)
    run(moved / "case.toml", tmp_path / "second")
    for name in ("history.csv", "contacts.csv", "surfaces.csv", "case.toml"):
        assert (tmp_path / "second" / name).read_bytes() == (moved / name).read_bytes()


def test_results_are_never_written_over_what_they_are_made_from(made, tmp_path, tribox):
    first = tmp_path / "first"
    run(made, first)
    for out in (first, first / "inputs"):
        refused = tribox("run", first / "case.toml", "--out", out, "--force", "--trust")
        assert refused.returncode == 2 and "which the run reads" in refused.stderr
    laws = made.parent / "laws"
    laws.mkdir()
    (laws / "other.py").write_text(documented_law())
    words = ["--set", "contact.0.friction.class=laws/other.py:MyLaw", "--out", laws, "--force"]
    refused = tribox("run", made, "--trust", *words)
    assert refused.returncode == 2 and "holds other.py, which the run reads" in refused.stderr
    assert sorted(p.name for p in (first / "inputs").iterdir()) == [
        "SHA256SUMS",
        "my_law.py",
        "two.msh",
    ]
    again = tribox("run", made, "--out", first, "--force", "--trust")  # inputs are results
    assert again.returncode == 0, again.stderr


def test_inputs_of_somebody_else_are_never_cleared(made, tmp_path, tribox):
    """A directory of this name with one's own meshes in it, and no case file beside it."""
    out = tmp_path / "project"
    (out / "inputs").mkdir(parents=True)
    (out / "inputs" / "two.msh").write_text("the only one there is")
    words = ["run", made, "--out", out, "--force", "--trust"]
    for sums in (None, "", f"{'0' * 64}  my_law.py\n"):
        if sums is not None:
            (out / "inputs" / "SHA256SUMS").write_text(sums)
        refused = tribox(*words)
        assert refused.returncode == 2 and "which is no result of tribox" in refused.stderr
        assert "holds inputs/" in refused.stderr
    assert (out / "inputs" / "two.msh").read_text() == "the only one there is"


def test_a_sweep_holds_one_copy_for_all_its_values(made, tmp_path, tribox):
    sweep = '[sweep]\nkey = "contact.0.friction.parameters.mu"\nvalues = [0.2, 0.3]\n'
    made.write_text(made.read_text() + sweep)
    out = tmp_path / "out"
    words = ["--jobs", "1", "--trust"]
    done = tribox("run", made, "--out", out, *words)
    assert done.returncode == 0, done.stderr
    meshes = [out / "inputs" / "two.msh", *(out / f"mu=0.{k}/inputs/two.msh" for k in (2, 3))]
    assert len({path.stat().st_ino for path in meshes}) == 1
    shutil.rmtree(made.parent)
    for part in ("mu=0.2", "mu=0.3"):
        run(out / part / "case.toml", tmp_path / part)
        text = (out / part / "history.csv").read_text()
        assert (tmp_path / part / "history.csv").read_text() == text
    again = load_case(out / "case.toml")
    assert [label for label, _ in again.sweep_cases()] == ["mu=0.2", "mu=0.3"]
    assert set(input_files(again)) == {out / "inputs" / "two.msh", out / "inputs" / "my_law.py"}


def test_a_sweep_over_files_keeps_them_all_under_the_same_labels(made, tmp_path):
    other = made.parent / "other"
    other.mkdir()
    (other / "my_law.py").write_text(documented_law() + "\n")
    (other / "your_law.py").write_text(documented_law() + "\n\n")
    values = '["my_law.py:MyLaw", "other/your_law.py:MyLaw"]'
    sweep = f'[sweep]\nkey = "contact.0.friction.class"\nvalues = {values}\n'
    made.write_text(made.read_text() + sweep)
    out = tmp_path / "out"
    out.mkdir()
    case = load_case(made)
    kept = keep_inputs(case, out)
    assert set(kept.sums) == {"two.msh", "my_law.py", "your_law.py"}
    write_case(case, out, kept)
    again = load_case(out / "case.toml")
    assert again.sweep is not None and case.sweep is not None
    assert again.sweep.values == ("inputs/my_law.py:MyLaw", "inputs/your_law.py:MyLaw")
    assert again.sweep.labels == case.sweep.labels
    assert again.sweep.labels == ("class=my_law.py_MyLaw", "class=your_law.py_MyLaw")


def test_files_of_the_same_name_are_kept_apart(made, tmp_path):
    other = made.parent / "other"
    other.mkdir()
    (other / "my_law.py").write_text(documented_law() + "\n")
    data = load_case(made).model_dump(mode="json", exclude_unset=True)
    pair = data["contact"][0] | {"slave": "elastomer_left", "master": "aluminium_left"}
    friction = data["contact"][0]["friction"] | {"class": f"{other}/my_law.py:MyLaw"}
    data["contact"].append(pair | {"friction": friction})
    case = Case.model_validate(data)
    (tmp_path / "out").mkdir()
    kept = keep_inputs(case, tmp_path / "out")
    assert set(kept.sums) == {"two.msh", "my_law.py", "my_law-2.py"}
    assert kept.names[other / "my_law.py"] == "my_law-2.py"
    write_case(case, tmp_path / "out", kept)
    again = load_case(tmp_path / "out" / "case.toml").contact
    assert [c.friction.file.name for c in again] == ["my_law.py", "my_law-2.py"]


def test_a_checksum_of_nothing_is_an_error(tmp_path):
    with pytest.raises(InputError, match=r"gone\.msh: cannot be read \(No such file"):
        sha256_of(tmp_path / "gone.msh")
