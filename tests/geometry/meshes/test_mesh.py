"""Named meshes: measures, names, what a file may hold, errors, and independence of ranks."""

from pathlib import Path

import dolfinx
import gmsh
import numpy as np
import pytest
import ufl
from mpi4py import MPI

from tests.geometry.meshes.test_damaged import CRASHING
from tribox.app.build.mesh import bodies_sharing_nodes
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.meshes.foreign import read_msh
from tribox.geometry.meshes.gmsh_model import MeshError, gmsh_session, write_msh
from tribox.geometry.meshes.mesh import generate, read

BLOCKS = TwoBlocks(
    Block(1.0e-3, 0.5e-3, (8, 4), grading=3.0), Block(2.0e-3, 0.4e-3, (13, 5)), offset=0.35e-3
)
MEASURES = {
    "elastomer": 0.5e-6, "aluminium": 0.8e-6, "elastomer_contact": 1.0e-3,
    "aluminium_contact": 2.0e-3, "top": 1.0e-3, "bottom": 2.0e-3, "elastomer_left": 0.5e-3,
    "elastomer_right": 0.5e-3, "aluminium_left": 0.4e-3, "aluminium_right": 0.4e-3,
}  # fmt: skip


def resultants(named):
    """The area of each body and the length of each surface, integrated on all processes."""
    mesh = named.mesh
    tdim = mesh.topology.dim
    found = {}
    for names, dim, kind in ((named.bodies, tdim, "dx"), (named.surfaces, tdim - 1, "ds")):
        for name in names:
            entities = named.cells(name) if dim == tdim else named.facets(name)
            marks = dolfinx.mesh.meshtags(mesh, dim, entities, np.ones(len(entities), np.int32))
            # The same form for all: one compilation.
            measure = ufl.Measure(kind, domain=mesh, subdomain_data=marks)(1)
            one = dolfinx.fem.Constant(mesh, 1.0)
            local = dolfinx.fem.assemble_scalar(dolfinx.fem.form(one * measure))
            found[name] = mesh.comm.allreduce(local)
    return found


def strip():
    """Two unit squares one beside the other, glued along x = 1, in the current model: no groups."""
    geo = gmsh.model.geo
    p = [geo.addPoint(x, y, 0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0, 2.0)]
    pairs = ((0, 1), (1, 2), (2, 5), (5, 4), (4, 3), (3, 0), (1, 4))
    c = [geo.addLine(p[a], p[b]) for a, b in pairs]
    left = geo.addPlaneSurface([geo.addCurveLoop([c[0], c[6], c[4], c[5]])])
    right = geo.addPlaneSurface([geo.addCurveLoop([c[1], c[2], c[3], -c[6]])])
    geo.synchronize()
    return left, right, c


def group(dim, entities, name="", tag=-1):
    return gmsh.model.addPhysicalGroup(dim, entities, tag, name)


def write_built(builder, path, version=4.1, save_all=False):
    """Run a builder in a gmsh session and write what it leads to."""
    with gmsh_session("test"):
        builder()
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.SaveAll", int(save_all))
        gmsh.write(str(path))


@pytest.fixture
def msh(tmp_path):
    """A function that runs a builder in a gmsh session and returns the file it leads to."""

    def make(builder, version=4.1, save_all=False):
        path = tmp_path / "case.msh"
        write_built(builder, path, version, save_all)
        return path

    return make


def test_unknown_names_offer_the_nearest():
    named = generate(BLOCKS, MPI.COMM_SELF)
    assert named.body_tag("elastomer") != named.body_tag("aluminium")
    with pytest.raises(MeshError, match="no body named 'elastomr'; did you mean 'elastomer'"):
        named.body_tag("elastomr")
    with pytest.raises(MeshError, match="no surface named 'zzz'; there are: elastomer_left, ela"):
        named.facets("zzz")


def test_touching_blocks_are_not_glued_and_a_strip_is(msh):
    block = Block(1.0, 0.5, (4, 3))
    assert bodies_sharing_nodes(generate(TwoBlocks(block, block), MPI.COMM_WORLD)) == {}

    def glued():
        left, right, _ = strip()
        group(2, [left], "left")
        group(2, [right], "right")
        gmsh.model.mesh.generate(2)

    assert bodies_sharing_nodes(read(msh(glued), MPI.COMM_SELF)) == {("left", "right"): 2}


