r"""The motion of a rigid tool: a displacement and one angle, as two reference nodes hold them.

Axis letters: a control points, i, j space. The first reference node carries the displacement c of
the centre, the second one's first component θL, an angle times a length, so that all unknowns are
lengths. Control points Y_a are carried along,

.. math:: y_a = C + c + R(\theta)(Y_a - C), \qquad
   R = I + \sin\theta\, W + (1 - \cos\theta)\, W^2,

with W the cross product with the axis (Rodrigues); in the plane the axis points out of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facets import Floats


@dataclass(frozen=True, slots=True, eq=False)
class RigidMotion:
    """How control points follow the displacement c and the angle θ of a tool.

    Attributes:
        centre: (i,), m, reference: C, about which the tool turns; it moves with c.
        points: (a, i), m, reference: Y_a.
        length: m: L, that the angle is multiplied by as an unknown.
        axis: (3,) of the rotation in space, of any length; None in the plane.
    """

    centre: Floats
    points: Floats
    length: float
    axis: Floats | None = None
    _spin: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Find W.

        Raises:
            ValueError: no length, or an axis that is missing in space or given in the plane.
        """
        if not (np.isfinite(self.length) and self.length > 0.0):
            raise ValueError(f"the length of a rotation must be positive, not {self.length:g}")
        if (self.axis is None) != (self.dim == 2):
            raise ValueError("a rotation has an axis in space, and none in the plane")
        object.__setattr__(self, "_spin", self._cross())

    def _cross(self) -> Floats:
        """W (i, j)."""
        if self.axis is None:
            return np.array([[0.0, -1.0], [1.0, 0.0]])
        size = np.linalg.norm(self.axis)
        if not (np.isfinite(size) and size > 0.0):
            raise ValueError(f"the axis of a rotation has no direction: {self.axis}")
        x, y, z = np.asarray(self.axis) / size
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])

    @property
    def dim(self) -> int:
        """Of space."""
        return int(np.shape(self.points)[1])

    def read(self, values: Floats) -> tuple[Floats, float]:
        """Displacement c (i,), m, and angle θ, rad, from the reference nodes' values (2, i), m."""
        return values[0], float(values[1, 0]) / self.length

    def rotation(self, theta: float) -> Floats:
        """R (i, j)."""
        w = self._spin
        out: Floats = np.eye(self.dim) + np.sin(theta) * w + (1.0 - np.cos(theta)) * (w @ w)
        return out

    def control_points(self, displacement: Floats, theta: float) -> Floats:
        """y_a (a, i), m, current.

        Args:
            displacement: (i,), m: c.
            theta: rad, counter-clockwise, or right-handed about the axis.
        """
        out: Floats = self.centre + displacement + self._arms() @ self.rotation(theta).T
        return out

    def tangent(self, theta: float) -> Floats:
        """T = ∂y_a/∂(c, θL) (a, i, 2 · i), no unit, for all components of both nodes in turn.

        Those of the second node but the first do nothing.
        """
        out = np.zeros((len(self.points), self.dim, 2 * self.dim))
        out[:, :, : self.dim] = np.eye(self.dim)
        w = self._spin
        slope = np.cos(theta) * w + np.sin(theta) * (w @ w)
        out[:, :, self.dim] = self._arms() @ slope.T / self.length
        return out

    def bend(self, theta: float) -> Floats:
        """∂²y_a/∂(θL)² (a, i), 1/m; all other second derivatives are zero."""
        w = self._spin
        second = np.cos(theta) * (w @ w) - np.sin(theta) * w
        out: Floats = self._arms() @ second.T / self.length**2
        return out

    def _arms(self) -> Floats:
        """Y_a − C (a, i), m."""
        out: Floats = self.points - self.centre
        return out
