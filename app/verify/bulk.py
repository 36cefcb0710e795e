"""Verification of the solids: a nearly incompressible block in plane-strain compression."""

from __future__ import annotations

from collections.abc import Sequence

import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.app.case.generators import BlocksGeometry
from tribox.app.results.fields import StressField
from tribox.app.simulation.simulation import Simulation
from tribox.app.verify.result import Check, Floats, Line, Panel, Verification, compare
from tribox.app.verify.shipped_case import solve
from tribox.forms.closed_forms.block_compression import plane_strain_pressure, plane_strain_stress

BODY = "elastomer"


def block_compression(overrides: Sequence[str] = ()) -> Verification:
    """Nominal stress against the incompressible closed form, and pressures of the elements."""
    case, simulation = solve("block-compression", overrides)
    geometry, modulus = case.geometry, case.bodies[BODY].shear_modulus
    assert isinstance(geometry, BlocksGeometry)
    block = geometry.upper
    (down,) = (b.displacement.y for b in case.boundary if b.surface == "top" and b.displacement)
    assert down is not None and not isinstance(down, str)
    stretch = np.array([1.0 + down(row.time) / block.height for row in simulation.rows])
    area = block.width * geometry.slab
    nominal = np.array([-row.normal_force for row in simulation.rows]) / area
    exact = np.array([plane_strain_stress(s, modulus) for s in stretch])
    pressure = cell_pressures(simulation)
    jump = float(np.abs(np.diff(pressure[neighbours(simulation)], axis=1)).max())
    uniform = plane_strain_pressure(float(stretch[-1]), modulus)
    checks = (
        *(
            compare(f"nominal stress at λ = {s:.2f}", n * 1e-6, e * 1e-6, 5e-3, "MPa")
            for s, n, e in zip(stretch, nominal, exact, strict=True)
        ),
        compare(
            "mean pressure of the elements", pressure.mean() * 1e-6, uniform * 1e-6, 5e-3, "MPa"
        ),
        Check("neighbouring elements' pressures, max difference / mean", jump / uniform, 0.05),
    )
    fine = np.linspace(stretch.min(), 1.0, 101)
    curve = np.array([plane_strain_stress(s, modulus) for s in fine])
    lines = (
        Line("G (λ − λ⁻³)", fine, curve * 1e-6, exact=True),
        Line("computed", stretch, nominal * 1e-6),
    )
    K, formulation = case.bodies[BODY].bulk_modulus, simulation.model.case.bodies[BODY].formulation
    return Verification(
        "block-compression",
        "nearly incompressible block, plane-strain compression",
        f"{len(pressure)} elements ({formulation}) with K/G = {K / modulus:.4g}, "
        "pressed by a platen from above on a stiff block, both without friction; the nodes of the "
        "two blocks do not match. The closed form is that of an incompressible body.",
        checks,
        (Panel("stretch λ (-)", "nominal stress (MPa)", lines),),
    )


def cell_pressures(simulation: Simulation) -> Floats:
    """Pressure −tr σ/3 of the elastomer's elements in their order of number, (c,), Pa."""
    model = simulation.model
    field = StressField(model.problem.u, model.problem.solids)
    field.update()
    return np.asarray(field.pressure.x.array[np.sort(model.named.cells(BODY))], dtype=np.float64)


def neighbours(simulation: Simulation) -> NDArray[np.int64]:
    """Pairs of elements of the elastomer that share a facet, (n, 2), as rows of its pressures."""
    named = simulation.model.named
    topology = named.mesh.topology
    topology.create_connectivity(topology.dim - 1, topology.dim)
    table: dolfinx.graph.AdjacencyList = topology.connectivity(topology.dim - 1, topology.dim)
    inner = np.flatnonzero(np.diff(table.offsets) == 2)
    pairs = np.stack([table.array[table.offsets[inner] + side] for side in (0, 1)], axis=1)
    cells = np.sort(named.cells(BODY))
    # Bodies share no facet: one cell of the body suffices to tell.
    return np.searchsorted(cells, pairs[np.isin(pairs[:, 0], cells)])
