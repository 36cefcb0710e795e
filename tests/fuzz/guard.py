"""Watches one input: what it raises, how long it takes, how much memory, and where it writes."""

import os
import resource
import signal
import sys
import tempfile
import traceback
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from tribox.app.errors import TriboxError

SECONDS = 10.0  # of computing that one input may take; a busy machine takes longer for them
WAITING = 20.0  # times as long on the clock: what waits for ever computes nothing
MEMORY = 2 << 30  # bytes that one input may take beside what there is
LONGEST = 800  # letters of a message
# Control characters, those that turn the direction of writing, line ends and halves of pairs.
_UNFIT = ("Cc", "Cf", "Zl", "Zp", "Cs")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
# Events of Python's audit hooks by which files come and go, and which arguments are paths.
_CHANGES = {
    **dict.fromkeys(("os.mkdir", "os.remove", "os.rmdir", "os.truncate", "os.chmod"), (0,)),
    **dict.fromkeys(("os.rename", "os.link", "shutil.move", "shutil.copyfile"), (1,)),
    **dict.fromkeys(("os.symlink",), (1,)),
    "shutil.rmtree": (0,),
}


_BELOW = ("os.remove", "os.rmdir")


class OddLine(Exception):
    """A message that is more than a line, or that a terminal would take for a command."""


class Hang(BaseException):
    """One input took too long."""


@dataclass
class Watch:
    """Directories that an input may write, what it wrote elsewhere, whether it is watched."""

    allowed: tuple[str, ...] = ()
    outside: list[str] = field(default_factory=list)
    active: bool = False

    def see(self, event: str, arguments: tuple[Any, ...]) -> None:
        """One event of Python's audit hooks."""
        if not self.active:
            return
        if event == "open":
            path, mode, flags = (*arguments, None, None, None)[:3]
            writes = any(c in mode for c in "wax+") if mode else bool((flags or 0) & _WRITING)
            if writes:
                self._note(event, path)
        for index in _CHANGES.get(event, ()):
            if event in _BELOW and arguments[-1] != -1:
                continue  # below a directory that is open: one of shutil.rmtree, which is noted
            self._note(event, arguments[index])

    def _note(self, event: str, path: Any) -> None:
        if isinstance(path, int):  # A descriptor, which was seen when it was opened.
            return
        above, name = os.path.split(os.path.abspath(os.fsdecode(path)))
        full = f"{os.path.realpath(above)}/{name}"
        if full == "/dev/null" or "__pycache__" in full:
            return
        if full.startswith(f"{tempfile.gettempdir()}/tmp"):  # what tempfile makes is called so
            return
        if not any(f"{full}/".startswith(f"{top}/") for top in self.allowed):
            self.outside.append(f"{event} {full[:200]}")


_WATCH = Watch()
_HOOKED: list[bool] = []


@contextmanager
def watched(*allowed: Path, seconds: float = SECONDS) -> Iterator[None]:
    """Watch what is done inside: what is written elsewhere, and how long it computes, s."""
    if not _HOOKED:
        _HOOKED.append(True)
        sys.addaudithook(_WATCH.see)
    caches = [os.environ.get(name) for name in ("XDG_CACHE_HOME", "MPLCONFIGDIR")]
    homes = [os.path.expanduser(f"~/{name}") for name in (".cache", ".config/matplotlib")]
    places = [*map(str, allowed), *(cache for cache in caches if cache), *homes]
    _WATCH.allowed = tuple(os.path.realpath(place) for place in places)
    _WATCH.outside = []
    before = [signal.signal(number, _hang) for number in (signal.SIGPROF, signal.SIGALRM)]
    _WATCH.active = True
    signal.setitimer(signal.ITIMER_PROF, seconds)
    timer = signal.setitimer(signal.ITIMER_REAL, WAITING * seconds)  # of pytest's own time limit
    limits = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_size() + MEMORY, limits[1]))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)  # before the handlers are another's again
        resource.setrlimit(resource.RLIMIT_AS, limits)
        _WATCH.active = False
        signal.signal(signal.SIGPROF, before[0])
        signal.signal(signal.SIGALRM, before[1])
        signal.setitimer(signal.ITIMER_REAL, *timer)
    assert not _WATCH.outside, f"written outside: {_WATCH.outside}"


def _size() -> int:
    """Address space of this process, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def _hang(number: int, frame: FrameType | None) -> None:
    raise Hang("".join(traceback.format_stack(frame)[-6:]))


def outcome(act: Callable[[], object], *allowed: Path, seconds: float = SECONDS) -> str:
    """What an input comes to: fine, refused: LINE, traceback: ..., hang: ... or outside: ..."""
    try:
        with watched(*allowed, seconds=seconds):
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
    except AssertionError as error:
        return f"outside: {error}"
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
