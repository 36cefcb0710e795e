"""Strain energies of the user's own at points: functions of the invariants in UFL, in numpy.

They are differentiated by UFL and evaluated at all points at once; nothing is compiled. Energies
that the C sources know have kernels (:mod:`tribox.forms.bodies.point_stress`).

Axis letters: n points, p components of F and P, a, b invariants: J, I1, I2 in space, of the plane J
and I1 in it and the stretch across it.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import basix.ufl
import numpy as np
import ufl
from numpy.typing import NDArray
from ufl.algorithms import expand_derivatives

from tribox.forms.bodies.kinematics import Kinematics
from tribox.forms.bodies.materials import OwnEnergy

Floats = NDArray[np.float64]
TURNED = np.array([[0.0, 0, 0, 1], [0, 0, -1, 0], [0, -1, 0, 0], [1, 0, 0, 0]])  # ∂²det/∂F²
PAIRS = [(a, b) for a in range(3) for b in range(a, 3)]


class InvariantEnergy:
    """Parts of an energy and their derivatives, by the chain rule over the invariants.

    P = W_a g_a and A = W_ab g_a ⊗ g_b + W_a ∂g_a/∂F with g_a = ∂I_a/∂F.
    """

    def __init__(self, material: OwnEnergy, parts: slice, space: bool) -> None:
        """Differentiate the sum of some ``parts``; ``space``: by 9 components of F, else by 5."""
        self._space = space
        self._constants, self._variables = free_variables(3)
        k = Kinematics(*self._variables)
        if not space:
            # Eigenvalues of C: those of the in-plane part, with product J₂², and λ².
            J, trace, stretch = self._variables
            second = trace * stretch**2 + J**2
            k = Kinematics(J * stretch, trace + stretch**2, second)
        energy = sum(material.energy(k, dict(material.parameters()))[parts])
        self._slopes = [ufl.diff(energy, v) for v in self._variables]
        self._first = [expand_derivatives(e) for e in (energy, *self._slopes)]

    @property
    def vanishes(self) -> bool:
        """Whether nothing depends on the deformation."""
        return all(isinstance(slope, ufl.constantvalue.Zero) for slope in self._first[1:])

    @cached_property
    def _second(self) -> list[Any]:
        pairs = [ufl.diff(self._slopes[a], self._variables[b]) for a, b in PAIRS]
        return [expand_derivatives(e) for e in pairs]

    def __call__(self, F: Floats, tangent: bool = False) -> tuple[Floats, Floats, Floats | None]:
        """Energy (n,), J/m³, P, A (n, p, p), Pa; NaN where J ≤ 0; or NotImplementedError."""
        with np.errstate(all="ignore"):
            return self._derivatives(F, tangent)

    def _derivatives(self, F: Floats, tangent: bool) -> tuple[Floats, Floats, Floats | None]:
        values, g = self._invariants(F)
        given = dict(zip(self._constants, values, strict=True))
        size = len(F)
        W, *slopes = (np.broadcast_to(v, size) for v in values_of(self._first, given))
        P = np.einsum("an,anp->np", slopes, g)
        if not tangent:
            return W, P, None
        second = [np.broadcast_to(v, size) for v in values_of(self._second, given)]
        A = sum(w[:, None, None] * H for w, H in zip(slopes, self._curvatures(F), strict=True))
        for (a, b), w in zip(PAIRS, second, strict=True):
            outer = g[a][:, :, None] * g[b][:, None, :]
            both = outer if a == b else outer + outer.transpose(0, 2, 1)
            A = A + w[:, None, None] * both
        return W, P, np.asarray(A)

    def _invariants(self, F: Floats) -> tuple[Sequence[Floats], Floats]:
        """The three invariants (n,), and their derivatives (a, n, p); NaN where J ≤ 0."""
        if self._space:
            f = F.reshape(-1, 3, 3)
            # ∂J/∂F is the cofactor matrix, its rows the cross products of the two other rows of F.
            cofactors = np.stack([np.cross(f[:, i - 2], f[:, i - 1]) for i in range(3)], axis=1)
            J, first = np.einsum("ni,ni->n", f[:, 0], cofactors[:, 0]), (f**2).sum(axis=(1, 2))
            slope = 2.0 * (first[:, None, None] * f - f @ f.transpose(0, 2, 1) @ f)
            g = np.stack([cofactors, 2.0 * f, slope]).reshape(3, -1, 9)
            return [np.where(J > 0.0, J, np.nan), first, (cofactors**2).sum(axis=(1, 2))], g
        flat, across = F[:, :4], F[:, 4]
        # det of the plane part is the quadratic form ½ F·T·F, T of zeros and ±1: its slope is T F,
        # its curvature T.
        turned = flat @ TURNED
        g = np.zeros((3, len(F), 5))
        g[0, :, :4], g[1, :, :4], g[2, :, 4] = turned, 2.0 * flat, 1.0
        J = 0.5 * (flat * turned).sum(axis=1)
        good = (J > 0.0) & (across > 0.0)
        return [np.where(good, J, np.nan), (flat**2).sum(axis=1), across], g

    def _curvatures(self, F: Floats) -> Sequence[Floats]:
        """Second derivatives (n, p, p) or (p, p) of the invariants by F."""
        if not self._space:
            flat = np.zeros((2, 5, 5))
            flat[0, :4, :4], flat[1, :4, :4] = TURNED, 2.0 * np.eye(4)
            return [flat[0], flat[1], np.zeros((5, 5))]
        f, one = F.reshape(-1, 3, 3), np.eye(3)
        # ∂²J/∂F_iJ ∂F_kL = ε_ikm ε_JLM F_mM.
        alternating = np.zeros((3, 3, 3))
        for i in range(3):
            alternating[i, i - 2, i - 1], alternating[i, i - 1, i - 2] = 1.0, -1.0
        volume = np.einsum("ikm,JLM,nmM->niJkL", alternating, alternating, f)
        C, b = f.transpose(0, 2, 1) @ f, f @ f.transpose(0, 2, 1)
        first = (f**2).sum(axis=(1, 2))
        # I2 = ½ ((tr C)² − tr C²): ∂²I2/∂F_iJ ∂F_kL = 4 F_iJ F_kL + 2 I1 δ_ik δ_JL − 2 (F_iL F_kJ +
        # δ_ik C_LJ + b_ik δ_JL).
        second = 4.0 * np.einsum("niJ,nkL->niJkL", f, f) - 2.0 * np.einsum("niL,nkJ->niJkL", f, f)
        second += 2.0 * np.einsum("n,ik,JL->niJkL", first, one, one)
        second -= 2.0 * np.einsum("ik,nLJ->niJkL", one, C)
        second -= 2.0 * np.einsum("nik,JL->niJkL", b, one)
        return [volume.reshape(-1, 9, 9), 2.0 * np.eye(9), second.reshape(-1, 9, 9)]


def at_rest(material: OwnEnergy) -> tuple[float, float, float]:
    """Stress, shear modulus and bulk modulus, Pa, of the undeformed material, from its energy.

    The second derivatives by logarithmic stretches, λ_a λ_b A_ab + δ_ab λ_a P_a, are K + 4G/3 for
    one and K - 2G/3 for two; NotImplementedError of unknown functions.
    """
    _, P, A = InvariantEnergy(material, slice(None), space=True)(np.eye(3).reshape(1, 9), True)
    assert A is not None
    stress, same, other = float(P[0, 0]), float(A[0, 0, 0] + P[0, 0]), float(A[0, 0, 4])
    return stress, 0.5 * (same - other), (same + 2.0 * other) / 3.0


# -- Values of scalar UFL expressions at many points at once ---------------------------------------


def free_variables(count: int) -> tuple[list[Any], list[Any]]:
    """Constants that stand for numbers, and UFL variables of them to differentiate an energy by."""
    # A constant belongs to a mesh; that of one interval has no cells that anybody looks at.
    domain = ufl.Mesh(basix.ufl.element("Lagrange", "interval", 1, shape=(1,)))
    constants = [ufl.Constant(domain) for _ in range(count)]
    return constants, [ufl.variable(constant) for constant in constants]


def values_of(expressions: Sequence[Any], arguments: Mapping[Any, Floats]) -> list[Floats | float]:
    """Values of UFL's scalars, of constants that ``arguments`` (p,) give; shared parts once.

    NotImplementedError names what else is in them.
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
    **{"Label": lambda: None, "Variable": lambda value, label: value, "Real": operator.pos},
}
