"""Compiles the forms of the usual cells, and the C sources."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section
    from tribox.geometry.meshes.gmsh_model import Shape


@dataclass(frozen=True, slots=True)
class _Group:
    """Forms that go together."""

    cell: str  # shape of the cells
    section: Section  # what the mesh stands for


# Second-order elements and what else is rare are compiled when first used.
GROUPS = (
    _Group("quadrilateral", "plane-strain"),
    _Group("triangle", "plane-strain"),
    _Group("quadrilateral", "axisymmetric"),
    _Group("hexahedron", "3D"),
    _Group("tetrahedron", "3D"),
)


def compile_forms(first: int = 0, every: int = 1) -> Iterator[str]:
    """Compile C sources and `GROUPS` of forms, from ``first`` ``every`` so many; a line on each."""
    import tribox.forms.native
    import tribox.geometry.native.compiler

    rooms = (tribox.geometry.native.compiler, tribox.forms.native)
    sources = [(room, source) for room in rooms for source in room.SOURCES]
    for room, source in sources[first::every]:
        room.library(source)
        yield f"{source} compiled"
    for group in GROUPS[first::every]:
        yield from _compile(group)


def main() -> None:
    """Compile all on the processors there are, a line on each; SystemExit if one has failed."""
    count = min(len(os.sched_getaffinity(0)), len(GROUPS))
    fork = multiprocessing.get_context("fork")  # before MPI is started
    processes = [fork.Process(target=_print_share, args=(first, count)) for first in range(count)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        sys.exit(1)


def _print_share(first: int, every: int) -> None:
    for line in compile_forms(first, every):
        print(line, flush=True)


def _compile(group: _Group) -> Iterator[str]:
    import dolfinx
    import numpy as np
    from mpi4py import MPI

    from tribox.forms.bodies.loads import (
        BodyForce,
        DeadTraction,
        FollowerPressure,
        Foundation,
        mean_normal,
        reference_area,
    )
    from tribox.forms.bodies.materials import NeoHookean
    from tribox.forms.bodies.solid import Solid
    from tribox.forms.bodies.weights import surface_weights
    from tribox.geometry.meshes.mesh import generate

    # Groups share a form or two: one process waits for the other's compiler, s.
    dolfinx.jit.DOLFINX_DEFAULT_JIT_OPTIONS["timeout"] = (300, "Timeout for JIT compilation")
    # From gmsh, as every case: another mesh's coordinate element would give other forms.
    mesh = generate(_shape(group.cell), MPI.COMM_SELF).mesh
    dim = mesh.geometry.dim
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (dim,)))
    u = dolfinx.fem.Function(space)
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    Solid("sample", u, cells, NeoHookean(1.0, 2.0), "q1", section=group.section)
    yield f"{group.cell} {group.section} bodies"
    mesh.topology.create_connectivity(dim - 1, dim)
    facets = dolfinx.mesh.exterior_facet_indices(mesh.topology)
    FollowerPressure(u, facets, group.section)
    reference_area(mesh, facets, group.section)
    surface_weights(space, facets, group.section)
    mean_normal(mesh, facets)
    DeadTraction(u, facets, group.section)
    BodyForce(u, cells, 1.0, group.section)
    Foundation(u, facets, group.section)
    yield f"{group.cell} {group.section} loads"


def _shape(cell: str) -> Shape:
    """Two small blocks or boxes of these cells."""
    from tribox.geometry.generators.two_blocks import CELLS, Block, Box, TwoBlocks

    plane = cell in CELLS[2]
    block = Block(1.0, 1.0, (2, 2)) if plane else Box(1.0, 1.0, 1.0, (2, 2, 2))
    return TwoBlocks(block, block, cell=cell)


if __name__ == "__main__":
    main()
