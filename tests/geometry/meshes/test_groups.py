"""Named points and edges: read from a file, found on every rank, loads spread over them."""

from pathlib import Path
from typing import Any

import dolfinx
import gmsh
import numpy as np
import pytest
from mpi4py import MPI

from tribox.geometry.meshes.drawing import Meshing, mesh_drawing
from tribox.geometry.meshes.gmsh_model import MeshError
from tribox.geometry.meshes.mesh import NamedMesh, generate, group_dofs, read


class Cube:
    """A unit cube of 2 by 3 by 4 cells, with a named edge along z and two named corners."""

    def build(self) -> None:
        occ = gmsh.model.occ
        occ.addBox(0, 0, 0, 1, 1, 1)
        occ.synchronize()
        for _, curve in gmsh.model.getEntities(1):
            low = np.array(gmsh.model.getBoundingBox(1, curve)[:3])
            axis = int(np.argmax(np.array(gmsh.model.getBoundingBox(1, curve)[3:]) - low))
            gmsh.model.mesh.setTransfiniteCurve(curve, (3, 4, 5)[axis])
            if axis == 2 and np.allclose(low[:2], [1, 1], atol=1e-3):
                edge = curve
        for _, face in gmsh.model.getEntities(2):
            gmsh.model.mesh.setTransfiniteSurface(face)
            gmsh.model.mesh.setRecombine(2, face)
        gmsh.model.mesh.setTransfiniteVolume(1)
        gmsh.model.addPhysicalGroup(3, [1], name="cube")
        gmsh.model.addPhysicalGroup(1, [edge], name="edge")
        tags = [tag for _, tag in gmsh.model.getEntities(0)]
        places = {tag: gmsh.model.getValue(0, tag, []) for tag in tags}
        points = [tag for tag in tags if places[tag][0] == 1.0 and places[tag][2] == 0.0]
        gmsh.model.addPhysicalGroup(0, points, name="corners")
        gmsh.model.mesh.generate(3)


def space_on(named: NamedMesh, degree: int) -> dolfinx.fem.FunctionSpace:
    return dolfinx.fem.functionspace(named.mesh, ("Lagrange", degree, (3,)))


def facts(comm: MPI.Comm, directory: Path) -> dict[str, Any]:
    """Of each group and order: places, in order, and shares."""
    named = generate(Cube(), comm)
    found: dict[str, Any] = {"body": named.body_of("edge")}
    for degree in (1, 2):
        space = space_on(named, degree)
        for name, group in named.groups.items():
            nodes = group_dofs(space, group, 1) // 3
            shares = group.shares(space)
            rows = np.column_stack([space.tabulate_dof_coordinates()[nodes], shares[nodes]])
            everything = np.round(np.concatenate(comm.allgather(rows)), 12) + 0.0
            found[f"{name} {degree}"] = everything[np.lexsort(everything[:, :3].T)].tolist()
            found[f"rest {name} {degree}"] = comm.allreduce(float(np.delete(shares, nodes).sum()))
    return found


@pytest.mark.mpi(facts, 2)
def test_groups_are_found_and_their_shares_are_those_of_a_line_load(on_ranks):
    alone = on_ranks(facts, 1)
    assert on_ranks(facts, 2) == alone
    assert alone["body"] == "cube"
    ends, inside = 1.0 / 8.0, 1.0 / 4.0
    edge = np.array(alone["edge 1"])
    np.testing.assert_allclose(edge[:, :2], 1.0)
    np.testing.assert_allclose(edge[:, 2], np.arange(5) / 4.0, atol=1e-12)
    np.testing.assert_allclose(edge[:, 3], [ends, inside, inside, inside, ends], atol=1e-11)
    edge = np.array(alone["edge 2"])  # Simpson's rule
    weights = np.array([1, 4, 2, 4, 2, 4, 2, 4, 1]) / 24.0
    np.testing.assert_allclose(edge[:, 3], weights, atol=1e-11)
    for degree in (1, 2):
        corners = np.array(alone[f"corners {degree}"])
        np.testing.assert_allclose(corners, [[1, 0, 0, 0.5], [1, 1, 0, 0.5]], atol=1e-11)
        assert alone[f"rest edge {degree}"] == alone[f"rest corners {degree}"] == 0.0


def test_a_name_that_is_missing_offers_the_nearest():
    named = generate(Cube(), MPI.COMM_SELF)
    assert len(named.nodes("edge")) == 5
    with pytest.raises(MeshError, match="no group named 'edgy'; did you mean 'edge'"):
        named.nodes("edgy")
    with pytest.raises(MeshError, match="no surface named 'corner'"):
        named.heed_place("corner")


def test_a_drawing_keeps_its_points(tmp_path):
    drawing = tmp_path / "pad.geo"
    drawing.write_text(
        "Point(1) = {0, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {0, 1, 0};\n"
        "Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 1};\n"
        "Curve Loop(1) = {1, 2, 3}; Plane Surface(1) = {1};\n"
        'Physical Surface("pad") = {1}; Physical Curve("foot") = {1};\n'
        'Physical Point("tips") = {2, 3};\n'
    )
    mesh_drawing(drawing, tmp_path / "pad.msh", Meshing(size=0.5))

    named = read(tmp_path / "pad.msh", MPI.COMM_SELF)
    named.mesh.topology.create_connectivity(0, 2)
    tips = dolfinx.mesh.compute_midpoints(named.mesh, 0, named.nodes("tips"))
    assert sorted(map(tuple, tips[:, :2])) == [(0.0, 1.0), (2.0, 0.0)]
