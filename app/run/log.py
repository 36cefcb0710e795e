"""The log of a run: every line is on the disk as soon as it is written."""

from __future__ import annotations

from pathlib import Path

from tribox.app.errors import folded
from tribox.app.results.directory import GrowingFile
from tribox.app.results.saving import Saving


class Log:
    """``log.txt``; lines that could not be written wait for the next that can."""

    def __init__(self, path: Path, saving: Saving, resumed: bool = False) -> None:
        """Begin the file.

        Args:
            path: of the file.
            saving: keeps errors of writing.
            resumed: whether it goes on with one that is there.
        """
        self._keep = path.stat().st_size if resumed and path.is_file() else 0
        self._path, self._saving = path, saving
        self._file: GrowingFile | None = None
        self._waiting = ""
        self.write()

    def write(self, *lines: str) -> None:
        """Append lines, folded where they are long."""
        self._waiting += "".join(folded(line) + "\n" for line in lines)
        with self._saving:
            if self._file is None:
                self._file = GrowingFile(self._path, keep=self._keep)
            self._file.append(self._waiting)
            self._waiting = ""
