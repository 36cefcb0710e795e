"""What field output is made of: stress in the cells, contact pressure at the nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import dolfinx
import numpy as np

from tribox.forms.bodies.deformation import Rows, centre_rows, rows_at
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.point_stress import mean_pressure, von_mises
from tribox.forms.bodies.solid import Solid
from tribox.geometry.compat import interpolation_points
from tribox.geometry.meshes.blocks import like
from tribox.geometry.meshes.places import centre
from tribox.geometry.surfaces.facets import Floats, Ints, Longs, facet_shape
from tribox.geometry.surfaces.surface import ContactSurface

# -- Deformation at the centre of every cell: volume ratio, stretch and logarithmic strain ---------


@dataclass(frozen=True, slots=True)
class Strain:
    """Measures of the deformation of each cell.

    Attributes:
        J: (c,) volume ratio det F.
        max_stretch: (c,) largest principal stretch.
        log_strain: (c, 3, 3) ln V = ½ ln(F Fᵀ), along the axes of the deformed body.
    """

    J: Floats
    max_stretch: Floats
    log_strain: Floats


def strain_of(F: Floats, dim: int) -> Strain:
    """The measures of deformation gradients (c, 3, 3) of a mesh in the plane or in space."""
    return strain_in_plane(F) if dim == 2 else strain_in_space(F)


class CellStrain:
    """Evaluates the deformation gradient F at the centres of this rank's own cells."""

    def __init__(self, u: dolfinx.fem.Function, section: Section) -> None:
        """Tabulate the shape functions.

        Args:
            u: displacement, m.
            section: what the mesh stands for.
        """
        space, topology = u.function_space, u.function_space.mesh.topology
        owned = np.arange(topology.index_map(topology.dim).size_local, dtype=np.int32)
        self._rows = rows_at(space, section, owned, centre(topology.cell_name()))
        self._nodes = space.dofmap.list[owned]
        self._u, self._dim = u, space.mesh.geometry.dim
        self._plane = _InPlane(self._rows, self._nodes) if self._dim == 2 else None

    def evaluate(self) -> Strain:
        """The measures at the present displacement."""
        u = self._u.x.array.reshape(-1, self._dim)
        if self._plane is not None:
            return strain_in_plane(self._plane.deformation(u))
        return strain_in_space(self._rows.deformation(u[self._nodes]))


class _InPlane:
    """The deformation gradients of :meth:`Rows.deformation` for all cells of a plane at once.

    Component by component, each in one row of memory: products of matrices as small as 2 × 2 take
    several times as long.
    """

    def __init__(self, rows: Rows, nodes: Ints) -> None:
        self._rows, self._nodes = rows, np.ascontiguousarray(nodes.T)
        self._gradients = np.ascontiguousarray(  # (j, a, c), 1/m, ∂N_a/∂X_j
            np.einsum("cza,czj->jac", rows.slopes, rows.inverse)
        )

    def deformation(self, u: Floats) -> Floats:
        """Deformation gradients (c, 3, 3) of displacements (n, 2), m, of all nodes."""
        moved = [np.ascontiguousarray(u[:, i])[self._nodes] for i in range(2)]
        F = np.zeros((3, 3, self._nodes.shape[1]))
        for i in range(2):
            F[i, :2] = np.einsum("jac,ac->jc", self._gradients, moved[i])
        for i in range(3):
            F[i, i] += 1.0
        rows = self._rows
        if rows.across.any() or rows.on_axis.any():
            radial = np.einsum("ca,ac->c", rows.values, moved[0])
            F[2, 2] += rows.across * radial + rows.on_axis * (F[0, 0] - 1.0)
        return F.transpose(2, 0, 1)


def strain_in_space(F: Floats) -> Strain:
    """The measures of deformation gradients (c, 3, 3)."""
    squares, axes = np.linalg.eigh(F @ F.transpose(0, 2, 1))
    logs = 0.5 * np.log(squares)
    strain = (axes * logs[:, None]) @ axes.transpose(0, 2, 1)
    return Strain(np.linalg.det(F), np.sqrt(squares[:, -1]), strain)


