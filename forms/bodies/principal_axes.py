"""Principal axes of the elastic trial deformation of material points.

b = F C_p⁻¹ Fᵀ = Σ w_a n_a⊗n_a and G_a = F⁻¹ n_a, in numpy. Points where this does not exist (det F
not positive, numbers not finite) are marked and get those of F = I. Axis letters: n points, a
principal axes, i, J components in space; always three, in the plane the third axis is its normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SERIES = 0.02  # below it artanh(z)/z is taken from its series, whose rest is below 1e-17


@dataclass(frozen=True, slots=True)
class PrincipalAxes:
    """Principal values and axes of the trial deformation.

    Attributes:
        w: (n, a) principal values of b, squares of stretches.
        logs: (n, a), e_a = ½ ln w_a.
        n: (n, a, i) unit vectors of the axes.
        G: (n, a, J), F⁻¹ n_a.
        valid: (n,) whether the point's F and state are proper ones.
    """

    w: Floats
    logs: Floats
    n: Floats
    G: Floats
    valid: Bools

    def bases(self) -> Floats:
        """n_a⊗G_b (n, 3a + b, 3i + J)."""
        return np.einsum("nai,nbJ->nabiJ", self.n, self.G).reshape(-1, 9, 9)


def axes_in_space(F: Floats, state: Floats) -> PrincipalAxes:
    """Axes from F (n, 9), row by row, and C_p⁻¹ (11, 22, 33, 12, 23, 13) in ``state``."""
    with np.errstate(all="ignore"):
        good = _finite(F) & _finite(state)
        tensor = _or_identity(F, good)
        good &= _finite_positive(np.linalg.det(tensor))
        tensor = _or_identity(F, good)
        C = _or_identity(state[:, [0, 3, 5, 3, 1, 4, 5, 4, 2]], good)
        b = tensor @ C @ np.swapaxes(tensor, 1, 2)
        good &= _finite(b.reshape(-1, 9))
        w, vectors = np.linalg.eigh(_or_identity(b, good))
        G = np.linalg.solve(_or_identity(F, good), vectors)
        return _axes(w, np.swapaxes(vectors, 1, 2), np.swapaxes(G, 1, 2), good)


def _or_identity(tensors: Floats, good: Bools) -> Floats:
    """Tensors (n, 3, 3), the identity where they are not good."""
    return np.where(good[:, None, None], tensors.reshape(-1, 3, 3), np.eye(3))


def axes_in_plane(F: Floats, state: Floats) -> PrincipalAxes:
    """Axes from F (n, 5) (11, 12, 21, 22, 33) and C_p⁻¹ (11, 22, 33, 12) in ``state``.

    The in-plane values are m ± r with the mean m and the radius r of Mohr's circle, the smaller one
    as determinant over the larger, which does not cancel.
    """
    with np.errstate(all="ignore"):
        good = _finite(F) & _finite(state)
        det = F[:, 0] * F[:, 3] - F[:, 1] * F[:, 2]
        good &= _finite_positive(det) & (F[:, 4] > 0.0)
        F = np.where(good[:, None], F, [1.0, 0.0, 0.0, 1.0, 1.0])
        c11, c22, c33, c12 = np.where(good[:, None], state[:, :4], [1.0, 1.0, 1.0, 0.0]).T
        f11, f12, f21, f22, f33 = F.T
        det = f11 * f22 - f12 * f21
        b11 = f11 * (f11 * c11 + 2.0 * f12 * c12) + f12 * f12 * c22
        b22 = f21 * (f21 * c11 + 2.0 * f22 * c12) + f22 * f22 * c22
        b12 = f11 * (c11 * f21 + c12 * f22) + f12 * (c12 * f21 + c22 * f22)
        n = np.zeros((len(F), 3, 3))
        n[:, 0, :2], larger = _mohr(b11, b22, b12)
        n[:, 1, 0], n[:, 1, 1], n[:, 2, 2] = -n[:, 0, 1], n[:, 0, 0], 1.0
        smaller = det * det * (c11 * c22 - c12 * c12) / larger
        w = np.stack([larger, smaller, f33 * f33 * c33], axis=1)
        G = np.zeros_like(n)
        G[:, :2, 0] = (f22[:, None] * n[:, :2, 0] - f12[:, None] * n[:, :2, 1]) / det[:, None]
        G[:, :2, 1] = (f11[:, None] * n[:, :2, 1] - f21[:, None] * n[:, :2, 0]) / det[:, None]
        G[:, 2, 2] = 1.0 / f33
        return _axes(w, n, G, good)


def _mohr(b11: Floats, b22: Floats, b12: Floats) -> tuple[Floats, Floats]:
    """Axis (n, 2) of the larger principal value of a plane symmetric tensor, and that value."""
    half = 0.5 * (b11 - b22)
    radius = np.hypot(half, b12)
    long = radius + np.abs(half)
    axis = np.where((half >= 0.0)[:, None], np.stack([long, b12], 1), np.stack([b12, long], 1))
    length = np.hypot(long, b12)
    round_ = length == 0.0
    axis = np.where(round_[:, None], [1.0, 0.0], axis / np.where(round_, 1.0, length)[:, None])
    return axis, 0.5 * (b11 + b22) + radius


def _axes(w: Floats, n: Floats, G: Floats, good: Bools) -> PrincipalAxes:
    good = good & (np.isfinite(w) & (w > 0.0)).all(axis=1)
    w = np.where(good[:, None], w, 1.0)
    return PrincipalAxes(w, 0.5 * np.log(w), n, G, good)


def _finite_positive(x: Floats) -> Bools:
    return np.asarray(np.isfinite(x) & (x > 0.0))


def _finite(rows: Floats) -> Bools:
    return np.asarray(np.isfinite(rows).all(axis=1))


def log_ratio(w: Floats, v: Floats, difference: Floats) -> Floats:
    """½ ln(w/v) (w + v)/(w − v) = artanh(z)/z with z = (w − v)/(w + v), also where w = v.

    Args:
        w: positive.
        v: positive, of the same shape.
        difference: ½ ln(w/v).
    """
    z = (w - v) / (w + v)
    near = np.abs(z) < SERIES
    s = z * z
    series = 1.0 + s * (1 / 3 + s * (1 / 5 + s * (1 / 7 + s * (1 / 9))))
    return np.where(near, series, difference / np.where(near, 1.0, z))
