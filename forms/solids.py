"""One solid body: residual, tangent and strain energy of its material on its cells.

Selective reduced integration (``q1-sri``) takes the distortional energy at 2 × 2 Gauss points and
the volumetric energy at the centre. The two parts are compiled as forms of their own: a linear form
that mixes two quadrature degrees on the same cells is compiled wrongly by FFCx 0.9.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import dolfinx
import dolfinx.fem.petsc
import numpy as np
import ufl
from numpy.typing import NDArray
from petsc4py import PETSc
from ufl.algorithms import expand_derivatives, strip_variables

from forms.kinematics import plane_strain
from forms.materials import Material, oedometric_modulus

Formulation = Literal["q1", "q1-sri"]
FULL_DEGREE = 2  # 2 × 2 Gauss points on quadrilaterals, exact for the energy of P1 triangles
CENTRE_DEGREE = 1


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


class Solid:
    """A body: its cells, its material, and the compiled forms of its strain energy."""

    def __init__(
        self,
        name: str,
        u: dolfinx.fem.Function,
        cells: NDArray[np.int32],
        material: Material,
        formulation: Formulation,
        density: float = 0.0,
    ) -> None:
        """Compile the body's forms, or take them from the cache.

        Args:
            name: the body's name, for messages.
            u: displacement, m.
            cells: local cells (owned and ghosts) of the body.
            material: strain energy.
            formulation: ``q1`` for full, ``q1-sri`` for selective reduced integration.
            density: kg/m³, reference.
        """
        self.name = name
        self.material = material
        self.density = density
        mesh = u.function_space.mesh
        owned = mesh.topology.index_map(mesh.topology.dim).size_local
        self.cells = np.sort(cells[cells < owned])
        constants = {
            key: dolfinx.fem.Constant(mesh, PETSc.ScalarType(value))
            for key, value in material.parameters().items()
        }
        distortional, volumetric = material.energy(plane_strain(u), constants)
        self._u, self._constants = u, constants
        one = dolfinx.fem.Constant(mesh, PETSc.ScalarType(1.0))
        dx = ufl.Measure("dx", domain=mesh, subdomain_data=[(1, self.cells)])(1)
        self._area = dolfinx.fem.form(one * dx)
        self.forms: list[CompiledForms] = []
        if formulation == "q1":
            parts = [(distortional + volumetric, FULL_DEGREE)]
        else:
            parts = [(distortional, FULL_DEGREE), (volumetric, CENTRE_DEGREE)]
        for density_of_energy, degree in parts:
            dx = ufl.Measure(
                "dx",
                domain=mesh,
                subdomain_data=[(1, self.cells)],
                metadata={"quadrature_degree": degree},
            )(1)
            self.forms.append(compile_energy(density_of_energy, dx, u))

    def cauchy_stress(self) -> Any:
        """Cauchy stress σ = J⁻¹ P Fᵀ (3, 3), Pa, out-of-plane part included, in UFL."""
        one = dolfinx.fem.Constant(self._u.function_space.mesh, PETSc.ScalarType(1.0))
        stretch = ufl.variable(one)
        k = plane_strain(self._u, stretch)
        energy = sum(self.material.energy(k, self._constants))
        plane = ufl.dot(ufl.diff(energy, k.F), k.F.T) / k.J
        across = ufl.diff(energy, stretch) / k.plane_J
        sigma = ufl.as_tensor(
            [[plane[0, 0], plane[0, 1], 0], [plane[1, 0], plane[1, 1], 0], [0, 0, across]]
        )
        # Variables are numbered through the whole process, and FFCx's cache looks at the number:
        # with them in, hardly an expression would ever be found compiled.
        return strip_variables(expand_derivatives(sigma))

    def roundoff_force(self) -> float:
        """Square of this rank's nodal force noise from rounding F, (N/m)².

        A rounding error ε in F is a stress error ε M; over cells of size h and n unknowns the
        norm of the nodal forces is ε M h √n = ε M √(2 A), A the body's area in the plane.
        """
        area = dolfinx.fem.assemble_scalar(self._area)
        return float(2.0 * area * (np.finfo(float).eps * oedometric_modulus(self.material)) ** 2)

    def strain_energy(self) -> float:
        """This rank's strain energy, J per unit thickness."""
        return float(sum(dolfinx.fem.assemble_scalar(part.energy) for part in self.forms))
