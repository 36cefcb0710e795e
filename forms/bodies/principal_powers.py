"""Sums of powers of the principal stretches as functions that are smooth where stretches coincide.

What energies in principal stretches (Ogden's) are made of: Σ λ̄_aᵅ over the three isochoric
principal stretches, less 3, for any real α, from the invariants and without eigenvalues. Value,
first and second derivatives are those of the exact function at equal stretches too.

In a plane section the two stretches in the plane are known in closed form. In space Σ λ̄_aᵅ =
tr exp(α/2 ln C̄): the logarithm by square roots and a series, the exponential by a series and
squarings, all of them on invariants. Value and both derivatives are right to 1e-12 while the
isochoric stretches or their inverses are at most 4 and |α| at most 10, to 1e-9 up to 8; at |α| = 20
to 1e-10 up to 3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl

from tribox.forms.bodies.kinematics import Kinematics, PlanePart

# -- Functions of two variables with their first and second derivatives, on numbers or UFL ---------
#
# UFL's own second derivatives of an expression that uses a part of itself many times take time that
# doubles with each use; these are made in one go along with the value.

Scalar = Any  # a number, an array or a UFL expression


@dataclass(frozen=True, slots=True)
class Jet:
    """A function f(x, y) at a point."""

    value: Scalar  # f
    first: tuple[Scalar, Scalar] = (0.0, 0.0)  # (f_x, f_y)
    second: tuple[Scalar, Scalar, Scalar] = (0.0, 0.0, 0.0)  # (f_xx, f_xy, f_yy)

    def __add__(self, other: Jet | Scalar) -> Jet:
        """F + g, or f plus a constant."""
        if not isinstance(other, Jet):
            return Jet(self.value + other, self.first, self.second)
        (a, b), (c, d) = self.first, other.first
        (p, q, r), (s, t, u) = self.second, other.second
        return Jet(self.value + other.value, (a + c, b + d), (p + s, q + t, r + u))

    def __sub__(self, other: Jet | Scalar) -> Jet:
        """F − g, or f less a constant."""
        return self + (-1.0) * other

    def __mul__(self, other: Jet | Scalar) -> Jet:
        """F g, or f times a constant."""
        if not isinstance(other, Jet):
            (a, b), (p, q, r) = self.first, self.second
            c = other
            return Jet(c * self.value, (c * a, c * b), (c * p, c * q, c * r))
        f, (a, b), (p, q, r) = self.value, self.first, self.second
        g, (c, d), (s, t, u) = other.value, other.first, other.second
        return Jet(
            f * g,
            (a * g + f * c, b * g + f * d),
            (
                p * g + 2.0 * (a * c) + f * s,
                q * g + a * d + b * c + f * t,
                r * g + 2.0 * (b * d) + f * u,
            ),
        )

    __radd__ = __add__
    __rmul__ = __mul__

    def __truediv__(self, other: Jet) -> Jet:
        """f/g."""
        inverse = 1.0 / other.value
        return self * other.through(inverse, -(inverse**2), 2.0 * inverse**3)

    def root(self) -> Jet:
        """√f."""
        root = self.value**0.5
        return self.through(root, 0.5 / root, -0.25 / (root * self.value))

    def through(self, h: Scalar, slope: Scalar, curvature: Scalar) -> Jet:
        """h(f) of a function h of one variable, from h, h′ and h″ at f."""
        (a, b), (p, q, r) = self.first, self.second
        return Jet(
            h,
            (slope * a, slope * b),
            (
                curvature * (a * a) + slope * p,
                curvature * (a * b) + slope * q,
                curvature * (b * b) + slope * r,
            ),
        )

    def of(self, u: Jet, v: Jet) -> Jet:
        """f(u, v) of two functions of two variables; this one was taken at their values."""
        (a, b), (p, q, r) = self.first, self.second
        (ux, uy), (vx, vy) = u.first, v.first
        second = [
            a * s + b * t + p * (u1 * u2) + q * (u1 * v2 + u2 * v1) + r * (v1 * v2)
            for s, t, u1, v1, u2, v2 in zip(
                u.second, v.second, (ux, ux, uy), (vx, vx, vy), (ux, uy, uy), (vx, vy, vy),
                strict=True,
            )
        ]  # fmt: skip
        return Jet(self.value, (a * ux + b * vx, a * uy + b * vy), tuple(second))

    def taylor(self, x: Scalar, y: Scalar) -> Scalar:
        """F + f_x x + f_y y + (f_xx x² + 2 f_xy x y + f_yy y²)/2."""
        (a, b), (p, q, r) = self.first, self.second
        return self.value + a * x + b * y + 0.5 * p * x**2 + q * (x * y) + 0.5 * r * y**2


Expr = Any

ROOTS = 3  # square roots taken of C̄ before the series of its logarithm
NEWTON_STEPS = 3  # for the invariants of each
LOGARITHM_TERMS = 9  # of the series
DOUBLINGS = 4  # of the exponent, after the series of the exponential
EXPONENTIAL_TERMS = 16  # of that series
SMALL = 0.25  # argument up to which cosh √x − 1 is a series


def power_sum(k: Kinematics, terms: Sequence[tuple[Expr, Expr]]) -> Expr:
    """Σ_p f_p (Σ_a λ̄_a^α_p − 3) of the isochoric principal stretches.

    Args:
        terms: pairs of factor f_p and exponent α_p, numbers or UFL constants; another value of a
            constant compiles nothing.
    """
    if k.plane is not None:
        return sum(f * _plane_power_sum(k.plane, k.J, alpha) for f, alpha in terms)
    named = ufl.classes.Variable
    J, I1, I2 = (i.ufl_operands[0] if isinstance(i, named) else i for i in (k.J, k.I1, k.I2))
    (x, y), (x0, y0) = _excess(k), _excess(Kinematics(k.F, J, I1, I2, plane=None))
    # The derivatives by the invariants, which are UFL variables, see x and y alone: x0 and y0 are
    # equal to them and made of what the variables stand for.
    return space_power_sum(x0, y0, terms).taylor(x - x0, y - y0)


def _excess(k: Kinematics) -> tuple[Expr, Expr]:
    """Ī1 − 3 and Ī2 − 3."""
    return k.J ** (-2.0 / 3.0) * k.I1 - 3.0, k.J ** (-4.0 / 3.0) * k.I2 - 3.0


def space_power_sum(x: Expr, y: Expr, terms: Sequence[tuple[Expr, Expr]]) -> Jet:
    """The sum of :func:`power_sum` as a function of x = Ī1 − 3 and y = Ī2 − 3."""
    square, cube = _logarithm_traces(x, y)
    total = Jet(0.0)
    for factor, alpha in terms:
        a, b = 0.25 * alpha**2, 0.125 * alpha**3
        part = _exponential_trace(a * square.value, b * cube.value)
        total = total + factor * part.of(a * square, b * cube)
    return total


def _plane_power_sum(plane: PlanePart, J: Expr, alpha: Expr) -> Expr:
    """The sum where the normal of the plane is not tilted.

    The two stretches in the plane have the product J₂ and (λ₁/λ₂ + λ₂/λ₁)/2 = tr C₂/(2 J₂) =
    cosh d with d = ln λ₁/λ₂, so that λ₁ᵅ + λ₂ᵅ = 2 J₂^(α/2) cosh(α d/2).
    """
    excess = plane.I1 / (2.0 * plane.J) - 1.0
    # (α d/2)², whose hyperbolic cosine is even in d: d itself, a root, would not be differentiable
    # where the stretches coincide.
    swing = _cosh_of_root(0.25 * alpha**2 * squared_arcosh(excess))
    log_j = ufl.ln(J)
    mean = _expm1(alpha * (0.5 * ufl.ln(plane.J) - log_j / 3.0))
    across = _expm1(alpha * (ufl.ln(plane.stretch) - log_j / 3.0))
    return 2.0 * (mean + swing + mean * swing) + across


def squared_arcosh(x: Expr) -> Expr:
    """arcosh(1 + x)², analytic at x = 0 where arcosh itself is not.

    Below x = 0.02 the Taylor series 2x − x²/3 + 4x³/45 − x⁴/35 + 16x⁵/1575 − 8x⁶/2079 is used (the
    terms left out are below 1e-13 of the sum there); the other branch is given 0.02 instead, so
    that it does not divide by zero.
    """
    series = x * (
        2.0 + x * (-1 / 3 + x * (4 / 45 + x * (-1 / 35 + x * (16 / 1575 + x * (-8 / 2079)))))
    )
    large = ufl.conditional(ufl.gt(x, 0.02), x, 0.02)
    exact = ufl.ln(1.0 + large + ufl.sqrt(large * (large + 2.0))) ** 2
    return ufl.conditional(ufl.gt(x, 0.02), exact, series)


def _cosh_of_root(x: Expr) -> Expr:
    """Cosh √x − 1 for x ≥ 0, an entire function: its Taylor series up to `SMALL`."""
    series = _polynomial(x, [0.0] + [1.0 / math.factorial(2 * n) for n in range(1, 9)])
    power = ufl.exp(ufl.sqrt(ufl.conditional(ufl.gt(x, SMALL), x, SMALL)))
    return ufl.conditional(ufl.gt(x, SMALL), 0.5 * (power + 1.0 / power) - 1.0, series)


def _expm1(x: Expr) -> Expr:
    return ufl.exp(x) - 1.0


def _polynomial(x: Expr, coefficients: list[float]) -> Expr:
    """Σ c_n xⁿ by Horner's rule."""
    total: Expr = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        total = c + x * total
    return total


