"""How far a body is from undeformed: an upper bound of its displacement gradients, in numpy.

Axis letters: c cells, a nodes of a cell, i, j space, α reference directions.
"""

from __future__ import annotations

import basix
import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.forms.bodies.deformation import ON_AXIS, Rows, rows_at
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Floats


class GradientBound:
    """An upper bound of |∇u| (Frobenius) at the quadrature points of one body's own cells.

    With Σ_a ∇N_a = 0, |∇u| = |Σ_a (u_a − u_0) ⊗ ∇N_a| ≤ Σ_a |u_a − u_0| |∇N_a|, u_0 being the
    displacement of the first node. A rotation by θ counts as well, with about θ. The bound is up to
    7 times too large, in elements of second order 12 times in the plane and 40 times in space. With
    axial symmetry the hoop strain is at most the largest |u_x|/x of the nodes.

    Attributes:
        content: m³ (m² in a plane section), volume of these cells.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace, solid: Solid) -> None:
        """Tabulate the gradients of the shape functions.

        Args:
            space: of the displacement.
            solid: the body.
        """
        kind = basix.CellType[space.mesh.topology.cell_name()]
        nodes = space.dofmap.list[solid.cells]
        slopes = np.zeros(nodes.shape)  # 1/m, largest |∇N_a| of all points
        self.content = 0.0
        for xi, weight in zip(*basix.make_quadrature(kind, solid.full_degree), strict=True):
            rows = rows_at(space, solid.section, solid.cells, xi[None])
            self.content += float(weight * rows.volume.sum())
            np.maximum(slopes, _gradient_norms(rows), out=slopes)
        self._first, self._others = nodes[:, :1].copy(), nodes[:, 1:].copy()
        self._slopes = slopes[:, 1:].copy()
        self._ring, self._curvature = np.empty(0, dtype=np.int32), np.empty(0)
        if solid.section == "axisymmetric":
            own = np.unique(nodes)
            radius = space.tabulate_dof_coordinates()[own, 0]
            off_axis = radius > ON_AXIS * radius.max(initial=0.0)
            self._ring, self._curvature = own[off_axis], 1.0 / radius[off_axis]

    def largest(self, u: Floats) -> float:
        """The bound for this rank's cells at nodal displacements ``u`` (n, i), m, with ghosts."""
        moved = u[self._others]
        moved -= u[self._first]
        lengths = np.sqrt(np.einsum("cai,cai->ca", moved, moved))
        bound = float(np.einsum("ca,ca->c", self._slopes, lengths).max(initial=0.0))
        hoop = float((np.abs(u[self._ring, 0]) * self._curvature).max(initial=0.0))
        return float(np.hypot(bound, hoop))


def _gradient_norms(rows: Rows) -> Floats:
    """Lengths (c, a), 1/m, of the shape functions' gradients."""
    gradients = np.einsum("cza,czj->caj", rows.slopes, rows.inverse)
    lengths: Floats = np.sqrt(np.einsum("caj,caj->ca", gradients, gradients))
    return lengths


def thickness_ratio(space: dolfinx.fem.FunctionSpace, solid: Solid, content: float) -> float:
    """Thickness of a body over its length, at most 1; collective.

    The thickness is that of a plate or beam of the same volume in the box around the body: of a
    thin ring, a frame or a beam askew it is right to a factor of about 3, or too small.

    Args:
        space: of the displacement.
        solid: the body.
        content: m³ (m² in a plane section), this rank's volume of the body.
    """
    comm, dim = space.mesh.comm, space.mesh.geometry.dim
    x = space.tabulate_dof_coordinates()[np.unique(space.dofmap.list[solid.cells]), :dim]
    far = np.stack([-x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)])
    comm.Allreduce(MPI.IN_PLACE, far, op=MPI.MAX)
    extents = np.sort(far.sum(axis=0))[::-1]
    thickness = comm.allreduce(content) / float(np.prod(extents[:-1]))
    return min(1.0, thickness / float(extents[0]))
