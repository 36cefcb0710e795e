"""Which cases may run code of their own: those that the user says so of, now or once and for all.

``TRIBOX_TRUST`` in the environment lists directories, absolute and parted as those of ``PATH``:
what lies below one is trusted.
"""

from __future__ import annotations

import os
from pathlib import Path

from tribox.app.case.case import Case
from tribox.app.errors import InputError
from tribox.geometry.meshes.drawing import GEO

TRUSTED = "TRIBOX_TRUST"
CONTAINED = "TRIBOX_CONTAINED"
"""1 in the image, where what a drawing may do besides drawing reaches what is mounted only."""
_OPEN = (
    "APPTAINER_CONTAINER",
    "SINGULARITY_CONTAINER",
)  # these mount homes and working directories


def trusted_directories() -> list[Path]:
    """The directories of ``TRIBOX_TRUST``, without links; InputError if one is relative, or all."""
    found = []
    for name in filter(None, os.environ.get(TRUSTED, "").split(os.pathsep)):
        try:
            real = Path(name).resolve()
        except (OSError, RuntimeError):  # links that lead round in a circle
            raise InputError(f'{TRUSTED}: "{name}" leads nowhere') from None
        if not Path(name).is_absolute() or real == real.parent:
            raise InputError(f'{TRUSTED}: "{name}" is no directory of your own in full')
        found.append(real)
    return found


def code_files(case: Case, python: bool) -> list[tuple[str, Path]]:
    """(what says so, file) of all code that a case, or a value of its sweep, would run.

    Drawings are scripts of gmsh; ``python``: laws and materials too, not only the mesh.
    """
    parts = [case, *(part for _, part in case.sweep_cases())]
    found: dict[tuple[str, Path], None] = {}
    for part in parts:
        files = {".".join(map(str, place)): path for place, path in part.named_files()}
        for key, path in files.items():
            if python and key.endswith(".class"):
                kind = "law" if key.startswith("contact.") else "material"
                found[f'{key.removesuffix("class")}{kind} = "python"', path] = None
            if key == "geometry.mesh" and "geometry.meshed" not in files and is_code(path):
                found[key, path] = None
    return list(found)


def is_code(drawing: Path) -> bool:
    """Whether meshing a drawing takes trust; STEP files hold no code."""
    contained = os.environ.get(CONTAINED) == "1" and not any(name in os.environ for name in _OPEN)
    return drawing.suffix.lower() in GEO and not contained


def require_trust(case: Case, case_file: Path, given: bool, python: bool = True) -> bool:
    """Whether a case runs code, which the user allows (``given``) or by where its files are.

    InputError if neither; ``python``: see :func:`code_files`.
    """
    files = code_files(case, python)
    if not given:
        for place, file in files:
            said = f"{case_file}: {place} makes this case code: {file} would be run"
            for path in (case_file, file):
                require_trusted_file(path, said)
    return bool(files)


def require_drawing(drawing: Path) -> None:
    """InputError if a drawing holds code, and lies where the user does not trust all."""
    if is_code(drawing):
        said = f"{drawing} is code, which gmsh would run: it can start programs and write files"
        require_trusted_file(drawing, said)


def require_trusted_file(path: Path, said: str) -> None:
    """See that a file lies in a directory that the user trusts; InputError if it does not."""
    real = path.resolve()
    if not any(one in real.parents for one in trusted_directories()):
        raise InputError(
            f"{said}; allow it for this time with --trust, or for all in a directory by the "
            f"environment: {TRUSTED}={real.parent}"
        )
