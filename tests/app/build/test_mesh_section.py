"""What a case says of a mesh of the user's own, held against the mesh itself."""

import re
from pathlib import Path

import gmsh
import pytest
from mpi4py import MPI

from tribox.app.build.model import build_model
from tribox.app.case.case import resolved_toml
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError
from tribox.geometry.generators.two_blocks import Block, Box, TwoBlocks
from tribox.geometry.meshes.gmsh_model import write_msh

BODIES = """
[bodies]
elastomer = { material = "neo-hookean", E = "5 MPa", nu = 0.495 }
aluminium = { material = "hencky", E = "70 GPa", nu = 0.33 }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "coulomb", mu = 0.2 }
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "top"
displacement = { y = [["0 s", "0 mm"], ["1 s", "-0.05 mm"]] }
[[stage]]
name = "press"
duration = "1 s"
"""
SHAPES = {
    "boxes": TwoBlocks(Box(1e-3, 1e-3, 1e-3, (2, 2, 2)), Box(2e-3, 1e-3, 2e-3, (2, 2, 2))),
    "tetrahedra": TwoBlocks(
        Box(1e-3, 1e-3, 1e-3, (2, 2, 2)), Box(2e-3, 1e-3, 2e-3, (2, 2, 2)), cell="tetrahedron"
    ),
    "blocks": TwoBlocks(Block(1e-3, 1e-3, (2, 2)), Block(2e-3, 1e-3, (2, 2)), 0.0),
    "astride": TwoBlocks(Block(1e-3, 1e-3, (2, 2)), Block(2e-3, 1e-3, (2, 2)), -0.5e-3),
}
SHAPES |= {
    "in millimetres": TwoBlocks(Block(1.0, 1.0, (2, 2)), Block(2.0, 1.0, (3, 2)), 0.0),
    "apart": TwoBlocks(Block(1e-3, 1e-3, (2, 2)), Block(2e-3, 1e-3, (3, 2)), 0.0, gap=2e-3),
    "coarse": TwoBlocks(Block(1e-3, 1e-3, (2, 2)), Block(2e-3, 1e-3, (20, 2)), 0.0),
}


class Astride:
    """The blocks, with a surface that is partly on each."""

    def build(self) -> None:
        SHAPES["blocks"].build()
        groups = gmsh.model.getPhysicalGroups(1)
        sides = [(d, t) for d, t in groups if gmsh.model.getPhysicalName(d, t).endswith("_right")]
        curves = [c for d, t in sides for c in gmsh.model.getEntitiesForPhysicalGroup(d, t)]
        gmsh.model.removePhysicalGroups(sides)
        gmsh.model.addPhysicalGroup(1, curves, name="both")


SHAPES["one surface"] = Astride()


def write_case(shape: str, geometry: str, directory: Path) -> Path:
    """Write the mesh of a shape and a case with it."""
    write_msh(SHAPES[shape], directory / "mesh.msh")
    path = directory / "case.toml"
    path.write_text(f'[geometry]\nmesh = "mesh.msh"\n{geometry}\n{BODIES}')
    return path


@pytest.fixture
def model(tmp_path: Path):
    """Builds the model of a shape written to a file, with lines for [geometry]."""

    def build(shape: str, geometry: str = "", *overrides: str):
        path = write_case(shape, geometry, tmp_path)
        return build_model(load_case(path, list(overrides)), MPI.COMM_SELF)

    return build


def test_meshes_in_space_and_of_revolution(model):
    made = model("boxes", "", "boundary.0.displacement.z=0")
    assert (made.section, made.thickness, made.problem.dim) == ("3D", 1.0, 3)
    assert {note[:14] for note in made.notes} == {"body elastomer"}
    assert sum("in x" in note or "in z" in note for note in made.notes) == 2
    ring = model("blocks", 'section = "axisymmetric"')
    assert (ring.section, ring.thickness) == ("axisymmetric", 1.0)
    assert all(solid.section == "axisymmetric" for solid in ring.problem.solids)
    assert not any("in x" in note for note in ring.notes)
    slab = model("blocks", 'thickness = "2 mm"', "boundary.1.displacement.x=0")
    assert (slab.section, slab.thickness) == ("plane-strain", 2e-3)
    assert model("blocks").thickness == 1.0


@pytest.mark.parametrize(
    ("shape", "geometry", "resolved"),
    [
        ("blocks", "", ("plane-strain", 1.0)),
        ("blocks", 'thickness = "2 mm"', ("plane-strain", 2e-3)),
        ("blocks", 'section = "axisymmetric"', ("axisymmetric", None)),
        ("boxes", "", (None, None)),
    ],
)
def test_a_resolved_case_says_what_its_mesh_stands_for(model, tmp_path, shape, geometry, resolved):
    case = model(shape, geometry).case
    assert (case.geometry.section, case.geometry.thickness) == resolved
    assert {body.formulation for body in case.bodies.values()} == {"q1-sri"}
    assert case.contact[0].quadrature_degree == (5 if shape == "boxes" else 9)
    again = tmp_path / "again.toml"
    again.write_text(resolved_toml(case), encoding="utf-8")
    assert load_case(again) == case
    assert build_model(load_case(again), MPI.COMM_SELF).case == case