def _logarithm_traces(x: Expr, y: Expr) -> tuple[Jet, Jet]:
    """The traces of H² and H³, H = ln C̄, as functions of x = Ī1 − 3 and y = Ī2 − 3.

    The invariants of A = C̄^(1/8) come from three square roots (:func:`_root_excess`). With the
    small Z = (A − I)(A + I)⁻¹, ln A = 2 artanh Z. By the characteristic polynomial of A, of
    determinant 1, the invariants of Z are (i2 − i1, 6 − i1 − i2, i1 − i2)/(i1 + i2 + 2); the traces
    of its powers follow by Newton's identities, those of artanh Z by its series.
    """
    u, v = Jet(x, (1.0, 0.0)), Jet(y, (0.0, 1.0))
    for _ in range(ROOTS):
        u, v = _root_excess(u, v)
    below = u + v + 8.0
    e1, e2 = (v - u) / below, (-1.0) * (u + v) / below
    second, third = _artanh_powers(2 * LOGARITHM_TERMS + 1)
    traces = [Jet(3.0), e1, e1 * e1 - 2.0 * e2]
    for _ in range(3, len(third)):
        # The third invariant of Z is −e1.
        traces.append(e1 * (traces[-1] - traces[-3]) - e2 * traces[-2])
    scale = 2.0 ** (ROOTS + 1)
    square, cube = Jet(0.0), Jet(0.0)
    for c, d, trace in zip(second, third, traces, strict=True):
        square = square + scale**2 * c * trace if c else square
        cube = cube + scale**3 * d * trace if d else cube
    return square, cube


