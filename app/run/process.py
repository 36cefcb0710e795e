"""What a process of tribox does before anything else: with signals, its terminal, its parent."""

from __future__ import annotations

import errno
import gc
import io
import os
import signal
import sys
from contextlib import contextmanager

import tribox

# What takes long to import is so where it is needed: until this module is there, a signal ends the
# process as Python would.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from types import FrameType
    from typing import Any, TextIO

PARENT = "TRIBOX_PARENT"
"""Variable of the environment: id of the process of tribox that waits for this one."""
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_PETSC = "PETSC_OPTIONS"
_NO_HANDLER = "-no_signal_handler"
_PR_SET_PDEATHSIG = 1
_GONE = (errno.EPIPE, errno.EIO)
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _MMAP_MAX = -1, -3, -4  # as malloc.h counts them
_LARGE, _USUAL = 4 << 20, 65536  # bytes; number of arrays that glibc maps at most


def begin_process() -> None:
    """Outlive the terminal, but not the process of tribox that has started this one."""
    leave_signals_alone()
    # pydantic would read what every installed package says of itself, in search of plugins.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    sys.stdout = _outliving(sys.stdout)
    sys.stderr = _outliving(sys.stderr)
    parent = os.environ.pop(PARENT, None)
    if parent is not None:
        end_with_parent(signal.SIGTERM)
        if os.getppid() != int(parent):
            os.kill(os.getpid(), signal.SIGTERM)


@contextmanager
def nothing_begun() -> Iterator[None]:
    """Nothing has been begun that a signal could cut short: it ends the process at once.

    In imports, and in what pydantic makes of a case, an exception would become another one.
    """
    ours = [number for number in STOPPING if signal.getsignal(number) is interrupt]
    for number in ours:
        signal.signal(number, leave_at_once)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, interrupt)


@contextmanager
def lasting_imports() -> Iterator[None]:
    """Import what stays to the end: the garbage collector looks through it neither now nor later.

    Imports make a million objects. Looking through them again and again, and once more at the end
    of Python, costs more than all other collections of a run.
    """
    gc.disable()
    try:
        with nothing_begun():
            yield
    finally:
        gc.freeze()
        gc.enable()


def collect_the_rest() -> None:
    """Take apart what a solver has left, and leave the rest to the system as a whole.

    Objects of PETSc are to go before it ends. Those of imports are passed over by this collection,
    and everything is by the one that Python makes after it.
    """
    if "petsc4py" in sys.modules:
        gc.collect()
    gc.freeze()


def interrupt(number: int, frame: FrameType | None) -> None:
    """What Ctrl-C does, for other signals too."""
    raise KeyboardInterrupt


def leave_at_once(number: int, frame: FrameType | None) -> None:
    """End as a signal ends a command that has not begun anything."""
    if is_first_rank():
        os.write(2, b"tribox: interrupted\n")
    os._exit(130)


def obey_signals(handler: Callable[[int, FrameType | None], None] = interrupt) -> None:
    """Set what signals to stop do, but those that were ignored, as by nohup."""
    for number in STOPPING:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, handler)


def ranks_around() -> int:
    """Number of ranks this process was started with, without starting MPI."""
    for name in ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_SIZE"):
        if name in os.environ:
            return int(os.environ[name])
    # Of srun with PMIx a rank learns its own number, and that of all as of any of Slurm's tasks.
    return int(os.environ.get("SLURM_STEP_NUM_TASKS", "1")) if "PMIX_RANK" in os.environ else 1


def is_first_rank() -> bool:
    """Whether this is the first of the ranks, or no rank, without starting MPI."""
    names = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")
    return next((os.environ[name] for name in names if name in os.environ), "0") == "0"


def tribox_command(*words: str, before: Sequence[str] = ()) -> list[str]:
    """The command line of another process of tribox.

    Python looks for no module in the working directory, which may be that of anyone's case.
    """
    return [sys.executable, "-P", *before, "-m", "tribox", *words]


def with_sources(environment: Mapping[str, str]) -> dict[str, str]:
    """An environment in which another process finds this package, wherever it was found."""
    root = os.path.dirname(tribox.__path__[0])
    path = environment.get("PYTHONPATH")
    return {**environment, "PYTHONPATH": f"{root}{os.pathsep}{path}" if path else root}


def leave_signals_alone() -> None:
    """Have PETSc and UCX, when they start, set no handlers of their own.

    PETSc's end the process at SIGPIPE and SIGHUP through ``MPI_Abort``; UCX, below MPI, takes
    SIGHUP for a wish to trace it.
    """
    os.environ.setdefault("UCX_DEBUG_SIGNO", "0")
    before = os.environ.get(_PETSC, "")
    if _NO_HANDLER not in before.split():
        os.environ[_PETSC] = f"{before} {_NO_HANDLER}".strip()


def end_with_parent(number: signal.Signals) -> None:
    """Have the kernel send this process a signal when the thread that started it is gone."""
    import ctypes

    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(number), 0, 0, 0)


def give_memory_back() -> None:
    """Have what is freed go back to the system, after PETSc has been loaded.

    SuperLU_DIST, which PETSc is linked to, forbids glibc to map large arrays by themselves and to
    trim its heap. Then what the first matrices leave lies between later ones, for good.
    """
    import ctypes

    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # missing in other C libraries
    if mallopt is not None:
        mallopt(_MMAP_MAX, _USUAL)
        mallopt(_MMAP_THRESHOLD, _LARGE)
        mallopt(_TRIM_THRESHOLD, _LARGE)


class _Outliving(io.FileIO):
    """A terminal or pipe; once nobody is at its other end, what is written is dropped."""

    def write(self, data: Any, /) -> int:
        """Write what the other end takes."""
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in _GONE:
                raise
        drop_output(self.fileno())
        return len(data)


def drop_output(descriptor: int = 1) -> None:
    """Have all that is written to a descriptor from now on vanish, by libraries too."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)


def end_process() -> None:
    """See that all that was printed is written, else SystemExit; no signal matters from here on."""
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)
    # Python ends by SIGINT, whatever the exit code, if the last text that it ran as code (as
    # dataclasses are made of) was interrupted: have it run another.
    eval("0")
    try:
        sys.stdout.flush()
    except OSError as error:
        from tribox.app.errors import OutputError

        drop_output()
        print(f"tribox: what is printed cannot be written ({error.strerror})", file=sys.stderr)
        sys.exit(OutputError.exit_code)


def _outliving(stream: TextIO) -> TextIO:
    """A stream in the place of standard output or error that outlives its terminal."""
    try:
        raw = _Outliving(stream.fileno(), "w", closefd=False)
    except (AttributeError, OSError, ValueError):
        return stream  # closed from the start, or no file
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream is sys.stderr or stream.isatty(),
    )