def strain_in_plane(F: Floats) -> Strain:
    """The same where x_3 is a principal direction: F_13 = F_23 = F_31 = F_32 = 0.

    B = F Fᵀ has in the plane the eigenvalues λ² = m ± r, with m = tr B/2 and
    r² = ((B_11 − B_22)/2)² + B_12², and, as (B − m I)² = r² I there,

        ln B = ½ (ln λ_1² + ln λ_2²) I + (ln λ_1² − ln λ_2²)/(2 r) (B − m I).

    The quotient is ln(1 + 2 r/λ_2²)/(2 r), which tends to 1/λ_2²; the smaller eigenvalue is
    (det F)²/λ_1², without cancellation.
    """
    rows = F[:, :2, :2]
    B11, B22 = (rows[:, i, 0] ** 2 + rows[:, i, 1] ** 2 for i in range(2))
    B12 = (rows[:, 0] * rows[:, 1]).sum(axis=1)
    area = rows[:, 0, 0] * rows[:, 1, 1] - rows[:, 0, 1] * rows[:, 1, 0]
    half, r = 0.5 * (B11 - B22), np.hypot(0.5 * (B11 - B22), B12)
    most = 0.5 * (B11 + B22) + r
    least = area**2 / most
    twice = np.maximum(2.0 * r, np.finfo(float).tiny)
    slope = 0.5 * np.log1p(twice / least) / twice
    mean = 0.5 * np.log(np.abs(area))
    out = np.zeros_like(F)
    out[:, 0, 0], out[:, 1, 1] = mean + slope * half, mean - slope * half
    out[:, 0, 1] = out[:, 1, 0] = slope * B12
    out[:, 2, 2] = np.log(np.abs(F[:, 2, 2]))
    stretch = np.maximum(np.sqrt(most), np.abs(F[:, 2, 2]))
    return Strain(area * F[:, 2, 2], stretch, out)


# -- What field output is made of: stress in the cells, contact pressure at the nodes --------------


class StressField:
    """Cauchy stress at the centre of every cell, and how far the material has flowed there.

    Of bodies that remember, both are those of the last committed step: see
    :mod:`tribox.forms.bodies.memory_solid` for how they come from the quadrature points to the
    centre.

    Attributes:
        stress: (3, 3) per cell, Pa; von_mises: Pa; pressure: −tr σ/3, Pa.
        plastic_strain: equivalent plastic strain; flows: whether there is a body that flows.
    """

    def __init__(self, u: dolfinx.fem.Function, solids: Sequence[Solid]) -> None:
        """Compile the stress of each body, or take it from the cache."""
        mesh = u.function_space.mesh
        tensors = dolfinx.fem.functionspace(mesh, ("DG", 0, (3, 3)))
        scalars = dolfinx.fem.functionspace(mesh, ("DG", 0))
        self.stress = dolfinx.fem.Function(tensors, name="cauchy_stress")
        self.von_mises = dolfinx.fem.Function(scalars, name="von_mises_stress")
        self.pressure = dolfinx.fem.Function(scalars, name="pressure")
        self.plastic_strain = dolfinx.fem.Function(scalars, name="equivalent_plastic_strain")
        points = interpolation_points(tensors)
        self._parts = [
            (dolfinx.fem.Expression(solid.cauchy_stress(), points), solid.cells)
            for solid in solids
            if not solid.remembers
        ]
        self._centres = [_CentrePoints(u, solid) for solid in solids if solid.remembers]
        self.flows = any(solid.flows for solid in solids)

    def update(self) -> None:
        """Evaluate at the present displacement; collective."""
        for expression, cells in self._parts:
            self.stress.interpolate(expression, cells0=cells)
        for part in self._centres:
            part.put(self.stress, self.plastic_strain)
        self.stress.x.scatter_forward()
        self.plastic_strain.x.scatter_forward()
        sigma = self.stress.x.array.reshape(-1, 3, 3)
        self.pressure.x.array[:] = mean_pressure(sigma)
        self.von_mises.x.array[:] = von_mises(sigma)

    def own(self) -> tuple[Floats, Floats, Floats]:
        """Stress (c, 3, 3), von Mises stress (c,) and pressure (c,), Pa, of this rank's cells."""
        mesh = self.stress.function_space.mesh
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        tensors, scalars = (
            f.function_space.dofmap.list[:owned, 0] for f in (self.stress, self.pressure)
        )
        stress = self.stress.x.array.reshape(-1, 3, 3)[tensors]
        return stress, self.von_mises.x.array[scalars], self.pressure.x.array[scalars]

    def own_plastic_strain(self) -> Floats:
        """Equivalent plastic strain (c,) of this rank's cells."""
        space = self.plastic_strain.function_space
        owned = space.mesh.topology.index_map(space.mesh.topology.dim).size_local
        values: Floats = self.plastic_strain.x.array[space.dofmap.list[:owned, 0]]
        return values


