"""Meshes of a case that cannot be used, or hold more than was meant."""

from __future__ import annotations

import pytest
from mpi4py import MPI

from tests.geometry.meshes.test_damaged import CRASHING
from tribox.app.build.mesh import make_mesh
from tribox.app.build.mesh_notes import many_cells
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.gmsh_model import write_msh

BLOCKS = TwoBlocks(Block(1e-3, 5e-4, (3, 2)), Block(1e-3, 5e-4, (3, 2)))


@pytest.fixture
def own_mesh(case_file, block):
    """The small block with a mesh file, which is still to be written."""
    (head, rest) = block.split("[geometry]")[0], block.split("[bodies.elastomer]", 1)[1]

    def write(lines=""):
        path = case_file(f'{head}[geometry]\nmesh = "own.msh"\n{lines}\n[bodies.elastomer]{rest}')
        return path, path.with_name("own.msh")

    case_file("").with_name("own.msh").write_text(CRASHING)
    return write


@pytest.mark.parametrize("command", ["check", "run", "mesh"])
def test_a_mesh_that_gmsh_breaks_down_on_is_wrong_input(own_mesh, tribox, command):
    path, msh = own_mesh()
    done = tribox(command, path)
    assert done.returncode == 2
    [line] = done.stderr.splitlines()
    assert line.startswith(f"tribox: {path}: geometry.mesh: {msh}: gmsh broke down on it (SIG")


def test_more_cells_than_the_case_allows_are_refused(own_mesh):
    path, msh = own_mesh("max_cells = 11")
    write_msh(BLOCKS, msh)
    with pytest.raises(InputError, match=r"12 cells; geometry\.max_cells = 11 allows no more"):
        make_mesh(load_case(path), MPI.COMM_SELF)
    path, _ = own_mesh("max_cells = 23")
    case = load_case(path)
    named = make_mesh(case, MPI.COMM_SELF)
    assert list(many_cells(case, named)) == ["the mesh has 12 cells; geometry.max_cells allows 23"]
    path, _ = own_mesh("max_cells = 24")
    assert not list(many_cells(load_case(path), named))
