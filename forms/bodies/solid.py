"""One solid body: residual, tangent and strain energy of its material on its cells.

:class:`Solid` is a body whose stress follows from its present deformation;
:class:`tribox.forms.bodies.memory_solid.MemorySolid` is one whose material points remember.

Selective reduced integration (``q1-sri``) takes the distortional energy at 2 × 2 (2 × 2 × 2 in
space) Gauss points and the volumetric energy at the centre. In a section of a body of revolution
all integrals carry the weight 2πx, so that forces and energies are those of the whole body.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Literal

import basix.cell
import dolfinx
import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.forms.bodies import point_stress
from tribox.forms.bodies.kinematics import Section, body_measure, circumference, section_of
from tribox.forms.bodies.materials import Material, oedometric_modulus
from tribox.forms.bodies.point_cells import PointCells, centres_of
from tribox.forms.bodies.point_state import Floats, PointHistory
from tribox.geometry.surfaces.facets import Ints

Formulation = Literal["q1", "q1-sri", "q2"]
DEGREE: dict[Formulation, int] = {"q1": 1, "q1-sri": 1, "q2": 2}
"""Degree of the displacement in each formulation."""


def full_degree(formulation: Formulation, cell: str) -> int:
    """Degree of the quadrature that leaves no mode of deformation without energy.

    2 × 2 (× 2) Gauss points for first-order quadrilaterals and hexahedra, 3 × 3 (× 3) for those of
    second order. The energy of linear tetrahedra is constant; that of linear triangles is taken at
    three points, for the hoop strain. Quadratic triangles and tetrahedra take six points.
    """
    simplex = cell in ("triangle", "tetrahedron")
    if DEGREE[formulation] == 2:
        return 3 if simplex else 4
    return 1 if cell == "tetrahedron" else 2


class Solid:
    """A body: its cells, its material, and the compiled forms of its strain energy.

    Attributes:
        remembers: whether its stress depends on what its material points remember; flows: whether
            they yield; unloading: whether tangents are to be those of points that do not flow on.
        cell: shape of the cells.
        reduced: whether the volumetric part of the strain energy is taken at the cells' centres.
    """

    remembers = False
    flows = False
    unloading = False

    def __init__(
        self,
        name: str,
        u: dolfinx.fem.Function,
        cells: NDArray[np.int32],
        material: Material,
        formulation: Formulation,
        density: float = 0.0,
        section: Section | None = None,
    ) -> None:
        """Take the body's cells and its material.

        Args:
            name: the body's name, for messages.
            u: displacement, m, of the degree of the formulation.
            cells: local cells (owned and ghosts) of the body.
            formulation: ``q1`` for full, ``q1-sri`` for selective reduced integration of
                first-order elements, ``q2`` for second-order ones with full integration.
            density: kg/m³, reference.
            section: what the mesh stands for; by default plane strain, or a body in space.

        Raises:
            ValueError: the displacement is not of the formulation's degree, or the section does
                not fit the mesh.
        """
        self.name = name
        self.material = material
        self.density = density
        mesh = u.function_space.mesh
        self.section = section_of(mesh.geometry.dim, section)
        degree = u.function_space.ufl_element().degree
        if degree != DEGREE[formulation]:
            raise ValueError(f"{name}: {formulation} on a displacement of degree {degree}")
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        # A cell is integrated by the rank that owns it; sorted, as `PointValues` searches in them.
        self.cells = np.sort(cells[cells < owned])
        self._u = u
        self._roundoff = self._roundoff_forms()
        self.cell = mesh.topology.cell_name()
        self.full_degree = full_degree(formulation, self.cell)
        # An energy without a part of J, as a user's own may be, has nothing to take at the centre.
        self.reduced = formulation == "q1-sri" and point_stress.has_volume(material)
        self._start_points()

    @cached_property
    def carried(self) -> CarriedPressure | None:
        """Of a reduced volumetric part, what another pressure changes of its tangent."""
        if not self.reduced:
            return None
        return CarriedPressure(self._u, self.cells, self.section, self.material)

    @property
    def elastic(self) -> Material | None:
        """The material whose strain energy loops over the cells have; None: there is none."""
        return self.material

    def add_point_forces(self, out: Floats) -> None:
        """Add the nodal forces, N (N/m), of points that remember, as evaluated last, to (n,)."""

    def point_energy(self) -> float:
        """This rank's energy that is stored at points that remember, J (J/m)."""
        return 0.0

    @property
    def displacement(self) -> dolfinx.fem.Function:
        """The displacement, m, that the forms are evaluated at."""
        return self._u

    def _start_points(self) -> None:
        """Make what material points remember, if they do."""

    def _dx(self, degree: int) -> Any:
        """Measure over the body's cells, of a quadrature degree."""
        return body_measure(self._u.function_space.mesh, self.cells, degree)

    def _roundoff_forms(self) -> list[dolfinx.fem.Form]:
        """What :meth:`roundoff_squares` gives but for ε and M, at the middle of the cells."""
        u, mesh, dx = self._u, self._u.function_space.mesh, self._dx(1)
        rows, width = mesh.geometry.dim, circumference(mesh, self.section)
        inverse = ufl.inv(ufl.Identity(rows) + ufl.grad(u))
        thin = ufl.inner(inverse, inverse) / rows
        edges = abs(ufl.JacobianDeterminant(mesh))
        cofactor = edges * ufl.inv(ufl.Jacobian(mesh))
        size = edges ** (1.0 / 3.0) if self.section == "3D" else 1.0
        reference = basix.cell.volume(basix.CellType[mesh.topology.cell_name()])
        share = self._nodes_per_cell() / (reference * edges)
        # Lengths (areas in space) of a cell's sides, squared; per volume: rows of a square's side.
        sides = ufl.inner(cofactor, cofactor) / edges
        at_rest = width**2 * sides * thin * dx
        carried = share * (width * size * thin) ** 2 * ufl.inner(u, u) * dx
        return [dolfinx.fem.form(at_rest), dolfinx.fem.form(carried)]

    def _nodes_per_cell(self) -> dolfinx.fem.Constant:
        """Nodes of the body over its cells; collective."""
        space = self._u.function_space
        nodes = np.unique(space.dofmap.list[self.cells])
        owned = nodes < space.dofmap.index_map.size_local
        local = np.array([float(np.count_nonzero(owned)), float(len(self.cells))])
        found, cells = space.mesh.comm.allreduce(local)
        return dolfinx.fem.Constant(space.mesh, PETSc.ScalarType(found / max(cells, 1.0)))

    def roundoff_squares(self) -> Floats:
        """Squares (2,), N² ((N/m)²), of the nodal forces that rounding leaves on this rank.

        They are those at the present displacement, from rounding F and from rounding u.

        A rounding error ε in F is a stress error ε M. In the plane, over cells of size h, the
        nodal forces of the n = 2 A/h² unknowns are ε M h each, of norm ε M √(2 A), A the body's
        area; of a body of revolution they are 2πx times as large. In space they are ε M h² at
        n = 3 V/h³ unknowns, of norm ε M √(3 ∫ h dV). The sides of long cells count with their
        squared lengths (in space areas): the noise is more than their volume says. An error ε u of
        an unknown is a force ε M s u, with s = 1, 2πx or h. Where the body has become thin, the
        same force of a cell acts over less of it: forces grow with |F⁻¹|, and with its square
        where they follow from u.
        """
        local = [dolfinx.fem.assemble_scalar(form) for form in self._roundoff]
        return np.array(local) * (np.finfo(float).eps * self._stiffness) ** 2

    @property
    def _stiffness(self) -> float:
        return oedometric_modulus(self.material)

    def stress_at(self, cells: NDArray[np.int32], xi: Floats | None) -> point_stress.StressAt:
        """What gives the Cauchy stress at points of owned cells (k,), in numpy.

        At ξ (k, α), or (1, α) the same in all; None: all points of full integration (q, c), of all.
        """
        return point_stress.PointStress(self.material, self.section)

    # -- what material points remember: nothing here, see `tribox.forms.bodies.memory_solid` -------

    def evaluate(self, dt: float = math.inf, tangent: bool = False) -> bool:
        """Evaluate forces, and if asked the tangent, now; changes nothing that is remembered.

        ``dt``: s, infinite without rates. False where the material could not be; forces are NaN.
        """
        return True

    def evaluate_elastic(self) -> bool:
        """As :meth:`evaluate`, with points that do not flow on: for the stable step."""
        return True

    def commit(self) -> None:
        """Remember what was evaluated last: the next step starts from it."""

    @property
    def dissipated(self) -> Floats:
        """Energy (2,), J (J/m in plane strain), of this rank in all committed steps.

        The second is the part of the first that belongs to the lengths of the steps.
        """
        return np.zeros(2)

    @property
    def dissipated_by_part(self) -> Floats:
        """Energy (b,), J (J/m), of this rank in all committed steps, of each branch."""
        return np.zeros(0)

    def history(self) -> PointHistory | None:
        """What :meth:`adopt` takes to come to the present committed state; None: nothing."""
        return None

    def cell_rows(self, values: Floats) -> Floats:
        """Values (c, …) by cell from those (k, s) of material points."""
        return values

    def point_rows(self, values: Floats) -> Floats:
        """Values (k, s) of material points from those (c, …) by cell."""
        return values

    def adopt(self, history: PointHistory) -> None:
        """Go back to before the last step of a history, which is to be made again."""

    def repeat_step(self) -> None:
        """Evaluate and commit that step, at the present displacement, if there was one."""


