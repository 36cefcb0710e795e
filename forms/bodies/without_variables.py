"""UFL expressions without variables."""

from __future__ import annotations

from typing import Any

from ufl.corealg.multifunction import MultiFunction


class WithoutVariables(MultiFunction):
    """Replaces variables by their expressions; UFL's own visits shared parts many times.

    Variables are numbered over the whole process and the number enters FFCx's cache key: with
    them, the same expression would be compiled again in almost every run.
    """

    expr = MultiFunction.reuse_if_untouched

    def variable(self, o: Any, operand: Any, label: Any) -> Any:
        """The expression itself."""
        return operand
