"""Runs the case files that verification is based on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

CASES = Path(__file__).parents[2] / "cases"


def solve(
    name: str, overrides: Sequence[str] = (), observer: Observer | None = None
) -> tuple[Case, Simulation]:
    """Run a case file in this process, without results.

    Args:
        name: of a file in ``cases``, without its ending.
        overrides: "key=value" texts.
        observer: of the run.

    Returns:
        The case (without its sweep) and the finished simulation.

    Raises:
        InputError: the file or an override is wrong.
        SolutionError: a step could not be solved.
    """
    case = load_case(CASES / f"{name}.toml", overrides)
    simulation = Simulation(build_model(case, MPI.COMM_SELF))
    simulation.run(observer or Observer())
    return case, simulation
