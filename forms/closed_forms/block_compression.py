r"""Closed forms of the homogeneous deformation of an incompressible neo-Hookean block.

With :math:`W = G/2 (I_1 - 3)` and lateral faces free of stress; nominal stress is force over
undeformed area, positive in tension.
"""

from __future__ import annotations


def plane_strain_stress(stretch: float, shear_modulus: float) -> float:
    r"""Nominal stress, Pa, in plane strain: :math:`G (\lambda - \lambda^{-3})`.

    Args:
        stretch: λ > 0, deformed over undeformed height.
        shear_modulus: Pa, G.
    """
    return shear_modulus * (stretch - stretch**-3)


def plane_strain_pressure(stretch: float, shear_modulus: float) -> float:
    r"""Mean pressure -tr σ/3, Pa, in plane strain.

    The Cauchy stresses are :math:`G(\lambda^2 - \lambda^{-2})` along the load, 0 across it in the
    plane, and :math:`G(1 - \lambda^{-2})` normal to the plane.

    Args:
        stretch: λ > 0, deformed over undeformed height.
        shear_modulus: Pa, G.
    """
    across = stretch**-2
    return -shear_modulus * (stretch**2 - across + 1.0 - across) / 3.0
