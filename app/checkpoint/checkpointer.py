"""Writes checkpoints while a run goes on, and the last one when it ends, is stopped or fails."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from tribox.app.case.case import resolved_toml
from tribox.app.checkpoint.files import Checkpoint, write_checkpoint
from tribox.app.checkpoint.layout import Layout, copied
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.errors import OutputError
from tribox.app.results.first_rank import on_first
from tribox.app.results.probes import ProbeRecorder
from tribox.app.results.recorder import Recorder
from tribox.app.results.versions import versions
from tribox.app.simulation.observer import Observer
from tribox.app.simulation.run_state import RunState
from tribox.app.simulation.simulation import Simulation

KEEP_EVERY = 1.0  # s between two snapshots that are kept in memory, of an explicit run


class Checkpointer(Observer):
    """Observer that writes checkpoints; all ranks take part, the first one decides and writes.

    Taking a snapshot changes nothing in the run, so that results do not depend on when it is done.
    """

    def __init__(
        self, simulation: Simulation, recorder: Recorder, probes: ProbeRecorder, directory: Path
    ) -> None:
        """Write nothing yet.

        Args:
            simulation: the run.
            recorder: of its results, whose state belongs to a checkpoint too.
            probes: whose tables are to be as long as the run.
            directory: of the results.
        """
        self._simulation, self._recorder, self._directory = simulation, recorder, directory
        self._probes = probes
        self._comm = simulation.model.problem.comm
        self._output = simulation.model.case.output
        self._layout: Layout | None = None
        self._step = simulation.state.step
        self._written = self._remembered = time.monotonic()
        self._memory: tuple[Snapshot, dict[str, Any]] | None = None

    def ready(self, state: RunState) -> None:
        """Write a checkpoint if one is due."""
        if not self._output.checkpoints_kept or not self._has_begun:
            return
        write, remember = self._comm.bcast(self._due(state))
        if write:
            self._write(*self._take("running"))
        elif remember:
            snapshot, about = self._take("failed")
            self._memory, self._remembered = (copied(snapshot), about), time.monotonic()

    def close(self, status: str) -> None:
        """Write the last checkpoint of a run that ended; collective.

        Where an explicit run fails it is in the middle of a step: what is written is the last
        snapshot kept in memory.

        Args:
            status: done, interrupted or failed.
        """
        simulation = self._simulation
        if not self._output.checkpoints_kept or not self._has_begun:
            return
        if status == "failed" and simulation.explicit is not None:
            if self._memory is not None:
                self._write(*self._memory)
            return
        self._write(*self._take(status))

    @property
    def _has_begun(self) -> bool:
        """Whether there is anything to be lost: a row, or explicit time steps on the way to one."""
        state = self._simulation.state
        return state.step > 0 or state.position.within > 0

    def _due(self, state: RunState) -> tuple[bool, bool]:
        """Whether to write, and whether to keep a snapshot in memory; asked on the first rank."""
        now, every = time.monotonic(), self._output.checkpoint_every
        write = now - self._written >= self._output.checkpoint_interval
        write |= 0 < every <= state.step - self._step
        explicit = self._simulation.explicit is not None
        return write, explicit and now - self._remembered >= KEEP_EVERY

    def _take(self, status: str) -> tuple[Snapshot, dict[str, Any]]:
        """A snapshot of the whole run, and what there is to say of it; collective."""
        simulation, state = self._simulation, self._simulation.state
        snapshot = {
            "case": resolved_toml(simulation.model.case),
            "simulation": simulation.snapshot(),
            "recorder": self._recorder.snapshot(),
        }
        about = {
            "step": state.step,
            "time": state.time,
            "stage": state.rows[-1].stage if state.rows else simulation.model.case.stage[0].name,
            "status": status,
            "ranks": self._comm.size,
            "inputs": self._recorder.inputs,
            "versions": versions(),
        }
        return snapshot, about

    def _write(self, snapshot: Snapshot, about: dict[str, Any]) -> None:
        """Write a snapshot; collective.

        Raises:
            OutputError: it cannot be written.
        """
        with self._simulation.model.problem.timer("checkpoints"):
            if self._layout is None:
                self._layout = Layout(self._simulation.model)
            layout = self._layout
            tree, arrays = layout.gather(snapshot)
            arrays |= {f"mesh/{name}": array for name, array in layout.identity.items()}
            whole = Checkpoint(about | {"distribution": layout.ranks}, tree, arrays)
            on_first(self._comm, lambda: self._put(whole))
        self._step, self._written = about["step"], time.monotonic()
        self._remembered, self._memory = self._written, None

    def _put(self, checkpoint: Checkpoint) -> None:
        """Put a checkpoint on the disk, with the rows that belong to it; for the first rank.

        Raises:
            OutputError: it cannot be written.
        """
        try:
            self._recorder.sync()
            self._probes.sync()
            write_checkpoint(self._directory, checkpoint, self._output.checkpoints_kept)
        except OSError as error:
            why = f"no checkpoint could be written ({error})"
            raise OutputError(f"{self._directory}: {why}") from None
