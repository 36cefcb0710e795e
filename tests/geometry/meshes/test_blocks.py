"""Blocks of unknowns beside the displacement: where they lie, and what of the mesh stays."""

import dolfinx
import dolfinx.fem.petsc
import numpy as np
import pytest
import ufl

from tribox.app.results.fields import GatheredMesh
from tribox.app.results.output_files import BpWriter
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid
from tribox.geometry.generators.two_blocks import Block as Rectangle
from tribox.geometry.generators.two_blocks import Box, TwoBlocks
from tribox.geometry.meshes.blocks import Block, with_blocks
from tribox.geometry.meshes.mesh import generate

PLANE = TwoBlocks(Rectangle(1.0, 0.5, (3, 2)), Rectangle(2.0, 0.4, (4, 2)))
BOXES = TwoBlocks(Box(1.0, 0.5, 1.0, (2, 2, 2)), Box(2.0, 0.4, 2.0, (3, 2, 2)))


def spaces(shape, comm):
    """A mesh, its displacement's space, that with two blocks, and these."""
    named = generate(shape, comm)
    dim = named.mesh.geometry.dim
    plain = dolfinx.fem.functionspace(named.mesh, ("Lagrange", 1, (dim,)))
    facets = named.facets("elastomer_contact")
    nodes = dolfinx.fem.locate_dofs_topological(plain, dim - 1, facets)
    nodes = nodes[nodes < plain.dofmap.index_map.size_local]
    field = Block("field", len(nodes), plain.tabulate_dof_coordinates()[nodes][:, :dim])
    blocks = [Block.of_numbers("tool", dim + 1, comm), field]
    return named, plain, with_blocks(plain, blocks), blocks


def facts(comm, directory):
    """Of spaces without and with blocks: what is gathered, assembled, and where the blocks are."""
    return [_facts_of(shape, comm) for shape in (PLANE, BOXES)]


def _facts_of(shape, comm):
    named, *both, blocks = spaces(shape, comm)
    dim, found = named.mesh.geometry.dim, {}
    for kind, space in zip(("plain", "wider"), both, strict=True):
        mesh, index = GatheredMesh(space), space.dofmap.index_map
        u = dolfinx.fem.Function(space)
        u.interpolate(lambda x: np.stack([x[0] + 2.0 * x[1], x[1] ** 2, x[0] * x[1]])[:dim])
        v, w = ufl.TestFunction(space), ufl.TrialFunction(space)
        A = dolfinx.fem.petsc.assemble_matrix(dolfinx.fem.form(ufl.inner(w, v) * ufl.dx))
        A.assemble()
        x = u.x.petsc_vec
        moved = mesh.nodal(u.x.array.reshape(-1, dim)[: index.size_local])
        found[kind] = {
            "cells": mesh.cells.tolist(),
            "places": (mesh.reference.round(9) + 0.0).tolist(),
            "moved": moved.round(9).tolist(),
            "norm": round(A.norm(), 12),
            "work": round(x.dot(A * x), 10),
            "zeros": index.size_global - both[0].dofmap.index_map.size_global,
        }
    whole = both[1].dofmap.index_map
    values = np.arange(whole.size_local * dim) + float(whole.local_range[0] * dim)
    tool, field = blocks
    return {
        **found,
        "owner": comm.allreduce(comm.rank if tool.count else 0),
        "nodes": comm.allreduce(-(-tool.count // dim) + -(-field.count // dim)),
        "entries": [len(block.nodes) for block in blocks],
        "read": all(
            np.array_equal(b.on_all_ranks(values, comm), b.nodes * dim + b.components)
            for b in blocks
        ),
        "places": field.on_all_ranks(_at(field, values), comm).round(9).tolist(),
        "cells": bool(
            np.isin(both[1].dofmap.list, np.concatenate([b.dofs for b in blocks]) // dim).any()
        ),
    }


def _at(field, values):
    out = np.zeros_like(values)
    out[field.dofs] = field.place[:, 0]
    return out


@pytest.mark.mpi(facts, 3)
def test_blocks_have_nodes_of_their_own_and_leave_the_mesh_as_it_is(on_ranks):
    alone = on_ranks(facts, 1)
    for ranks in (1, 3):
        for found, one, entries in zip(
            on_ranks(facts, ranks), alone, ([3, 4], [4, 9]), strict=True
        ):
            assert found["wider"].pop("zeros") == found["nodes"]
            assert found["plain"].pop("zeros") == 0
            assert found["plain"] == found["wider"]
            assert found["owner"] == ranks - 1
            assert found["entries"] == entries
            assert found["read"]
            assert found["places"] == one["places"] == sorted(one["places"])
            assert not found["cells"]


def written(comm, directory):
    """Fields of a mesh with blocks beside it, as ADIOS2 has them: places and displacement."""
    import adios2

    named, _, space, _ = spaces(PLANE, comm)
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
def test_fields_of_adios2_have_the_nodes_of_the_mesh(on_ranks):
    one = on_ranks(written, 1)
    assert one["nodes"] == 4 * 3 + 5 * 3
    assert one["off"] < 1e-15
    assert on_ranks(written, 2)["off"] < 1e-15
