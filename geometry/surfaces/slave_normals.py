"""Normals of a slave surface in the plane that do not jump from facet to facet.

Axis letters: v vertices, q slave points, s the four vertices around a point's facet, i space, e the
two ends of the facet.

At a vertex the normal is that of the chord e_A = x_next − x_before over the facets on both sides
(one-sided at an end), and between the vertices A and B of a facet

    n = −M/|M|,   M = N_A ν_A + N_B ν_B,   ν = J e/|e|,

with J a turn to the left, so that n points from the master to the slave (Puso & Laursen, Comput.
Methods Appl. Mech. Engng 193 (2004) 601; Popp et al., Int. J. Numer. Meth. Engng 83 (2010) 1428).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.vertices import SlaveVertices

# e_A and e_B from the positions of the vertices before A, A, B and after B.
CHORDS = np.array([[-1.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]])


@dataclass(slots=True)
class PointNormals:
    """Normals at the points, and how they change.

    Attributes:
        normal: (q, i), unit, towards the slave; change: (q, e, i, j): ∂n/∂e of both chords, 1/m.
    """

    normal: Floats
    change: Floats

    def of(self, take: Longs) -> PointNormals:
        """The same of the points ``take`` (p,)."""
        return PointNormals(self.normal[take], self.change[take])


class SlaveNormals:
    """The vertices around each point's facet, and the normals from their positions.

    Attributes:
        around: (q, s) vertices before A, A, B and after B, along the surface; at its ends A or B
            again.
        shape: (q, e) shape functions of A and B.
    """

    def __init__(self, vertices: SlaveVertices, flipped: Bools) -> None:
        """Find the neighbours; collective.

        Args:
            vertices: of the slave.
            flipped: (q,) whether a point's facet has to be run through from its second vertex to
                its first for its normal, to the left, to point out of the body.
        """
        rows = np.arange(len(flipped))
        first = flipped.astype(np.int64)
        start, end = vertices.of_point[rows, first], vertices.of_point[rows, 1 - first]
        gathered = vertices.comm.allgather(np.unique(np.stack([start, end]), axis=1))
        pairs = np.concatenate(gathered, axis=1)
        before = np.full(vertices.count, -1, dtype=np.int64)
        after = before.copy()
        before[pairs[1]], after[pairs[0]] = pairs[0], pairs[1]
        left = np.where(before[start] >= 0, before[start], start)
        right = np.where(after[end] >= 0, after[end], end)
        self.around: Longs = np.stack([left, start, end, right], axis=1)
        self.shape = vertices.shape[rows[:, None], np.stack([first, 1 - first], axis=1)]

    def at(self, position: Floats) -> PointNormals:
        """Normals from the current positions (q, s, i), m, of the vertices ``around``."""
        chord = np.einsum("es,qsi->qei", CHORDS, position)
        length = np.linalg.norm(chord, axis=2)[..., None]
        nu = np.stack([-chord[..., 1], chord[..., 0]], axis=2) / length
        total = np.einsum("qe,qei->qi", self.shape, nu)
        size = np.linalg.norm(total, axis=1)
        normal = -total / size[:, None]
        # ∂ν/∂e = (I − ν⊗ν) J/|e|, and ∂n/∂M = −(I − n⊗n)/|M|.
        turn = np.array([[0.0, -1.0], [1.0, 0.0]])
        across = np.eye(2) - nu[..., :, None] * nu[..., None, :]
        d_nu = (self.shape[..., None, None] / length[..., None]) * (across @ turn)
        plane = np.eye(2) - normal[:, :, None] * normal[:, None, :]
        change = -(plane / size[:, None, None])[:, None] @ d_nu
        return PointNormals(normal, change)
