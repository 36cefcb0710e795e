"""What is asked of ``tribox run``; starts ranks by mpirun, and sees that signals reach them."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import NoReturn, Self

from tribox.app.errors import InputError, OutputError, SolutionError, TriboxError, as_line, tell
from tribox.app.results.claim import is_beginning
from tribox.app.results.directory import checkpoint_numbers
from tribox.app.run.process import (
    STOPPING,
    end_with_parent,
    is_first_rank,
    ranks_around,
    tribox_command,
    with_sources,
)


@dataclass(frozen=True, slots=True)
class RunOptions:
    """The options of ``tribox run``."""

    out: Path | None = None  # results directory; None: by the name of the case
    overrides: Sequence[str] = ()  # "KEY=VALUE" texts that change the case
    ranks: int = 1  # MPI ranks to run on
    force: bool = False  # replace results that are there
    jobs: int | None = None  # runs of a sweep at a time; None: as many as the cores allow
    part: int | None = None  # the only value of the sweep that is run, counted from 0; None: all
    trust: bool = False  # run the Python that the case names
    resume: bool = False  # go on from the last checkpoint
    extend: bool = False  # the same, and past the end
    # results directory of the sweep, whose copies of mesh and laws are linked
    inputs_of: Path | None = None

    @property
    def goes_on(self) -> bool:
        """Whether a run or sweep that is there goes on."""
        return self.resume or self.extend

    def how(self, directory: Path) -> dict[str, bool]:
        """How the value of a sweep in a directory goes on: one that never got far, anew."""
        begun = checkpoint_numbers(directory) and not is_beginning(directory)
        extend = self.extend and bool(begun)
        return {"resume": self.goes_on and not extend, "extend": extend}

    def for_ranks(self) -> list[str]:
        """Words of the command line that each rank of one case gets too."""
        flags = {"--force": self.force, "--resume": self.resume, "--extend": self.extend}
        named = {"--part": self.part, "--inputs-of": self.inputs_of}
        words = [name for name, given in flags.items() if given]
        return words + [str(w) for n, v in named.items() if v is not None for w in (n, v)]


# -- Signals to a process that waits for others: passed on to them, and waited for -----------------

SAID = "finishing the step at hand; Ctrl-C, or the same signal again, stops at once"
Handler = Callable[[int, FrameType | None], None]


def say_stopping() -> None:
    """Say on standard error that the step at hand is being finished; for handlers of signals.

    These come in the middle of anything, also of a write to a buffered stream.
    """
    with contextlib.suppress(OSError):
        start = "\n" if os.isatty(2) else ""  # below what a terminal shows of Ctrl-C
        os.write(2, f"{start}tribox: {SAID}\n".encode())


def stopping_signals() -> tuple[signal.Signals, ...]:
    """Signals that stop a run: not SIGHUP where it was ignored from the start, as by nohup.

    SIGUSR1 does so too, by which mpirun tells its ranks.
    """
    ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return tuple(n for n in (*STOPPING, signal.SIGUSR1) if n != signal.SIGHUP or not ignored)


def taken(handlers: Mapping[signal.Signals, Handler]) -> dict[signal.Signals, signal._HANDLER]:
    """Set handlers of signals, and return those before; in the main thread only.

    In another one nothing is set: its owner decides what stops it.
    """
    if threading.current_thread() is not threading.main_thread():
        return {}
    return {number: signal.signal(number, handler) for number, handler in handlers.items()}


def give_back(before: Mapping[signal.Signals, signal._HANDLER]) -> None:
    """Set the handlers that :func:`taken` returned."""
    for number, handler in before.items():
        signal.signal(number, signal.SIG_DFL if handler is None else handler)


def repeats(first: int) -> tuple[int, int]:
    """Signals that, after a first one to stop, are a second one.

    Not any other: engines of containers whose terminal has gone send SIGHUP, and SIGTERM after it.
    But mpirun, which passes on one SIGUSR1 once or twice, ends its ranks by SIGTERM.
    """
    return signal.SIGTERM if first == signal.SIGUSR1 else first, signal.SIGINT


class Forwarding:
    """Context in which signals to stop go to child processes, and none ends this one.

    The children have process groups of their own; ``asked``: how many such signals have come.
    """

    def __init__(self, first: signal.Signals, further: signal.Signals) -> None:
        self.asked = 0
        self._first: int | None = None
        self._sent = (first, further)
        self._telling = threading.RLock()  # a handler may come in the middle of another
        self._children: dict[subprocess.Popen[str], int] = {}
        self._before: dict[signal.Signals, signal._HANDLER] = {}

    def __enter__(self) -> Self:
        """Take the signals."""
        self._before = taken(dict.fromkeys(stopping_signals(), self._stop))
        self._before |= taken({signal.SIGTSTP: self._pause})
        return self

    def __exit__(self, *error: object) -> None:
        """Give the signals back."""
        give_back(self._before)

    def add(self, child: subprocess.Popen[str]) -> None:
        """Pass signals on to this child from now on, and one that has come before."""
        self._children[child] = 0
        self._tell()

    def remove(self, child: subprocess.Popen[str]) -> None:
        """This child has ended."""
        del self._children[child]

    def _stop(self, number: int, frame: FrameType | None) -> None:
        if self._first is None:
            self._first, self.asked = number, 1
            say_stopping()
        elif number in repeats(self._first):
            self.asked += 1
        self._tell()

    def _tell(self) -> None:
        """Send every child what it has not been sent yet."""
        with self._telling:
            for child, told in list(self._children.items()):
                if told < self.asked:
                    self._children[child] = self.asked
                    child.send_signal(self._sent[self.asked > 1])

    def _pause(self, number: int, frame: FrameType | None) -> None:
        """Ctrl-Z: stop with the children, and go on with them."""
        for child in list(self._children):
            child.send_signal(signal.SIGTSTP)
        os.kill(os.getpid(), signal.SIGSTOP)
        for child in list(self._children):
            child.send_signal(signal.SIGCONT)


# -- ``tribox run --np N``: starts the ranks by mpirun, and sees that signals reach them -----------

EXIT_CODE = "TRIBOX_EXIT_CODE"
"""Variable of the environment: file into which the first rank writes the exit code of all.

