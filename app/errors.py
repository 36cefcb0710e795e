"""The exceptions a user can meet, their exit codes, and how lines are told."""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
import unicodedata
from collections.abc import Sequence
from typing import TextIO

LONGEST = 1000  # letters of a message; of a longer one the middle is left out
WIDEST = 100  # columns of a line in a log or on a terminal; longer ones are folded
CONTINUED = "    "  # what the further lines of a folded one begin with
_JOINED = "\ue000"  # stands for a blank at which no line ends
_NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=[%\w/]{1,4}(?:[\s,;:)\"]|$))")
# Control characters, those that turn the direction of writing, line ends and halves of pairs.
_UNFIT = ("Cc", "Cf", "Zl", "Zp", "Cs")


def as_line(text: str) -> str:
    """Text as one line of bounded length that a terminal shows and does not obey.

    What a message quotes comes from files and options of anyone.
    """
    if len(text) > LONGEST:
        text = f"{text[: LONGEST // 2]} [...] {text[-LONGEST // 4 :]}"
    shown = (
        c if unicodedata.category(c) not in _UNFIT else c.encode("unicode_escape").decode()
        for c in text
    )
    return "".join(shown)


def folded(line: str, width: int = WIDEST) -> str:
    """A line as lines of at most ``width`` columns where words allow, all but the first indented.

    Nothing is wider than ``WIDEST``.
    """
    width = max(min(width, WIDEST), 2 * len(CONTINUED))
    if len(line) <= width:
        return line
    lines = textwrap.wrap(
        _NUMBER_AND_UNIT.sub(_JOINED, line),
        width,
        subsequent_indent=CONTINUED,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(lines).replace(_JOINED, " ")


def tell(line: str, stream: TextIO | None = None) -> None:
    """Print a line, folded where it goes to a terminal; elsewhere a message stays one line.

    Args:
        line: what is said.
        stream: where; None: standard output.
    """
    out = stream or sys.stdout
    if out is not None and out.isatty():
        line = folded(line, shutil.get_terminal_size().columns)
    print(line, file=out)


class SaidOnce:
    """Leaves out what has been said: advice of notes and warnings, and notes of several values."""

    def __init__(self) -> None:
        self._clauses: set[str] = set()
        self._lines: set[str] = set()

    def __call__(self, line: str) -> str:
        """A line without the advice at its end that stands in an earlier one.

        Clauses are what stands between semicolons; the first, which says what is found, stays.
        """
        first, *clauses = line.split("; ")
        while clauses and clauses[-1] in self._clauses:
            clauses.pop()
        self._clauses.update(clauses)
        return "; ".join([first, *clauses])

    def is_new(self, line: str) -> bool:
        """Whether a line is no note, or one that has not been said as it is."""
        said = line in self._lines
        if line.startswith("note: "):
            self._lines.add(line)
        return not said


class TriboxError(Exception):
    """Base of all errors that are reported as one line instead of a traceback."""

    exit_code = 1

    def __init__(self, message: str = "") -> None:
        super().__init__(as_line(message))

    @property
    def said(self) -> tuple[str, ...]:
        """The lines that the program prints as it ends."""
        return (str(self),)


class InputError(TriboxError):
    """The case file, an option or a file it names is wrong; nothing was run.

    Attributes:
        lines: all that is wrong; the message is the first and says how many more there are.
    """

    exit_code = 2

    def __init__(self, message: str = "", more: Sequence[str] = (), *, told: bool = False) -> None:
        """Take what is wrong, and what ``more`` is, a line each; all are said if ``told``."""
        note = f" (and {len(more)} more; tribox check lists them)" if more and not told else ""
        super().__init__(message + note)
        self.lines = tuple(map(as_line, (message, *more)))
        self._told = told

    @property
    def said(self) -> tuple[str, ...]:
        """The first of the lines, or all of them."""
        return self.lines if self._told else (str(self),)


class SolutionError(TriboxError):
    """The solver could not go on; the last converged state has been saved."""

    exit_code = 3


class OutputError(TriboxError):
    """Results cannot be written: a full disk, a directory that is gone; what is there is valid."""

    exit_code = 4


class Interrupted(KeyboardInterrupt):
    """A signal has stopped a run between two steps, on all ranks, and its state has been saved.

    Any other ``KeyboardInterrupt`` comes at once, on this rank alone: nothing collective may
    follow.
    """
