"""Series of files over time, one a step, and their index as ParaView reads it."""

from __future__ import annotations

import time
from pathlib import Path

from app.results.directory import Place, write_text

SHARE = 0.05  # of the time that may go into rewriting the index


class Series:
    """``NAME.pvd`` and the files ``NAME/NNNNNN.vtu`` that it lists; for one rank.

    The index is rewritten under a temporary name, so that it is whole at any moment; of a long
    series not with every file.
    """

    def __init__(self, directory: Path, name: str) -> None:
        """Nothing is written yet; the index comes with the first of the files."""
        self._directory, self._name = directory, name
        self._place = Place(directory)
        self._lines: list[str] = []
        self._next = 0.0

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
        file = f"{self._name}/{step:06d}.vtu"
        self._lines.append(f'    <DataSet timestep="{when!r}" part="0" file="{file}"/>\n')
        if time.monotonic() >= self._next:
            self.write_index()

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
