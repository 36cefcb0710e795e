"""Meshes of several kinds of cells, divided into cells of one kind."""

import re

import gmsh
import numpy as np
import pytest

from tests.geometry.meshes.test_mesh import group, resultants, strip, write_built
from tribox.geometry.meshes.extraction import refined
from tribox.geometry.meshes.foreign import read_msh
from tribox.geometry.meshes.gmsh_model import MeshError
from tribox.geometry.meshes.mesh import read


def half_and_half():
    """Two unit squares that share a side: triangles on the left, quadrilaterals on the right."""
    left, right, c = strip()
    group(2, [left], "left part")
    group(2, [right], "right part")
    group(1, [c[0], c[1]], "bottom")
    group(1, [c[2]], "right side")
    for curve in c:
        gmsh.model.mesh.setTransfiniteCurve(curve, 4)
    gmsh.model.mesh.setTransfiniteSurface(right)
    gmsh.model.mesh.setRecombine(2, right)
    gmsh.model.mesh.generate(2)


def prisms_and_more():
    """A plate of prisms and hexahedra, extruded from the squares, and a box of tetrahedra."""
    geo = gmsh.model.geo
    p = [geo.addPoint(x, y, 0.0, 0.5) for y in (0.0, 1.0) for x in (0.0, 1.0, 2.2)]
    pairs = ((0, 1), (1, 2), (2, 5), (5, 4), (4, 3), (3, 0), (1, 4))
    c = [geo.addLine(p[a], p[b]) for a, b in pairs]
    left = geo.addPlaneSurface([geo.addCurveLoop([c[0], c[6], c[4], c[5]])])
    right = geo.addPlaneSurface([geo.addCurveLoop([c[1], c[2], c[3], -c[6]])])
    for curve in c:
        geo.mesh.setTransfiniteCurve(curve, 3)
    geo.mesh.setTransfiniteSurface(right)
    geo.mesh.setRecombine(2, right)
    up = [
        geo.extrude([(2, tag)], 0.0, 0.3, 0.7, numElements=[2], recombine=True)
        for tag in (left, right)
    ]
    q = [geo.addPoint(x, y, 0.0, 0.5) for x, y in ((5, 0), (6, 0), (6, 1), (5, 1))]
    sides = [geo.addLine(a, b) for a, b in zip(q, (*q[1:], q[0]), strict=True)]
    floor = geo.addPlaneSurface([geo.addCurveLoop(sides)])
    box = geo.extrude([(2, floor)], 0.0, 0.0, 1.0)
    geo.synchronize()
    volumes = [next(tag for dim, tag in made if dim == 3) for made in up]
    group(3, volumes, "plate")
    group(3, [box[1][1]], "box")
    group(2, [made[0][1] for made in up], "above")
    group(2, [left, right], "below")
    group(2, [floor, *(tag for dim, tag in box if dim == 2)], "skin")
    gmsh.model.mesh.generate(3)


def facts(comm, directory):
    """Of both meshes: what they measure and what is said of them."""
    found = {}
    for build in (half_and_half, prisms_and_more):
        path = directory / f"{build.__name__}.msh"
        if comm.rank == 0:
            write_built(build, path)
        comm.barrier()
        named = read(path, comm)
        found[build.__name__] = {
            "measures": resultants(named),
            "cell": named.mesh.topology.cell_name(),
            "count": named.cell_count,
            "notes": named.notes,
        }
    return found


