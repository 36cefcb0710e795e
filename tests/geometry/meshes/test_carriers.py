"""Cells that carry unknowns of things without a mesh: where they lie, and that they stay unseen."""

from __future__ import annotations

from dataclasses import replace

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.results.fields import GatheredMesh
from tribox.app.results.output_files import BpWriter
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid
from tribox.geometry.generators.cylinders import FlatBlock, HalfCylinder, LineContact
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.generators.two_boxes import Box, TwoBoxes
from tribox.geometry.meshes.gmsh_model import MeshError
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.meshes.mesh_arrays import MeshArrays, Part
from tribox.geometry.pictures.space import outer_facets

BLOCKS = TwoBlocks(Block(1.0, 0.5, (3, 2)), Block(2.0, 0.4, (4, 2)))
BOXES = TwoBoxes(Box(1.0, 0.5, 1.0, (2, 2, 2)), Box(2.0, 0.4, 2.0, (3, 2, 2)))
NAMES = ("upper die", "roller")


def facts(comm, directory):
    """Of meshes without and with carriers: what is gathered, drawn, and where carriers are."""
    return [_facts_of(shape, comm) for shape in (BLOCKS, BOXES)]


def _facts_of(shape, comm):
    found = {}
    for kind, names in (("plain", ()), ("carrying", NAMES)):
        named = generate(shape, comm, carriers=names)
        mesh, dim = named.mesh, named.mesh.geometry.dim
        space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,)))
        owned = mesh.topology.index_map(dim).size_local
        cells = np.concatenate([named.cells(name) for name in named.bodies])
        cells = cells[cells < owned]
        part, whole = GatheredMesh(space, cells), GatheredMesh(space)
        numbers = mesh.topology.original_cell_index[:owned, None].astype(np.float64)
        ends = np.array([mesh.geometry.x.min(axis=0), -mesh.geometry.x.max(axis=0)])
        nodes = {name: _nodes(space, named.carrier(name)) for name in names}
        found[kind] = {
            "bodies": named.bodies,
            "cells": part.cells.tolist(),
            "places": (part.reference.round(9) + 0.0).tolist(),
            "numbers": part.cellwise(numbers).tolist(),
            "count": named.cell_count,
            "ends": np.min(comm.allgather(ends), axis=0).tolist(),
            "outer": comm.allreduce(len(outer_facets(named)[0])) if dim == 3 else 0,
        }
        more = {
            "owners": [comm.allreduce(int((named.carrier(n) < owned).sum())) for n in names],
            "nodes": [_of_all(comm, mine) for mine in nodes.values()],
            "of bodies": _of_all(comm, _nodes(space, cells)),
            "all cells": len(whole.cells),
        }
    return {**found, "more": more}


def _of_all(comm, numbers):
    return sorted(set().union(*comm.allgather(numbers)))


def _nodes(space, cells):
    nodes = space.dofmap.list[cells].reshape(-1)
    return space.dofmap.index_map.local_to_global(np.ascontiguousarray(nodes)).tolist()


@pytest.mark.mpi(facts, 2)
def test_carriers_have_nodes_of_their_own_and_are_in_nothing_that_is_shown(on_ranks):
    for ranks in (1, 2):
        for found, corners in zip(on_ranks(facts, ranks), (4, 8), strict=True):
            more = found["more"]
            assert found["plain"] == found["carrying"]
            assert more["all cells"] == found["plain"]["count"] + len(NAMES)
            assert more["owners"] == [1, 1]
            first, second = map(set, more["nodes"])
            assert len(first) == len(second) == corners
            assert not first & second
            assert not (first | second) & set(more["of bodies"])


