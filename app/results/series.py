"""Series of files over time, one a step, and their index as ParaView reads it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

from tribox.app.results.directory import Place, write_text

SHARE = 0.01  # of the time that may go into rewriting the index


class Series:
    """``NAME.pvd`` and the files ``NAME/NNNNNN.vtu`` that it lists; for one rank.

    The index is rewritten under a temporary name, so that it is whole at any moment; of a long
    series not with every file.
    """

    def __init__(
        self, directory: Path, name: str, times: Mapping[int, float] | None = None
    ) -> None:
        """Nothing is written yet; the index comes with the first of the files.

        Args:
            directory: of the results.
            name: of the series.
            times: s, by the number of the step, of the files that are kept of a run that goes on;
                the others are removed. None: there are none.
        """
        self._directory, self._name = directory, name
        self._place = Place(directory)
        self._lines: list[str] = []
        self._next = 0.0
        if times is not None:
            self._keep(times)

    def _keep(self, times: Mapping[int, float]) -> None:
        kept = {step: when for step, when in times.items() if self.path(step).is_file()}
        names = {self.path(step).name for step in kept}
        for path in (self._directory / self._name).glob("*.vtu*"):
            if path.name not in names:
                path.unlink()
        self._lines = [self._line(step, when) for step, when in kept.items()]
        if kept:
            self.write_index()

    def path(self, step: int) -> Path:
        """The file of a step, in a directory that is made with the first of them."""
        self._place.check()
        (self._directory / self._name).mkdir(exist_ok=True)
        return self._directory / self._name / f"{step:06d}.vtu"

    def add(self, step: int, when: float) -> None:
        """List the file of a step, which has been written.

        Args:
            step: number of the step.
            when: s, its time.
        """
        self._lines.append(self._line(step, when))
        if time.monotonic() >= self._next:
            self.write_index()

    def _line(self, step: int, when: float) -> str:
        file = f"{self._name}/{step:06d}.vtu"
        return f'    <DataSet timestep="{when!r}" part="0" file="{file}"/>\n'

    def write_index(self) -> None:
        """Write the index of all files so far, if there are any."""
        if not self._lines:
            return
        self._place.check()
        began = time.monotonic()
        write_text(
            self._directory / f"{self._name}.pvd",
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
            f"{''.join(self._lines)}  </Collection>\n</VTKFile>\n",
        )
        ended = time.monotonic()
        self._next = ended + (ended - began) / SHARE
