r"""How much of a point counts near the ends and the sharp corners of a line in the plane.

Axis letters: q points, p pieces, e the two ends of a piece, i space (the plane).

At the end of a line a point fades to nothing over its reach, as at the end of facets. Projected
along normals n of the slave, points behind a steep corner look at a flank that they only graze, far
away, or at nothing: they would leave or join the contact at once as n turns a little. With the
normal m of a piece they therefore count by how much it faces them,

.. math:: s = \frac{m\cdot n - \cos_0}{\cos_1 - \cos_0}, \quad 0 \le s \le 1,

and up to a sharp corner by what is the same on both sides of it, :math:`c = \min(s, s_{next})`:

.. math:: \sigma = c + (s - c)\, w, \qquad w = \min(1, \text{way to the corner}/\text{reach}).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tribox.geometry.surfaces.rigid_pieces import GRAZING, Pieces, left_of

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facets import Bools, Floats, Ints

FACING = 0.45  # cosine between the normals of piece and slave from which on points count in full


@dataclass(slots=True)
class Shares:
    """Shares σ of points.

    Attributes:
        share: (q,) σ; slope: (q,) ∂σ/∂ξ; turn: (q, i) ∂σ/∂n, None of closest points.
    """

    share: Floats
    slope: Floats
    turn: Floats | None = None


class LineEnds:
    """The ends and corners of a line, and what they leave of points near them."""

    def __init__(self, pieces: Pieces) -> None:
        """Find them."""
        self._open, self._sharp = pieces.open_ends(), pieces.turns() != 0.0
        self._length, self._sweep = pieces.length, pieces.sweep
        out = left_of(pieces.directions())
        self._start = out[:, 0]
        self._next = np.stack(
            [np.roll(out[:, 1], 1, axis=0), np.roll(out[:, 0], -1, axis=0)], axis=1
        )

    def of_closest(self, piece: Ints, xi: Floats, on_line: Bools, reach: Floats) -> Shares | None:
        """Shares of closest points at ξ (q,) of pieces (q,); None: all are whole.

        Args:
            piece: see above.
            xi: see above.
            on_line: (q,) False past an open end.
            reach: (q,), m, way up to an open end over which a point fades.
        """
        at = np.nonzero(self._open[piece].any(axis=1) & on_line)[0]
        if not len(at):
            return None
        open_ends, length = self._open[piece[at]], self._length[piece[at]]
        way = np.where(open_ends, np.stack([xi[at], 1.0 - xi[at]], axis=1), np.inf)
        end = np.argmin(way, axis=1)
        per_length = length / np.minimum(reach[at], length)
        part = way[np.arange(len(at)), end] * per_length
        out = Shares(np.ones(len(xi)), np.zeros(len(xi)))
        out.share[at] = np.minimum(part, 1.0)
        out.slope[at] = np.where(part < 1.0, np.where(end == 0, per_length, -per_length), 0.0)
        return out

    def along_rays(
        self, piece: Ints, xi: Floats, met: Bools, reach: Floats, normals: Floats
    ) -> Shares:
        """Shares of points along normals (q, i) that have ``met`` (q,) pieces (q,) at ξ (q,)."""
        turn, start = xi * self._sweep[piece], self._start[piece]
        facing = np.cos(turn)[:, None] * start + np.sin(turn)[:, None] * left_of(start)
        own, d_own = _ramp(np.einsum("qi,qi->q", facing, normals))
        rolls = self._sweep[piece] * np.einsum("qi,qi->q", left_of(facing), normals)
        own_slope, own_turn = d_own * rolls, d_own[:, None] * facing
        end, w, d_w = self._ways(piece, xi, reach)
        beyond = self._next[piece, end]
        other, d_other = _ramp(np.einsum("qi,qi->q", beyond, normals))
        other = np.where(self._open[piece, end], 0.0, other)
        d_other = np.where(self._open[piece, end], 0.0, d_other)
        least = other < own
        corner = np.where(least, other, own)
        corner_slope = np.where(least, 0.0, own_slope)
        corner_turn = np.where(least[:, None], d_other[:, None] * beyond, own_turn)
        share = corner + (own - corner) * w
        slope = corner_slope + (own_slope - corner_slope) * w + (own - corner) * d_w
        change = corner_turn + (own_turn - corner_turn) * w[:, None]
        return Shares(
            np.where(met, share, 1.0),
            np.where(met, slope, 0.0),
            np.where(met[:, None], change, 0.0),
        )

    def _ways(self, piece: Ints, xi: Floats, reach: Floats) -> tuple[Ints, Floats, Floats]:
        """The end (q,) that counts, the way to it over the reach, at most 1, and its slope.

        Of two ends the nearer one counts, and neither reaches further than to the middle.
        """
        ends = self._open[piece] | self._sharp[piece]
        end = np.where(ends[:, 0] & (~ends[:, 1] | (xi < 0.5)), 0, 1).astype(np.int32)
        length = self._length[piece]
        per_length = length / np.minimum(reach, np.where(ends.all(axis=1), 0.5, 1.0) * length)
        way = np.where(end == 0, xi, 1.0 - xi) * per_length
        near = (way < 1.0) & ends.any(axis=1)
        slope = np.where(near, np.where(end == 0, per_length, -per_length), 0.0)
        return end, np.where(near, way, 1.0), slope


def _ramp(cosine: Floats) -> tuple[Floats, Floats]:
    """S (q,) and ds/dcos of the cosine between the normals."""
    width = FACING - GRAZING
    share = (cosine - GRAZING) / width
    slope = np.where((share > 0.0) & (share < 1.0), 1.0 / width, 0.0)
    return np.clip(share, 0.0, 1.0), slope
