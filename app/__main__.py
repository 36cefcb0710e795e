"""``python3 -m app``, and the command ``tribox`` of an installation."""

from __future__ import annotations

import atexit
import gc
import sys


def start() -> None:
    """Run the command line as a process of its own, with little time for the garbage collector."""
    # Imports make a million objects that stay; looking through them again and again costs a tenth
    # of a second, and the program itself leaves few cycles.
    gc.set_threshold(100_000)
    atexit.register(_skip_last_collection)
    from app.run.process import begin_process, end_process

    begin_process()
    from app.cli import main

    try:
        main()
    finally:
        end_process()


def _skip_last_collection() -> None:
    """At the end memory goes back as a whole: looking for cycles in it costs a fifth of a second.

    Where there was a solver, its library's objects are still taken apart in the usual way.
    """
    if "petsc4py" not in sys.modules:
        gc.freeze()


if __name__ == "__main__":
    start()
