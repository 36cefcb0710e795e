"""tribox: finite-strain frictional contact of an elastomer on aluminium through a film.

What most scripts need is here: :func:`load_case`, :func:`check_case`, :func:`run_case` and
:func:`read`, loaded when they are asked for. All else is in ``tribox.app`` (what a person runs),
``tribox.forms`` (what bodies and contacts obey) and ``tribox.geometry`` (where things are).
"""

from __future__ import annotations

import os
import sys
from importlib import import_module

TYPE_CHECKING = False  # without typing: see tribox.app.run.process
if TYPE_CHECKING:
    from typing import Any

    from tribox.app.case import Case, check_case, json_schema, load_case
    from tribox.app.results import Results, read
    from tribox.app.run import run_case

__version__ = "0.1.0"
__all__ = ["Case", "Results", "check_case", "json_schema", "load_case", "read", "run_case"]

_ROOMS = {
    "Case": "app.case",
    "Results": "app.results",
    "check_case": "app.case",
    "json_schema": "app.case",
    "load_case": "app.case",
    "read": "app.results",
    "run_case": "app.run",
}

if not os.path.isdir(os.path.join(__path__[0], "app")):
    # A checkout without symbolic links: what they would lead to stands at its top.
    __path__.append(os.path.dirname(os.path.dirname(__path__[0])))


def __getattr__(name: str) -> Any:
    if name not in _ROOMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_ROOMS[name]}"), name)


class _PetscWithoutFiles:
    """Starts PETSc, when it is first imported, without options from files.

    It reads ``.petscrc`` and ``petscrc`` of the directory that it is started in, which may be that
    of anyone's case, and options can write files and run code. No variable of the environment and
    no option set later keeps it from that; commands that need no PETSc do not load it.
    """

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        """Find nothing; start PETSc before its module is found by others."""
        if name == "petsc4py.PETSc":
            sys.meta_path.remove(self)
            import petsc4py

            petsc4py.init(["tribox", "-skip_petscrc"])


sys.meta_path.insert(0, _PetscWithoutFiles())
