"""A results directory as one object: case, summary, tables and fields.

Neither DOLFINx nor PETSc nor MPI is needed: what is read are the files. ::

    from tribox.app.results import read

    results = read("results/sfa")
    results.history.plot("time", "friction_coefficient")
    mesh = results.fields()          # after the last step
    mesh.cell_data["von_mises_stress"][0].max()
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from tribox.app.case.case import Case
from tribox.app.case.reading import load_past_case
from tribox.app.case.solver import LABEL, LONGEST_LABEL
from tribox.app.case.toml_files import see_file
from tribox.app.errors import InputError
from tribox.app.results.claim import owner_of
from tribox.app.results.directory import TEXT_COLUMNS, json_of
from tribox.app.simulation.history import COLUMNS

if TYPE_CHECKING:
    import meshio
    from pandas import DataFrame

LAST = -1
RUNNING = "running"
CUT_OFF = "is cut off or not"
# Columns that every table has, and those that some have beside them; a sweep's has its own.
STEP_COLUMNS = ("step", "time", "stage")
NAME_COLUMNS = {
    **{"contacts": ("pair",), "surfaces": ("surface",), "bodies": ("body",), "tools": ("tool",)},
    **dict.fromkeys(("probes", "body_probes", "contact_probes"), ("probe",)),
    **dict.fromkeys(("shape_probes", "surface_probes"), ("probe",)),
}
SWEEP_COLUMNS = ("label", "steady")
SUMMARY_KINDS: dict[str, type] = {"load_steps": list, "parts": dict, "bodies": list}
STEADY = {True: 1.0, False: 0.0, None: -1.0}


# -- A table of a results directory as columns of numbers and names --------------------------------

Column = NDArray[Any]


class Table:
    """Columns of one length by name, in the order of the file.

    Attributes:
        columns: (n,) each, SI: names are text (of Python), all else floats.
    """

    __slots__ = ("columns",)

    def __init__(self, columns: Mapping[str, Column] | None = None) -> None:
        """Take the columns as they are; without any the table is empty."""
        self.columns: dict[str, Column] = dict(columns or {})

    @classmethod
    def from_csv(cls, text: str) -> Table:
        """The table in a text; ValueError if it is none, or a number is none."""
        try:
            header, *rows = [
                row for row in csv.reader(StringIO(text, newline=""), strict=True) if row
            ] or [[]]
        except csv.Error as error:
            raise ValueError(str(error)) from None
        if not header or len(set(header)) < len(header):
            raise ValueError("no header, or a name twice")
        if any(len(row) != len(header) for row in rows):
            raise ValueError("lines of different lengths")
        found = zip(*rows, strict=True) if rows else [()] * len(header)
        return cls({k: column_of(k, v) for k, v in zip(header, found, strict=True)})

    @classmethod
    def from_records(cls, records: Sequence[Mapping[str, Any]]) -> Table:
        """The table of rows by name; ValueError if they differ in names, or a number is none."""
        names = list(records[0]) if records else []
        if any(record.keys() != records[0].keys() for record in records):
            raise ValueError("rows of different columns")
        return cls({name: column_of(name, [r[name] for r in records]) for name in names})

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> Column:
        """A column (n,)."""
        return self.columns[name]

    def rows(self, which: Column | slice) -> Table:
        """Some of the rows, by their numbers (k,) or whether each is one of them (n,)."""
        return Table({name: values[which] for name, values in self.columns.items()})

    def where(self, name: str, *values: object) -> Table:
        """The rows that have one of these values in a column."""
        return self.rows(np.isin(self.columns[name], np.array(values)))

    def parts(self, name: str) -> Iterator[tuple[Any, Table]]:
        """Each value of a column, in the order of its first row, with its rows."""
        for value in dict.fromkeys(self.columns[name].tolist()):
            yield value, self.rows(self.columns[name] == value)

    def records(self) -> list[dict[str, Any]]:
        """Each row by name, in Python's own numbers."""
        rows = zip(*(values.tolist() for values in self.columns.values()), strict=True)
        return [dict(zip(self.columns, row, strict=True)) for row in rows]


def read_table(path: Path) -> list[dict[str, Any]]:
    """Rows of a CSV file, by name; InputError if there is none, or it is cut off."""
    try:
        return Table.from_csv(_text(path, "a table")).records()
    except ValueError:
        raise InputError(f"{path}: {CUT_OFF} a table of tribox") from None