@pytest.mark.parametrize("cell", ["quadrilateral", "triangle"])
def test_written_mesh_reads_back_the_same(tmp_path, cell):
    blocks = TwoBlocks(BLOCKS.upper, BLOCKS.lower, BLOCKS.offset, cell=cell)
    write_msh(blocks, tmp_path / "blocks.msh")
    back, direct = read(tmp_path / "blocks.msh", MPI.COMM_SELF), generate(blocks, MPI.COMM_SELF)
    assert (back.bodies, back.surfaces) == (direct.bodies, direct.surfaces)
    np.testing.assert_allclose(back.mesh.geometry.x, direct.mesh.geometry.x, rtol=0, atol=1e-18)
    assert resultants(back) == pytest.approx(resultants(direct), rel=1e-13)


@pytest.mark.parametrize(("version", "save_all"), [(2.2, False), (4.0, False), (4.0, True)])
def test_other_versions_of_the_format(msh, version, save_all):
    named = read(msh(lambda: BLOCKS.build(), version, save_all), MPI.COMM_SELF)
    assert resultants(named) == pytest.approx(MEASURES, rel=1e-12)


def test_node_numbers_with_holes_and_nodes_of_no_cell(msh):
    def sparse():
        left, right, c = strip()
        group(2, [left, right], "body")
        group(1, [c[0]], "below")
        gmsh.model.geo.addPoint(7.0, 7.0, 7.0)
        gmsh.model.geo.synchronize()
        group(0, [7], "far point")
        gmsh.model.mesh.generate(2)
        tags = gmsh.model.mesh.getNodes()[0]
        gmsh.model.mesh.renumberNodes(tags, 10 * tags + 3)

    named = read(msh(sparse), MPI.COMM_SELF)
    assert resultants(named) == pytest.approx({"body": 2.0, "below": 1.0})
    assert named.mesh.geometry.x.max() == 2.0


def no_groups():
    strip()
    gmsh.model.mesh.generate(2)


def unnamed_group():
    left, right, _ = strip()
    group(2, [left], "left")
    group(2, [right], tag=12)
    gmsh.model.mesh.generate(2)


def forgotten_face():
    group(2, [strip()[0]], "left")
    gmsh.model.mesh.generate(2)


def two_groups():
    left, right, _ = strip()
    group(2, [left, right], "all")
    group(2, [right], "right")
    gmsh.model.mesh.generate(2)


def third_order():
    BLOCKS.build()
    gmsh.model.mesh.setOrder(3)


def lifted():
    BLOCKS.build()
    gmsh.model.mesh.affineTransform([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0.25])


def tilted():
    BLOCKS.build()
    gmsh.model.mesh.affineTransform([1, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1, 0])


def only_curves():
    _, _, c = strip()
    group(1, c, "curves")
    gmsh.model.mesh.generate(1)


def folded():
    face = gmsh.model.addDiscreteEntity(2)
    gmsh.model.mesh.addNodes(2, face, [1, 2, 3, 4], [0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0])
    gmsh.model.mesh.addElementsByType(face, 3, [1], [1, 2, 4, 3])
    group(2, [face], "body")


def doubled_cell():
    face = gmsh.model.addDiscreteEntity(2)
    gmsh.model.mesh.addNodes(2, face, [1, 2, 3], [0, 0, 0, 1, 0, 0, 1, 1, 0])
    gmsh.model.mesh.addElementsByType(face, 2, [1, 2], [1, 2, 3, 2, 3, 1])
    group(2, [face], "body")


def quadrilateral(x, cells=((1, 2, 3), (1, 3, 4)), name="body"):
    """Triangles on four nodes, the third of which is at x, 1."""
    face = gmsh.model.addDiscreteEntity(2)
    gmsh.model.mesh.addNodes(2, face, [1, 2, 3, 4], [0, 0, 0, 1, 0, 0, x, 1, 0, 0, 1, 0])
    tags = list(range(1, len(cells) + 1))
    gmsh.model.mesh.addElementsByType(face, 2, tags, [n for cell in cells for n in cell])
    group(2, [face], name, 7)


def inverted():
    quadrilateral(-0.5)


def three_on_an_edge():
    quadrilateral(1.0, ((1, 2, 3), (1, 2, 4), (1, 3, 4), (2, 3, 4)))
    gmsh.model.mesh.setNode(4, [0.6, 0.3, 0.0], [])
    gmsh.model.mesh.addNodes(2, 1, [5], [0.5, -1, 0])
    gmsh.model.mesh.addElementsByType(1, 2, [5], [1, 2, 5])
    gmsh.model.mesh.removeElements(2, 1, [3, 4])


