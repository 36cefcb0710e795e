"""Checks of parameters; an error is one line with name, value and the allowed values."""

from __future__ import annotations

import math


def refusal(name: str, value: object, allowed: str) -> ValueError:
    """The error for a value that is not allowed."""
    return ValueError(f"{name} = {value!r} is not allowed: expected {allowed}")


def require_at_least(name: str, value: float, lowest: float) -> None:
    """Check that a number is not below a bound.

    Raises:
        ValueError: The value is not finite, or below ``lowest``.
    """
    if not (math.isfinite(value) and value >= lowest):
        raise refusal(name, value, f"a finite number of at least {lowest:g}")


def require_above(name: str, value: float, bound: float, of: str = "") -> None:
    """Check that a number is above a bound; ``of`` precedes the bound in the message.

    Raises:
        ValueError: The value is not finite, or not above ``bound``.
    """
    if not (math.isfinite(value) and value > bound):
        raise refusal(name, value, f"a finite number above {of}{bound:g}")


def require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Check that a word is one of the choices.

    Raises:
        ValueError: The value is none of ``choices``.
    """
    if value not in choices:
        raise refusal(name, value, " or ".join(repr(choice) for choice in choices))
