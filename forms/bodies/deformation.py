"""Deformation gradients at fixed material points, from the nodal displacements, in numpy.

Axis letters: p points, c cells, q quadrature points of a cell, a nodes of a cell, i, j, l space,
α, β reference directions. Gradients are (3, 3), the direction across a plane being the third.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import basix
import dolfinx
import numpy as np

from tribox.forms.bodies.kinematics import Section
from tribox.geometry.compat import cell_order
from tribox.geometry.meshes.places import centre, nodes_of, shape_functions
from tribox.geometry.surfaces.facets import Floats, Ints

PIECE = 2048  # cells that are gone through at a time
ON_AXIS = 1e-6  # radius over the cell's outer one up to which a point lies on the axis


@dataclass(frozen=True, slots=True)
class Rows:
    """What takes the displacements of a cell's nodes to one point of it; by cell, (c, …)."""

    values: Floats  # (c, a) shape functions
    slopes: Floats  # (c, α, a) their derivatives in the reference cell
    inverse: Floats  # (c, α, j), 1/m, ∂ξ_α/∂X_j
    place: Floats  # (c, i), m, undeformed
    # (c,) 1/m, by which a radial displacement gives the hoop strain; 0 on the axis, where it is the
    # radial strain instead, and in all sections but axisymmetric ones
    across: Floats
    on_axis: Floats  # (c,) whether that is so
    volume: Floats  # (c,) determinant of the Jacobian, m² or m³

    def deformation(self, u: Floats) -> Floats:
        """Deformation gradients (c, 3, 3) of nodal displacements ``u`` (c, a, i), m."""
        dim = u.shape[2]
        F: Floats = np.tile(np.eye(3), (len(u), 1, 1))
        F[:, :dim, :dim] += (self.slopes @ u).transpose(0, 2, 1) @ self.inverse
        if dim == 2:
            # The hoop stretch 1 + u_r/R. On the axis both vanish, and its limit is the radial
            # stretch: u_r/R → ∂u_r/∂R.
            radial = np.einsum("ca,ca->c", self.values, u[:, :, 0])
            F[:, 2, 2] += self.across * radial + self.on_axis * (F[:, 0, 0] - 1.0)
        return F

    def displacement(self, u: Floats) -> Floats:
        """Displacements (c, i), m."""
        return np.einsum("ca,cai->ci", self.values, u)

    @property
    def gradients(self) -> Floats:
        """Gradients (c, a, j), 1/m, of the shape functions."""
        return np.einsum("cza,czj->caj", self.slopes, self.inverse)


def rows_at(space: dolfinx.fem.FunctionSpace, section: Section, cells: Ints, xi: Floats) -> Rows:
    """Rows at ξ (c, α), or (1, α) the same in all, of local cells (c,)."""
    mesh = space.mesh
    kind, X = mesh.topology.cell_name(), nodes_of(mesh, cells)
    geometry = shape_functions(kind, cell_order(mesh), 1, xi)
    place = np.einsum("ca,cai->ci", _each(geometry[0], cells), X)
    # ∂X/∂ξ of an isoparametric cell; its inverse takes slopes in the reference cell to those in
    # space.
    edges = np.einsum("zca,cai->ciz", _each(geometry[1:], cells), X)
    table = shape_functions(kind, space.element.basix_element.degree, 1, xi)
    values, slopes = _each(table[0], cells), _each(table[1:], cells).transpose(1, 0, 2)
    across, axis = _hoop(X, place, section)
    volume = np.abs(np.linalg.det(edges))
    return Rows(values, slopes, np.linalg.inv(edges), place, across, axis, volume)


