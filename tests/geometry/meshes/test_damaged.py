"""Damaged files cost a line, and never the program: gmsh reads them in a process of its own."""

import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI

from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes import drawing
from tribox.geometry.meshes.drawing import mesh_drawing
from tribox.geometry.meshes.gmsh_model import MeshError, ask, write_msh
from tribox.geometry.meshes.mesh import read

HEAD = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
CRASHING = HEAD + '$PhysicalNames\n1\n77777 2 "a"\n$EndPhysicalNames\n'
GREEDY = HEAD + "$Nodes\n1 9999999999 1 9999999999\n2 1 0 9999999999\n$EndNodes\n"


def one_line(path: Path) -> str:
    """The line that refuses a file."""
    with pytest.raises(MeshError) as caught:
        read(path, MPI.COMM_SELF)
    line = str(caught.value)
    assert line.startswith(f"{path}: ") and line.isprintable()
    return line


def test_a_file_that_gmsh_breaks_down_on_costs_a_line(tmp_path):
    (tmp_path / "mesh.msh").write_text(CRASHING)
    assert "gmsh broke down on it (SIG" in one_line(tmp_path / "mesh.msh")


def test_a_file_that_names_more_than_memory_holds_costs_a_line(tmp_path):
    (tmp_path / "mesh.msh").write_text(GREEDY)
    one_line(tmp_path / "mesh.msh")


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> bytes:
    """A file of two blocks of four cells each."""
    path, block = tmp_path_factory.mktemp("good") / "mesh.msh", Block(1.0, 0.5, (2, 2))
    write_msh(TwoBlocks(block, block), path)
    return path.read_bytes()


READ = """
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_CPU, (50, 50))
from mpi4py import MPI
from tribox.geometry.meshes.mesh import read
read(Path(sys.argv[1]), MPI.COMM_SELF)
"""


def test_limits_that_a_shell_or_a_batch_system_sets_stay(good, tmp_path):
    """Only the administrator may raise them: asked to, the system refused, and no mesh was read."""
    (tmp_path / "mesh.msh").write_bytes(good)
    call = [sys.executable, "-c", READ, str(tmp_path / "mesh.msh")]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_more_cells_than_allowed_are_refused(good, tmp_path):
    path = tmp_path / "mesh.msh"
    path.write_bytes(good)
    with pytest.raises(MeshError, match=r"8 cells; geometry\.max_cells = 7 allows no more"):
        read(path, MPI.COMM_SELF, most_cells=7)
    with path.open("ab") as stream:
        stream.truncate(10**9)
    with pytest.raises(MeshError, match=r"a file of 1 GB; geometry\.max_cells = 1000 is too few"):
        read(path, MPI.COMM_SELF, most_cells=1000)


@pytest.mark.parametrize(
    ("text", "longest", "said"),
    [
        ("Exit;", 60.0, "gmsh ended without a mesh: the file is damaged"),
        ("For i In {0:1e9}\nx = i;\nEndFor\n", 1.0, "gmsh was stopped; it may use 2 s"),
        # On a busy machine gmsh is imported, and its crash reported, in more than two seconds.
        ('Merge "crashing.msh";', 60.0, r"gmsh broke down on it \(SIG"),
    ],
)
def test_a_drawing_that_ends_gmsh_costs_a_line(tmp_path, monkeypatch, text, longest, said):
    monkeypatch.setattr(drawing, "LONGEST", longest)
    (tmp_path / "crashing.msh").write_text(CRASHING)
    (tmp_path / "part.geo").write_text(text)
    with pytest.raises(MeshError, match=said):
        mesh_drawing(tmp_path / "part.geo", tmp_path / "part.msh")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["crashing.msh", "part.geo"]


def test_the_process_is_no_rank_and_finds_its_modules_here_only(tmp_path, monkeypatch):
    """A directory with a mesh may hold anything, and mpirun counts who speaks to it."""
    told = tmp_path / "told"
    for name in ("json", "numpy"):
        (tmp_path / f"{name}.py").write_text(f"open({str(told)!r}, 'w')\n")
    child = tmp_path / "child"
    child.write_text('#!/bin/sh\nenv\necho "$@"\n')
    child.chmod(0o700)
    monkeypatch.setenv("PMIX_RANK", "1")
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", str(child))
        said = ask("read", child, "1", 10.0, 1 << 30).decode()
        child.write_text("#!/bin/sh\necho half an answer\nexit 3\n")
        with pytest.raises(MeshError, match="gmsh ended without a mesh: the file is damaged"):
            ask("read", child, "1", 10.0, 1 << 30)
    assert "PMIX" not in said and "OMPI" not in said
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    assert "no such file" in one_line(Path("missing.msh"))
    (tmp_path / "mesh.msh").write_text(HEAD)
    assert "no faces" in one_line(Path("mesh.msh"))
    assert not told.exists()


def test_no_mesh_file_is_run(good, tmp_path):
    """gmsh runs scripts, and takes for one what does not begin as a mesh."""
    command = f'SystemCall "touch {tmp_path}/ran";\n'.encode()
    path = tmp_path / "mesh.msh"
    path.write_bytes(command + good)
    assert "not a gmsh mesh" in one_line(path)
    (tmp_path / "mesh.msh.opt").write_bytes(command)
    for before in (b"", b"$Comments\nours\n$EndComments\n"):
        path.write_bytes(before + good)
        assert set(read(path, MPI.COMM_SELF).bodies) == {"elastomer", "aluminium"}
    assert not (tmp_path / "ran").exists()