# -- The geometric stiffness of nearly incompressible cells away from the solution -----------------
#
# A Newton step that is wrong by a rotation θ has a volume wrong by θ², and hence a pressure wrong
# by K θ², which for ν → ½ is far above the shear modulus: in the tangent that pressure is a
# geometric stiffness of its own, and the next step is worth nothing. A mixed formulation has no
# such pressure, for there it is an unknown and changes with the volume of the *linearised* motion.
# Taken from there, the tangent at u is that with
#
#     p = U'(J₀) + U''(J₀) DJ(u₀)[u − u₀],
#
# u₀ being where the tangent was taken before, instead of U'(J). The residual stays as it is, and at
# the solution the two agree to second order, so that the convergence stays quadratic. Magisano,
# Leonetti & Garcea, Comput. Methods Appl. Mech. Engng 313 (2017) 986.


class CarriedPressure:
    """What pressures carried from another displacement exceed those of the present volumes by."""

    def __init__(
        self, u: dolfinx.fem.Function, cells: Ints, section: Section, material: Material
    ) -> None:
        """Take the owned cells of a body."""
        self._u = u
        self._excess: Floats = np.zeros(len(cells))
        self._centres = PointCells(section, centres_of(u.function_space, section, cells))
        self._energy = point_stress.energy_at_points(material, point_stress.VOLUME, space=True)

    def carry(self, before: Floats) -> None:
        """Find the pressures now; ``before``: u₀ (n,), m, ghosts included."""
        F, start = self._gradients(self._u.x.array), self._gradients(before)
        with np.errstate(all="ignore"):
            J, J0 = np.linalg.det(F), np.linalg.det(start)
            # The rows of cof F are the cross products of the two other rows of F.
            cofactors = [np.cross(start[:, i - 2], start[:, i - 1]) for i in range(3)]
            change = np.einsum("icj,cij->c", cofactors, F - start)
            slope, curvature = self._slopes(J0)
            excess = slope + curvature * change - self._slopes(J)[0]
        # An iterate may have no volume to take a logarithm of; its residual is refused elsewhere.
        self._excess = np.where(np.isfinite(excess), excess, 0.0)

    def excess(self) -> Floats:
        """The pressures found last less those of the present volumes (c,), Pa, of the cells."""
        return self._excess

    def _gradients(self, u: Floats) -> Floats:
        """Deformation gradients (c, 3, 3) at the centres, for displacements (n,), m."""
        return point_stress.as_tensors(self._centres.deformation(u))

    def _slopes(self, J: Floats) -> tuple[Floats, Floats]:
        """U' and U'' (c,), Pa: in a sphere F = J^(1/3) I, P = U' cof F."""
        side = np.cbrt(J)
        _, P, A = self._energy(side[:, None] * np.eye(3).reshape(9), True)
        assert A is not None
        return P[:, 0] / side**2, A[:, 0, 0] / side**4
