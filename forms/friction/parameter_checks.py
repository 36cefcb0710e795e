"""Refusals of parameters that are not allowed: one line with name, value and what is allowed."""

from __future__ import annotations

import math


def refusal(name: str, value: object, allowed: str) -> ValueError:
    """The error for a value that is not allowed."""
    return ValueError(f"{name} = {value!r} is not allowed: expected {allowed}")


def require_at_least(name: str, value: float, lowest: float) -> None:
    """Refuse a number below a bound.

    Raises:
        ValueError: The value is not finite, or below ``lowest``.
    """
    if not (math.isfinite(value) and value >= lowest):
        raise refusal(name, value, f"a finite number of at least {lowest:g}")


def require_above(name: str, value: float, bound: float, of: str = "") -> None:
    """Refuse a number up to a bound, which may be called something in the message (``of``).

    Raises:
        ValueError: The value is not finite, or not above ``bound``.
    """
    if not (math.isfinite(value) and value > bound):
        raise refusal(name, value, f"a finite number above {of}{bound:g}")


def require_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Refuse a word that is not one of the choices.

    Raises:
        ValueError: The value is none of ``choices``.
    """
    if value not in choices:
        raise refusal(name, value, " or ".join(repr(choice) for choice in choices))
