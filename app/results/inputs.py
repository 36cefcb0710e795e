"""Copies of the files that a run reads beside its case file, so that its results can be run again.

They lie in ``inputs`` of the results directory, where ``case.toml`` names them relative to itself.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.case.case import Case, resolved_toml
from tribox.app.errors import InputError
from tribox.app.results.directory import SUMS, sha256_of, unwritable, write_text

INPUTS = "inputs"


@dataclass(frozen=True, slots=True)
class KeptInputs:
    """What was copied."""

    # of the copies, by the files that they were made from
    names: Mapping[Path, str] = field(default_factory=dict)
    sums: Mapping[str, str] = field(default_factory=dict)  # SHA-256 of each copy, by its name


NOTHING = KeptInputs()


def input_files(case: Case) -> list[Path]:
    """The files that a case, or a value of its sweep, names: meshes, Python of its own."""
    every = (case, *(part for _, part in case.sweep_cases()))
    return list(dict.fromkeys(path for one in every for _, path in one.named_files()))


def keep_inputs(case: Case, directory: Path, like: Path | None = None) -> KeptInputs:
    """Copy all that a case reads beside its file into ``inputs`` of a results directory.

    ``like``: directory whose ``inputs`` hold copies of the same files, that of the sweep: what is
    the same there is linked, so that it takes no room again. InputError or OutputError.
    """
    kept = kept_inputs(case)
    names, sums, folder = kept.names, kept.sums, directory / INPUTS
    if not names:
        return NOTHING
    try:
        folder.mkdir(exist_ok=True)
        # First, so that what is copied is known to be a copy whatever happens.
        write_text(folder / SUMS, "".join(f"{sums[name]}  {name}\n" for name in sums))
        for source, name in names.items():
            if like is None or not _linked(like / INPUTS / name, folder / name, sums[name]):
                shutil.copyfile(source, folder / name)
    except OSError as error:
        raise unwritable(directory, error) from None
    return kept


def kept_inputs(case: Case) -> KeptInputs:
    """What :func:`keep_inputs` makes of a case, not copied; InputError if a file is unreadable."""
    names = copy_names(case)
    return KeptInputs(names, {name: sha256_of(source) for source, name in names.items()})


def write_case(case: Case, directory: Path, kept: KeptInputs = NOTHING) -> None:
    """Write ``case.toml``: the resolved case, which reads the copies of its files."""
    text = resolved_toml(case, {path: f"{INPUTS}/{name}" for path, name in kept.names.items()})
    write_text(directory / "case.toml", text)


def copy_names(case: Case) -> dict[Path, str]:
    """Names of the copies of what a case reads: those of the files, numbered where alike."""
    names: dict[Path, str] = {}
    for path in input_files(case):
        name, count = path.name, 1
        while name in (SUMS, *names.values()):
            count += 1
            name = f"{path.stem}-{count}{path.suffix}"
        names[path] = name
    return names


def _linked(there: Path, target: Path, digest: str) -> bool:
    """Whether a file that is there already, with the same contents, could be linked."""
    try:
        if sha256_of(there) != digest:
            return False
        os.link(there, target)
    except (InputError, OSError):  # not there, or a file system without links
        return False
    return True


# -- Versions of the program and of what it stands on, for summaries and checkpoints  -------------


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
    """The compiled C sources that this process has loaded: name, and key of its build.

    That is of source, headers, options and machine; none where the system does not tell.
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
