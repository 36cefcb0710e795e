"""The geometric stiffness of nearly incompressible cells away from the solution.

A Newton step that is wrong by a rotation θ has a volume wrong by θ², and hence a pressure wrong by
K θ², which for ν → ½ is far above the shear modulus: in the tangent that pressure is a geometric
stiffness of its own, and the next step is worth nothing. A mixed formulation has no such
pressure, for there it is an unknown and changes with the volume of the *linearised* motion. Taken
from there, the tangent at u is that with

    p = U'(J₀) + U''(J₀) DJ(u₀)[u − u₀],

u₀ being where the tangent was taken before, instead of U'(J). The residual stays as it is, and at
the solution the two agree to second order, so that the convergence stays quadratic. Magisano,
Leonetti & Garcea, Comput. Methods Appl. Mech. Engng 313 (2017) 986.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import dolfinx
import numpy as np
import ufl
from ufl.algorithms import expand_derivatives
from ufl.corealg.map_dag import map_expr_dag

from tribox.forms.bodies.kinematics import (
    Kinematics,
    Section,
    WithoutVariables,
    centre_kinematics,
    circumference,
)
from tribox.geometry.compat import interpolation_points
from tribox.geometry.surfaces.facets import Floats, Ints

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
            section: what the mesh stands for.
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
        found: Floats = self._excess.x.array[
            self._excess.function_space.dofmap.list[self._cells, 0]
        ]
        return found


def _derivatives(
    u: dolfinx.fem.Function, section: Section, volumetric: Volumetric
) -> tuple[Any, Any, Any]:
    """J at the centre, and U' and U'' there."""
    k = centre_kinematics(u, section)
    variable = ufl.variable(k.J)
    slope = ufl.diff(volumetric(replace(k, J=variable)), variable)
    return k.J, slope, ufl.diff(slope, variable)