def flat():
    quadrilateral(1e-16)


def nowhere():
    quadrilateral(float("nan"))


def far_away():
    quadrilateral(1e300)


def unmeshed_body():
    quadrilateral(1.0)
    strip()
    group(2, [3], "no cells")


def odd_name():
    quadrilateral(1.0, name="tab\tin it")


def long_name():
    quadrilateral(1.0, name=400 * "n")


def with_curve(nodes):
    """A triangle 1 2 3, a point 4 outside, and a surface of two-node facets."""
    face, curve = gmsh.model.addDiscreteEntity(2), gmsh.model.addDiscreteEntity(1)
    x = [0, 0, 0, 1, 0, 0, 1, 1, 0, 5, 5, 0]
    gmsh.model.mesh.addNodes(2, face, [1, 2, 3, 4], x)
    gmsh.model.mesh.addElementsByType(face, 2, [1], [1, 2, 3])
    count = len(nodes) // 2
    gmsh.model.mesh.addElementsByType(curve, 1, list(range(2, 2 + count)), nodes)
    group(2, [face], "body")
    group(1, [curve], "side")


def doubled_facet():
    with_curve([1, 2, 2, 1])


def facet_off_the_body():
    with_curve([1, 2, 3, 4])


def facet_across_the_body():
    """A surface along a diagonal that is no side of a cell."""
    face, curve = gmsh.model.addDiscreteEntity(2), gmsh.model.addDiscreteEntity(1)
    gmsh.model.mesh.addNodes(2, face, [1, 2, 3, 4], [0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0])
    gmsh.model.mesh.addElementsByType(face, 3, [1], [1, 2, 3, 4])
    gmsh.model.mesh.addElementsByType(curve, 1, [2, 3], [1, 2, 1, 3])
    group(2, [face], "body")
    group(1, [curve], "side")


def body_without_a_group():
    """Two blocks of which only the lower is a body; the upper one's surface has a name."""
    rectangles = [gmsh.model.occ.addRectangle(0, y, 0, 1, 1) for y in (0, 2)]
    gmsh.model.occ.synchronize()
    curves = [[t for _, t in gmsh.model.getBoundary([(2, r)], oriented=False)] for r in rectangles]
    group(2, rectangles[1:], "body")
    group(1, curves[0], "forgotten")
    group(1, curves[1], "side")
    gmsh.model.mesh.generate(2)


@pytest.mark.parametrize(
    ("builder", "options", "said"),
    [
        (no_groups, {}, "no physical groups; name the bodies"),
        (lambda: BLOCKS.build(), {"version": 2.2, "save_all": True}, "save without Mesh.SaveAll"),
        (unnamed_group, {}, "physical group 12 .* has no name"),
        (forgotten_face, {"save_all": True}, "[0-9]+ cells are in no named body"),
        (two_groups, {}, "'all' and 'right'; it may be in one only: make groups that do not over"),
        (two_groups, {"version": 2.2}, "face 2 is in the physical groups 'all' and 'right'"),
        (third_order, {}, "first and second order are read"),
        (inverted, {}, "at 1 facets both cells lie on the same side"),
        (three_on_an_edge, {}, "1 facets are those of more than two cells"),
        (flat, {}, "1 cells are folded or without extent"),
        (nowhere, {}, r"1 of the 4 nodes are nowhere, the first at .nan, 1, 0."),
        (far_away, {}, r"1 of the 4 nodes are nowhere, the first at .1e\+300, 1, 0."),
        (unmeshed_body, {}, "body 'no cells' contains face [0-9]+, which is not meshed"),
        (odd_name, {}, r"the name of physical group 7 .faces. cannot be used"),
        (long_name, {}, r"the name of physical group 7 .faces. cannot be used"),
        (lifted, {}, "must lie in the plane z = 0; it has z = 0.25"),
        (tilted, {}, "must lie in the plane z = 0; it has z = 0 to 0.002"),
        (only_curves, {}, "no faces and no volumes"),
        (folded, {}, "1 cells are folded"),
        (doubled_cell, {}, "1 cells are listed twice"),
        (doubled_facet, {}, "1 facets of surface 'side' are listed twice"),
        (facet_off_the_body, {}, "1 of the 2 facets of surface 'side' are not on the boundary"),
        (body_without_a_group, {}, "the [0-9]+ facets of surface 'forgotten' .* is their face in"),
    ],
)
def test_unusable_mesh_gets_one_line(msh, builder, options, said):
    path = msh(builder, **options)
    with pytest.raises(MeshError, match=f"^{path}: .*{said}") as caught:
        read_msh(path)
    assert "\n" not in str(caught.value)
    assert not gmsh.isInitialized()