def written(comm, directory):
    """Fields of a mesh with carriers, as ADIOS2 has them: places, displacement and stress."""
    import adios2

    named = generate(BLOCKS, comm, carriers=NAMES)
    space = dolfinx.fem.functionspace(named.mesh, ("Lagrange", 1, (2,)))
    u = dolfinx.fem.Function(space, name="displacement")
    u.interpolate(lambda x: 1e-3 * np.stack([x[0] + 2.0 * x[1], x[1] ** 2]))
    material = NeoHookean(shear_modulus=1e6, bulk_modulus=3e6)
    solids = [Solid(name, u, named.cells(name), material, "q1") for name in named.bodies]
    writer = BpWriter(u, solids, directory)
    writer.write(0.0)
    writer.close()
    if comm.rank > 0:
        return None
    with adios2.FileReader(str(directory / "fields.bp")) as file:
        x, moved = (
            np.concatenate([file.read(name, block_id=k).reshape(-1, 3) for k in range(comm.size)])
            for name in ("geometry", "displacement")
        )
    true = 1e-3 * np.stack([x[:, 0] + 2.0 * x[:, 1], x[:, 1] ** 2], axis=1)
    return {"nodes": len(x), "off": float(np.abs(moved[:, :2] - true).max())}


@pytest.mark.mpi(written, 2)
def test_fields_of_adios2_are_those_of_the_bodies(on_ranks):
    one = on_ranks(written, 1)
    assert one["nodes"] == 4 * 3 + 5 * 3
    assert one["off"] < 1e-15
    assert on_ranks(written, 2)["off"] < 1e-15


def test_a_carrier_that_is_not_there_is_refused_with_the_nearest_name():
    named = generate(BLOCKS, MPI.COMM_SELF, carriers=NAMES)
    assert tuple(named.carriers) == NAMES
    with pytest.raises(MeshError, match="no carrier named 'rolle'; did you mean 'roller'"):
        named.carrier("rolle")


def test_nodes_that_no_cell_uses_are_taken_first():
    """The centre of an arc is a node of the mesh that DOLFINx does not count."""
    round_one = LineContact(HalfCylinder(1.0, 0.4, 0.1), FlatBlock(2.0, 0.8, 0.4, 0.1))
    named = generate(round_one, MPI.COMM_SELF, carriers=NAMES)
    assert [len(named.carrier(name)) for name in NAMES] == [1, 1]
    plain = generate(round_one, MPI.COMM_SELF)
    assert named.mesh.geometry.x.max() == plain.mesh.geometry.x.max()
    assert named.cell_count == plain.cell_count


def second_order() -> MeshArrays:
    """A curved triangle of six nodes beside a node that nothing uses, its named edge and corner."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    middles = 0.5 * (corners + corners[[1, 2, 0]])
    nodes = np.concatenate([corners, middles, [[5.0, 5, 0]]])
    return MeshArrays(
        "triangle",
        nodes,
        {"body": Part(1, np.arange(6, dtype=np.int64)[None])},
        {"edge": Part(2, np.array([[0, 1, 3]], dtype=np.int64))},
        groups={"corner": np.array([[2]], dtype=np.int64)},
        order=2,
    )


def test_carriers_leave_the_nodes_between_the_corners_alone():
    arrays = second_order().with_carriers(NAMES)
    np.testing.assert_array_equal(arrays.position[:6], second_order().position[:6])
    carried = np.concatenate([arrays.carriers[name].nodes.ravel() for name in NAMES])
    assert carried[0] == 6 and len(set(carried)) == 12 and set(carried).isdisjoint(range(6))


def test_a_straightened_mesh_keeps_its_groups():
    arrays = second_order()
    moved = replace(arrays, position=arrays.position[::-1].copy())
    for part in (*moved.bodies.values(), *moved.surfaces.values()):
        part.nodes[:] = 6 - part.nodes
    moved.groups["corner"][:] = 6 - moved.groups["corner"]
    straight = moved.straightened()
    assert straight.order == 1 and len(straight.position) == 3
    np.testing.assert_array_equal(straight.position[straight.groups["corner"]][0, 0], [0, 1, 0])