def test_linear_tetrahedra_that_lock_are_pointed_out(model):
    assert any("linear tetrahedra lock" in note for note in model("tetrahedra").notes)
    second = model("tetrahedra", "", "bodies.elastomer.formulation=q2")
    assert not any("lock" in note for note in second.notes)
    assert second.problem.space.dofmap.index_map.size_global == 2 * 5**3


@pytest.mark.parametrize(
    ("shape", "cells"), [("blocks", "quadrilaterals"), ("boxes", "hexahedra")], ids=["2D", "3D"]
)
@pytest.mark.parametrize(
    ("formulation", "nu", "said"), [("q1", 0.48, 1), ("q1", 0.45, "3D"), ("q1-sri", 0.4995, 0)]
)
def test_rubber_of_full_integration_is_said_to_lock(model, shape, cells, formulation, nu, said):
    """The metal beside it, K/G = 2.6, does not; at .45 hexahedra err by 6 %, others by 3."""
    keys = f"formulation={formulation}", f"nu={nu}"
    notes = model(shape, "", *(f"bodies.elastomer.{key}" for key in keys)).notes
    lines = [note for note in notes if "lock" in note]
    assert len(lines) == (shape == "boxes" if said == "3D" else said)
    for line in lines:
        ratio = 2.0 * (1.0 + nu) / 3.0 / (1.0 - 2.0 * nu)
        said_of = f"body elastomer: linear {cells} of full integration lock with K/G = {ratio:.3g}"
        assert said_of in line
        assert line.endswith('; use formulation = "q1-sri"')


@pytest.mark.parametrize(
    ("shape", "geometry", "overrides", "said"),
    [
        ("boxes", 'thickness = "1 mm"', [], "geometry.thickness = 0.001 m: goes with plane strain"),
        ("boxes", 'section = "axisymmetric"', [], 'geometry.section = "axisymmetric": the mesh is'),
        ("astride", 'section = "axisymmetric"', [], "the mesh reaches x = -0.0005 m; x is the"),
        ("blocks", "", ["boundary.0.displacement.z=0"], "there is no z in a mesh in the plane"),
        ("tetrahedra", "", ["bodies.elastomer.formulation=q1-sri"],
         'bodies.elastomer.formulation: "q1-sri" needs quadrilaterals or hexahedra'),
        ("blocks", "", ["bodies.elastomer.formulation=q2", "bodies.aluminium.formulation=q1"],
         'bodies.aluminium.formulation: bodies.elastomer has "q2"'),
        ("one surface", "", ["boundary.1.surface=both"],
         'surface "both" must lie on one body; it lies on elastomer, aluminium'),
    ],
)  # fmt: skip
def test_what_does_not_go_with_the_mesh_is_named(model, shape, geometry, overrides, said):
    with pytest.raises(InputError) as error:
        model(shape, geometry, *overrides)
    assert said in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ("in millimetres", r"mesh \S+mesh.msh: 2 m long; coordinates are taken as metres"),
        ("apart", "contact.0: elastomer_contact and aluminium_contact start 0.002 m apart"),
        ("coarse", "contact.0: the facets of the slave elastomer_contact are 5 times as long as"),
    ],
)
def test_a_mesh_that_may_not_be_meant_so_is_pointed_out(model, shape, said):
    assert sum(bool(re.match(said, note)) for note in model(shape).notes) == 1
    assert not any(re.match(said, note) for note in model("blocks").notes)


def test_a_smooth_master_that_bulges_into_the_slave_is_named(model, monkeypatch):
    monkeypatch.setattr(
        "tribox.app.build.pair_at_start.OVERLAP", -1.0
    )  # bodies that touch overlap too much already
    with pytest.raises(
        InputError, match=r'not overlap \(but as a press fit: interference = "drawn"\)$'
    ):
        model("blocks")
    bulges = r"not overlap .*; a smooth master bulges .* gap of (0|[\d.]+e-20) m"
    with pytest.raises(InputError, match=bulges):
        model("blocks", "", "contact.0.smoothing_angle=30 deg")


def notes_in_millimetres(comm, directory):
    """What there is to say of a mesh in millimetres, the same on all ranks."""
    if comm.rank == 0:
        write_case("in millimetres", "", directory)
    comm.barrier()
    notes = build_model(load_case(directory / "case.toml"), comm).notes
    assert len(set(map(tuple, comm.allgather(notes)))) == 1
    return notes


@pytest.mark.mpi(notes_in_millimetres, 3)
def test_ranks_agree_on_what_there_is_to_say(on_ranks):
    def local(notes):
        """Notes without the directory of the mesh."""
        return [re.sub(r"\S+/mesh.msh", "mesh.msh", note) for note in notes]

    assert local(on_ranks(notes_in_millimetres, 3)) == local(on_ranks(notes_in_millimetres, 1))
