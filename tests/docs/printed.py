"""Whether a page shows what its block prints: numbers to the digits shown, "..." for anything."""

import re
from collections.abc import Callable, Sequence
from functools import lru_cache

_NUMBER = r"(?<![\w.])[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?(?!\w)"
_TOKEN = re.compile(rf"\.\.\.|…|{_NUMBER}|\w+|[^\w\s]")
_IS_NUMBER = re.compile(_NUMBER)
# What rounding decides, and with it the processor: iterations, and how closely they end.
_OF_ROUNDING = re.compile(
    r"Newton \d+|\d+ Newton iterations|after \d+ iterations|residual [\d.e+-]+\d"
)
_ELISION = ("...", "…")
_NEARLY = 1e-4  # relative, of numbers shown with more digits than a solver is exact to


def difference(shown: str, printed: str, differs: str = "") -> str | None:
    """What differs between a text block and the output; None if nothing does.

    Args:
        shown: the block; a line "..." stands for any lines, "..." in a line for any words.
        printed: the output.
        differs: pieces of the block, between semicolons, whose numbers are of another machine.
    """
    want, have = (_lines(text) for text in (_elided(shown, differs), printed))
    if _match(want, have, lambda line: line.strip() in _ELISION, _same_line):
        return None
    missing = [line for line in want if not any(_same_line(line, other) for other in have)]
    which = f"not printed: {missing[0].strip()!r}" if missing else "other lines are printed too"
    return f"{which}\nprinted is:\n{printed}"


def _elided(shown: str, differs: str) -> str:
    """The block with "..." for the numbers of rounding, and of the pieces that may differ."""
    for piece in filter(None, (part.strip() for part in differs.split(";"))):
        if piece not in shown:
            raise AssertionError(f"differs: {piece!r} is not in the text")
        shown = shown.replace(piece, _IS_NUMBER.sub("...", piece))
    return _OF_ROUNDING.sub(lambda piece: _IS_NUMBER.sub("...", piece.group()), shown)


def _lines(text: str) -> list[str]:
    return [line.rstrip() for line in text.splitlines() if line.strip()]


@lru_cache(maxsize=4096)
def _tokens(line: str) -> tuple[str, ...]:
    return tuple(_TOKEN.findall(line))


def _same_line(shown: str, printed: str) -> bool:
    return _match(_tokens(shown), _tokens(printed), _ELISION.__contains__, _same_token)


def _same_token(shown: str, printed: str) -> bool:
    if shown == printed:
        return True
    if not (_IS_NUMBER.fullmatch(shown) and _IS_NUMBER.fullmatch(printed)):
        return False
    digit = _last_digit(shown)
    if digit is None:
        return False  # a count
    wanted = float(shown)
    return abs(float(printed) - wanted) <= max(1.01 * digit, _NEARLY * abs(wanted))


def _last_digit(number: str) -> float | None:
    """What one more in the last digit shown is worth; None of a number without a point."""
    mantissa, _, exponent = number.lower().partition("e")
    _, point, decimals = mantissa.partition(".")
    if not point and not exponent:
        return None
    return float(10.0 ** (int(exponent or 0) - len(decimals)))


def _match(
    want: Sequence[str],
    have: Sequence[str],
    wild: Callable[[str], bool],
    same: Callable[[str, str], bool],
) -> bool:
    """Whether two sequences are the same, where an entry that is wild stands for any number."""
    reached = {0}  # how much of `have` what has been seen of `want` may have taken
    for entry in want:
        if wild(entry):
            reached = set(range(min(reached), len(have) + 1))
        else:
            reached = {n + 1 for n in reached if n < len(have) and same(entry, have[n])}
        if not reached:
            return False
    return len(have) in reached
