"""Compiles the packages' C sources on first use and keeps the libraries in FFCx's cache.

FFCx needs a C compiler too. Where there is none, or it fails, :func:`compiled` returns None and the
callers use DOLFINx's generated kernels and numpy instead.
"""

from __future__ import annotations

import ctypes
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


def compiled(source: Path) -> ctypes.CDLL | None:
    """The compiled library of a C source; None where it can be neither found nor made.

    Args:
        source: the file; it may include the headers of its own directory.
    """
    key = hashlib.sha256(source.read_bytes())
    for header in sorted(source.parent.glob("*.h")):
        key.update(header.read_bytes())
    key.update(" ".join((*_flags(), platform.machine())).encode())
    file = f"libtribox_{source.stem}_{key.hexdigest()[:24]}.so"
    for directory in filter(_trusted, _caches()):
        built = directory / file
        loaded = _load(built)
        if loaded is None and _build(source, built):
            loaded = _load(built)
        if loaded is not None:
            return loaded
    return None


def _flags() -> tuple[str, ...]:
    return (*FLAGS, *os.environ.get(MORE_FLAGS, "").split())


def _trusted(directory: Path) -> bool:
    """Whether a directory is new, or was made by this user or the administrator."""
    return not directory.exists() or directory.stat().st_uid in (0, os.getuid())


def _load(file: Path) -> ctypes.CDLL | None:
    """The library in a file; None where there is no file, or one of another system."""
    try:
        return ctypes.CDLL(str(file)) if file.exists() else None
    except OSError:
        return None


def _caches() -> tuple[Path, Path]:
    """Directories for the libraries: FFCx's cache, or one for this user among temporary files."""
    ours = Path(tempfile.gettempdir()) / f"tribox-{os.getuid()}"
    return compiler_cache(), ours


def _build(source: Path, target: Path) -> bool:
    """Compile ``source`` into ``target``, complete or not at all; whether it worked."""
    compiler = next(filter(None, map(shutil.which, (os.environ.get("CC", "cc"), "gcc"))), None)
    if compiler is None:
        return False
    try:
        target.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
            made = Path(scratch) / target.name
            done = subprocess.run(
                [compiler, *_flags(), "-o", str(made), str(source), "-lm"],
                capture_output=True,
                check=False,
            )
            if done.returncode != 0:
                return False
            made.chmod(0o755)
            made.replace(target)
    except OSError:  # a cache that cannot be written
        return False
    return True
