r"""Contacts on their way to their laws from inside: pressed everywhere, at their threshold nowhere.

The laws of contact have kinks, at which points open or close, stick or slip. Newton's method goes
from one set of them to the next, and its iterations grow with their number. Interior points have no
kinks: "one of two numbers is zero" becomes "their product is a small number", which falls from
iteration to iteration, with both as unknowns of their own (the primal-dual method: J. Nocedal,
S. Wright, Numerical Optimization, 2006, chapter 19). Eliminated point by point, they leave the
bodies with laws that are *linear* in gap and slip.

- Normal: pressure p > 0 and slack s = g + p/K > 0, with p s = \mu.
- Tangential: elastic slip e, shorter than its threshold \ell, at which asperities slip, and
  permanent slip y > 0 of the step, with e + y e/\ell = q, the trial slip, and
  y (\ell - |e|^2/\ell) = \nu.

Where these are solved at each gap and slip, the laws are smooth but not linear, and contacts never
pull: the central path (:class:`CentralPoint`, :class:`CentralSlip`).

Axis letters: q points, v vertices, i, j space.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tribox.forms.friction.law import FrictionResponse, FrictionState
from tribox.forms.native import library
from tribox.geometry.surfaces.facets import Floats

# Least share of permanent slip, and of the distance to slip, that an iteration leaves: a step
# of Newton's method that is made whole, and one that may be shortened.
KEPT, KEPT_SHORTENED = 0.2, 0.1
BEYOND = 1.01  # pressure that the law is asked at, over that at which it would slip
ROUND_OFF = 1e-12  # least distance to slip over the threshold
HALVINGS = 52  # of the interval of an elastic slip on the central path: to the last digit
LEAST_BARRIER = 1e-14  # of the slip, over the threshold squared: less is lost beside 1
TINY = float(np.finfo(float).tiny)

Answer = Callable[[Floats, FrictionState], FrictionResponse]  # of pressure, Pa, and state


@dataclass(frozen=True, slots=True)
class LinearSlip:
    """Elastic slips that are linear in trial slip and threshold."""

    elastic: Floats  # (q, i), m, may be longer than the threshold
    permanent: Floats  # (q,), m, may be negative
    # (q, i, j), derivative of ``elastic`` for the trial slip, symmetric, between 0 and 1
    d_trial: Floats
    d_threshold: Floats  # (q, i), that for the length at the threshold


@dataclass(frozen=True, slots=True)
class InteriorSlip:
    r"""Elastic slips inside of their threshold."""

    elastic: Floats  # e, (q, i), m
    permanent: Floats  # y, (q,), m
    threshold: Floats  # \ell, (q,), m, longer than e
    barrier: Floats  # \nu, (q,), m^2

    def linear(self, trial: Floats, threshold: Floats) -> LinearSlip:
        r"""One step of Newton's method for e and y, at a trial slip and a threshold.

        With :math:`a = e/\ell` and :math:`h = \ell (1 - |a|^2)` it is linear in all three of them:

        .. math:: \delta e + \frac{y}{\ell} \delta e + a\,\delta y - \frac{y}{\ell} a\,\delta\ell
           = q - e - y a, \qquad
           h\,\delta y + y ((1 + |a|^2)\,\delta\ell - 2 a \cdot \delta e) = \nu - y h

        Args:
            trial: q, (q, i), m, elastic slip of the last step and slip of this one.
            threshold: (q,), m, that at the end of the Newton step.
        """
        ahead = self.elastic / self.threshold[:, None]
        size = np.einsum("qi,qi->q", ahead, ahead)
        slack = np.maximum(self.threshold * (1.0 - size), TINY)
        slid, pull = self.permanent / self.threshold, self.permanent / slack
        # With δy eliminated, ((1 + y/ℓ) I + 2 (y/h) a⊗a) δe = right: the rank-one change of a
        # multiple of I is inverted by the formula of Sherman and Morrison, `along` being its
        # eigenvalue along a.
        across = 1.0 + slid
        along = across + 2.0 * pull * size
        by_threshold = pull * (1.0 + size) + slid
        longer = threshold - self.threshold
        drawn = self.permanent - self.barrier / slack + by_threshold * longer
        right = trial - across[:, None] * self.elastic + drawn[:, None] * ahead
        by_ahead = 2.0 * pull / (across * along)
        change = right / across[:, None]
        change -= (by_ahead * np.einsum("qi,qi->q", ahead, right))[:, None] * ahead
        d_trial = -by_ahead[:, None, None] * ahead[:, :, None] * ahead[:, None, :]
        for i in range(ahead.shape[1]):
            d_trial[:, i, i] += 1.0 / across
        outwards = np.einsum("qi,qi->q", ahead, change)
        permanent = self.barrier / slack - pull * ((1.0 + size) * longer - 2.0 * outwards)
        d_threshold = (by_threshold / along)[:, None] * ahead
        return LinearSlip(self.elastic + change, permanent, d_trial, d_threshold)

    def central(self) -> CentralSlip:
        """With elastic slips that stay on the central path."""
        return CentralSlip(self.elastic, self.permanent, self.threshold, self.barrier)

    def advanced(
        self, trial: Floats, threshold: Floats, following: Floats, shrinks: float, whole: bool
    ) -> InteriorSlip:
        """After a Newton step of the bodies, every elastic slip shorter than its threshold.

        Args:
            trial: (q, i), m, after the step.
            threshold: (q,), m, that it was evaluated with.
            following: (q,), m, of the pressures that the next step starts from.
            shrinks: factor of the barrier.
            whole: whether the step was made as it was found.
        """
        kept = KEPT if whole else KEPT_SHORTENED
        new = self.linear(trial, threshold)
        before = np.linalg.norm(self.elastic, axis=1)
        # Fraction to the boundary: neither the distance to the threshold nor the permanent slip
        # falls to less than a share of what it was, so that the next barrier starts from inside.
        reached = np.maximum(following, kept * self.threshold)
        left = np.maximum(kept * (self.threshold - before), ROUND_OFF * reached)
        most = reached - np.minimum(left, 0.5 * reached)
        length = np.linalg.norm(new.elastic, axis=1)
        shorter = np.minimum(1.0, most / np.maximum(length, TINY))
        permanent = np.maximum(new.permanent, kept * self.permanent)
        if whole:
            # A point that the linear law takes past its threshold has slipped, by e + y e/ℓ = q.
            # With the y of a point that sticks, next to none, it would go on sticking, and the
            # border of slip would move by a facet in an iteration.
            slipped = reached * (np.linalg.norm(trial, axis=1) / np.maximum(most, TINY) - 1.0)
            permanent = np.where(length > most, np.maximum(permanent, slipped), permanent)
        elastic: Floats = shorter[:, None] * new.elastic
        return InteriorSlip(elastic, permanent, reached, shrinks * self.barrier)

    def respond(
        self,
        answer: Answer,
        threshold: Floats,
        slip: Floats,
        state: FrictionState,
        pressure: Floats,
    ) -> FrictionResponse:
        """A law's answer where its asperities have these elastic slips; its derivatives.

        It is asked with the elastic slip from which its trial slip is the one wanted here, so that
        it sticks: what it has beside its asperities, such as a film, stays as it is.

        Args:
            threshold: (q,), m, elastic slip at which it slips under the pressure.
            slip: (q, i), m, of the step.
            state: last converged, with the elastic slip (q, i) transported.
            pressure: (q,), Pa.
        """
        new = self.linear(slip + state.elastic_slip, threshold)
        length = np.linalg.norm(new.elastic, axis=1)
        holding = pressure * np.maximum(1.0, BEYOND * length / np.maximum(threshold, TINY))
        out = answer(holding, replace(state, elastic_slip=new.elastic - slip))
        # The law was asked at the trial slip e: ∂T/∂e, times the derivatives of e, takes the place
        # of its derivative for the trial slip.
        by_elastic, same = out.d_traction_d_elastic, np.eye(slip.shape[1])
        per_pressure = threshold / np.maximum(pressure, TINY)
        d_pressure = np.einsum("qij,qj,q->qi", by_elastic, new.d_threshold, per_pressure)
        return replace(
            out,
            d_traction_d_slip=out.d_traction_d_slip + by_elastic @ (new.d_trial - same),
            d_traction_d_elastic=by_elastic @ new.d_trial,
            d_traction_d_pressure=out.d_traction_d_pressure + d_pressure,
        )


@dataclass(frozen=True, slots=True)
class InteriorPoint:
    r"""Contact pressures on their way to the penalty's law from inside: all positive.

    With the slack s = g + p/K the law p = K⟨−g⟩ is p ≥ 0, s ≥ 0, p s = 0. On the way both are
    unknowns and p s = μ. Newton's method for these, with s eliminated, is Newton's method for the
    bodies with the linear law

    .. math:: p(g) = p + \frac{\mu - p \, (g + p/K)}{s + p/K}

    (the primal-dual method: J. Nocedal, S. Wright, Numerical Optimization, 2006, chapter 19).

    Attributes:
        pressure: p, Pa, and slack: s, m, of the vertices (v,), or point by point (q,).
        barrier: μ, J/m².
        reach: m; gap up to which the surfaces feel each other.
        slip: what the points' friction is; None: the law as it is.
    """

    pressure: Floats
    slack: Floats
    barrier: float
    reach: float
    slip: InteriorSlip | None = None

    def law(self, gap: Floats, penalty: Floats) -> tuple[Floats, Floats]:
        """Pressure, Pa, at gaps, m, and −∂p/∂g, Pa/m; all of the shape of ``pressure``."""
        below = self.slack + self.pressure / penalty
        stiffness: Floats = self.pressure / below
        closed: Floats = gap + self.pressure / penalty
        out: Floats = self.pressure + self.barrier / below - stiffness * closed
        return out, stiffness

    def central(self) -> CentralPoint:
        """With laws that stay on the central path."""
        slip = None if self.slip is None else self.slip.central()
        return CentralPoint(self.pressure, self.slack, self.barrier, self.reach, slip)

    def advanced(self, gap: Floats, penalty: Floats, barrier: float, kept: float) -> InteriorPoint:
        """After a Newton step to ``gap``, m, with the next barrier; both stay positive.

        ``kept``: least share of pressure and slack that the step leaves.
        """
        pressure, _ = self.law(gap, penalty)
        slack = pressure / penalty + gap
        return InteriorPoint(
            np.maximum(pressure, kept * self.pressure),
            np.maximum(slack, kept * self.slack),
            barrier,
            self.reach,
            self.slip,
        )


@dataclass(frozen=True, slots=True)
class CentralSlip(InteriorSlip):
    """Elastic slips on the central path, whatever the trial slip is."""

    def linear(self, trial: Floats, threshold: Floats) -> LinearSlip:
        r"""The elastic slip of a trial slip and a threshold, and its derivatives there.

        With :math:`a = |e|/\ell`, :math:`t = |q|/\ell` and :math:`\kappa = \nu/\ell^2`

        .. math:: a + \frac{\kappa a}{1 - a^2} = t, \qquad 0 \le a < 1

        Args:
            trial: q, (q, i), m, elastic slip of the last step and slip of this one.
            threshold: (q,), m, under the present pressure.
        """
        reached = np.maximum(threshold, ROUND_OFF * self.threshold)
        length = np.linalg.norm(trial, axis=1)
        wanted = length / reached
        barrier = np.maximum(self.barrier / reached**2, LEAST_BARRIER)
        low = np.empty_like(wanted)
        arrays = (ctypes.c_void_p(array.ctypes.data) for array in (wanted, barrier, low))
        sizes = map(ctypes.c_int64, (len(low), HALVINGS))
        library("central_slip.c").tribox_central_slip(*sizes, *arrays)
        left = 1.0 - low**2
        # Implicit derivatives of a(t): a/t across the trial slip, da/dt along it, and for ℓ those
        # of e = ℓ a(|q|/ℓ, ν/ℓ²).
        across = 1.0 / (1.0 + barrier / left)
        along = 1.0 / (1.0 + barrier * (1.0 + low**2) / left**2)
        direction = trial / np.maximum(length, TINY)[:, None]
        d_trial = (along - across)[:, None, None] * direction[:, :, None] * direction[:, None, :]
        for i in range(trial.shape[1]):
            d_trial[:, i, i] += across
        by_threshold = low - along * (wanted - 2.0 * barrier * low / left)
        return LinearSlip(
            elastic=(reached * low)[:, None] * direction,
            permanent=barrier * reached / left,
            d_trial=d_trial,
            d_threshold=np.where(reached > threshold, 0.0, by_threshold)[:, None] * direction,
        )

    def advanced(
        self, trial: Floats, threshold: Floats, following: Floats, shrinks: float, whole: bool
    ) -> CentralSlip:
        """See :class:`InteriorSlip`: the next path, at the threshold that follows."""
        at = self.linear(trial, threshold)
        # Where nothing holds the points any length will do: one that fell by ROUND_OFF in each
        # iteration would soon have no square.
        reached = np.where(following > ROUND_OFF * self.threshold, following, self.threshold)
        return CentralSlip(at.elastic, at.permanent, reached, shrinks * self.barrier)


@dataclass(frozen=True, slots=True)
class CentralPoint(InteriorPoint):
    r"""Contact pressures on the central path, whatever the gap is: p s = \mu.

    .. math:: p(g) = \frac{K}{2} \left( \sqrt{g^2 + 4 \mu/K} - g \right)
    """

    def law(self, gap: Floats, penalty: Floats) -> tuple[Floats, Floats]:
        root = np.sqrt(gap**2 + 4.0 * self.barrier / penalty)
        below = np.maximum(root + np.abs(gap), TINY)
        apart = 2.0 * self.barrier / below  # without cancellation
        pressure = np.where(gap > 0.0, apart, 0.5 * penalty * (root - gap))
        return pressure, pressure / np.maximum(root, TINY)

    def advanced(self, gap: Floats, penalty: Floats, barrier: float, kept: float) -> CentralPoint:
        """See :class:`InteriorPoint`: the next path. Nothing need be kept from one to the next."""
        pressure = np.maximum(self.law(gap, penalty)[0], TINY)
        return CentralPoint(pressure, self.barrier / pressure, barrier, self.reach, self.slip)


@dataclass(frozen=True, slots=True)
class SoftenedPoint:
    r"""Pressures of a penalty K that is softened to c K and begins from pressures of its own.

    With :math:`p = \langle b - c K g \rangle` and b = (1 - c) p of a state, the pressures p of
    that state are those of K there. Where each state begins the next one, they come to
    :math:`p = K \langle -g \rangle`, by a share of about 1/c of the bodies' stiffness over K each
    time (the method of multipliers: R. T. Rockafellar, Math. Oper. Res. 1 (1976) 97).
    """

    base: Floats  # b, (v,) or (q,), Pa
    penalty: Floats  # K, likewise, Pa/m
    softness: float  # c
    slip: None = None  # friction as it is

    @property
    def reach(self) -> Floats:
        """Gap, m, up to which there is a pressure."""
        return self.base / (self.softness * self.penalty)

    def law(self, gap: Floats, penalty: Floats) -> tuple[Floats, Floats]:
        """Pressure, Pa, and its derivative by the approach, Pa/m; of what touches, that beyond."""
        stiffness = self.softness * penalty
        return np.maximum(self.base - stiffness * gap, 0.0), stiffness
