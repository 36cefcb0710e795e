"""The compiled loop over plastic material points, ``plastic_points.c``.

The same numbers to round-off as :mod:`tribox.forms.bodies.plastic_points` computes in numpy.
"""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.hardening import (
    Hardening,
    JohnsonCook,
    Linear,
    Metal,
    Perzyna,
    RateFactor,
    Swift,
    Table,
    Voce,
)
from tribox.forms.native.libraries import library

Floats = NDArray[np.float64]

SOURCE = "plastic_points.c"
MOST_BRANCHES = 8  # of the backstress, MOST of the C source


class _Material(ctypes.Structure):
    """``Material`` of the C source, field by field in the same order."""

    _fields_ = (
        ("shear", ctypes.c_double),
        ("bulk", ctypes.c_double),
        ("dt", ctypes.c_double),
        ("rate_parameters", ctypes.c_double * 2),
        ("law", ctypes.c_int64),
        ("rate", ctypes.c_int64),
        ("count", ctypes.c_int64),
        ("parameters", ctypes.c_void_p),
        ("branches", ctypes.c_int64),
        ("backstress", ctypes.c_void_p),
    )


class CompiledPoints:
    """The loop for one material."""

    def __init__(self, code: ctypes.CDLL, material: Metal, space: bool) -> None:
        """Lay the material out.

        Args:
            code: the library of ``SOURCE``.
            material: laws that the library knows.
            space: 9 components of F instead of the plane's 5.

        Raises:
            RuntimeError: the library's layout of a material is another one.
        """
        code.tribox_plastic_material_size.restype = ctypes.c_int64
        if code.tribox_plastic_material_size() != ctypes.sizeof(_Material):
            raise RuntimeError(f"{SOURCE}: its structure Material is not the one of {__name__}")
        kind = "turning" if material.kinematic else "plastic"
        self._function = getattr(code, f"tribox_{kind}_{'space' if space else 'plane'}")
        self._function.argtypes = [ctypes.c_void_p, ctypes.c_int64, *[ctypes.c_void_p] * 6]
        self._function.restype = ctypes.c_int64
        law, self._parameters = _law(material.hardening)
        branches = [(branch.modulus, branch.recovery) for branch in material.kinematic]
        self._branches = np.array(branches, dtype=np.float64)
        self._rate, rate_parameters = _rate(material.rate)
        self._material = _Material(
            shear=material.shear_modulus,
            rate_parameters=rate_parameters,
            law=law,
            count=len(self._parameters) // 2,
            parameters=self._parameters.ctypes.data,
            branches=len(branches),
            backstress=self._branches.ctypes.data,
        )

    def __call__(
        self, F: Floats, state: Floats, dt: float, bulk: float, tangent: bool
    ) -> tuple[Floats, Floats, Floats | None, tuple[Floats, Floats, Floats], bool]:
        """See ``PlasticPoints.update``.

        Args:
            F: (n, p) deformation gradients.
            state: (n, s) at the step's begin.
            dt: s, its length.
            bulk: K, Pa, or 0.
            tangent: whether to compute A.

        Returns:
            P (n, p), state (n, s), A (n, p, p) or None, then elastic energy, dissipation and its
            numerical part (n,), and whether all points are valid.
        """
        F, state = (np.ascontiguousarray(x, dtype=np.float64) for x in (F, state))
        n, p = F.shape
        P, end, energies = np.empty_like(F), np.empty_like(state), np.empty((3, n))
        A = np.empty((n, p, p)) if tangent else None
        self._material.bulk, self._material.dt = bulk, dt
        self._material.rate = self._rate if np.isfinite(dt) else 0
        arrays = (F, state, P, end, A, energies)
        places = [None if array is None else array.ctypes.data for array in arrays]
        bad = self._function(ctypes.byref(self._material), n, *places)
        return P, end, A, (energies[0], energies[1], energies[2]), not bad


def compiled_points(material: Metal, space: bool) -> CompiledPoints | None:
    """The loop for a material; None without a C compiler, or for laws that it does not know."""
    known = isinstance(material.hardening, Linear | Voce | Swift | Table)
    known &= isinstance(material.rate, JohnsonCook | Perzyna | None)
    known &= len(material.kinematic) <= MOST_BRANCHES
    code = library(SOURCE) if known else None
    return None if code is None else CompiledPoints(code, material, space)


def _law(law: Hardening) -> tuple[int, Floats]:
    """Number and parameters of a law as the C source has them."""
    if isinstance(law, Linear):
        return 0, np.array([law.yield_stress, law.modulus])
    if isinstance(law, Voce):
        return 1, np.array([law.yield_stress, law.saturation_stress, law.exponent, law.modulus])
    if isinstance(law, Swift):
        return 2, np.array([law.K, law.strain0, law.n])
    assert isinstance(law, Table)
    return 3, np.ascontiguousarray(np.array(law.points).T).reshape(-1)


def _rate(rate: RateFactor | None) -> tuple[int, tuple[float, float]]:
    """Number and parameters of a rate factor as the C source has them."""
    if isinstance(rate, JohnsonCook):
        return 1, (rate.C, rate.reference_rate)
    if isinstance(rate, Perzyna):
        return 2, (rate.reference_rate, rate.exponent)
    return 0, (0.0, 0.0)
