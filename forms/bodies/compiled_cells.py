"""Bodies whose forces, energy and tangent compiled loops compute, several cells at a time.

A kernel gives stress, moduli and energy of an elastic point, the loop over points
(:mod:`tribox.forms.bodies.point_cells`) makes cells of any kind from them. Forces and energy of
first-order cells in plane strain and in space, of which explicit steps need nothing else, have
loops of their own. All give what the forms that DOLFINx compiles give, to round-off.

Axis letters: c cells, a and b corners, i and j space; n local unknowns, ghosts included.
"""

from __future__ import annotations

import ctypes
from functools import cached_property
from typing import Any

import dolfinx
import numpy as np

from tribox.forms.bodies import point_cells, point_stress
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.materials import Material
from tribox.forms.bodies.memory_solid import MemorySolid
from tribox.forms.bodies.solid import Solid
from tribox.forms.native import library
from tribox.geometry.compat import cell_order
from tribox.geometry.surfaces.facets import Floats

# Loops over first-order cells: name in the sources, the source, and the materials that they know.
_FIRST_ORDER: dict[Section, tuple[str, str, int]] = {
    "plane-strain": ("plane", "plane_kernel.c", 3),
    "3D": ("space", "space_kernel.c", 5),
}
_POINTER = ctypes.c_void_p
_CELLS: list[Any] = [ctypes.c_int, ctypes.c_int, _POINTER, ctypes.c_int64, ctypes.c_int]
_CELLS += [_POINTER] * 4


class _FirstOrder:
    """Forces and energy of first-order cells by the loops for them."""

    def __init__(self, space: dolfinx.fem.FunctionSpace, solid: Solid, material: Material) -> None:
        name, source, _ = _FIRST_ORDER[solid.section]
        nodes = np.asarray(space.dofmap.list, dtype=np.int32)[solid.cells]
        x = space.tabulate_dof_coordinates()[:, : space.mesh.topology.dim][nodes]
        table = coefficients(x).reshape(len(nodes), 21) if solid.section == "3D" else _edges(x)
        triangles = nodes.shape[1] == 3  # which repeat their third node
        self._rows = point_cells.in_lanes(nodes[:, [0, 1, 2, 2]] if triangles else nodes)
        self._table = point_cells.in_lanes(table)
        self._constants = point_stress.constants_of(material)
        code = library(source)
        self._code = [getattr(code, f"tribox_{name}_{of}") for of in ("forces", "energy")]
        for function in self._code:
            function.argtypes, function.restype = _CELLS, ctypes.c_int
        blocks = len(self._rows)
        # Addresses only: the arrays behind them are attributes, and live as long as this object.
        self._arguments = (
            point_stress.NUMBERS[type(material)],
            2 if triangles else int(solid.reduced),
            self._constants.ctypes.data,
            blocks,
            len(nodes) - (blocks - 1) * point_cells.lanes(),
            self._rows.ctypes.data,
            self._table.ctypes.data,
        )

    def call(self, u: Floats, forces: Floats | None, energy: Floats | None) -> bool:
        """Add forces, or put the energy there; False: a cell is inverted."""
        number, out = (1, energy) if forces is None else (0, forces)
        assert out is not None
        bad: int = self._code[number](*self._arguments, u.ctypes.data, out.ctypes.data)
        return bad == 0


class CompiledCells:
    """Owned cells of one body by the compiled loops."""

    def __init__(self, space: dolfinx.fem.FunctionSpace, solid: Solid, material: Material) -> None:
        """Take a body's cells in ``space``, with a loop for a material's forces and energy."""
        self._space, self._solid, self._material = space, solid, material
        # Beside points that give the distortional stress themselves, K/2 (ln J)² is left.
        self._centres_alone = isinstance(solid, MemorySolid) and not solid.law.added
        degree, section = space.element.basix_element.degree, solid.section
        self._linear = degree == 1 and cell_order(space.mesh) == 1
        first = (
            self._linear
            and section in _FIRST_ORDER
            and point_stress.NUMBERS.get(type(material), len(point_stress.NUMBERS))
            < _FIRST_ORDER[section][2]
            and not self._centres_alone
            and solid.cell != "tetrahedron"  # whose one point any loop takes as quickly
        )
        self._first_order = _FirstOrder(space, solid, material) if first else None

    @cached_property
    def loops(self) -> list[point_cells.PointCells]:
        """The loops over points of full integration, and over the centres of ``q1-sri``."""
        solid, section, loops = self._solid, self._solid.section, []
        if not self._centres_alone:
            part = point_stress.DISTORTION if solid.reduced else point_stress.WHOLE
            loops.append(self._loop(self._cells(), part))
        if solid.reduced:
            loops.append(
                self._loop(
                    point_cells.centres_of(self._space, section, solid.cells), point_stress.VOLUME
                )
            )
        return loops

    def _cells(self) -> point_cells.Cells:
        """The cells with their points, shared with those that remember where these are the same."""
        solid, degree = self._solid, self._solid.full_degree
        simplex = solid.cell in ("triangle", "tetrahedron")
        if simplex and self._linear and solid.section != "axisymmetric":
            degree = 1  # the strain is constant, but for that of hoops
        if isinstance(solid, MemorySolid) and degree == solid.full_degree:
            return solid.point_cells.cells
        return point_cells.cells_of(self._space, solid.section, solid.cells, degree)

    def _loop(self, cells: point_cells.Cells, part: int) -> point_cells.PointCells:
        kernel = point_stress.energy_kernel(
            point_cells.NAMES[self._solid.section], self._material, part
        )
        return point_cells.PointCells(self._solid.section, cells, point_cells.Moduli(kernel))

    def tangent_loops(self, u: Floats) -> list[point_cells.PointCells]:
        """The loops, ready to add the tangent at ``u`` (n,), m."""
        return self.loops

    def add(self, u: Floats, out: Floats) -> bool:
        """Add the nodal forces at the displacements ``u`` to ``out``; False: a cell is inverted.

        Its forces are NaN where the forms' would be.
        """
        if self._first_order is not None:
            return self._first_order.call(u, out, None)
        works = [loop.work(loop.moduli.kernel, u=u, forces=out) for loop in self.loops]
        return self.loops[0].run(works)

    def energy(self, u: Floats) -> float:
        """Strain energy at ``u`` (n,), J per unit thickness; infinite where a cell is inverted."""
        found: Floats = np.zeros(3)
        if self._first_order is not None:
            good = self._first_order.call(u, None, found)
        else:
            works = [loop.work(loop.moduli.kernel, u=u, energies=found) for loop in self.loops]
            good = self.loops[0].run(works)
        return float(found[0] if good else np.inf)


