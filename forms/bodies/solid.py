"""One solid body: residual, tangent and strain energy of its material on its cells.

:class:`Solid` is a body whose stress follows from its present deformation;
:class:`tribox.forms.bodies.memory_solid.MemorySolid` is one whose material points remember.

Selective reduced integration (``q1-sri``) takes the distortional energy at 2 × 2 (2 × 2 × 2 in
space) Gauss points and the volumetric energy at the centre. The two parts are compiled as forms of
their own: a linear form that mixes two quadrature degrees on the same cells is compiled wrongly by
FFCx 0.9. In a section of a body of revolution all integrals carry the weight 2πx, so that forces
and energies are those of the whole body.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import basix.cell
import dolfinx
import dolfinx.fem.petsc
import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc
from ufl.algorithms import expand_derivatives
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.traversal import unique_pre_traversal

from tribox.forms.bodies.kinematics import (
    Kinematics,
    Section,
    WithoutVariables,
    body_measure,
    centre_kinematics,
    circumference,
    kinematics,
    section_of,
)
from tribox.forms.bodies.materials import Material, oedometric_modulus
from tribox.forms.bodies.point_state import Floats, PointHistory
from tribox.forms.bodies.point_stress import PointStress, StressAt
from tribox.geometry.compat import interpolation_points
from tribox.geometry.surfaces.facets import Ints

Formulation = Literal["q1", "q1-sri", "q2"]
DEGREE: dict[Formulation, int] = {"q1": 1, "q1-sri": 1, "q2": 2}
"""Degree of the displacement in each formulation."""
CENTRE_DEGREE = 1


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


@dataclass(slots=True)
class CompiledForms:
    """Forms of one integral: energy (scalar), residual (vector) and tangent (matrix)."""

    energy: dolfinx.fem.Form
    residual: dolfinx.fem.Form
    tangent: dolfinx.fem.Form


def compile_energy(density: Any, measure: Any, u: dolfinx.fem.Function) -> CompiledForms:
    """Compile ∫ W dΩ₀ and its first and second derivatives in the direction of ``u``'s space."""
    total = density * measure
    test, trial = ufl.TestFunction(u.function_space), ufl.TrialFunction(u.function_space)
    residual = ufl.derivative(total, u, test)
    return CompiledForms(
        energy=dolfinx.fem.form(total),
        residual=dolfinx.fem.form(residual),
        tangent=dolfinx.fem.form(ufl.derivative(residual, u, trial)),
    )


def compile_isotropic(
    energy: Callable[[Kinematics], Any], k: Kinematics, measure: Any, u: dolfinx.fem.Function
) -> CompiledForms:
    """Compile an energy W(J, I1, I2) in space, by the chain rule over the invariants.

    δW = W_i δI_i and ΔδW = W_ij δI_i ΔI_j + W_i ΔδI_i: test and trial functions stay out of W and
    its derivatives, which may be long.
    """
    space = u.function_space
    test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
    density, invariants = energy(k), (k.J, k.I1, k.I2)
    # What a derivative depends on is seen of bare variables, whose own need not be expanded.
    bare = [ufl.variable(dolfinx.fem.Constant(space.mesh, 1.0)) for _ in invariants]
    plain = energy(replace(k, J=bare[0], I1=bare[1], I2=bare[2]))
    used = [i for i, own in enumerate(bare) if _depends(plain, own)]
    shapes = {i: expand_derivatives(ufl.diff(plain, bare[i])) for i in used}
    slopes = {i: ufl.diff(density, invariants[i]) for i in used}
    first = {i: ufl.derivative(invariants[i], u, test) for i in used}
    second = {i: ufl.derivative(invariants[i], u, trial) for i in used}
    residual = sum(slopes[i] * first[i] for i in used)
    tangent = sum(slopes[i] * ufl.derivative(first[i], u, trial) for i in used)
    for i, j in itertools.product(used, repeat=2):
        if _depends(shapes[i], bare[j]):
            tangent += ufl.diff(slopes[i], invariants[j]) * first[i] * second[j]
    return CompiledForms(
        energy=dolfinx.fem.form(density * measure),
        residual=dolfinx.fem.form(residual * measure),
        tangent=dolfinx.fem.form(tangent * measure),
    )


