r"""Whether sliding has become steady, judged by slip distances and not by steps.

A force that changes little from row to row can still be far from its end: friction whose weakening
begins only after a slip :math:`A_d`, a thick soft body that takes long to be sheared, a film whose
drag grows slowly. So two things are asked of the tangential force T, at a way s slid at the present
velocity:

1. What friction will still lose by what its law says of itself,
   :math:`E = \int \omega (\mu(d) - \mu_\infty) t_N \, dA`, is at most ``SETTLED`` of T, or the
   tolerance below if that is more.
2. T - E, which does not feel the weakening, stays the same to within a tolerance over the last
   :math:`\max\{s/8, L\}` of the way, with the longer of two lengths for L: the pre-sliding length
   :math:`\mu p/K_T`, and the elastic length T/k in which the bodies are sheared under the load that
   they now bear; k is the steepest rise of T with the way so far. If s is shorter than L, the
   change over all of s is extrapolated to L. For a linear film T/k dT/ds is the part of the
   velocity that goes into shearing the bodies, so the part of T that is missing.

The eighth catches what has no length: of a tail of T that falls as 1/s at most seven times the
change is still to come.

Where points enter the contact all the time (rolling), E does not fall although all slides. So it is
as good if T itself has stayed the same over the whole slip in which friction settles.

Lengths are in metres and forces between rows are interpolated: how the way is cut into rows does
not matter. No constant here has a unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from tribox.app.equilibrium.snapshot import Snapshot
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.forms.friction.law import (
    SETTLED,
    FrictionLaw,
    knows_its_end,
    presliding_length,
    settling_slip,
    unsettled,
)

Floats = NDArray[np.float64]

SHARE = 1.0 / 8.0  # of the way slid, over which the force must at least have stayed the same


@dataclass(frozen=True, slots=True)
class Steadiness:
    """How near the tangential force is to its end."""

    steady: bool  # whether it is there
    left: float  # what friction has still to lose by its law, over the tangential force
    change: float  # of the tangential force without that, relative, over the distance
    distance: float  # m, of drive
    allowed: float = SETTLED  # tolerance of what is left

    @property
    def reason(self) -> str:
        """What is missing, in words."""
        if self.left > self.allowed:
            return f"friction has still to change by {self.left:.2g} of the tangential force"
        return (
            f"the tangential force changes by {self.change:.2g} of itself in {self.distance:.2g} m"
        )


def measure_settling(
    contacts: Sequence[ContactTerm], trials: Sequence[ContactTrial], comm: MPI.Comm
) -> tuple[float, float]:
    """What friction has still to lose, and in what slip it follows a change; collective.

    Returns N/m in plane strain, otherwise N, by what the laws say of themselves; and the pre-
    sliding length of all pairs, m, mean weighted by the pressure.
    """
    sums = np.zeros(3)
    for term, trial in zip(contacts, trials, strict=True):
        weight, state, pressure = term.surface.slave.weight, trial.response.state, trial.pressure
        load = weight * pressure
        sums += (
            weight @ unsettled(term.law, state, pressure),
            load @ presliding_length(term.law, state, pressure),
            load.sum(),
        )
    total = comm.allreduce(sums)
    return float(total[0]), float(total[1] / total[2]) if total[2] > 0.0 else 0.0


NOT_SLID = Steadiness(False, 0.0, np.inf, 0.0)


class SlidWay:
    """Tangential force of a run over the way of its driven boundaries, one sample for each row.

    ``settling_slip``: m, after which all friction has settled; ``knows_end``: all laws tell.
    """

    def __init__(self, laws: Iterable[FrictionLaw]) -> None:
        laws = list(laws)
        self.settling_slip = max(map(settling_slip, laws), default=0.0)
        self.knows_end = all(map(knows_its_end, laws))
        self._driven, self._force, self._unsettled = [0.0], [0.0], [0.0]
        self._presliding = self._stiffness = 0.0

    def add(self, driven: float, force: float, unsettled: float, presliding: float) -> None:
        """Add a row: displacement driven, m, force of either sign and still to lose, N.

        ``presliding``: m, slip in which friction follows a change.
        """
        moved = abs(driven - self._driven[-1])
        if moved > 0.0:
            rise = (abs(force) - abs(self._force[-1])) / moved
            self._stiffness = max(self._stiffness, rise)
        self._driven.append(driven)
        self._force.append(force)
        self._unsettled.append(unsettled)
        self._presliding = presliding

    def snapshot(self) -> Snapshot:
        """The samples so far."""
        return {
            "driven": np.array(self._driven),
            "force": np.array(self._force),
            "unsettled": np.array(self._unsettled),
            "presliding": self._presliding,
            "stiffness": self._stiffness,
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._driven, self._force = kept["driven"].tolist(), kept["force"].tolist()
        self._unsettled = kept["unsettled"].tolist()
        self._presliding, self._stiffness = kept["presliding"], kept["stiffness"]

    def judge(self, first: int, tolerance: float) -> Steadiness:
        """Whether the force is steady now."""
        driven = np.array(self._driven[first:])  # the sample before the first row is the start
        way = np.abs(driven - driven[0])
        if len(way) < 2 or way[-1] == 0.0:
            return NOT_SLID
        force = np.abs(self._force[first:])
        excess = np.array(self._unsettled[first:])
        now, left = float(force[-1]), abs(float(excess[-1]))
        length = self._presliding
        if self._stiffness > 0.0:
            length = max(length, now / self._stiffness)
        length = max(SHARE * float(way[-1]), length)
        change = change_over(way, force - excess, length)
        allowed = max(SETTLED, tolerance)
        settled = self.knows_end and left <= allowed * now
        steady = settled and change <= tolerance * now
        if not steady and 0.0 < self.settling_slip <= way[-1]:
            longest = max(length, self.settling_slip)
            steady = change_over(way, force, longest) <= tolerance * now
        return Steadiness(steady, _over(left, now), _over(change, now), length, allowed)


def _over(part: float, whole: float) -> float:
    if whole > 0.0:
        return part / whole
    return np.inf if part > 0.0 else 0.0


def change_over(way: Floats, values: Floats, length: float) -> float:
    """Largest difference of values (n,) over the last ``length``, m, of the way, from the last.

    Linear between samples at ``way`` (n,), m; of a longer length in proportion.
    """
    slid = float(way[-1])
    start = max(slid - length, 0.0)
    within = np.append(values[way >= start], np.interp(start, way, values))
    return float(np.abs(within - values[-1]).max()) * max(length / slid, 1.0)
