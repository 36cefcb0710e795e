"""Versions of the program and of what it stands on, for summaries and checkpoints."""

from __future__ import annotations

import importlib.metadata
import platform

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


def _version() -> str:
    from tribox import __version__

    try:
        return importlib.metadata.version("tribox")
    except importlib.metadata.PackageNotFoundError:
        return __version__
