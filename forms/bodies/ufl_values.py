"""Values of scalar UFL expressions at many points at once, in numpy and without compiling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ufl.corealg.multifunction import MultiFunction

Floats = NDArray[np.float64]


def values_of(expressions: Sequence[Any], arguments: Mapping[Any, Floats]) -> list[Floats | float]:
    """Values of scalar expressions; parts that they share are computed once.

    Args:
        expressions: of ``ufl.Constant``, numbers, arithmetic, roots, logarithms and conditionals.
        arguments: value (p,) of each constant that occurs.

    Raises:
        NotImplementedError: there is something else in them; the message names it.
    """
    rule, found = _Values(arguments), dict[int, Any]()
    for expression in expressions:
        _evaluate(expression, rule, found)
    return [found[id(expression)] for expression in expressions]


def _evaluate(expression: Any, rule: _Values, found: dict[int, Any]) -> None:
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
                found[id(part)] = rule(part, *(found[id(o)] for o in operands))


_FUNCTIONS: dict[str, Any] = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{f"a{name}": getattr(np, f"arc{name}") for name in ("sin", "cos", "tan")},
}


class _Values(MultiFunction):
    """Replaces every node of an expression by its value."""

    def __init__(self, arguments: Mapping[Any, Floats]) -> None:
        super().__init__()
        self._arguments = arguments

    def expr(self, o: Any, *operands: Any) -> Any:
        raise NotImplementedError(f"no values of {type(o).__name__}")

    def constant(self, o: Any) -> Any:
        return self._arguments[o]

    def scalar_value(self, o: Any) -> float:
        return float(o)

    def zero(self, o: Any) -> float:
        return 0.0

    def label(self, o: Any) -> None:
        return None

    def variable(self, o: Any, operand: Any, label: Any) -> Any:
        return operand

    def sum(self, o: Any, a: Any, b: Any) -> Any:
        return a + b

    def product(self, o: Any, a: Any, b: Any) -> Any:
        return a * b

    def division(self, o: Any, a: Any, b: Any) -> Any:
        return a / b

    def power(self, o: Any, a: Any, b: Any) -> Any:
        return a**b

    def abs(self, o: Any, a: Any) -> Any:
        return np.abs(a)

    def sqrt(self, o: Any, a: Any) -> Any:
        return np.sqrt(a)

    def exp(self, o: Any, a: Any) -> Any:
        return np.exp(a)

    def ln(self, o: Any, a: Any) -> Any:
        return np.log(a)

    def math_function(self, o: Any, a: Any) -> Any:
        if (known := _FUNCTIONS.get(o._name)) is None:
            raise NotImplementedError(f"no values of {o._name}")
        return known(a)

    def gt(self, o: Any, a: Any, b: Any) -> Any:
        return np.greater(a, b)

    def lt(self, o: Any, a: Any, b: Any) -> Any:
        return np.less(a, b)

    def ge(self, o: Any, a: Any, b: Any) -> Any:
        return np.greater_equal(a, b)

    def le(self, o: Any, a: Any, b: Any) -> Any:
        return np.less_equal(a, b)

    def conditional(self, o: Any, condition: Any, true: Any, false: Any) -> Any:
        return np.where(condition, true, false)