def centre_rows(space: dolfinx.fem.FunctionSpace, section: Section, cells: Ints) -> Rows:
    """Rows of the kinematics from which ``q1-sri`` takes the volume of a cell.

    Those of its centre; of a ring's cell with the in-plane gradients extrapolated to the centroid
    of its volume by their own derivatives, at R + h²/(12 R) for a width h at the radius R. The work
    of an axial stress in a rectangular cell is that at the centroid, the work of a hoop stress that
    at R; next to the axis the two are h/6 apart.
    """
    kind = space.mesh.topology.cell_name()
    rows = rows_at(space, section, cells, centre(kind))
    if section != "axisymmetric" or not len(cells):
        return rows
    X, table = nodes_of(space.mesh, cells), shape_functions(kind, 1, 2, centre(kind))[:, 0]
    # The order of basix: N, N_ξ, N_η, N_ξξ, N_ξη, N_ηη. Second derivatives of N along an edge of
    # the cell and across are those in the reference cell less what the edges themselves bend.
    second = table[[[3, 4], [4, 5]]]
    edges, bend = np.einsum("za,cai->ciz", table[1:3], X), np.einsum("zya,cai->cizy", second, X)
    gradients = rows.inverse.transpose(0, 2, 1) @ rows.slopes
    curved = second - np.einsum("cia,cizy->czya", gradients, bend)
    # Centroid of ∫ 2πR dA less the centre. In a reference cell of side 1 the second moments are
    # 1/12 in each direction, and 0 mixed: with R linear, J Jᵀ e_R/(12 R).
    away = np.einsum("ciz,cz->ci", edges, edges[:, 0]) / (12.0 * rows.place[:, :1])
    towards = np.einsum("cyi,ci->cy", rows.inverse, away)
    return replace(rows, slopes=rows.slopes + np.einsum("czya,cy->cza", curved, towards))


def quadrature_rows(
    space: dolfinx.fem.FunctionSpace, section: Section, cells: Ints, degree: int
) -> tuple[list[Rows], Floats]:
    """Rows of quadrature points of local cells (c,), and weights (q, c), m² or m³, of rings."""
    kind = basix.CellType[space.mesh.topology.cell_name()]
    points, weights = basix.make_quadrature(kind, degree)
    rows = [rows_at(space, section, cells, x[None]) for x in points]
    return rows, np.stack(
        [w * ring_volume(one, section) for w, one in zip(weights, rows, strict=True)]
    )


def ring_volume(rows: Rows, section: Section) -> Floats:
    """Determinant (c,) of the Jacobian, m² or m³, of whole rings."""
    return (
        2.0 * np.pi * rows.place[:, 0] * rows.volume if section == "axisymmetric" else rows.volume
    )


def volume_ratios(u: dolfinx.fem.Function, section: Section, cells: Ints, degree: int) -> Floats:
    """J = det F (c, q) at quadrature points of local cells (c,), at displacements ``u``, m."""
    space, mesh = u.function_space, u.function_space.mesh
    kind, dim = mesh.topology.cell_name(), mesh.geometry.dim
    points, _ = basix.make_quadrature(basix.CellType[kind], degree)
    geometry = shape_functions(kind, cell_order(mesh), 1, points)
    table = shape_functions(kind, space.element.basix_element.degree, 1, points)
    ratio = np.empty((len(cells), len(points)))
    for at in range(0, len(cells), PIECE):  # what lies between would not stay in caches
        some = cells[at : at + PIECE]
        moved = u.x.array.reshape(-1, dim)[space.dofmap.list[some]]
        # (c, i, z, q), z the function itself, then its derivatives along the reference directions
        before: Floats = np.asarray(np.tensordot(nodes_of(mesh, some), geometry, axes=(1, 2)))
        change: Floats = np.asarray(np.tensordot(moved, table, axes=(1, 2)))
        found = _determinant(before[:, :, 1:] + change[:, :, 1:])
        found /= _determinant(before[:, :, 1:])
        if section == "axisymmetric":
            found *= 1.0 + change[:, 0, 0] / before[:, 0, 0]
        ratio[at : at + PIECE] = found
    return ratio


def _determinant(edges: Floats) -> Floats:
    """Of matrices (c, i, α, q), by components: (c, q)."""
    a, b = edges[:, 0], edges[:, 1]
    if edges.shape[1] == 2:
        return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.einsum("czq,czq->cq", np.cross(a, b, axis=1), edges[:, 2])


def _each(table: Floats, cells: Ints) -> Floats:
    """A table (…, c or 1, a) with the same values for every cell where it has one row."""
    shape = (*table.shape[:-2], len(cells), table.shape[-1])
    return np.broadcast_to(table, shape)


def _hoop(X: Floats, place: Floats, section: Section) -> tuple[Floats, Floats]:
    """``across`` and ``on_axis`` of :class:`Rows`."""
    none = np.zeros(len(place))
    if section != "axisymmetric":
        return none, none
    radius, outer = place[:, 0], X[:, :, 0].max(axis=1, initial=0.0)
    axis = radius <= ON_AXIS * outer
    return np.where(axis, 0.0, 1.0 / np.where(axis, 1.0, radius)), axis.astype(np.float64)
