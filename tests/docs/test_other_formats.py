"""What the page on meshes makes of files of other programs."""

import re

import gmsh
import numpy as np
import pytest

from tests.docs.blocks import find_blocks
from tests.docs.pages import ROOT
from tribox.geometry.meshes.drawing import mesh_drawing
from tribox.geometry.meshes.foreign import read_msh
from tribox.geometry.meshes.gmsh_model import gmsh_session

PART = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
*ELEMENT, type=T3D2, ELSET=Line1
1, 1, 2
*ELEMENT, type=CPS3, ELSET=Surface1
2, 1, 2, 3
3, 1, 3, 4
*ELSET, ELSET=pad_face
1
*ELSET, ELSET=pad
2, 3
"""


def block(language: str) -> str:
    """The one block of the section on other formats in this language."""
    [text] = [
        one.text
        for one in find_blocks(ROOT / "docs" / "meshes.md")
        if one.language == language and re.search("meshio|Merge", one.text)
    ]
    return text


def test_sets_of_another_programs_mesh_become_bodies_and_surfaces(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.inp").write_text(PART)
    exec(compile(block("python"), "page", "exec"), {})
    mesh = read_msh(tmp_path / "part.msh")
    assert list(mesh.bodies) == ["pad"] and list(mesh.surfaces) == ["pad_face"]
    assert len(mesh.cells) == 2 and len(mesh.facets("pad_face")) == 1


def test_a_drawing_fills_what_triangles_enclose(tmp_path):
    with gmsh_session("box"):
        gmsh.model.occ.addBox(0.0, 0.0, 0.0, 2.0, 1.0, 1.0)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "part.stl"))
    (tmp_path / "part.geo").write_text(block("geo"))
    mesh_drawing(tmp_path / "part.geo", tmp_path / "part.msh")
    mesh = read_msh(tmp_path / "part.msh")
    corners = mesh.position[mesh.cells]
    edges = corners[:, 1:] - corners[:, :1]
    volume = float(np.abs(np.linalg.det(edges)).sum()) / 6.0
    assert list(mesh.bodies) == ["part"] and volume == pytest.approx(2.0)
