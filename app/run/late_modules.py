"""Modules that others import and a run hardly needs: loaded when something in them is asked for.

NumPy's and SciPy's packages import all of their parts, matplotlib writes help texts of all its
classes, and pydantic reads what every installed package says of itself in search of plugins: a
tenth of a second of each command, all together.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from importlib.util import LazyLoader
from types import ModuleType

# Those that ``scipy`` imports through ``from numpy import *``, and parts that its sparse matrices
# and search trees import for others to find. LazyLoader is the standard library's: to everybody
# such a module is the module itself.
LATE = frozenset(
    {
        "numpy.char",
        "numpy.core",
        "numpy.f2py",
        "numpy.polynomial",
        "numpy.rec",
        "numpy.strings",
        "numpy.testing",
        "pydoc",
        "scipy.sparse.csgraph",
        "scipy.sparse.linalg",
        "scipy.spatial.transform",
    }
)


class _LateModules:
    """Finds modules as all other finders do, and puts off their loading."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The module's spec with a loader that waits; None of others than :data:`LATE`."""
        if name == "matplotlib.figure":
            _leave_out_help()
        if name not in LATE:
            return None
        others = (finder for finder in sys.meta_path if finder is not self)
        spec = next(filter(None, (f.find_spec(name, path, target) for f in others)), None)
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


def _leave_out_help() -> None:
    """Have matplotlib write no lists of properties into the help texts of its classes."""
    import matplotlib.artist

    if hasattr(matplotlib.artist, "kwdoc"):
        matplotlib.artist.kwdoc = lambda artist: ""


def load_late() -> None:
    """Put off what a command of tribox may never need; for a process of its own."""
    sys.meta_path.insert(0, _LateModules())
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
