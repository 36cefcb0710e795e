"""Stress and strain measures at material points, from their deformation gradients.

Energies that the C sources know go through their kernels, those of the user's own through
:mod:`tribox.forms.bodies.own_energy`. Axis letters: p points, i, j space; tensors are always
(3, 3), the direction across a plane being the third.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies import materials
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.own_energy import InvariantEnergy
from tribox.forms.bodies.point_state import Kernel

Floats = NDArray[np.float64]
PIECE = 2048  # points whose stresses are found at once

# -- Strain energies at points ---------------------------------------------------------------------

# Of energies.h.
NUMBERS: dict[type, int] = {
    materials.NeoHookean: 0,
    materials.MooneyRivlin: 1,
    materials.Hencky: 2,
    materials.Yeoh: 3,
    materials.Ogden: 4,
}
WHOLE, DISTORTION, VOLUME = range(3)
_PARTS = {WHOLE: slice(None), DISTORTION: slice(0, 1), VOLUME: slice(1, 2)}
AtPoints = Callable[[Floats, bool], tuple[Floats, Floats, Floats | None]]
"""Energy (n,), J/m³, P (n, p) and, if asked for, A = ∂P/∂F (n, p, p), Pa, of F (n, p)."""


class _Law(ctypes.Structure):
    """``Law`` of ``energies.h``."""

    constants: Floats  # that ``c`` points to
    _fields_ = (("material", ctypes.c_int64), ("part", ctypes.c_int64), ("c", ctypes.c_void_p))


def constants_of(material: materials.Material) -> Floats:
    """The constants of a material that the C sources know, as they have them."""
    values = list(material.parameters().values())
    if isinstance(material, materials.Ogden):  # as many as it has terms, which must be told
        values = [values[-1], len(material.mu), *values[:-1]]
    return np.array(values, dtype=np.float64)


def energy_kernel(section: str, material: materials.Material, part: int) -> Kernel:
    """Gives stress, moduli and energy of a part of an energy, in "strain", "ring" or "space"."""
    constants = constants_of(material)
    law = _Law(NUMBERS[type(material)], part, constants.ctypes.data)
    law.constants = constants
    source = "space_kernel.c" if section == "space" else "elastic_points.c"
    return Kernel.of(source, f"elastic_{section}", law, symmetric=True)


def has_volume(material: materials.Material) -> bool:
    """Whether there is a volumetric part; that of a user's own energy may be 0."""
    elastic: materials.Material = getattr(material, "elastic", material)
    if type(elastic) in NUMBERS:
        return True
    return not InvariantEnergy(cast(materials.OwnEnergy, elastic), _PARTS[VOLUME], True).vanishes


def energy_at_points(material: materials.Material, part: int, space: bool) -> AtPoints:
    """A part of an energy with its derivatives by F (9 in space, else 5); NaN where J ≤ 0."""
    elastic: materials.Material = getattr(material, "elastic", material)
    if type(elastic) not in NUMBERS:
        return InvariantEnergy(cast(materials.OwnEnergy, elastic), _PARTS[part], space)
    kernel = energy_kernel("space" if space else "ring", elastic, part)

    def at(F: Floats, tangent: bool = False) -> tuple[Floats, Floats, Floats | None]:
        found = kernel.update(F, np.empty((len(F), 0)), tangent)
        return found.elastic, found.P, found.A

    return at


# -- Stress ----------------------------------------------------------------------------------------


class StressAt(Protocol):
    """What gives the stress of a body at fixed places of it."""

    def cauchy(self, F: Floats, volumetric: Floats | None = None) -> Floats:
        """Cauchy stress (p, 3, 3), Pa, at F (p, 3, 3) and the present displacement.

        ``volumetric``: (p, 3, 3), of the volumetric energy, if others: at the cells' centres.
        """
        ...

    def plastic_strain(self) -> Floats | None:
        """Equivalent plastic strain (p,); None of a material that does not flow."""
        ...


class PointStress:
    """Cauchy stress of a material from deformation gradients, σ = P Fᵀ/J."""

    def __init__(self, material: materials.Material, section: Section) -> None:
        self._space = section == "3D"
        self._parts = [
            energy_at_points(material, part, self._space) for part in (WHOLE, DISTORTION, VOLUME)
        ]

    def cauchy(self, F: Floats, volumetric: Floats | None = None) -> Floats:
        """See :meth:`StressAt.cauchy`."""
        whole, distortional, of_volume = self._parts
        if volumetric is None:
            return self._of(whole, F)
        return self._of(distortional, F) + self._of(of_volume, volumetric)

    def plastic_strain(self) -> None:
        """None: the material does not flow."""

    def _of(self, energy: AtPoints, F: Floats) -> Floats:
        """Cauchy stress (p, 3, 3), found piece by piece: what lies between takes far more room."""
        rows = F.reshape(-1, 9)[:, slice(None) if self._space else [0, 1, 3, 4, 8]]
        pieces = np.split(rows, list(range(PIECE, len(rows), PIECE)))
        P = as_tensors(np.concatenate([energy(piece, False)[1] for piece in pieces]))
        return cauchy_of(P, F)


def cauchy_of(P: Floats, F: Floats) -> Floats:
    """Push-forward σ = P Fᵀ/J of the first Piola stress (p, 3, 3)."""
    return np.asarray(P @ F.transpose(0, 2, 1) / np.linalg.det(F)[:, None, None])


def as_tensors(rows: Floats) -> Floats:
    """Tensors (k, 3, 3) from components (k, p): 11, 12, 21, 22, 33; in space all, row by row."""
    if rows.shape[1] == 9:
        return rows.reshape(-1, 3, 3)
    out = np.zeros((len(rows), 3, 3))
    out[:, :2, :2] = rows[:, :4].reshape(-1, 2, 2)
    out[:, 2, 2] = rows[:, 4]
    return out


def log_strain(F: Floats) -> Floats:
    """Logarithmic (Hencky) strain ln V = ½ ln b (p, 3, 3), in the deformed axes."""
    values, axes = np.linalg.eigh(F @ F.transpose(0, 2, 1))
    logs = 0.5 * np.log(values)
    return np.einsum("pia,pa,pja->pij", axes, logs, axes)


def mean_pressure(stress: Floats) -> Floats:
    """−tr σ/3 (p,), Pa, of stresses (p, 3, 3)."""
    return np.asarray(-(stress[:, 0, 0] + stress[:, 1, 1] + stress[:, 2, 2]) / 3.0)


def von_mises(stress: Floats) -> Floats:
    """√(3/2 s:s) (p,), Pa, of symmetric stresses (p, 3, 3) with the deviator s.

    √(½ Σ (σ_ii − σ_jj)² + 3 Σ σ_ij²), both sums over the three pairs of axes.
    """
    pairs = ((0, 1), (1, 2), (2, 0))
    normal = np.zeros(len(stress))
    shear = np.zeros(len(stress))
    for i, j in pairs:
        apart: Floats = stress[:, i, i] - stress[:, j, j]
        normal += apart**2
        shear += stress[:, i, j] ** 2
    return np.asarray(np.sqrt(0.5 * normal + 3.0 * shear))


def triaxiality(stress: Floats) -> Floats:
    """Mean stress over von Mises stress (p,) of stresses (p, 3, 3); 0 where there is none."""
    mises, mean = von_mises(stress), -mean_pressure(stress)
    # Below that the deviator is round-off of a hydrostatic stress, and the ratio is noise.
    some = mises > 1e-12 * np.abs(stress).max(axis=(1, 2), initial=0.0)
    return np.asarray(np.where(some, mean / np.where(some, mises, 1.0), 0.0))
