"""Compiles the packages' C sources on first use and keeps the libraries in FFCx's cache.

FFCx needs a C compiler too, so that one is there wherever a case runs.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

from tribox.geometry.compat import compiler_cache

FLAGS = ("-std=gnu11", "-O3", "-fno-math-errno", "-fPIC", "-shared", "-w")
MORE_FLAGS = "TRIBOX_CFLAGS"
"""Variable of the environment: further options of the compiler, of sanitizers, say."""


class KernelError(RuntimeError):
    """A C source could not be compiled, or its library not kept; with the compiler's words."""


def compiled(source: Path) -> ctypes.CDLL:
    """The compiled library of a C source, made if it is not at hand.

    Args:
        source: the file; it may include the headers of its own directory.

    Raises:
        KernelError: it can be neither found nor made.
    """
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
    return (*FLAGS, *os.environ.get(MORE_FLAGS, "").split())


def _trusted(directory: Path) -> bool:
    """Whether a directory is new, or was made by this user or the administrator."""
    return not directory.exists() or directory.stat().st_uid in (0, os.getuid())


def _load(file: Path) -> ctypes.CDLL | None:
    """The library in a file; None where there is no file, or one of another system.

    Raises:
        KernelError: it is in a directory of somebody else's.
    """
    if not _trusted(file.parent):
        raise KernelError(f"{file.parent} belongs to somebody else")
    try:
        return ctypes.CDLL(str(file)) if file.exists() else None
    except OSError:
        return None


def _caches() -> tuple[Path, Path]:
    """Directories for the libraries: FFCx's cache, or one for this user among temporary files."""
    ours = Path(tempfile.gettempdir()) / f"tribox-{os.getuid()}"
    return compiler_cache(), ours


def _made(source: Path, target: Path) -> ctypes.CDLL:
    """Compile ``source`` into ``target``, complete or not at all, and load it.

    Raises:
        KernelError: there is no compiler, it refuses, or ``target`` cannot be written or loaded.
    """
    compiler = next(filter(None, map(shutil.which, (os.environ.get("CC", "cc"), "gcc"))), None)
    if compiler is None:
        raise KernelError("there is no C compiler on the PATH (gcc, or what CC names)")
    try:
        target.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
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

SOURCES = ("closest_points.c",)


@functools.cache
def library(name: str) -> ctypes.CDLL:
    """The compiled library of the source ``name``.

    Args:
        name: file name of a C source in this directory.

    Raises:
        KernelError: it can be neither found nor made.
    """
    return compiled(Path(__file__).with_name(name))
