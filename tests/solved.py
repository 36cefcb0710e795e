"""Cases solved in memory, without files."""

from typing import Any

from mpi4py import MPI

from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation


class Cuts(Observer):
    """Keeps the lengths of the steps that were cut, and counts the iterations of all."""

    def __init__(self) -> None:
        self.lengths: list[float] = []
        self.iterations = 0

    def attempt(self, state, load_step, dt, result) -> None:
        self.iterations += result.iterations

    def cut(self, state, dt, result) -> None:
        self.lengths.append(dt)

    @property
    def count(self) -> int:
        return len(self.lengths)


def built(data: dict[str, Any], comm: MPI.Comm = MPI.COMM_SELF) -> Simulation:
    """The run of a case, before its first step."""
    return Simulation(build_model(Case.model_validate(data), comm))


def solved(
    data: dict[str, Any], comm: MPI.Comm = MPI.COMM_SELF, observer: Observer | None = None
) -> Simulation:
    """The run of a case, at its end."""
    simulation = built(data, comm)
    simulation.run(observer or Observer())
    return simulation
