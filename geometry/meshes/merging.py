"""Hands a file to gmsh, and that file alone: gmsh also runs a script that lies beside it.

With ``mesh.msh`` gmsh reads ``mesh.msh.opt``, if there is one, and does what stands in it, commands
to the system included. A mesh is data, so it is read by a link from a directory where nothing else
lies.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from types import ModuleType


def companion(path: Path) -> Path:
    """The file that gmsh reads, and runs, together with another one."""
    return path.with_name(path.name + ".opt")


def merge_alone(gmsh: ModuleType, path: Path) -> None:
    """Read a file into gmsh's current model without what lies beside it.

    Raises:
        Exception: what gmsh raises, with the file's own name.
    """
    with tempfile.TemporaryDirectory() as directory:
        link = Path(directory) / path.name
        link.symlink_to(path.resolve())
        try:
            gmsh.merge(str(link))
        # gmsh raises nothing more specific.
        except Exception as error:
            raise Exception(str(error).replace(str(link), str(path))) from error
