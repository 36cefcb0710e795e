"""Results directories: what is in them, and how files get there without loss."""

from __future__ import annotations

import csv
import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from app.errors import InputError

OWN = (
    "case.toml",
    "summary.json",
    "history.csv",
    "contacts.csv",
    "surfaces.csv",
    "bodies.csv",
    "probes.csv",
    "body_probes.csv",
    "contact_probes.csv",
    "log.txt",
    "report.html",
    "checkpoints",
    "fields.pvd",
    "fields",
    "contact.pvd",
    "contact",
    "contact_points.pvd",
    "contact_points",
    "fields.bp",
    "stress.bp",
    "figures",
    "sweep.csv",
    "mesh.msh",
    "inputs",
    "friction_map.csv",
    "load_map.csv",
    "slip_weakening.csv",
    "start_stop.csv",
    "velocity_jump.csv",
    "fit.json",
    "fit.csv",
    "friction.toml",
    "verification.md",
)
# What earlier versions wrote and --force clears too.
EARLIER = ("motion.csv", "contact_nodes.pvd", "contact_nodes")
SUMS = "SHA256SUMS"  # in the directory of inputs
TEXT_COLUMNS = ("stage", "label", "pair", "surface", "body", "probe")


def default_directory(case_file: Path) -> Path:
    """Where the results of a case go if nobody says: ``results/CASE``."""
    root = os.environ.get("TRIBOX_RESULTS", "results")
    return Path(root) / case_file.stem


def check_free(directory: Path, force: bool, labels: Sequence[str] = ()) -> None:
    """See that results may be written; changes nothing.

    Args:
        directory: where they are to go.
        force: whether results that are there may be cleared.
        labels: sub-directories of a sweep whose results are there (``sweep_labels``); only
            these count as results too.

    Raises:
        InputError: the directory holds results (or anything else) and ``force`` is not given, or
            holds files that are not results, which are never removed.
    """
    try:
        taken = directory.exists() and not directory.is_dir()
    except OSError as error:
        raise InputError(f"{directory}: not a usable name ({error.strerror or error})") from None
    if taken:
        raise InputError(f"{directory}: is a file; the results need a directory")
    present = sorted(p.name for p in directory.iterdir()) if directory.is_dir() else []
    if not present:
        return
    if not force:
        raise InputError(
            f"{directory}: holds results already; name another directory with --out, or replace "
            "them with --force"
        )
    foreign = [name for name in present if not _is_own(name, labels)]
    foreign += [f"inputs/{name}" for name in foreign_inputs(directory)]
    if foreign:
        raise InputError(
            f"{directory}: holds {foreign[0]}, which is no result of tribox, so --force does not "
            "clear it; name another directory with --out"
        )


def prepare(directory: Path) -> None:
    """Make the directory and clear old results from it, after :func:`check_free`.

    Raises:
        InputError: it cannot be made or written.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for path in list(directory.iterdir()):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
        probe = directory / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(f"{directory}: cannot be written ({error.strerror or error})") from None


def foreign_inputs(directory: Path) -> list[str]:
    """Names in ``inputs`` that a run has not put there, by the list of sums beside them.

    Others may have a directory of this name too, with the only copy of their meshes in it.
    """
    folder = directory / "inputs"
    try:
        lines = (folder / SUMS).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        lines = []
    known = {line.partition("  ")[2] for line in lines} | ({SUMS} if lines else set())
    present = folder.iterdir() if folder.is_dir() else ()
    return sorted(path.name for path in present if path.name not in known)


def _is_own(name: str, labels: Sequence[str]) -> bool:
    """Whether a name in a results directory is one of a result, or of a value of its sweep."""
    return name.removesuffix(".part") in OWN + EARLIER or name in labels


def write_text(path: Path, text: str) -> None:
    """Write a file under a temporary name and rename it."""
    part = path.with_name(path.name + ".part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a JSON file, as :func:`write_text`."""
    write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n")


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file, as :func:`write_text`; numbers with all their digits."""
    part = path.with_name(path.name + ".part")
    with part.open("w", newline="", encoding="utf-8") as stream:
        out = csv.writer(stream, lineterminator="\n")
        out.writerow(columns)
        out.writerows([repr(v) if isinstance(v, float) else v for v in row] for row in rows)
    part.replace(path)


class GrowingTable:
    """A CSV file that gets rows while a run goes on; what is there is whole up to its last row.

    Attributes:
        written: number of rows so far.
    """

    def __init__(self, path: Path, columns: Sequence[str], after: int | None = None) -> None:
        """Begin the file with the names of the columns, or go on with one that is there.

        Args:
            path: of the file.
            columns: their names; the first is the number of the step.
            after: number of the step whose rows are the last to be kept; None: a new file.
        """
        self._path = path
        self.written = 0
        if after is not None and path.is_file():
            self._cut(after)
            return
        with path.open("w", newline="", encoding="utf-8") as stream:
            csv.writer(stream, lineterminator="\n").writerow(columns)

    def _cut(self, after: int) -> None:
        """Drop the rows of later steps."""
        header, *rows = self._path.read_text(encoding="utf-8").splitlines(keepends=True)
        kept = [row for row in rows if row.endswith("\n") and int(row.split(",", 1)[0]) <= after]
        if len(kept) < len(rows):
            write_text(self._path, header + "".join(kept))
        self.written = len(kept)

    def sync(self) -> None:
        """See that the rows are on the disk."""
        with self._path.open("rb") as stream:
            os.fsync(stream.fileno())

    def extend(self, rows: Sequence[Sequence[Any]]) -> None:
        """Append rows; numbers with all their digits."""
        if not rows:
            return
        with self._path.open("a", newline="", encoding="utf-8") as stream:
            out = csv.writer(stream, lineterminator="\n")
            out.writerows([repr(v) if isinstance(v, float) else v for v in row] for row in rows)
        self.written += len(rows)


def _entry(column: str, text: str) -> float | str:
    """A number, or the text of a column that holds text; what is swept may be either."""
    if column in TEXT_COLUMNS:
        return text
    try:
        return float(text)
    except ValueError:
        if column == "value":
            return text
        raise


def read_table(path: Path) -> list[dict[str, Any]]:
    """Rows of a CSV file written here, numbers as floats.

    Raises:
        InputError: no such file.
    """
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            return [
                {key: _entry(key, value) for key, value in row.items()}
                for row in csv.DictReader(stream)
            ]
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; is this a results directory?") from None
    except (TypeError, ValueError):
        raise InputError(f"{path}: is cut off or not a table of tribox") from None
