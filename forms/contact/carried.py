r"""From the control points of a rigid tool to its own unknowns, displacement and angle.

Axis letters: a control points, p points, m, n nodes of a block, i, j space, k the 2·i unknowns of
the two reference nodes, which hold (c, θL), see :mod:`tribox.geometry.surfaces.rigid_motion`.

All of a contact between kinematics and assembly is written in the control points y_a, as if they
were nodes. Their forces F_a and blocks K_ab become those of q = (c, θL) by the chain rule,

.. math:: F_q = T^T F, \qquad K_{qq} = T^T K T + \sum_a F_a \cdot \partial^2 y_a/\partial q^2,
   \qquad T = \partial y_a/\partial q;

without the last term, which the angle alone has, Newton's method would not be quadratic.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.facets import Floats, Longs
from tribox.geometry.surfaces.rigid_motion import RigidMotion


@dataclass(frozen=True, slots=True, eq=False)
class Carried:
    """How control points follow the unknowns of their tool, at one state.

    Attributes:
        tangent: (a, i, k), no unit: T; bend: (a, i), 1/m: ∂²y_a/∂(θL)².
        centre: (i,), m, current: about which the tool turns.
    """

    tangent: Floats
    bend: Floats
    centre: Floats

    @classmethod
    def at(cls, motion: RigidMotion, values: Floats) -> Carried:
        """At the reference nodes' values (2, i), m."""
        displacement, theta = motion.read(values)
        return cls(motion.tangent(theta), motion.bend(theta), motion.centre + displacement)

    @property
    def dim(self) -> int:
        """Of space."""
        return int(self.tangent.shape[1])

    def forces(self, shares: Floats, force: Floats) -> Floats:
        """Forces (p, 2, i), N, on the reference nodes of forces (p, i) shared by (p, a)."""
        moved = np.einsum("pa,aik->pik", shares, self.tangent)
        out: Floats = np.einsum("pik,pi->pk", moved, force).reshape(len(force), 2, self.dim)
        return out

    def motions(self, values: Floats) -> Floats:
        """Velocities (a, i) of the control points of those (2, i) of the reference nodes."""
        out: Floats = self.tangent @ values.reshape(-1)
        return out

    def blocks(self, places: Longs, blocks: Floats, first: int) -> tuple[Longs, Floats]:
        """Blocks in the unknowns of the pair's nodes.

        Args:
            places: (p, m) nodes of the blocks, the control points from number ``first`` on, in the
                same columns at all p.
            blocks: (p, m, i, n, j), N/m.
            first: see above.

        Returns:
            Nodes (p, m′), with the reference nodes at ``first`` and after, and blocks.
        """
        control = places[0] >= first
        matrix = self._columns(places[0][control] - first)
        count, dim = len(places), self.dim
        flat = blocks[:, control].reshape(count, -1, blocks[0, 0, 0].size)
        rows = (matrix.T @ flat).reshape(count, 2, dim, *blocks.shape[3:])
        half: Floats = np.concatenate([blocks[:, ~control], rows], axis=1)
        kept = half.shape[1]
        moved = half[:, :, :, control].reshape(count, kept, dim, -1) @ matrix
        columns = moved.reshape(count, kept, dim, 2, dim)
        tool = np.broadcast_to(first + np.arange(2), (count, 2))
        nodes = np.concatenate([places[:, ~control], tool], axis=1)
        return nodes, np.concatenate([half[:, :, :, ~control], columns], axis=3)

    def _columns(self, points: Longs) -> Floats:
        """T (m i, k) of control points (m,)."""
        return self.tangent[points].reshape(-1, 2 * self.dim)

    def bending(self, forces: Floats) -> Floats:
        """Block (1, 2, i, 2, j), N/m, of the angle, from forces (a, i), N, at control points."""
        out = np.zeros((1, 2, self.dim, 2, self.dim))
        out[0, 1, 0, 1, 0] = np.sum(forces * self.bend)
        return out

    def operator(self, first: int) -> scipy.sparse.csr_matrix:
        """T of all unknowns (nodes and control points · i, nodes of the pair · i)."""
        nodes = scipy.sparse.identity(first * self.dim, format="csr")
        tool = self.tangent.reshape(-1, 2 * self.dim)
        return scipy.sparse.block_diag([nodes, tool], format="csr")
