"""Blocks of unknowns beside the displacement: where they lie, and what of the mesh stays."""

import dolfinx
import dolfinx.fem.petsc
import numpy as np
import pytest
import ufl

from tribox.app.results.fields import GatheredMesh
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
