"""Versions of the program and of what it stands on, for summaries and checkpoints."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
from pathlib import Path

import dolfinx
import numpy as np
from mpi4py import MPI
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


def host() -> dict[str, str]:
    """The machine and what it runs: operating system, kernel, processor, MPI."""
    about = platform.uname()
    try:
        system = platform.freedesktop_os_release().get("PRETTY_NAME", about.system)
    except OSError:
        system = about.system
    found = {
        "system": system,
        "kernel": f"{about.system} {about.release}",
        "processor": f"{_processor() or about.machine}, {os.cpu_count()} cores",
        "mpi": MPI.Get_library_version().split(",")[0].split("\n")[0].strip(),
    }
    return {name: value for name, value in found.items() if value}


def _processor() -> str:
    """The model of the processor; "" where the system does not tell."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    match = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return match[1].strip() if match else ""


def kernels() -> dict[str, str]:
    """The program's compiled C sources that this process has loaded: name, and key of its build.

    The key is of the source, its headers, the compiler's options and the machine. None where the
    system does not tell.
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
