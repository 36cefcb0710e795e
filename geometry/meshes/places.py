"""Places in the undeformed mesh: the cells around a point, and how far it is from them.

Axis letters: p points, k pairs of a point and a cell around it, c cells, a corners of a cell,
i space, α reference directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import basix
import dolfinx
import numpy as np

from tribox.geometry.compat import cell_nodes, cell_order
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs

INSIDE = 1e-6  # reference coordinates by which a point may lie outside a cell it is counted to
NEWTON_STEPS = 40
_SIMPLICES = ("triangle", "tetrahedron")


@dataclass(frozen=True, slots=True)
class CellPlaces:
    """Points in the cells around them; one on a side between cells is in each of these."""

    point: Longs  # (k,) number of the point
    cell: Ints  # (k,) local number of the cell
    xi: Floats  # (k, α) reference coordinates of the point in the cell


def shape_functions(cell: str, degree: int, order: int, xi: Floats) -> Floats:
    """Lagrange shape functions and derivatives (z, p, a) at ξ (p, α), up to an order.

    Row z is the function, then its derivatives in basix's order.
    """
    at = xi if len(xi) else centre(cell)  # basix wants one point at least
    table: Floats = _lagrange(cell, degree).tabulate(order, at)[..., 0]
    return table[:, : len(xi)]


@lru_cache
def _lagrange(cell: str, degree: int) -> basix.finite_element.FiniteElement:
    """The element whose nodes a mesh's cells and displacements have."""
    return basix.create_element(
        basix.ElementFamily.P, basix.CellType[cell], degree, basix.LagrangeVariant.equispaced
    )


def nodes_of(mesh: dolfinx.mesh.Mesh, cells: Ints) -> Floats:
    """Nodes (c, a, i), m, of local cells, the corners first."""
    return mesh.geometry.x[cell_nodes(mesh)[cells]][:, :, : mesh.geometry.dim]


def centre(cell: str) -> Floats:
    """Reference coordinates (1, α) of the middle of a cell."""
    return basix.geometry(basix.CellType[cell]).mean(axis=0)[None]


def places_in(mesh: dolfinx.mesh.Mesh, cells: Ints, points: Floats) -> CellPlaces:
    """The cells, of local ones (c,), that each point (p, i), m, lies in or on, on any ranks.

    What is found does not depend on the ranks: every rank has the same corners.
    """
    X = nodes_of(mesh, cells)
    low, high = _boxes(X, cell_order(mesh))
    slack = INSIDE * (high - low).max(axis=1, initial=0.0)[:, None]
    near = [
        np.flatnonzero(np.all((low - slack <= x) & (x <= high + slack), axis=1)) for x in points
    ]
    point = np.repeat(np.arange(len(points)), [len(n) for n in near])
    row = np.concatenate([*near, np.empty(0, dtype=np.int64)]).astype(np.int64)
    kind = mesh.topology.cell_name()
    xi = places_from_centre(kind, cell_order(mesh), X[row], points[point])
    inside = _inside(kind, xi)
    return CellPlaces(point[inside], cells[row[inside]], xi[inside])


def nearest_place(mesh: dolfinx.mesh.Mesh, cells: Ints, point: Floats) -> tuple[float, Floats]:
    """Distance (m) of a point from local cells, and the place (i,) there that is nearest.

    Infinite without cells. (Cells that are not convex count as the convex hull of their nodes.)
    """
    best, place = np.inf, np.zeros_like(point)
    X = nodes_of(mesh, cells)
    low, high = _boxes(X, cell_order(mesh))
    # Distance from a cell's box: once it exceeds the best, no later cell is nearer.
    outside: Floats = np.maximum(low - point, point - high)
    bound = np.linalg.norm(np.maximum(outside, 0.0), axis=1)
    # DOLFINx's distance of hulls knows space only.
    here = np.zeros((1, 3))
    here[0, : len(point)] = point
    for row in np.argsort(bound):
        if bound[row] >= best:
            break
        hull = np.zeros((X.shape[1], 3))
        hull[:, : len(point)] = X[row]
        away = dolfinx.geometry.compute_distance_gjk(hull, here)
        if (distance := float(np.linalg.norm(away))) < best:
            best, place = distance, point + away[: len(point)]
    return best, place


def _boxes(X: Floats, order: int) -> tuple[Floats, Floats]:
    """Lowest and highest corners (c, i) of boxes around cells with nodes (c, a, i)."""
    low, high = X.min(axis=1), X.max(axis=1)
    # A parabola leaves the box of its three nodes by an eighth of its size at most, in space twice.
    bulge = 0.25 * (high - low) if order > 1 else np.zeros_like(low)
    return low - bulge, high + bulge


def places_from_centre(cell: str, order: int, X: Floats, points: Floats) -> Floats:
    """ξ (k, α) with Σ_a N_a(ξ) X_a = x, by Newton's method; not finite where there is none."""
    xi = np.repeat(centre(cell), len(points), axis=0)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS if len(points) else 0):
            table = shape_functions(cell, order, 1, xi)
            away = points - np.einsum("ka,kai->ki", table[0], X)
            edges = np.einsum("zka,kai->kiz", table[1:], X)
            flat = np.abs(np.linalg.det(edges)) == 0.0
            # A singular map would end the solve of all cells: any step will do for a point that is
            # then outside.
            edges[flat] = np.eye(xi.shape[1])
            step = np.linalg.solve(edges, away[..., None])[..., 0]
            # Beyond these bounds the point is outside; a twisted map may have no way back.
            xi = np.clip(xi + step, -1.0, 2.0)
            if np.all(np.abs(step) < 1e-13) or (cell in _SIMPLICES and order == 1):
                break
    return xi


def excess(cell: str, xi: Floats) -> Floats:
    """By how much reference coordinates (k, α) lie outside a cell (k,); negative inside."""
    beyond = xi.sum(axis=1) if cell in _SIMPLICES else xi.max(axis=1, initial=-np.inf)
    return np.maximum((-xi).max(axis=1, initial=-np.inf), beyond - 1.0)


def clipped(cell: str, xi: Floats) -> Floats:
    """Reference coordinates (k, α) moved into a cell, those inside as they are."""
    inner = np.clip(xi, 0.0, 1.0)
    if cell in _SIMPLICES:
        inner /= np.maximum(inner.sum(axis=1, keepdims=True), 1.0)
    return inner


def _inside(cell: str, xi: Floats) -> Bools:
    """Whether reference coordinates (k, α) lie in a cell."""
    return excess(cell, xi) <= INSIDE