mpirun prints a page wherever a rank ends with another code than 0.
"""
INTERRUPTED = 130


def run_on_ranks(count: int, arguments: Sequence[str]) -> int:
    """Run tribox on ranks and wait for them; the exit code; InputError without mpirun.

    mpirun, told to end, kills its ranks after a quarter of a second. So signals to stop go to the
    ranks themselves, by SIGUSR1, which mpirun passes on; these finish their step.
    """
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        raise InputError(f"--np {count}: there is no mpirun here")
    python = tribox_command(*arguments, before=("-m", "mpi4py"))
    command = [mpirun, "-n", str(count), *python]
    with tempfile.TemporaryDirectory(prefix="tribox-") as place:
        told = Path(place) / "exit-code"
        code, asked = _supervise(command, told)
        if told.exists():
            return int(told.read_text(encoding="ascii"))
    return INTERRUPTED if asked else code


def tell_exit_code(code: int) -> bool:
    """Tell who waits for these ranks what to end with; whether there is one: then end with 0."""
    if EXIT_CODE not in os.environ:
        return False
    try:
        Path(os.environ[EXIT_CODE]).write_text(f"{code}", encoding="ascii")
    except OSError:
        return False  # mpirun tells it, on a page
    return True


def _supervise(command: Sequence[str], told: Path) -> tuple[int, bool]:
    """Exit code of mpirun, and whether it was asked to stop."""
    # Open MPI refuses more ranks than cores otherwise, with a page of advice.
    oversubscribed = {"PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe"}
    environment = with_sources(oversubscribed | dict(os.environ))
    with Forwarding(signal.SIGUSR1, signal.SIGTERM) as forwarding:
        process = subprocess.Popen(
            command,
            env=environment | {EXIT_CODE: str(told)},
            stdin=subprocess.DEVNULL,
            text=True,
            process_group=0,
            preexec_fn=lambda: end_with_parent(signal.SIGUSR1),
        )
        forwarding.add(process)
        code = process.wait()
    return code, forwarding.asked > 0


# -- Where compiled forms are kept, if the usual place cannot be written ---------------------------

VARIABLE = "XDG_CACHE_HOME"


def ensure_cache() -> None:
    """See that the cache of DOLFINx and matplotlib can be written, before either is imported.

    Where it cannot (a read-only file system, another's home), the variable that both go by is set
    to a directory of this user's own among temporary files; ranks and runs of a sweep inherit it.

    Raises:
        InputError: that directory is not this user's alone.
    """
    usual = Path(os.environ.get(VARIABLE) or os.path.expanduser("~/.cache"))
    if usual.is_absolute() and _writable(usual):
        return
    ours = Path(tempfile.gettempdir()) / f"tribox-{os.getuid()}"
    if not _made_for_us(ours):
        raise InputError(
            f"{usual}: cannot be written, and {ours} is not yours alone; compiled forms need a "
            f"directory, named by {VARIABLE}"
        )
    os.environ[VARIABLE] = str(ours)
    if is_first_rank():
        print(f"note: {usual} cannot be written: compiled forms go to {ours}", file=sys.stderr)


def _writable(directory: Path) -> bool:
    """Whether files can be made in a directory, or it can be made itself."""
    for place in (directory, *directory.parents):
        if os.path.lexists(place):
            return place.is_dir() and os.access(place, os.W_OK | os.X_OK)
    return False


def _made_for_us(directory: Path) -> bool:
    """Make a directory that only this user writes; False where it is another's, or a link."""
    try:
        directory.mkdir(mode=0o700, exist_ok=True)
        found = directory.lstat()
    except OSError:
        return False
    others = stat.S_IWGRP | stat.S_IWOTH
    return (
        stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & others
    )


# -- How a process ends: one line, an exit code, and no rank that waits for another ----------------

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
_NO_WAY = (errno.ENAMETOOLONG, errno.EACCES, errno.EPERM)  # to a file, for this user


def end_with(error: Exception) -> NoReturn:
    """End the program for an error: with a line if it is one of ours, else with its traceback."""
    if isinstance(error, TriboxError):
        together = isinstance(error, SolutionError | OutputError)
        _leave(error.said, error.exit_code, together)
    if isinstance(error, OSError) and error.errno in _FULL:
        where = error.filename or "what is printed"
        _say_once(f"{where}: cannot be written ({error.strerror})")
        _abort(OutputError.exit_code)
    if isinstance(error, OSError) and error.filename and error.errno in _NO_WAY:
        _say_once(f"{as_line(str(error.filename))}: {error.strerror}")
        _abort(InputError.exit_code)
    if isinstance(error, RuntimeError) and (line := _of_a_kernel(error)):
        print(f"tribox: {as_line(line)}", file=sys.stderr)  # it may be this rank's alone
        _abort(1)
    if ranks_around() == 1:
        raise error
    traceback.print_exception(error)
    _abort(1)


def _of_a_kernel(error: RuntimeError) -> str:
    """What kept a C source from being compiled; "" where that is not what went wrong."""
    from tribox.geometry.native.compiler import KernelError

    return str(error) if isinstance(error, KernelError) else ""


def end_interrupted(together: bool) -> NoReturn:
    """End the program after a signal."""
    if together:
        _leave(["interrupted; the results so far are saved"], INTERRUPTED, True)
    _say_once("interrupted")
    _abort(INTERRUPTED)


def _leave(lines: Sequence[str], code: int, together: bool) -> NoReturn:
    """End with lines and a code; ``together`` if all ranks do so here."""
    for line in lines:
        _say_once(line)
    sys.exit(0 if together and tell_exit_code(code) else code)


def _abort(code: int) -> NoReturn:
    """End this process, and with it ranks that would wait for it for ever."""
    if ranks_around() > 1:
        from mpi4py import MPI

        sys.stderr.flush()
        MPI.COMM_WORLD.Abort(code)
    sys.exit(code)


def _say_once(line: str) -> None:
    """Print a line to standard error, on the first rank only."""
    if is_first_rank():
        tell(f"tribox: {line}", sys.stderr)
