"""Functions of two variables with their first and second derivatives, on numbers or UFL.

UFL's own second derivatives of an expression that uses a part of itself many times take time that
doubles with each use; these are made in one go along with the value.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Scalar = Any  # a number, an array or a UFL expression


@dataclass(frozen=True, slots=True)
class Jet:
    """A function f(x, y) at a point.

    Attributes:
        value: f.
        first: (f_x, f_y).
        second: (f_xx, f_xy, f_yy).
    """

    value: Scalar
    first: tuple[Scalar, Scalar] = (0.0, 0.0)
    second: tuple[Scalar, Scalar, Scalar] = (0.0, 0.0, 0.0)

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
