"""Compiles the packages' C sources on first use and keeps the libraries in FFCx's cache.

FFCx needs a C compiler too, so that one is there wherever a case runs. A library is made for the
level of the processor's instructions, which its name tells by its key: code for all levels at once
takes three times as long to compile. Of processes that want one library, the first makes it.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

FLAGS = ("-std=gnu11", "-O3", "-fno-math-errno", "-fPIC", "-shared", "-w")
_THIRD = frozenset("avx avx2 bmi1 bmi2 f16c fma abm movbe xsave".split())
LEVELS = {
    "x86-64-v4": _THIRD | frozenset("avx512f avx512bw avx512cd avx512dq avx512vl".split()),
    "x86-64-v3": _THIRD,
}
"""What a processor must have for a level of the x86-64 instructions, as Linux names it."""
MORE_FLAGS = "TRIBOX_CFLAGS"
"""Variable of the environment: further options of the compiler, of sanitizers, say."""


class KernelError(RuntimeError):
    """A C source could not be compiled, or its library not kept; with the compiler's words."""


def compiled(source: Path) -> ctypes.CDLL:
    """The compiled library of a C source; KernelError if it is neither there nor can be made."""
    key = hashlib.sha256(source.read_bytes())
    for header in sorted(source.parent.glob("*.h")):
        key.update(header.read_bytes())
    key.update(" ".join((*_flags(), platform.machine())).encode())
    file = f"libtribox_{source.stem}_{key.hexdigest()[:24]}.so"
    reasons = []
    for directory in _caches():
        try:
            return _load(directory / file) or _made(source, directory / file)
        except KernelError as error:
            reasons.append(str(error))
    raise KernelError(f"{source.name} cannot be compiled: {'; '.join(dict.fromkeys(reasons))}")


def _flags() -> tuple[str, ...]:
    return (*FLAGS, *_level(), *os.environ.get(MORE_FLAGS, "").split())


@functools.cache
def _level() -> tuple[str, ...]:
    """The option for the instructions of this processor; none where they are not known."""
    if platform.machine() != "x86_64":
        return ()
    try:
        lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    except OSError:
        return ()
    return level_of(next((line for line in lines if line.startswith("flags")), ""))


def level_of(flags: str) -> tuple[str, ...]:
    """The compiler's option for an x86 processor, from its line ``flags`` of /proc/cpuinfo."""
    has = set(flags.split())
    for level, needed in LEVELS.items():
        if needed <= has:
            return (f"-march={level}",)
    return ()


def _load(file: Path) -> ctypes.CDLL | None:
    """The library in a file; None where there is no file, or one of another system."""
    # Made by this user or the administrator, if it is there.
    if file.parent.exists() and file.parent.stat().st_uid not in (0, os.getuid()):
        raise KernelError(f"{file.parent} belongs to somebody else")
    try:
        return ctypes.CDLL(str(file)) if file.exists() else None
    except OSError:
        return None


def _caches() -> tuple[Path, Path]:
    """Directories for the libraries: FFCx's cache, or one for this user among temporary files."""
    from tribox.geometry.compat import compiler_cache  # which loads the solver

    ours = Path(tempfile.gettempdir()) / f"tribox-{os.getuid()}"
    return compiler_cache(), ours


@contextlib.contextmanager
def _alone(target: Path) -> Iterator[None]:
    """Waits until no other process makes ``target``; where files know no locks, both make it."""
    lock = target.with_suffix(".lock")
    with lock.open("w") as file:
        with contextlib.suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX)
        try:
            yield
        finally:
            lock.unlink(missing_ok=True)


def _made(source: Path, target: Path) -> ctypes.CDLL:
    """Compile ``source`` into ``target``, complete or not at all, and load it."""
    compiler = next(filter(None, map(shutil.which, (os.environ.get("CC", "cc"), "gcc"))), None)
    if compiler is None:
        raise KernelError("there is no C compiler on the PATH (gcc, or what CC names)")
    try:
        target.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with _alone(target), tempfile.TemporaryDirectory(dir=target.parent) as scratch:
            if (loaded := _load(target)) is not None:  # made by whom this one waited for
                return loaded
            made = Path(scratch) / target.name
            done = subprocess.run(
                [compiler, *_flags(), "-o", str(made), str(source), "-lm"],
                capture_output=True,
                check=False,
                text=True,
                errors="replace",
            )
            if done.returncode != 0:
                said = done.stderr.strip() or f"nothing, and ends with code {done.returncode}"
                raise KernelError(f"{compiler} says: {said}")
            made.chmod(0o755)
            made.replace(target)
    except OSError as error:
        raise KernelError(f"{target.parent}: {error.strerror}") from None
    if (loaded := _load(target)) is None:
        raise KernelError(f"{target} cannot be loaded")
    return loaded


# -- The libraries of this directory's C sources ---------------------------------------------------

SOURCES = ("closest_points.c", "polyline.c")


@functools.cache
def library(name: str) -> ctypes.CDLL:
    """The compiled library of the source ``name``; KernelError if it cannot be made."""
    return compiled(Path(__file__).with_name(name))


# -- What the functions of a library are given -----------------------------------------------------


def packed(array: Any, kind: Any = np.float64) -> Any:
    """An array as loops read it, copied only where it is not; None stays None."""
    return None if array is None else np.ascontiguousarray(array, dtype=kind)


def start_of(array: Any) -> ctypes.c_void_p:
    """Where an array begins, which the caller keeps alive; None is nowhere."""
    return ctypes.c_void_p(None if array is None else array.__array_interface__["data"][0])


def require_size(theirs: int, ours: type[ctypes.Structure], source: str) -> None:
    """See that a structure is as large as its source's; RuntimeError if not: fields would shift."""
    if theirs != ctypes.sizeof(ours):
        raise RuntimeError(
            f"{source}: its structure {ours.__name__.strip('_')} takes {theirs} bytes, the one of "
            f"{ours.__module__} {ctypes.sizeof(ours)}; both must list the same fields in one order"
        )
