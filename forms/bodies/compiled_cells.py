"""Bodies whose forces, energy and tangent compiled loops compute, several cells at a time.

The loops are those over first-order cells in plane strain, in half sections of bodies of revolution
and in space; they give what the forms that DOLFINx compiles give, to round-off.

Axis letters: c cells, a and b corners, i and j space; n local unknowns, ghosts included.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.deformation import centre_rows, quadrature_rows, ring_volume
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.materials import Hencky, Material, MooneyRivlin, NeoHookean, Yeoh
from tribox.forms.bodies.point_cells import LANES, Beside, in_lanes
from tribox.forms.bodies.solid import Solid
from tribox.forms.native import library
from tribox.geometry.compat import cell_order
from tribox.geometry.surfaces.facets import Bools, Floats, Ints

_IN_THE_PLANE: dict[type, int] = {NeoHookean: 0, MooneyRivlin: 1, Hencky: 2}
# By the section: name in the sources, the source of forces and energy and that of the tangent, and
# the materials by their number there, after which comes K/2 (ln J)² without other energies.
_LOOPS: dict[Section, tuple[str, str, str, dict[type, int]]] = {
    "plane-strain": ("plane", "plane_kernel.c", "plane_tangent.c", _IN_THE_PLANE),
    "axisymmetric": ("ring", "ring_cells.c", "ring_cells.c", _IN_THE_PLANE),
    "3D": ("space", "space_kernel.c", "space_kernel.c", {**_IN_THE_PLANE, Yeoh: 3}),
}
_CORNERS = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}
_POINTER = ctypes.c_void_p
_CELLS: list[Any] = [ctypes.c_int, ctypes.c_int, _POINTER, ctypes.c_int64, ctypes.c_int]
_CELLS += [_POINTER] * 3


@dataclass(frozen=True, slots=True)
class _Code:
    """The loops of a section for a material, by its number in them."""

    forces: Any
    energy: Any
    tangent: Any
    number: int


def _code(section: Section, material: Material) -> _Code:
    kind, loops, tangents, numbers = _LOOPS[section]
    # Hencky's energy without a shear modulus: only K/2 (ln J)² is left of it, beside points that
    # give the distortional stress themselves. It has a number of its own, for its loop skips the
    # rest.
    alone = isinstance(material, Hencky) and material.shear_modulus == 0.0
    code = _Code(
        getattr(library(loops), f"tribox_{kind}_forces"),
        getattr(library(loops), f"tribox_{kind}_energy"),
        getattr(library(tangents), f"tribox_{kind}_tangent"),
        len(numbers) if alone else numbers[type(material)],
    )
    for function, more in ((code.forces, 1), (code.energy, 1), (code.tangent, 4)):
        function.argtypes, function.restype = _CELLS + [_POINTER] * more, ctypes.c_int
    return code


class CompiledCells:
    """Owned cells of one body by the compiled loops, ``LANES`` at a time.

    Attributes:
        nodes: (c, a) local nodes of each cell, in the order of the loop.
    """

    def __init__(
        self, code: _Code, nodes: Ints, table: Floats, constants: Floats, kind: int
    ) -> None:
        """Arrange the cells for the loops.

        Args:
            code: the loops.
            nodes: (c, a) int32, in DOLFINx's order.
            table: (c, k) what the loops need of the geometry of each cell.
            constants: of the strain energy.
            kind: 0; 1 where the volumetric part is taken at the centre; 2 of simplices.
        """
        self.nodes, self._parts = nodes, (code, table, constants, kind)
        self._code, self._constants = code, constants
        triangles = nodes.shape[1] == 3  # which repeat their third node
        self._rows = in_lanes(nodes[:, [0, 1, 2, 2]] if triangles else nodes)
        self._table = in_lanes(table)
        self._result = np.zeros(1)
        blocks = len(self._rows)
        # Addresses only: the arrays behind them are attributes, and live as long as this object.
        self._arguments = (
            code.number,
            kind,
            constants.ctypes.data,
            blocks,
            len(nodes) - (blocks - 1) * LANES,
            self._rows.ctypes.data,
            self._table.ctypes.data,
        )

    def part(self, take: Bools) -> CompiledCells:
        """The cells (c,) to ``take`` by themselves."""
        code, table, constants, kind = self._parts
        return CompiledCells(code, self.nodes[take], table[take], constants, kind)

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """See :meth:`tribox.forms.bodies.internal_force.BodyForce.add`.

        Forces of a cell that is turned inside out are NaN where the forms' would be.
        """
        bad: int = self._code.forces(*self._arguments, u.ctypes.data, out.ctypes.data)
        return bad == 0

    def energy(self, u: Floats) -> float:
        """Strain energy at ``u`` (n,), J per unit thickness; infinite where a cell is inverted."""
        bad = self._code.energy(*self._arguments, u.ctypes.data, self._result.ctypes.data)
        return float(np.inf if bad else self._result[0])

    def add_tangent(
        self,
        u: Floats,
        values: Floats,
        starts: NDArray[np.int32],
        excess: Floats | None = None,
        beside: Beside | None = None,
    ) -> None:
        """Add the element matrices at ``u`` (n,), N/m per unit thickness.

        Args:
            u: m.
            values: of a sparse matrix, changed.
            starts: (c, a, i, b), contiguous, from where on in ``values`` the dim numbers of the
                row (a, i) and the columns (b, j) are.
            excess: (c,), Pa, added to the volumetric pressures of ``q1-sri``
                (:mod:`tribox.forms.bodies.solid`).
            beside: points of the same cells that remember, whose matrices are added too.
        """
        assert starts.flags.c_contiguous and starts.dtype == np.int32
        assert starts.shape[:2] == self.nodes.shape
        more = None if excess is None else np.ascontiguousarray(excess)
        self._code.tangent(
            *self._arguments,
            u.ctypes.data,
            None if more is None else more.ctypes.data,
            None if beside is None else ctypes.addressof(beside),
            starts.ctypes.data,
            values.ctypes.data,
        )


def compiled_cells(space: dolfinx.fem.FunctionSpace, solid: Solid) -> CompiledCells | None:
    """The loop for this rank's cells of a body, even if there are none; None: no loop covers it.

    All ranks get one, or none does.
    """
    mesh, material, section = space.mesh, solid.elastic, solid.section
    corners = _CORNERS[mesh.topology.cell_name()]
    linear = space.dofmap.dof_layout.num_dofs == corners and cell_order(mesh) == 1
    if not linear or material is None or type(material) not in _LOOPS[section][3]:
        return None
    nodes = np.asarray(space.dofmap.list, dtype=np.int32)[solid.cells]
    simplex = corners == mesh.topology.dim + 1
    if section == "axisymmetric":
        table = _points(space, solid)
    else:
        x = space.tabulate_dof_coordinates()[:, : mesh.topology.dim][nodes]
        table = coefficients(x).reshape(len(nodes), 21) if section == "3D" else _edges(x)
    constants = np.array(list(material.parameters().values()))
    kind = 2 if simplex else int(solid.reduced)
    return CompiledCells(_code(section, material), nodes, table, constants, kind)


def _points(space: dolfinx.fem.FunctionSpace, solid: Solid) -> Floats:
    """Table (c, p·(3 a + 1)) of the points of the cells of a ring.

    Of each point the gradients (j, a), 1/m, of the shape functions, these over the radius (a), 1/m,
    and the weight, m³. The last point of ``q1-sri`` is the centre.
    """
    section, cells = solid.section, solid.cells
    rows, weight = quadrature_rows(space, section, cells, solid.full_degree)
    if solid.reduced:
        rows.append(centre_rows(space, section, cells))
        weight = np.concatenate([weight, ring_volume(rows[-1], section)[None]])
    out = []
    for g, one in enumerate(rows):
        gradients, hoop = one.gradients, one.values / one.place[:, :1]
        out += [gradients[:, :, 0], gradients[:, :, 1], hoop, weight[g, :, None]]
    return np.concatenate(out, axis=1)


def _edges(x: Floats) -> Floats:
    """Edges (c, 6), m, along both directions of cells (c, a, i), and the mixed difference."""
    last = x[:, -1]  # triangles repeat their third node
    edges = [x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], last - x[:, 2] - x[:, 1] + x[:, 0]]
    return np.stack(edges, axis=1).reshape(len(x), 6)


def coefficients(x: Floats) -> Floats:
    """Coefficients (c, 7, i) of ξ, η, ξη, ζ, ξζ, ηζ, ξηζ in the positions (c, a, i) of the nodes.

    The parent cell is [−1, 1]³; tetrahedra have the edges from their first node in the places of
    ξ, η and ζ.
    """
    if x.shape[1] == 4:
        found = np.zeros((len(x), 7, 3))
        found[:, [0, 1, 3]] = x[:, 1:] - x[:, :1]
        return found
    # N_a = ⅛ Π (1 ± ξ_i): a monomial, whose bits m are its directions, has the coefficient ⅛ times
    # the signs of the node, whose bits a are the sides it is on. Σ_a of each is 0, so that the
    # first node may be taken off before the products, which keeps the digits of bodies far from the
    # origin.
    signs = np.array([[(-1.0) ** (m & ~a).bit_count() for a in range(8)] for m in range(1, 8)])
    return np.einsum("ma,cai->cmi", signs / 8.0, x - x[:, :1])