class OwnCells(CompiledCells):
    """The same of an energy of the user's own, which is evaluated in numpy."""

    def __init__(self, space: dolfinx.fem.FunctionSpace, solid: Solid, material: Material) -> None:
        """Differentiate the energy, too: what is wrong with it is told beforehand."""
        super().__init__(space, solid, material)
        self._energies: list[point_stress.AtPoints] = []
        _ = self.loops

    def _loop(self, cells: point_cells.Cells, part: int) -> point_cells.PointCells:
        section = self._solid.section
        self._energies.append(point_stress.energy_at_points(self._material, part, section == "3D"))
        return point_cells.PointCells(section, cells)

    def add(self, u: Floats, out: Floats) -> bool:
        good = True
        for loop, F, energy in self._points(u):
            P = np.concatenate([energy(piece, False)[1] for piece in _pieces(F)])
            loop.add_forces(u, P, out)
            good &= bool(np.isfinite(P).all())
        return good

    def energy(self, u: Floats) -> float:
        total = 0.0
        for loop, F, energy in self._points(u):
            W = np.concatenate([energy(piece, False)[0] for piece in _pieces(F)])
            total += float(loop.cells.weights @ W)
        return total if np.isfinite(total) else np.inf

    def tangent_loops(self, u: Floats) -> list[point_cells.PointCells]:
        for loop, F, energy in self._points(u):
            # What lies between takes many times the room of the moduli.
            found = []
            for piece in _pieces(F):
                _, P, A = energy(piece, True)
                assert A is not None
                found.append(point_cells.moduli_in_place(piece, P, A))
            loop.moduli.A = np.concatenate(found)
        return self.loops

    def _points(
        self, u: Floats
    ) -> list[tuple[point_cells.PointCells, Floats, point_stress.AtPoints]]:
        """Each loop with the deformation gradients (k, p) at its points, and the energy there."""
        pairs = zip(self.loops, self._energies, strict=True)
        return [(loop, loop.deformation(u), energy) for loop, energy in pairs]


def _pieces(F: Floats) -> list[Floats]:
    return np.split(F, range(point_cells.PIECE, len(F), point_cells.PIECE))


def compiled_cells(space: dolfinx.fem.FunctionSpace, solid: Solid) -> CompiledCells | None:
    """The loops for a body's cells, on all ranks or none; None: there is no such energy."""
    material = solid.elastic
    if material is None:
        return None
    material = getattr(material, "elastic", material)
    return (CompiledCells if type(material) in point_stress.NUMBERS else OwnCells)(
        space, solid, material
    )


def _edges(x: Floats) -> Floats:
    """Edges (c, 6), m, along both directions of cells (c, a, i), and the mixed difference."""
    last = x[:, -1]  # triangles repeat their third node
    edges = [x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], last - x[:, 2] - x[:, 1] + x[:, 0]]
    return np.stack(edges, axis=1).reshape(len(x), 6)


def coefficients(x: Floats) -> Floats:
    """Coefficients (c, 7, i) of ξ, η, ξη, ζ, ξζ, ηζ, ξηζ in positions (c, a, i), on [−1, 1]³."""
    # N_a = ⅛ Π (1 ± ξ_i): a monomial, whose bits m are its directions, has the coefficient ⅛ times
    # the signs of the node, whose bits a are the sides it is on. Σ_a of each is 0, so that the
    # first node may be taken off before the products, which keeps the digits of bodies far from the
    # origin.
    signs = np.array([[(-1.0) ** (m & ~a).bit_count() for a in range(8)] for m in range(1, 8)])
    return np.einsum("ma,cai->cmi", signs / 8.0, x - x[:, :1])
