"""What a person runs: command line, case files, simulations, results and figures."""

from __future__ import annotations

import sys

__version__ = "0.1.0"


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
