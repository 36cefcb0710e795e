"""Writes checkpoints while a run goes on, and the last one when it ends, is stopped or fails."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tribox.app.case.case import resolved_toml
from tribox.app.checkpoint.layout import Layout, copied
from tribox.app.equilibrium.snapshot import Array, Snapshot
from tribox.app.errors import InputError, OutputError
from tribox.app.results.directory import CHECKPOINTS, checkpoint_numbers
from tribox.app.results.inputs import versions
from tribox.app.results.probes import ProbeRecorder
from tribox.app.results.recorder import Recorder
from tribox.app.results.saving import on_first
from tribox.app.simulation.run_state import Observer, RunState
from tribox.app.simulation.simulation import Simulation

# -- Checkpoints as files: ``checkpoints/NNNNNN/`` in a results directory, whole or not there at all
#
# Each is written under a temporary name, synced to the disk and renamed; its manifest holds the
# size and the SHA-256 sum of its files, and its own. They are numbered from 1; the last few stay.

FORMAT = 12
INSTEAD = "; the one before it is taken"  # of one that is damaged
# What reading something else than was written may end in.
DAMAGE = (
    *(OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, EOFError),
    *(MemoryError, RecursionError, zipfile.BadZipFile, NotImplementedError),
)
_STATE, _ARRAYS, _MANIFEST = "state.json", "arrays.npz", "manifest.json"


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """One checkpoint."""

    about: dict[str, Any]  # its manifest: step, time, status of the run, versions and so on
    tree: Any  # snapshot as plain data
    arrays: dict[str, Array] = field(default_factory=dict)  # of it, by name


def write_checkpoint(directory: Path, checkpoint: Checkpoint, keep: int) -> Path:
    """Write a checkpoint, drop all but the last ``keep``; its directory; OSError if it cannot."""
    root = directory / CHECKPOINTS
    root.mkdir(exist_ok=True)
    numbers = checkpoint_numbers(directory)
    final = root / f"{(numbers[-1] if numbers else 0) + 1:06d}"
    part = final.with_name(f"{final.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        part.mkdir()
        _fill(part, checkpoint)
        os.replace(part, final)
        _sync(root)
    except OSError:
        shutil.rmtree(part, ignore_errors=True)
        raise
    for number in checkpoint_numbers(directory)[:-keep]:
        shutil.rmtree(root / f"{number:06d}", ignore_errors=True)
    return final


def _fill(part: Path, checkpoint: Checkpoint) -> None:
    with (part / _STATE).open("w", encoding="utf-8") as stream:
        json.dump(checkpoint.tree, stream, default=_plain)
    np.savez(part / _ARRAYS, **{f"a{name}": a for name, a in checkpoint.arrays.items()})  # type: ignore[arg-type]
    files = {name: _fingerprint(part / name) for name in (_STATE, _ARRAYS)}
    about = {"format": FORMAT, **checkpoint.about, "files": files}
    with (part / _MANIFEST).open("w", encoding="utf-8") as stream:
        json.dump(about | {"sha256": _sum(about)}, stream, indent=2, default=_plain)
    for name in (_STATE, _ARRAYS, _MANIFEST, "."):
        _sync(part / name)


def _plain(value: Any) -> Any:
    """Numbers of numpy as Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} in a checkpoint")


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _sum(about: dict[str, Any]) -> str:
    """SHA-256 of what a manifest holds, however it is laid out."""
    text = json.dumps(about, sort_keys=True, default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()


def _fingerprint(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return {"bytes": path.stat().st_size, "sha256": digest}


def latest(directory: Path) -> tuple[Checkpoint | None, list[str]]:
    """The last whole checkpoint, or None, and a line for each later one that is damaged.

    InputError if the last one is of another format.
    """
    damaged: list[str] = []
    for number in reversed(checkpoint_numbers(directory)):
        path = directory / CHECKPOINTS / f"{number:06d}"
        try:
            return _read(path), damaged
        except DAMAGE as error:
            damaged.append(f"{path}: is damaged ({why(error)}){INSTEAD}")
    return None, damaged


def why(error: BaseException) -> str:
    """One of ``DAMAGE`` in words."""
    if isinstance(error, KeyError):
        return f"{error} is missing"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__


def _read(path: Path) -> Checkpoint:
    about = json.loads((path / _MANIFEST).read_text(encoding="utf-8"))
    if not isinstance(about, dict):
        raise ValueError(f"{_MANIFEST} is not what was written")
    if about["format"] != FORMAT:
        raise InputError(
            f"{path}: a checkpoint of format {about['format']}, this version of tribox reads "
            f"{FORMAT}; resume it with the version that wrote it "
            f"({about.get('versions', {}).get('tribox', 'unknown')})"
        )
    if about.pop("sha256") != _sum(about):
        raise ValueError(f"{_MANIFEST} is not what was written")
    for name in (_STATE, _ARRAYS):
        if _fingerprint(path / name) != about["files"][name]:
            raise ValueError(f"{name} is not what was written")
    tree = json.loads((path / _STATE).read_text(encoding="utf-8"))
    return Checkpoint(about, tree, _arrays(path / _ARRAYS))


def _arrays(path: Path) -> dict[str, Array]:
    with np.load(path, allow_pickle=False) as stored:
        return {name.removeprefix("a"): stored[name] for name in stored.files}


# -- Writes checkpoints while a run goes on, and the last one when it ends, is stopped or fails ----

KEEP_EVERY = 1.0  # s between two snapshots that are kept in memory, of an explicit run


class Checkpointer(Observer):
    """Observer that writes checkpoints; all ranks take part, the first one decides and writes.

    Taking a snapshot changes nothing in the run, so that results do not depend on when it is done.
    """

    def __init__(
        self, simulation: Simulation, recorder: Recorder, probes: ProbeRecorder, directory: Path
    ) -> None:
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
        # Clocks differ from rank to rank: the first one's counts.
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
        """Write a snapshot; collective."""
        with self._simulation.model.problem.timer("checkpoints"):
            if self._layout is None:
                self._layout = Layout(self._simulation.model)
            layout = self._layout
            tree, arrays = layout.gather(snapshot)
            arrays |= {f"mesh/{name}": array for name, array in layout.identity.items()}
            whole = Checkpoint(about, tree, arrays)
            on_first(self._comm, lambda: self._put(whole))
        self._step, self._written = about["step"], time.monotonic()
        self._remembered, self._memory = self._written, None

    def _put(self, checkpoint: Checkpoint) -> None:
        """Put a checkpoint on the disk, with the rows that belong to it; for the first rank."""
        try:
            self._recorder.sync()
            self._probes.sync()
            write_checkpoint(self._directory, checkpoint, self._output.checkpoints_kept)
        except OSError as error:
            why = f"no checkpoint could be written ({error})"
            raise OutputError(f"{self._directory}: {why}") from None