def _depends(expression: Any, variable: Any) -> bool:
    return any(part == variable for part in unique_pre_traversal(expression))


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
        self._constants = {
            key: dolfinx.fem.Constant(mesh, PETSc.ScalarType(value))
            for key, value in material.parameters().items()
        }
        self._roundoff = self._roundoff_forms()
        self.cell = mesh.topology.cell_name()
        self.full_degree = full_degree(formulation, self.cell)
        # An energy without a part of J, as a user's own may be, has nothing to take at the centre.
        slope = expand_derivatives(_derivatives(u, self.section, self._volumetric)[1])
        has_volume = not isinstance(slope, ufl.constantvalue.Zero)
        self.reduced = formulation == "q1-sri" and has_volume
        self._start_points()

    @cached_property
    def carried(self) -> CarriedPressure | None:
        """Of a reduced volumetric part, what another pressure changes of its tangent.

        Compiled, or taken from the cache, when first asked for, which is collective.
        """
        if not self.reduced:
            return None
        dx = self._dx(CENTRE_DEGREE)
        return CarriedPressure(self._u, self.cells, self.section, self._volumetric, dx)

    @property
    def elastic(self) -> Material | None:
        """The material whose strain energy the forms are of; None: there are none.

        A compiled loop may stand for these forms.
        """
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

    @cached_property
    def forms(self) -> list[CompiledForms]:
        """Of each integral of the strain energy; compiled, or taken from the cache, when asked for.

        Where a compiled loop stands for them they never are. The first call is collective.
        """
        return self._energy_forms()

    def _energy_forms(self) -> list[CompiledForms]:
        """The forms of the strain energy, of a reduced volumetric part by itself."""
        u = self._u
        k = kinematics(u, self.section)
        full = self._dx(self.full_degree)
        if not self.reduced:
            return [self._compiled(k, lambda k: sum(self._energy(k)), full)]
        centre = centre_kinematics(u, self.section)
        return [
            self._compiled(k, lambda k: self._energy(k)[0], full),
            self._compiled(centre, self._volumetric, self._dx(CENTRE_DEGREE)),
        ]

    def _energy(self, k: Kinematics) -> tuple[Any, Any]:
        """The strain energy, J/m³: its distortional and its volumetric part."""
        return self.material.energy(k, self._constants)

    def _volumetric(self, k: Kinematics) -> Any:
        """The volumetric part of the strain energy, J/m³."""
        return self._energy(k)[1]

    def _compiled(
        self, k: Kinematics, energy: Callable[[Kinematics], Any], dx: Any
    ) -> CompiledForms:
        if self.section == "3D":
            return compile_isotropic(energy, k, dx, self._u)
        weight = circumference(self._u.function_space.mesh, self.section)
        return compile_energy(weight * energy(k), dx, self._u)

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

    def strain_energy(self) -> float:
        """This rank's strain energy, J; in plane strain per unit thickness, J/m."""
        of_forms = float(sum(dolfinx.fem.assemble_scalar(part.energy) for part in self.forms))
        return of_forms + self.point_energy()

    def stress_at(self, cells: NDArray[np.int32], xi: Floats | None) -> StressAt:
        """What gives the Cauchy stress at points of owned cells, in numpy.

        Args:
            cells: (k,) local, of the body.
            xi: reference coordinates, (k, α) of a point in each cell or (1, α) of the same point
                in all; None: all quadrature points of full integration, (q, c) in this order, of
                all cells of the body.
        """
        return PointStress(self.material, self.section)

    # -- what material points remember: nothing here, see `tribox.forms.bodies.memory_solid` -------

    def evaluate(self, dt: float = math.inf, tangent: bool = False) -> bool:
        """Let the forms be those of the present displacement; changes nothing that is remembered.

        Args:
            dt: s, duration of the step; infinite where rates do not count.
            tangent: whether the tangent is wanted too.

        Returns:
            Whether the material could be evaluated on this rank; where not, the forms give NaN.
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

Volumetric = Callable[[Kinematics], Any]


class CarriedPressure:
    """What the pressure carried from another displacement adds to the tangent of one body.

    Attributes:
        tangent: form of the difference to the exact tangent, for the pressures found last.
    """

    def __init__(
        self,
        u: dolfinx.fem.Function,
        cells: Ints,
        section: Section,
        volumetric: Volumetric,
        measure: Any,
    ) -> None:
        """Compile, or take from the cache.

        Args:
            u: displacement, m.
            cells: owned cells of the body.
            volumetric: energy U(J), J/m³, of the kinematics at the centre.
            measure: over these cells, at their centres.
        """
        space = u.function_space
        mesh = space.mesh
        self._u, self._cells = u, cells
        self._before = dolfinx.fem.Function(space)
        self._step = dolfinx.fem.Function(space)
        constants = dolfinx.fem.functionspace(mesh, ("DG", 0))
        self._excess = dolfinx.fem.Function(constants)
        volume, slope, curvature = _derivatives(self._before, section, volumetric)
        change = ufl.derivative(volume, self._before, self._step)
        carried = slope + curvature * change - _derivatives(u, section, volumetric)[1]
        self._expression = dolfinx.fem.Expression(
            map_expr_dag(WithoutVariables(), expand_derivatives(carried)),
            interpolation_points(constants),
        )
        test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
        now = centre_kinematics(u, section).J
        # (p − U'(J)) ∂²J/∂u²: the geometric stiffness is all that the carried pressure changes, for
        # U''(J) DJ⊗DJ stays that of the present volume.
        second = ufl.derivative(ufl.derivative(now, u, test), u, trial)
        weight = circumference(mesh, section)
        self.tangent = dolfinx.fem.form(weight * self._excess * second * measure)

    def carry(self, before: Floats) -> None:
        """Find the pressures at the present displacement.

        Args:
            before: (n,), m, u₀ at this rank's unknowns, ghosts included.
        """
        self._before.x.array[:] = before
        self._step.x.array[:] = self._u.x.array - before
        self._excess.interpolate(self._expression, cells0=self._cells)
        # An iterate may have no volume to take a logarithm of; its residual is refused elsewhere.
        values = self._excess.x.array
        values[~np.isfinite(values)] = 0.0

    def excess(self) -> Floats:
        """The pressures found last less those of the present volumes (c,), Pa, of the cells."""
        return self._excess.x.array[self._excess.function_space.dofmap.list[self._cells, 0]]


def _derivatives(
    u: dolfinx.fem.Function, section: Section, volumetric: Volumetric
) -> tuple[Any, Any, Any]:
    """J at the centre, and U' and U'' there."""
    k = centre_kinematics(u, section)
    variable = ufl.variable(k.J)
    slope = ufl.diff(volumetric(replace(k, J=variable)), variable)
    return k.J, slope, ufl.diff(slope, variable)
