"""Versions of the program and of what it stands on, for summaries and checkpoints."""

from __future__ import annotations

import importlib.metadata
import platform
import re
from pathlib import Path

import dolfinx
import numpy as np
from petsc4py import PETSc


def versions() -> dict[str, str]:
    """Versions by name."""
    return {
        "tribox": _version(),
        "dolfinx": dolfinx.__version__,
        "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


def kernels() -> dict[str, str]:
    """The program's compiled C sources that this process has loaded: name, and key of its build.

    The key is of the source, its headers, the compiler's options and the machine. None where
    everything runs in numpy, or where the system does not tell.
    """
    try:
        mapped = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return {}
    return dict(sorted(set(re.findall(r"/libtribox_(\w+)_([0-9a-f]{24})\.so", mapped))))


def _version() -> str:
    from tribox import __version__

    try:
        return importlib.metadata.version("tribox")
    except importlib.metadata.PackageNotFoundError:
        return __version__
