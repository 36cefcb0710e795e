"""Kills a run just before each file that it gives its name, has it go on, and compares the results.

python3 -m tests.app.checkpoint.at_renames case.toml directory
"""

import contextlib
import os
import shutil
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from unittest import mock

import tests.loaded_once  # noqa: F401
from tests.app.checkpoint.going_on import unlike
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.results import read
from tribox.app.run.run import run_case

KILLED = -signal.SIGKILL
REPLACE = os.replace
CLEARED = 5  # renames after which nothing old is left


def in_a_child(act: Callable[[], object]) -> int:
    """Do something in a copy of this process; its exit code, or less the signal that ended it."""
    number = os.fork()
    if number == 0:
        try:
            act()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])


@contextlib.contextmanager
def killed_at(number: int) -> Iterator[None]:
    """Context in which the process is killed in the place of its rename of this number, from 1."""
    left = number

    def replace(source: Path, target: Path) -> None:
        nonlocal left
        left -= 1
        if not left:
            os.kill(os.getpid(), signal.SIGKILL)
        REPLACE(source, target)

    with mock.patch("os.replace", replace):
        yield


def main(case_file: str, place: str) -> None:
    """Print a line for each rename: what is wrong after it, or that nothing is."""
    case, root = load_case(Path(case_file)), Path(place)
    reference = root / "reference"
    run_case(case, reference, quiet=True)  # here, so that no child imports and loads all this again
    number, left = 0, True
    while left:
        number += 1
        # Into a new directory, and in the place of other results, which are cleared at the start.
        for old in (False, True)[: 1 + (number <= CLEARED)]:
            out = root / f"{number}-{'forced' if old else 'new'}"
            if old:
                shutil.copytree(reference, out)
            left = in_a_child(partial(_killed_run, case, out, old, number)) == KILLED
            if left:
                print(out.name, _after(case, out, reference), flush=True)


def _killed_run(case: Case, out: Path, force: bool, number: int) -> None:
    with killed_at(number):
        run_case(case, out, quiet=True, force=force)


def _after(case: Case, out: Path, reference: Path) -> str:
    """What becomes of a run that goes on after a kill."""
    before = sorted(path.name for path in out.iterdir())
    if in_a_child(lambda: run_case(case, out, quiet=True, resume=True)) != 0:
        return f"refused, with {before}"
    return "; ".join(unlike(reference, out)) or f"{read(out).summary['status']}, same bytes"


if __name__ == "__main__":
    main(*sys.argv[1:])