@pytest.mark.mpi(facts, 2)
def test_mixed_cells_become_one_kind_that_measures_the_same(on_ranks):
    one, two = on_ranks(facts, 1), on_ranks(facts, 2)
    plane, space = one["half_and_half"], one["prisms_and_more"]
    assert plane["cell"] == "quadrilateral" and space["cell"] == "hexahedron"
    assert plane["measures"] == pytest.approx(
        {"left part": 1.0, "right part": 1.0, "bottom": 2.0, "right side": 1.0}, rel=1e-13
    )
    slanted = 2.2  # the extrusion is along (0, 0.3, 0.7)
    assert space["measures"] == pytest.approx(
        {"plate": 2.2 * 0.7, "box": 1.0, "above": slanted, "below": slanted, "skin": 6.0}, rel=1e-12
    )
    [said] = plane["notes"]
    found = re.fullmatch(
        r"mixed cells \((\d+) triangles, 9 quadrilaterals\): refined to (\d+) quadrilaterals", said
    )
    assert int(found[2]) == 3 * int(found[1]) + 4 * 9 == plane["count"]
    [said] = space["notes"]
    numbers = {
        kind: int(n) for n, kind in re.findall(r"(\d+) (prisms|tetrahedra|hexahedra)[,)]", said)
    }
    total = 6 * numbers["prisms"] + 8 * numbers["hexahedra"] + 4 * numbers["tetrahedra"]
    assert space["count"] == total and numbers["hexahedra"] == 8
    for name, facts_of in one.items():
        assert two[name]["measures"] == pytest.approx(facts_of["measures"], rel=1e-12)
        assert (two[name]["count"], two[name]["notes"]) == (facts_of["count"], facts_of["notes"])


def test_each_kind_falls_into_as_many_cells_as_it_has_corners_and_neighbours_fit():
    """One prism, one tetrahedron on its end, one hexahedron on its side: no node is doubled."""
    position = np.array(
        [
            *([0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [0.2, 0.2, 2.0]),
            *([0, -1, 0], [1, -1, 0], [0, -1, 1], [1, -1, 1]),
        ],
        dtype=np.float64,
    )
    bodies = {
        "a": (1, {"prism": np.array([[0, 1, 2, 3, 4, 5]])}),
        "b": (2, {"tetrahedron": np.array([[3, 4, 5, 6]])}),
        "c": (3, {"hexahedron": np.array([[7, 8, 1, 0, 9, 10, 4, 3]])}),
    }
    mesh = refined(position, bodies, {}, "test")
    assert [len(part.nodes) for part in mesh.bodies.values()] == [6, 4, 8]
    # Corners, edges, faces and cells, each once.
    edges, faces = 9 + 3 + 8, 5 + 3 + 5
    assert len(mesh.position) == len(position) + edges + faces + 3
    x = mesh.position[mesh.cells]
    determinant = np.linalg.det(x[:, [1, 3, 4]] - x[:, :1])
    assert (determinant > 0.0).all()


def test_facets_that_are_no_cells_and_folded_cells_are_refused():
    position = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0.5, 0]], dtype=np.float64)
    cells = {"quadrilateral": np.array([[0, 1, 2, 3]]), "triangle": np.array([[1, 4, 2]])}
    off = {"side": (1, {"interval": np.array([[0, 2]])})}
    with pytest.raises(MeshError, match="not on the boundary of any cell"):
        refined(position, {"a": (1, cells)}, off, "test")
    position[2] = (0.1, 0.1, 0.0)  # the quadrilateral is no longer convex
    with pytest.raises(MeshError, match=r"[23] of the 7 quadrilaterals .* folded, the first at \("):
        refined(position, {"a": (1, cells)}, {}, "test")


def test_pyramids_and_mixed_curved_cells_are_refused(tmp_path):
    def pyramid():
        geo = gmsh.model.addDiscreteEntity(3)
        x = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1)]
        gmsh.model.mesh.addNodes(3, geo, range(1, 6), np.ravel(x))
        gmsh.model.mesh.addElementsByType(geo, 7, [1], range(1, 6))
        group(3, [geo], "all")

    def curved():
        gmsh.option.setNumber("Mesh.ElementOrder", 2)
        half_and_half()

    for build, said in ((pyramid, "pyramids cannot be divided"), (curved, "of first order")):
        write_built(build, tmp_path / "bad.msh")
        with pytest.raises(MeshError, match=said):
            read_msh(tmp_path / "bad.msh")