def test_facets_that_no_cell_has_are_found_in_the_mesh(msh):
    path = msh(facet_across_the_body)
    said = f"^{path}: 1 of the 2 facets of surface 'side' are not on the boundary"
    with pytest.raises(MeshError, match=said):
        read(path, MPI.COMM_SELF)


@pytest.mark.parametrize(
    ("version", "said"),
    # gmsh itself drops the second name when it reads the older format.
    [
        (4.1, "groups 1 and 2 .faces. are both named 'elastomer'"),
        (2.2, "group 2 .* no name of its"),
    ],
)
def test_two_bodies_of_one_name_are_refused(msh, version, said):
    path = msh(lambda: BLOCKS.build(), version)
    path.write_text(path.read_text().replace('"aluminium"', '"elastomer"'))
    with pytest.raises(MeshError, match=said):
        read_msh(path)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("mesh.msh", None, "no such file"),
        ("mesh.vtk", "# vtk", r"meshes are read from gmsh's \.msh files, version 2 or 4"),
        ("mesh.inp", "*NODE", "meshio reads .inp files, .* in docs/meshes.md, other formats"),
        ("mesh.unv", "", "version 2 or 4; .* groups: gmsh mesh.unv -save -o mesh.msh"),
        ("mesh.stl", "solid", 'a .geo drawing with Merge "mesh.stl"'),
        ("mesh.iges", "", "export the part as STEP"),
        ("mesh.geo", "Point(1) = {0, 0, 0};", "meshes are read from"),
        ("mesh.msh", "", "not a gmsh mesh"),
        ("mesh.msh", "Point(1) = {0, 0, 0};", "not a gmsh mesh"),
        ("mesh.msh", "$MeshFormat\n\x01 0 8\n", "not a gmsh mesh"),
        ("mesh.msh", "$MeshFormat\n3 0 8\n$EndMeshFormat\n", "of version 3; meshes are read"),
        ("mesh.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n", "no faces and no volumes"),
    ],
)
def test_unusable_file_gets_one_line(tmp_path, name, text, said):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(MeshError, match=f"^{tmp_path / name}: .*{said}"):
        read_msh(tmp_path / name)


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_truncated_file_gets_one_line(msh, version, share):
    path = msh(lambda: BLOCKS.build(), version)
    text = path.read_text()
    path.write_text(text[: int(share * len(text))])
    with pytest.raises(MeshError, match="gmsh cannot read it: ") as caught:
        read_msh(path)
    assert "\n" not in str(caught.value)


def contact_shares(comm):
    """Cells and slave facets of this rank, of a mesh that contact is shared out for."""
    pairs = [("elastomer_contact", "aluminium_contact"), ("no", "such surface")]
    named = generate(BLOCKS, comm, pairs)
    maps = [named.mesh.topology.index_map(dim) for dim in (2, 1)]
    slaves = named.facets("elastomer_contact")
    return maps[0].size_local, int(np.count_nonzero(slaves < maps[1].size_local))


def seamed():
    """The strip with the seam of its bodies, and one side, as surfaces, meshed."""
    left, right, c = strip()
    group(2, [left], "left")
    group(2, [right], "right")
    group(1, [c[6]], "seam")
    group(1, [c[5]], "wall")
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.2)
    gmsh.model.mesh.generate(2)


def facts(comm, directory):
    """What must not depend on the number of processes, and every process's error."""
    path = directory / "mesh.msh"
    if comm.rank == 0:
        write_built(seamed, path)
    comm.barrier()
    named, strip = generate(BLOCKS, comm), read(path, comm)
    crashing = directory / "crashing.msh"
    if comm.rank == 0:
        crashing.write_text(CRASHING)
    comm.barrier()
    with pytest.raises(MeshError, match=r"gmsh broke down on it \(SIG"):
        read(crashing, comm)
    with pytest.raises(MeshError) as caught:
        read(Path("missing.msh"), comm)
    return {
        "measures": resultants(named),
        "strip": resultants(strip),
        "cells": named.mesh.topology.index_map(2).size_global,
        "shares": [comm.allgather(share) for share in contact_shares(comm)],
        "glued": [list(bodies_sharing_nodes(m).items()) for m in (named, strip)],
        "errors": comm.gather(str(caught.value)),
    }


