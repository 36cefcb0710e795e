"""Stress and strain measures at material points, from their deformation gradients, in numpy.

The energies are those of the materials, differentiated by UFL and evaluated at all points at once:
nothing is compiled, and every material serves. Axis letters: p points, i, j space; tensors are
always (3, 3), the direction across a plane being the third.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import basix.ufl
import numpy as np
import ufl
from numpy.typing import NDArray
from ufl.algorithms import expand_derivatives

from tribox.forms.bodies.kinematics import Kinematics, PlanePart, Section, plane_kinematics
from tribox.forms.bodies.materials import Material

Floats = NDArray[np.float64]
PIECE = 2048  # points whose stresses are found at once


class StressAt(Protocol):
    """What gives the stress of a body at fixed places of it."""

    def cauchy(self, F: Floats, volumetric: Floats | None = None) -> Floats:
        """Cauchy stress (p, 3, 3), Pa, at the present displacement.

        Args:
            F: (p, 3, 3) deformation gradients there.
            volumetric: (p, 3, 3), those that the volumetric energy is taken at, where they are
                others (selective reduced integration: those at the cells' centres).
        """
        ...

    def plastic_strain(self) -> Floats | None:
        """Equivalent plastic strain (p,); None of a material that does not flow."""
        ...


class PointStress:
    """Cauchy stress of a material from deformation gradients.

    In space W(J, I1, I2) gives J σ = J W_J I + 2 (W_1 + I1 W_2) b − 2 W_2 b². In a plane section,
    with the determinant j and the trace i of C of the in-plane part and the stretch λ across it,
    W(j, i, λ) gives J σ = j W_j I + 2 W_i b in the plane and J σ₃₃ = λ W_λ.
    """

    def __init__(self, material: Material, section: Section) -> None:
        self._space = section == "3D"
        self._constants, variables = free_variables(3)
        k = of_invariants(variables, self._space)
        parts = material.energy(k, dict(material.parameters()))
        self._distortional, self._volumetric = (
            [expand_derivatives(ufl.diff(part, v)) for v in variables] for part in parts
        )

    def cauchy(self, F: Floats, volumetric: Floats | None = None) -> Floats:
        """See :meth:`StressAt.cauchy`."""
        first, second = self._distortional, self._volumetric
        if volumetric is None:
            return self._of([*first, *second], F)
        return self._of(first, F) + self._of(second, volumetric)

    def plastic_strain(self) -> None:
        """None: the material does not flow."""

    def _of(self, slopes: Sequence[Any], F: Floats) -> Floats:
        """Cauchy stress (p, 3, 3) of parts of the energy, from the three slopes of each."""
        pieces = np.split(F, list(range(PIECE, len(F), PIECE)))
        return np.concatenate([self._of_piece(slopes, piece) for piece in pieces])

    def _of_piece(self, slopes: Sequence[Any], F: Floats) -> Floats:
        """The same of few points, as what lies between takes many times the room of F."""
        rows = np.ascontiguousarray(F.transpose(1, 2, 0))  # numpy is several times faster so
        invariants = _space_invariants(rows) if self._space else _plane_invariants(rows)
        found = values_of(slopes, dict(zip(self._constants, invariants, strict=True)))
        w = [sum(found[k::3]) for k in range(3)]
        stress = _space_stress if self._space else _plane_stress
        return stress(w, invariants, rows).transpose(2, 0, 1)


def _space_stress(w: Sequence[Floats | float], invariants: Sequence[Floats], F: Floats) -> Floats:
    """Cauchy stress (3, 3, p) of the slopes W_J, W_1 and W_2 at F (3, 3, p)."""
    J, first, _ = invariants
    b = np.einsum("ikp,jkp->ijp", F, F)
    out = np.asarray(2.0 * (w[1] + first * w[2]) / J * b)
    # Most elastomers have no I2: two products of tensors are then saved.
    if np.any(w[2]):
        out -= 2.0 * w[2] / J * np.einsum("ikp,kjp->ijp", b, b)
    for i in range(3):
        out[i, i] += w[0]
    return out


def _plane_stress(w: Sequence[Floats | float], invariants: Sequence[Floats], F: Floats) -> Floats:
    """Cauchy stress (3, 3, p) of the slopes W_j, W_i and W_λ at F (3, 3, p)."""
    plane, _, across = invariants
    out = np.zeros_like(F)
    out[:2, :2] = 2.0 * w[1] / (plane * across) * np.einsum("ikp,jkp->ijp", F[:2, :2], F[:2, :2])
    for i in range(2):
        out[i, i] += w[0] / across
    out[2, 2] = w[2] / plane
    return out


def free_variables(count: int) -> tuple[list[Any], list[Any]]:
    """Constants that stand for numbers, and UFL variables of them to differentiate an energy by."""
    # A constant belongs to a mesh; that of one interval has no cells that anybody looks at.
    domain = ufl.Mesh(basix.ufl.element("Lagrange", "interval", 1, shape=(1,)))
    constants = [ufl.Constant(domain) for _ in range(count)]
    return constants, [ufl.variable(constant) for constant in constants]


def of_invariants(variables: Sequence[Any], space: bool) -> Kinematics:
    """Kinematics in which the invariants stand for themselves."""
    first, second, third = variables
    if space:
        return Kinematics(F=None, J=first, I1=second, I2=third, plane=None)
    return plane_kinematics(None, PlanePart(stretch=third, J=first, I1=second))


def _space_invariants(F: Floats) -> Sequence[Floats]:
    """J, I1 and I2 (p,) of F (3, 3, p): I2 is the sum of squares of all cofactors."""
    x, y, z = F
    cofactors = np.stack([np.cross(*pair, axis=0) for pair in ((y, z), (z, x), (x, y))])
    return (x * cofactors[0]).sum(axis=0), (F**2).sum(axis=(0, 1)), (cofactors**2).sum(axis=(0, 1))


def _plane_invariants(F: Floats) -> Sequence[Floats]:
    """Determinant and trace of C (p,) of the in-plane part of F (3, 3, p), stretch across it."""
    (a, b), (c, d) = F[:2, :2]
    return a * d - b * c, a**2 + b**2 + c**2 + d**2, F[2, 2]


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
    normal = sum((stress[:, i, i] - stress[:, j, j]) ** 2 for i, j in pairs)
    shear = sum(stress[:, i, j] ** 2 for i, j in pairs)
    return np.asarray(np.sqrt(0.5 * normal + 3.0 * shear))


def triaxiality(stress: Floats) -> Floats:
    """Mean stress over von Mises stress (p,) of stresses (p, 3, 3); 0 where there is none."""
    mises, mean = von_mises(stress), -mean_pressure(stress)
    # Below that the deviator is round-off of a hydrostatic stress, and the ratio is noise.
    some = mises > 1e-12 * np.abs(stress).max(axis=(1, 2), initial=0.0)
    return np.asarray(np.where(some, mean / np.where(some, mises, 1.0), 0.0))


# -- Values of scalar UFL expressions at many points at once, in numpy and without compiling -------


def values_of(expressions: Sequence[Any], arguments: Mapping[Any, Floats]) -> list[Floats | float]:
    """Values of scalar expressions; parts that they share are computed once.

    Args:
        expressions: of ``ufl.Constant``, numbers, scalar functions and conditionals.
        arguments: value (p,) of each constant that occurs.

    Raises:
        NotImplementedError: there is something else in them; the message names it.
    """
    found: dict[int, Any] = {}
    for expression in expressions:
        _evaluate(expression, arguments, found)
    return [found[id(expression)] for expression in expressions]


def _evaluate(expression: Any, arguments: Mapping[Any, Floats], found: dict[int, Any]) -> None:
    """Put the values of an expression and its parts into ``found``, by the parts' identity.

    UFL's own traversal compares parts that look alike, which takes for ever where parts are used
    many times.
    """
    waiting = [expression]
    while waiting:
        part = waiting[-1]
        operands = part.ufl_operands
        missing = [o for o in operands if id(o) not in found]
        waiting += missing
        if not missing:
            waiting.pop()
            if id(part) not in found:
                found[id(part)] = _value(part, arguments, [found[id(o)] for o in operands])


def _value(part: Any, arguments: Mapping[Any, Floats], operands: Sequence[Any]) -> Any:
    if isinstance(part, ufl.Constant):
        return arguments[part]
    if isinstance(part, ufl.constantvalue.ScalarValue | ufl.constantvalue.Zero):
        return float(part)
    name = type(part).__name__
    if name.startswith("Bessel") or name == "Erf":
        from scipy import special  # which few energies want

        return getattr(special, _SPECIAL[name])(*operands)
    if (known := _FUNCTIONS.get(name)) is None:
        raise NotImplementedError(f"no values of {name}")
    return known(*operands)


_SPECIAL = {"Erf": "erf"} | {f"Bessel{kind}": f"{kind.lower()}v" for kind in "IJKY"}
_SLOPING = ("sin", "cos", "tan", "sinh", "cosh", "tanh")
# By the names of UFL's classes.
_FUNCTIONS: dict[str, Any] = {
    **{"Sum": operator.add, "Product": operator.mul, "Division": operator.truediv},
    **{"Power": operator.pow, "Abs": np.abs, "Sqrt": np.sqrt, "Exp": np.exp, "Ln": np.log},
    **{name.capitalize(): getattr(np, name) for name in _SLOPING},
    **{f"A{name}": getattr(np, f"arc{name}") for name in _SLOPING[:3]},
    **{"Atan2": np.arctan2, "MaxValue": np.maximum, "MinValue": np.minimum},
    **{"GT": np.greater, "LT": np.less, "GE": np.greater_equal, "LE": np.less_equal},
    **{"EQ": np.equal, "NE": np.not_equal, "AndCondition": np.logical_and},
    **{"OrCondition": np.logical_or, "NotCondition": np.logical_not, "Conditional": np.where},
    **{"Label": lambda: None, "Variable": lambda value, label: value},
}