def column_of(name: str, values: Iterable[Any]) -> Column:
    """A column (n,) of a table: text where its name says so, else floats, or ValueError.

    What was swept (``value``) is text where it is no number.
    """
    found = list(values)
    if None in found:
        raise ValueError(f"{name} is missing")
    if name not in TEXT_COLUMNS:
        try:
            numbers = np.array(found, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            numbers = np.empty((0, 0))
        if numbers.ndim == 1:
            return numbers
        if name != "value":
            raise ValueError(f"{name} holds what is no number")
    out = np.empty(len(found), dtype=object)
    out[:] = [str(value) for value in found]
    return out


def joined(first: Table, second: Table) -> Table:
    """The rows of two tables below each other; NaN, or no text, where one has no such column."""
    both, out = (first, second), {}
    for name in dict.fromkeys([*first.columns, *second.columns]):
        nothing = np.array("", dtype=object) if name in TEXT_COLUMNS else np.array(np.nan)
        parts = [one.columns.get(name, np.repeat(nothing, len(one))) for one in both]
        out[name] = np.concatenate(parts)
    return Table(out)


# -- The directory ------------------------------------------------------------------------------


def _frame_of(name: str, words: str) -> cached_property[DataFrame]:
    """A table of :class:`Results` as a data frame; ``words``: what its rows are."""

    def frame(results: Results) -> DataFrame:
        import pandas as pd

        return pd.DataFrame(results.table(name).columns)

    frame.__doc__ = words
    return cached_property(frame)


def read(directory: str | Path) -> Results:
    """A results directory of ``tribox run``, also while it runs; InputError if it is none."""
    return Results(Path(directory))


class Results:
    """What a run has written. Every part is read when it is asked for, and once.

    Tables are pandas data frames with a column for each of the file's, in SI: names are text, all
    else floats. A table that the run did not write is empty.

    Attributes:
        directory: where the results are.
    """

    def __init__(self, directory: Path) -> None:
        """See that it is a results directory; nothing is read yet; InputError if it is none."""
        if not (directory / "case.toml").is_file():
            what = "no such directory"
            if directory.is_dir():
                what = "no results directory of tribox run (it has no case.toml)"
            elif directory.exists():
                what = "is no directory"
            raise InputError(f"{directory}: {what}")
        self.directory = directory

    def __repr__(self) -> str:
        return f"Results({str(self.directory)!r})"

    @cached_property
    def case(self) -> Case:
        """The case as run, all defaults resolved, in SI; InputError if of another version."""
        return load_past_case(self.directory / "case.toml")

    @cached_property
    def summary(self) -> dict[str, Any]:
        """What ``summary.json`` holds, little while the run goes on; InputError if it is none."""
        path = self.directory / "summary.json"
        if not path.exists():
            return {}
        try:
            found = json_of(_text(path, "a summary"))
        except ValueError:
            found = None
        if not isinstance(found, dict):
            raise InputError(f"{path}: {CUT_OFF} a summary of tribox")
        for key, kind in SUMMARY_KINDS.items():
            if not isinstance(found.get(key, kind()), kind):
                what = "list" if kind is list else "table"
                raise InputError(f"{path}: is no summary of tribox ({key} is no {what})")
        return found

    @cached_property
    def unfinished(self) -> str | None:
        """Why a run has not said how it ended: it goes on, or was killed; None: it has."""
        if self.summary.get("status", "done" if self.summary else RUNNING) != RUNNING:
            return None
        owner = owner_of(self.directory)
        if owner is None:
            return "ended from outside; this is what it had written"
        return f"goes on, as process {owner.get('pid', '?')} on {owner.get('host', '?')}"

    # -- tables -------------------------------------------------------------------------------

    history = _frame_of("history", "One row a step: contact of all pairs, energies, iterations.")
    contacts = _frame_of("contacts", "One row a step and pair.")
    surfaces = _frame_of("surfaces", "One row a step and surface with a boundary: motion, force.")
    bodies = _frame_of("bodies", "One row a step and body: motion and contact force.")
    tools = _frame_of("tools", "One row a step and rigid tool: motion, forces and moments.")
    progress = _frame_of("progress", "One row for each attempt at an implicit step.")
    probes = _frame_of("probes", "One row a step and point of the probes that are points or lines.")
    body_probes = _frame_of("body_probes", "One row a step and probe that is a body.")
    contact_probes = _frame_of("contact_probes", "One row a step and point of slave surfaces.")
    shape_probes = _frame_of("shape_probes", "One row a step and probe of a surface: its shape.")
    surface_probes = _frame_of("surface_probes", "One row a step and node of probes of surfaces.")
    load_steps = _frame_of(
        "load_steps",
        "One row for each stage or velocity: label, steady, and the history at its end. steady is "
        "1 if the velocity was held until steady, 0 if not, −1 where nobody asked.",
    )
    sweep = _frame_of("sweep", "One row for each stage or velocity of each run of a sweep.")
    sweep_details = _frame_of("sweep_details", "A row for each of their pairs, tools and probes.")

    @cached_property
    def parts(self) -> dict[str, Results]:
        """Runs of a sweep by label, but those without results; InputError if one is no name."""
        labels = list(self.summary.get("parts", ()))
        odd = next((label for label in labels if not _is_label(label)), None)
        if odd is not None:
            path = self.directory / "summary.json"
            raise InputError(f'{path}: is no summary of tribox ("{odd[:40]}" is no part of it)')
        if not labels and self.case.sweep is not None:
            labels = list(self.case.sweep.labels)
        found = {label: self.directory / label for label in labels}
        return {k: Results(path) for k, path in found.items() if (path / "case.toml").is_file()}

    def table(self, name: str) -> Table:
        """A table as columns, which need no pandas; InputError if it is cut off, or is none."""
        if name not in self._tables:
            if name == "load_steps":
                self._tables[name] = self._load_steps()
            elif name in ("sweep", "sweep_details"):
                self._read_sweep()
            else:
                self._tables[name] = self._read_table(name)
        return self._tables[name]

    @cached_property
    def _tables(self) -> dict[str, Table]:
        return {}

    def _load_steps(self) -> Table:
        path = self.directory / "summary.json"
        try:
            rows = [r | {"steady": STEADY[r["steady"]]} for r in self.summary.get("load_steps", [])]
        except (KeyError, TypeError):
            raise InputError(
                f"{path}: is no summary of tribox (a load step has no steady true, false or null)"
            ) from None
        try:
            found = Table.from_records(rows)
        except ValueError:
            raise InputError(f"{path}: {CUT_OFF} a table of tribox") from None
        if rows:
            _check_columns(found, ("label", "step", "stage"), path)
        return found

    def _read_sweep(self) -> None:
        """The rows of runs, and those of what is in them, each with the columns they have."""
        whole = self._read_table("sweep")
        # Without the column the file is of a version that wrote rows of runs only.
        is_run = whole["kind"] == "run" if "kind" in whole else np.ones(len(whole), np.bool_)
        runs, details = whole.rows(is_run), whole.rows(~is_run)
        own = (*COLUMNS, *SWEEP_COLUMNS, "value")
        told = {k: v for k, v in runs.columns.items() if "kind" not in whole or k in own}
        self._tables["sweep"] = Table(told)
        self._tables["sweep_details"] = details if len(details) else Table()

    def _read_table(self, name: str) -> Table:
        path = self.directory / f"{name}.csv"
        if not path.exists():
            return Table()
        text = _text(path, "a table")
        if self.unfinished:  # its last row may be in the middle of being written
            text = text[: text.rfind("\n") + 1]
        try:
            found = Table.from_csv(text)
        except ValueError:
            raise InputError(f"{path}: {CUT_OFF} a table of tribox") from None
        if not text.endswith("\n"):
            raise InputError(f"{path}: {CUT_OFF} a table of tribox")
        needed = (*STEP_COLUMNS, *NAME_COLUMNS.get(name, ()))
        _check_columns(found, SWEEP_COLUMNS if name == "sweep" else needed, path)
        return found

    # -- fields -------------------------------------------------------------------------------

    @property
    def steps(self) -> NDArray[np.int64]:
        """Numbers (n,) of the steps whose fields were written."""
        return self._outputs[0]

    @property
    def times(self) -> NDArray[np.float64]:
        """Times (n,) of these steps, s."""
        return self._outputs[1]

    @cached_property
    def _outputs(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        for name in ("fields", "contact"):
            if (self.directory / f"{name}.pvd").exists():
                return _index(self.directory / f"{name}.pvd")
        return np.empty(0, dtype=np.int64), np.empty(0)

    def fields(self, step: int = LAST) -> meshio.Mesh:
        """Deformed bodies with displacement, stress and strain.

        Args:
            step: number of the step, one of ``steps``; −1: the last one.

        Returns:
            Mesh with ``points`` (n, 3), m, current; ``point_data`` and ``cell_data`` by name, as
            docs/results.md says; ``field_data``: ``TimeValue``, s, and ``step``.

        Raises:
            InputError: nothing was written at this step, or the file is cut off or gone.
        """
        return self._mesh("fields", step)

    def contact(self, step: int = LAST) -> meshio.Mesh:
        """Deformed slave surfaces with nodal values; as :meth:`fields`."""
        return self._mesh("contact", step)

    def contact_points(self, step: int = LAST) -> meshio.Mesh:
        """Contact points at their deformed places; as :meth:`fields`."""
        return self._mesh("contact_points", step)

    def tool_outlines(self, step: int = LAST) -> meshio.Mesh:
        """Outlines of the rigid tools where they are; as :meth:`fields`."""
        return self._mesh("tools", step)

    def _mesh(self, name: str, step: int) -> meshio.Mesh:
        import meshio

        path = self._file(name, step)
        try:
            see_file(path)
            return meshio.vtu.read(path)
        except Exception:  # whatever the XML parser, base64, zlib and numpy raise
            raise InputError(f"{path}: {CUT_OFF} a file of tribox") from None

    def _file(self, name: str, step: int) -> Path:
        """The file of a step."""
        files = self._files(name)
        if step in files:
            return files[step]
        index = self.directory / f"{name}.pvd"
        listed = [int(number) for number in _index(index)[0]] if index.exists() else []
        files = self._files(name)  # after the index, which a run writes after the files
        wanted = max([*files, *listed], default=step) if step == LAST else step
        if wanted in files:  # and maybe not listed yet
            return files[wanted]
        if wanted in listed:
            path = self.directory / name / f"{wanted:06d}.vtu"
            raise InputError(f"{path}: no such file, though {index.name} lists it")
        if not files:
            raise InputError(f"{self.directory}: holds no output in {name}/")
        raise InputError(
            f"{self.directory}: no output of step {step} in {name}/; there are {len(files)}, "
            f"from step {min(files)} to {max(files)}"
        )

    def _files(self, name: str) -> dict[int, Path]:
        """The files of a series by their steps."""
        found = self.directory.glob(f"{name}/*.vtu")
        return {int(p.stem): p for p in found if p.stem.isdecimal()}


def _is_label(text: str) -> bool:
    """Whether this can be the name that a value of a sweep has, and leads nowhere else."""
    return LABEL.fullmatch(text) is not None and len(text.encode()) <= LONGEST_LABEL


@contextmanager
def files_of_one_run(results: Results) -> Iterator[None]:
    """Draw or tell inside what the files of a directory hold, each of them whole by itself.

    Raises:
        InputError: what one file names another has not, so that they are not of one run.
    """
    try:
        yield
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise InputError(
            f"{results.directory}: its files are not of one run of this version ({reason})"
        ) from error


def _text(path: Path, what: str) -> str:
    """Text of a file."""
    try:
        see_file(path)
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (UnicodeDecodeError, MemoryError):
        raise InputError(f"{path}: {CUT_OFF} {what} of tribox") from None


def _index(path: Path) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Numbers (n,) and times (n,), s, of the steps that an index lists."""
    text = _text(path, "an index")
    try:
        sets = list(ElementTree.fromstring(text).iter("DataSet"))
        steps = [int(Path(s.attrib["file"]).stem) for s in sets]
        times = [float(s.attrib["timestep"]) for s in sets]
        return np.array(steps, dtype=np.int64), np.array(times)
    except (ElementTree.ParseError, KeyError, ValueError, OverflowError):
        raise InputError(f"{path}: {CUT_OFF} an index of tribox") from None


def _check_columns(table: Table, names: Iterable[str], path: Path) -> None:
    """See that a table has columns."""
    missing = next((name for name in names if name not in table), None)
    if missing is not None:
        raise InputError(f"{path}: is no table of tribox (it has no column {missing})")
