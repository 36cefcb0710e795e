"""Compiles the forms of every material, formulation and cell shape into FFCx's cache."""

from __future__ import annotations

from collections.abc import Iterator


def compile_forms() -> Iterator[str]:
    """Compile all forms a case can ask for; yields a line on each group."""
    import dolfinx
    import numpy as np
    from mpi4py import MPI

    from app.equilibrium import pattern_form
    from app.fields import StressField
    from forms.loads import FollowerPressure, mean_normal, reference_area
    from forms.materials import Hencky, MooneyRivlin, NeoHookean
    from forms.solids import Solid
    from geometry.mesh import generate
    from geometry.surface import point_operators
    from geometry.two_blocks import Block, TwoBlocks

    materials = (NeoHookean(1.0, 2.0), MooneyRivlin(0.4, 0.1, 2.0), Hencky(1.0, 2.0))
    block = Block(width=1.0, height=1.0, elements=(2, 2))
    for cell in (dolfinx.mesh.CellType.quadrilateral, dolfinx.mesh.CellType.triangle):
        # From gmsh, as every case: another mesh's coordinate element would give other forms.
        mesh = generate(TwoBlocks(block, block, cell=cell.name), MPI.COMM_SELF).mesh
        space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,)))
        u = dolfinx.fem.Function(space)
        cells = np.arange(mesh.topology.index_map(2).size_local, dtype=np.int32)
        quadrilateral = cell == dolfinx.mesh.CellType.quadrilateral
        for material in materials:
            for formulation in ("q1", "q1-sri") if quadrilateral else ("q1",):
                solid = Solid("warm", u, cells, material, formulation)
                StressField(u, [solid])
                yield f"{cell.name} {type(material).__name__} {formulation}"
        mesh.topology.create_connectivity(1, 2)
        facets = dolfinx.mesh.exterior_facet_indices(mesh.topology)
        pattern_form(space)
        FollowerPressure(u, facets)
        reference_area(mesh, facets)
        mean_normal(mesh, facets, 0)
        for degree in (1, 3, 5, 7, 9):
            point_operators(space, facets, degree)
        yield f"{cell.name} loads and contact points"