class _CentrePoints:
    """The centres of the cells of one body that remembers."""

    def __init__(self, u: dolfinx.fem.Function, solid: Solid) -> None:
        space = u.function_space
        self._u, self._cells, self._nodes = u, solid.cells, space.dofmap.list[solid.cells]
        self._values = solid.stress_at(solid.cells, centre(solid.cell))
        reduced = solid.carried is not None
        self._rows = centre_rows(space, solid.section, solid.cells) if reduced else None
        self._place = rows_at(space, solid.section, solid.cells, centre(solid.cell))

    def put(self, stress: dolfinx.fem.Function, strain: dolfinx.fem.Function) -> None:
        """Write stress, Pa, and equivalent plastic strain into functions constant by cell."""
        u = self._u.x.array.reshape(-1, self._u.function_space.dofmap.index_map_bs)[self._nodes]
        volumetric = None if self._rows is None else self._rows.deformation(u)
        sigma = self._values.cauchy(self._place.deformation(u), volumetric)
        at = stress.function_space.dofmap.list[self._cells, 0]
        stress.x.array.reshape(-1, 9)[at] = sigma.reshape(-1, 9)
        strain.x.array[strain.function_space.dofmap.list[self._cells, 0]] = (
            self._values.plastic_strain()
        )


class ContactPressureField:
    """Contact pressure at the nodes of slave surfaces, 0 at all others.

    Attributes:
        pressure: Pa, at the nodes of the displacement.
    """

    def __init__(self, u: dolfinx.fem.Function, surfaces: Sequence[ContactSurface]) -> None:
        """Find the nodes; collective."""
        space = u.function_space
        degree = space.element.basix_element.degree
        scalars = like(space, dolfinx.fem.functionspace(space.mesh, ("Lagrange", degree)))
        # Files hold one set of nodes, so both numberings must be the same; DOLFINx makes them so.
        assert np.array_equal(scalars.dofmap.list, space.dofmap.list)
        self.pressure = dolfinx.fem.Function(scalars, name="contact_pressure")
        self._rows = [_interpolation(surface) for surface in surfaces]

    def update(self, pressures: Sequence[Floats]) -> None:
        """Take the pressures (v,), Pa, at the vertices of each surface, on all ranks.

        Where surfaces share a node the largest counts.
        """
        out = self.pressure.x.array
        out[:] = 0.0
        for (nodes, vertices, share), values in zip(self._rows, pressures, strict=True):
            here = np.einsum("nk,nk->n", share, values[vertices])
            out[nodes] = np.maximum(out[nodes], here)


def _interpolation(surface: ContactSurface) -> tuple[Longs, Longs, Floats]:
    """Local nodes (n,) of a slave surface, their facets' vertices (n, k) and shares; collective."""
    slave, vertices, form = surface.slave, surface.vertices, surface.shape
    linear = facet_shape(form.cell, 1).values(form.points)
    _, first = np.unique(slave.facet, return_index=True)
    number = np.repeat(vertices.of_point[first], form.count, axis=0)
    share = np.tile(linear, (len(first), 1))
    mine = (slave.nodes[first].reshape(-1), number, share)
    # A rank may have a node of the surface, but none of the facets around it.
    gathered = zip(*vertices.comm.allgather(mine), strict=True)
    nodes, number, share = (np.concatenate(parts) for parts in gathered)
    distinct, once = np.unique(nodes, return_index=True)
    local = surface.space.dofmap.index_map.global_to_local(distinct).astype(np.int64)
    here = local >= 0
    return local[here], number[once][here], share[once][here]
