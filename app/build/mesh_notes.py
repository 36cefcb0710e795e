"""What may surprise once mesh and case are put together: lines for the person who runs it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from tribox.app.case.case import Case
from tribox.app.case.geometry import GeneratedGeometry
from tribox.forms.bodies.solid import Solid
from tribox.geometry.meshes import metis
from tribox.geometry.meshes.bonds import bodies_sharing_nodes
from tribox.geometry.meshes.mesh import NamedMesh

SRI = 'formulation = "q1-sri"'


class Locking(NamedTuple):
    """A linear cell: K/G from which it is said to lock, its plural, errors measured, a cure."""

    ratio: float
    plural: str
    measured: str
    cure: str


# Errors are those of the force under a given approach: at the ratio some 5 % where cells
# are twice as coarse. Tetrahedra that do not lock (K/G = 2.6) err by 5 %.
LINEAR = {
    "triangle": Locking(
        10.0,
        "triangles",
        "a pressed cylinder, 20 across the contact, by 7 % at K/G = 25, 10 % at 50, 20 % at 1000",
        f'cell = "quadrilateral" with {SRI}, or formulation = "q2"',
    ),
    "tetrahedron": Locking(
        8.0,
        "tetrahedra",
        "a pressed ball, 8 across the contact, by 10 % at K/G = 10, 19 % at 25, 32 % at 50",
        f'cell = "hexahedron" with {SRI}, or formulation = "q2"',
    ),
    "quadrilateral": Locking(
        10.0,
        "quadrilaterals of full integration",
        "a pressed cylinder, 20 across the contact, by 5 % at K/G = 25, 10 % at 50, 127 % at 1000",
        SRI,
    ),
    "hexahedron": Locking(
        8.0,
        "hexahedra of full integration",
        "a pressed ball, 8 across the contact, by 3 % at K/G = 10, 7 % at 25, 12 % at 50",
        SRI,
    ),
}
LOCKING = 25.0  # K/G of a body that flows, from which quadratic elements are said to lock
MANY = 0.5  # share of the cells that are allowed from which they are told
LARGE = 1.0  # extent of a body, m, from which the unit of a mesh that was read is asked for


def notes_on_ranks(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line where contact cannot be shared out evenly among the ranks."""
    wanted = named.mesh.comm.size > 1 and case.solver.partition == "contact"
    if wanted and not metis.is_available():
        yield "METIS (libmetis.so.5) is not installed: slave facets may be on few of the ranks"


def locking_bodies(named: NamedMesh, solids: Sequence[Solid], degree: int) -> Iterator[str]:
    """A line on each body of elements that lock: where the volume hardly changes.

    Linear elements of full integration do so in nearly incompressible bodies and in those that
    flow, triangles and tetrahedra the most; quadratic ones in those that are both.
    """
    if degree > 1:
        yield from _locking_quadratic(solids)
        return
    cell = named.mesh.topology.cell_name()
    for solid in solids:
        if solid.carried is not None:
            continue
        if solid.flows:
            yield (
                f"body {solid.name}: linear elements of full integration lock where a metal flows, "
                'which keeps its volume, and are too stiff; use formulation = "q1-sri" on '
                'quadrilaterals or hexahedra, or formulation = "q2"'
            )
            continue
        ratio, of_cell = solid.material.bulk_modulus / solid.material.shear_modulus, LINEAR[cell]
        if ratio > of_cell.ratio:
            yield (
                f"body {solid.name}: linear {of_cell.plural} lock with K/G = {ratio:.3g} and are "
                f"too stiff ({of_cell.measured}); use {of_cell.cure}"
            )


def _locking_quadratic(solids: Sequence[Solid]) -> Iterator[str]:
    for solid in solids:
        ratio = solid.material.bulk_modulus / solid.material.shear_modulus
        if solid.flows and ratio > LOCKING:
            yield (
                f"body {solid.name}: quadratic elements of full integration lock with K/G = "
                f"{ratio:.3g} where it flows (29 % too stiff with six across a thick tube, 2.5 % "
                'with twelve); use formulation = "q1-sri" on quadrilaterals or hexahedra, or a '
                "lower nu"
            )


def many_cells(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line on a mesh whose number of cells is near the most that are allowed."""
    cells = named.cell_count
    if cells > MANY * case.geometry.max_cells:
        yield f"the mesh has {cells} cells; geometry.max_cells allows {case.geometry.max_cells}"


def bonded_bodies(named: NamedMesh) -> Iterator[str]:
    """A line on each two bodies that share nodes; collective."""
    for (first, second), count in bodies_sharing_nodes(named).items():
        yield f"bodies {first} and {second} share {count} nodes: they are bonded there"


def large_mesh(case: Case, named: NamedMesh) -> Iterator[str]:
    """A line on a mesh that was read without a scale and may not be in metres; collective."""
    if isinstance(case.geometry, GeneratedGeometry) or case.geometry.says_unit:
        return
    x = named.mesh.geometry.x
    ends = np.concatenate([x.max(axis=0, initial=-np.inf), -x.min(axis=0, initial=np.inf)])
    named.mesh.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
    extent = float(np.max(ends[:3] + ends[3:]))
    if extent > LARGE:
        yield (
            f"mesh {case.geometry.mesh}: {extent:.3g} m long; coordinates are taken as metres, "
            'set geometry.scale = "mm" if they are millimetres'
        )