@pytest.mark.mpi(facts, 2)
def test_same_on_one_and_two_ranks(on_ranks):
    one, two = on_ranks(facts, 1), on_ranks(facts, 2)
    assert two["errors"] == 2 * one["errors"] == 2 * ["missing.msh: no such file"]
    for key in ("measures", "strip"):
        assert two[key] == pytest.approx(one[key], rel=1e-12)
    assert two["cells"] == one["cells"] == 97
    # Contact is shared out as evenly as cells are.
    assert one["shares"] == [[97], [8]]
    cells, slaves = two["shares"]
    assert sum(cells) == 97 and min(cells) >= 46
    assert slaves == [4, 4]
    assert two["glued"] == [[], [[["left", "right"], 6]]]
    assert one["glued"] == [[], [[["left", "right"], 6]]]


# --- in space -------------------------------------------------------------------------------------


def cubes(apart):
    """Two unit cubes one on the other, with common nodes or not, each with a surface."""
    occ = gmsh.model.occ
    boxes = [(3, occ.addBox(0, y, 0, 1, 1, 1)) for y in (0, 1)]
    if not apart:
        occ.fragment(boxes[:1], boxes[1:])
    occ.synchronize()
    for name, (_, tag) in zip(("lower", "upper"), boxes, strict=True):
        group(3, [tag], name)
        [face] = [
            face
            for _, face in gmsh.model.getBoundary([(3, tag)], oriented=False)
            if np.ptp(gmsh.model.getBoundingBox(2, face)[1::3]) < 1e-3
            and abs(gmsh.model.occ.getCenterOfMass(2, face)[1] - 1.0) > 0.5
        ]
        group(2, [face], f"{name}_far")
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
    gmsh.model.mesh.generate(3)


@pytest.mark.parametrize("apart", [True, False])
def test_bodies_in_space_that_share_nodes_are_found(msh, apart):
    named = read(msh(lambda: cubes(apart)), MPI.COMM_SELF)
    assert named.mesh.geometry.dim == 3 and named.mesh.topology.cell_name() == "tetrahedron"
    assert resultants(named) == pytest.approx(dict.fromkeys([*named.bodies, *named.surfaces], 1.0))
    between = int(np.count_nonzero(np.abs(named.mesh.geometry.x[:, 1] - 1.0) < 1e-9))
    assert bodies_sharing_nodes(named) == ({} if apart else {("lower", "upper"): between})


def test_a_body_drawn_in_parts_that_share_no_nodes_is_told(msh):
    def parts(apart, bodies):
        for n, x in enumerate((0.0, 1.0 + apart)):
            gmsh.model.occ.addRectangle(x, 0.0, 0.0, 1.0, 1.0, tag=n + 1)
        gmsh.model.occ.synchronize()
        for name, tags in bodies.items():
            group(2, tags, name)
        gmsh.model.mesh.generate(2)

    def notes(apart, bodies):
        return read(msh(lambda: parts(apart, bodies)), MPI.COMM_SELF, scale=1e-3).notes

    (note,) = notes(0.0, {"pad": [1, 2]})
    assert note.startswith("body pad: ") and "as at (0.001, 0) m, and are not joined" in note
    assert notes(0.1, {"pad": [1, 2]}) == ()
    # Bodies that lie on each other are what contact is between.
    assert notes(0.0, {"pad": [1], "plate": [2]}) == ()


@pytest.mark.parametrize("away", [0.0, 1e-12, 1.0])
def test_duplicate_nodes_of_a_surface_are_told_from_facets_elsewhere(tmp_path, away):
    """A square whose lower side has nodes of its own, at the places of the cell's or apart."""
    nodes = [(0, 0), (1, 0), (1, 1), (0, 1), (0, -away), (1, -away)]
    rows = "\n".join(f"{number} {x} {y} 0" for number, (x, y) in enumerate(nodes, 1))
    path = tmp_path / "square.msh"
    path.write_text(
        '$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 1 "pad"\n1 2 "face"\n'
        f"$EndPhysicalNames\n$Nodes\n6\n{rows}\n$EndNodes\n"
        "$Elements\n2\n1 3 2 1 1 1 2 3 4\n2 1 2 2 2 5 6\n$EndElements\n"
    )
    with pytest.raises(MeshError, match="1 of the 1 facets of surface 'face' are not on the") as it:
        read_msh(path)
    told = "duplicate nodes: 2 of 6 lie where others do, within 1e-08 of the extent; join them"
    assert (told in str(it.value)) == (away < 1e-8)
    assert ("in a physical group?" in str(it.value)) == (away > 1e-8)
