"""``python3 -m app``."""

import atexit
import gc
import sys

# Imports make a million objects that stay; looking through them again and again costs a tenth of a
# second, and the program itself leaves few cycles.
gc.set_threshold(100_000)

from app.cli import main  # noqa: E402


@atexit.register
def _skip_last_collection() -> None:
    """At the end memory goes back as a whole: looking for cycles in it costs a fifth of a second.

    Where there was a solver, its library's objects are still taken apart in the usual way.
    """
    if "petsc4py" not in sys.modules:
        gc.freeze()


main()