def _artanh_powers(highest: int) -> tuple[list[float], list[float]]:
    """Taylor coefficients of artanh(z)² and artanh(z)³ up to the power ``highest``."""
    first = [1.0 / n if n % 2 else 0.0 for n in range(highest + 1)]
    second = np.convolve(first, first)[: highest + 1]
    third = np.convolve(second, first)[: highest + 1]
    return list(map(float, second)), list(map(float, third))


def _root_excess(x: Jet, y: Jet) -> tuple[Jet, Jet]:
    """i1 − 3 and i2 − 3 of the square root U of a tensor with determinant 1.

    From x = I1 − 3 and y = I2 − 3 of the tensor: i1² = I1 + 2 i2 and i2² = I2 + 2 i1, which is
    never singular (i1 i2 ≥ 9), by Newton's method from a start that is exact at U = I. The excess
    over 3 keeps small strains from drowning in round-off.
    """
    # Start: the two equations put into each other four times, from i1² = I1 + 2 i2 ≈ I1 + 6.
    q = y + 3.0 + 2.0 * (x + 3.0 + 2.0 * (y + 3.0 + 2.0 * (x + 9.0).root()).root()).root()
    q = q.root()
    p = (x + 3.0 + 2.0 * q).root() - 3.0
    q = q - 3.0
    for _ in range(NEWTON_STEPS):
        f, g = p * (p + 6.0) - 2.0 * q - x, q * (q + 6.0) - 2.0 * p - y
        # Cramer's rule for the 2 × 2 system with the Jacobian [[2p + 6, −2], [−2, 2q + 6]]; a
        # factor of 2 is cancelled in numerators and determinant.
        slope = 2.0 * ((p + 3.0) * (q + 3.0) - 1.0)
        p, q = p - ((q + 3.0) * f + g) / slope, q - (f + (p + 3.0) * g) / slope
    return p, q


def _exponential_trace(square: Expr, cube: Expr) -> Jet:
    """The trace of exp(H), less 3, of a traceless H as a function of tr H² and tr H³.

    The traces t_n of the powers of A = H/16 follow from A³ = (t_2/2) A + (t_3/3) I; tr exp(±A) −
    3 is the sum of (±1)ⁿ t_n/n!. Of a tensor with determinant 1, I1(B²) = I1² − 2 I2 and I2(B²) =
    I2² − 2 I1: four squarings lead from exp(A) to exp(H).
    """
    scale = 0.5**DOUBLINGS
    t2 = Jet(scale**2 * square, (scale**2, 0.0))
    t3 = Jet(scale**3 * cube, (0.0, scale**3))
    traces = [Jet(3.0), Jet(0.0), t2, t3]
    while len(traces) <= EXPONENTIAL_TERMS:
        traces.append(0.5 * t2 * traces[-2] + 1.0 / 3.0 * t3 * traces[-3])
    even, odd = Jet(0.0), Jet(0.0)
    for n, trace in enumerate(traces[2:], start=2):
        part = 1.0 / math.factorial(n) * trace
        even, odd = (even + part, odd) if n % 2 == 0 else (even, odd + part)
    x, y = even + odd, even - odd
    for _ in range(DOUBLINGS):
        # The squaring above for the excesses x = I1 − 3 and y = I2 − 3: (x + 3)² − 2 (y + 3) − 3.
        x, y = x * (x + 6.0) - 2.0 * y, y * (y + 6.0) - 2.0 * x
    return x
