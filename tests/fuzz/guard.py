"""Watches one input: what it raises, and how long it takes."""

import signal
import traceback
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from tribox.app.errors import TriboxError

SECONDS = 10.0  # of computing that one input may take; a busy machine takes longer for them
WAITING = 20.0  # times as long on the clock: what waits for ever computes nothing
LONGEST = 800  # letters of a message
# Control characters, those that turn the direction of writing, line ends and halves of pairs.
_UNFIT = ("Cc", "Cf", "Zl", "Zp", "Cs")


class OddLine(Exception):
    """A message that is more than a line, or that a terminal would take for a command."""


class Hang(BaseException):
    """One input took too long."""


@contextmanager
def watched(seconds: float = SECONDS) -> Iterator[None]:
    """Watch how long what is done inside computes, s."""
    before = [signal.signal(number, _hang) for number in (signal.SIGPROF, signal.SIGALRM)]
    signal.setitimer(signal.ITIMER_PROF, seconds)
    timer = signal.setitimer(signal.ITIMER_REAL, WAITING * seconds)  # of pytest's own time limit
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)  # before the handlers are another's again
        signal.signal(signal.SIGPROF, before[0])
        signal.signal(signal.SIGALRM, before[1])
        signal.setitimer(signal.ITIMER_REAL, *timer)


def _hang(number: int, frame: FrameType | None) -> None:
    raise Hang("".join(traceback.format_stack(frame)[-6:]))


def outcome(act: Callable[[], object], seconds: float = SECONDS) -> str:
    """What an input comes to: fine, refused: LINE, traceback: ... or hang: ..."""
    try:
        with watched(seconds):
            try:
                act()
            except TriboxError as error:
                return refused(str(error))
            except OddLine as odd:
                return f"message: {odd}"
            except Exception as error:
                return f"traceback: {_last(error)}"
    except Hang as error:
        return f"hang: {error}"
    return "fine"


def refused(line: str) -> str:
    """A refusal, or what is wrong with its line."""
    try:
        see_line(line)
    except OddLine as odd:
        return f"message: {odd}"
    return f"refused: {line}"


def see_line(line: str) -> None:
    """See that a message is one line that a terminal can show and a person can read."""
    bad = sorted({repr(c) for c in line if unicodedata.category(c) in _UNFIT})
    if bad:
        raise OddLine(f"holds {', '.join(bad)}: {line[:200]!r}")
    if len(line) > LONGEST:
        raise OddLine(f"{len(line)} letters: {line[:200]!r}")


def _last(error: Exception) -> str:
    """Kind of error, and the last lines of ours that it came through."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/tests/" not in f.filename] or list(frames)
    places = [f"{'/'.join(f.filename.split('/')[-3:])}:{f.lineno} {f.name}" for f in ours[-3:]]
    return f"{type(error).__name__}: {str(error)[:200]!r} at {' < '.join(reversed(places))}"
