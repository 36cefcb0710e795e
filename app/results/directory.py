"""Results directories: what is in them, and how files get there without loss."""

from __future__ import annotations

import contextlib
import csv
import errno
import hashlib
import io
import json
import os
import re
import stat
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tribox.app.errors import InputError, OutputError

LOCK, CHECKPOINTS = "tribox.lock", "checkpoints"
PROBE_TABLES = (  # points, bodies, contact, shape of surfaces, their nodes
    *("probes.csv", "body_probes.csv", "contact_probes.csv"),
    *("shape_probes.csv", "surface_probes.csv"),
)
OWN = (
    *("case.toml", "summary.json", "history.csv", "contacts.csv", "surfaces.csv", "bodies.csv"),
    *("tools.csv", "progress.csv", *PROBE_TABLES, "log.txt", "report.html", "sweep.csv"),
    *("fields.pvd", "contact.pvd", "contact_points.pvd", "tools.pvd", "mesh.msh"),
    *("friction_map.csv", "load_map.csv", "film_map.csv", "slip_weakening.csv"),
    *("start_stop.csv", "velocity_jump.csv", "fit.json", "fit.csv", "friction.toml"),
    *("body.toml", "verification.md"),
)
_SERIES = re.compile(r"\d+\.vtu(\.part)?")
# Files below the directories that tribox makes; names of figures may end in those of fields.
BELOW = {
    "fields": _SERIES,
    "contact": _SERIES,
    "contact_points": _SERIES,
    "tools": _SERIES,
    CHECKPOINTS: re.compile(r"\d{6,}(\.part)?(/(state\.json|arrays\.npz|manifest\.json))?"),
    "figures": re.compile(
        r"(mesh|history|energy|force_displacement|stribeck|film|phase|effective_viscosity|friction_map|sweep"
        r"|deformed|animation|slip_weakening|start_stop|velocity_jump|fit|verify_).*"
        r"\.(png|gif|mp4)(\.part)?"
    ),
}
SUMS = "SHA256SUMS"  # in the directory of inputs
BEGINNING = {"status": "running", "begins": True}
"""The summary of a directory that is being made ready: what else is there counts for nothing."""
TEXT_COLUMNS = ("stage", "label", "pair", "surface", "body", "tool", "probe", "kind", "name")


def keep_inputs_apart(directory: Path, sources: Iterable[Path]) -> None:
    """InputError if a results directory, which is cleared, holds what results are made from."""
    for path in sources:
        if directory.resolve() in path.resolve().parents:
            raise InputError(
                f"{directory}: holds {path.name}, which the run reads; name another directory for "
                "the results with --out"
            )


def default_directory(case_file: Path) -> Path:
    """Where the results of a case go if nobody says: ``results/CASE``."""
    return Path(os.environ.get("TRIBOX_RESULTS", "results")) / case_file.stem


def suffixed_directory(source: Path, suffix: str) -> Path:
    """The default directory of a command beside ``run``: ``results/SOURCE-suffix``."""
    default = default_directory(source)
    return default.with_name(f"{default.name}-{suffix}")


def check_free(directory: Path, force: bool, labels: Sequence[str] = ()) -> None:
    """See that results may be written; changes nothing.

    ``labels``: sub-directories of a sweep, which count as results too (``sweep_labels``).
    InputError if the directory holds anything without ``force``, or what is no result, which is
    never removed.
    """
    try:
        taken = directory.exists() and not directory.is_dir()
    except OSError as error:
        raise InputError(f"{directory}: not a usable name ({error.strerror or error})") from None
    if taken:
        raise InputError(f"{directory}: is a file; the results need a directory")
    present = [p.name for p in directory.iterdir()] if directory.is_dir() else []
    if not set(present) - {LOCK}:
        return
    if not force:
        raise InputError(
            f"{directory}: holds results already; name another directory with --out, or replace "
            "them with --force"
        )
    foreign = _sort_out(directory, labels)[1]
    if foreign:
        raise InputError(
            f"{directory}: holds {foreign[0].relative_to(directory)}, which is no result of "
            "tribox, so --force does not clear it; name another directory with --out"
        )


def prepare(directory: Path, labels: Sequence[str] = (), begins: bool = False) -> None:
    """Make the directory and clear old results, of a sweep's ``labels`` too; OutputError.

    After :func:`check_free`; whatever else is there by now stays. Where a run ``begins`` there is a
    summary, ``BEGINNING``, before anything is cleared or written, so that who is killed from here
    on can begin again.
    """
    summary = directory / "summary.json"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        if begins:
            # Say that what is there is being cleared, also on a disk without room for another
            # summary.
            try:
                write_json(summary, BEGINNING)
            except OSError:
                summary.unlink(missing_ok=True)
        own = [path for path in _sort_out(directory, labels)[0] if not (begins and path == summary)]
        own.sort(key=lambda path: path != directory / "case.toml")  # goes last: it names the labels
        for path in reversed(own):
            if not path.is_dir():
                path.unlink()
                continue
            with contextlib.suppress(OSError):  # somebody has put something there
                path.rmdir()
        if begins and not summary.exists():
            write_json(summary, BEGINNING)
    except OSError as error:
        raise unwritable(directory, error) from None


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
    known.add(f"{SUMS}.part")  # of a run that was killed before the list had its name
    present = folder.iterdir() if folder.is_dir() else ()
    return sorted(path.name for path in present if path.name not in known)


def _sort_out(directory: Path, labels: Sequence[str]) -> tuple[list[Path], list[Path]]:
    """What results consist of, directories before what is in them, and what is no result."""
    own: list[Path] = []
    foreign: list[Path] = []
    for path in sorted(directory.iterdir()):
        folder = path.is_dir() and not path.is_symlink()
        inside = BELOW.get(path.name)
        if folder and path.name in labels:
            below = _sort_out(path, ())
            own += [path, *below[0]]
            foreign += below[1]
        elif folder and path.name == "inputs":
            strange = set(foreign_inputs(directory))
            own.append(path)
            for one in sorted(path.iterdir()):
                (foreign if one.name in strange else own).append(one)
        elif folder and inside is not None:
            own.append(path)
            for one in sorted(path.rglob("*")):
                name = one.relative_to(path).as_posix()
                (own if inside.fullmatch(name) else foreign).append(one)
        elif folder or path.is_symlink() or path.name.removesuffix(".part") not in OWN:
            foreign += [path] * (path.name != LOCK)
        else:
            own.append(path)
    return own, foreign


def checkpoint_numbers(directory: Path) -> list[int]:
    """Numbers of the checkpoints of a results directory that have been written whole, rising."""
    root = directory / CHECKPOINTS
    names = [path.name for path in root.iterdir()] if root.is_dir() else []
    return sorted(int(name) for name in names if re.fullmatch("[0-9]{6,}", name))


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's contents, in hexadecimal digits; InputError if it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None


def unwritable(directory: Path, error: OSError) -> OutputError:
    """What to raise where results cannot be written."""
    why = error.strerror or str(error)
    where = Path(error.filename) if isinstance(error.filename, str) else directory
    if where.is_relative_to(directory) and where != directory:
        why += f": {where.relative_to(directory)}"
    return OutputError(f"{directory}: cannot be written ({why})")


def open_own(path: Path, flags: int, mode: int = 0o666) -> int:
    """Open a file of a results directory; OSError if it is a link, a pipe, or cannot be opened."""
    safe = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        descriptor = os.open(path, flags | safe, mode)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, _LINK, str(path)) from None
        raise
    about = os.fstat(descriptor)
    if not stat.S_ISREG(about.st_mode) or about.st_nlink > 1:
        os.close(descriptor)
        raise OSError(errno.ELOOP, _LINK, str(path))
    return descriptor


_LINK = "is a link or no file, and is not followed"


def check_no_links(directory: Path) -> None:
    """InputError if anything that a run goes on with is a link, which others may have put there."""
    for path in directory.rglob("*") if directory.is_dir() else ():
        top = path.relative_to(directory).parts[0]
        known = (*OWN, *BELOW, LOCK, "inputs")
        ours = top.removesuffix(".part") in known
        if ours and path.is_symlink():
            raise InputError(f"{path}: is a link, and tribox writes through none; remove it")


@contextlib.contextmanager
def written_whole(path: Path, ending: str = ".part") -> Iterator[Path]:
    """Context that gives a temporary name to write to; at its end the file gets its own name.

    After an error there is no file, or the old one. ``ending``: of the temporary name, ".part" and
    what a library takes the format of a file from.
    """
    part = path.with_name(path.name + ending)
    # What has its name, be it a link of somebody else, goes.
    part.unlink(missing_ok=True)
    os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666))
    try:
        yield part
        part.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            part.unlink()
        raise


def write_text(path: Path, text: str) -> None:
    """Write a file under a temporary name and rename it."""
    with written_whole(path) as part:
        part.write_text(text, encoding="utf-8")


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a JSON file, as :func:`write_text`."""
    write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n")


def json_of(text: str) -> Any:
    """What JSON holds; ValueError if it is none, or has half a pair of surrogates."""
    try:
        found = json.loads(text)
        json.dumps(found, ensure_ascii=False).encode()
    except RecursionError:
        raise ValueError("nested too deep") from None
    return found


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file, as :func:`write_text`; numbers with all their digits."""
    write_text(path, _lines([columns, *map(_digits, rows)]))


def _digits(row: Sequence[Any]) -> list[Any]:
    """A row with all digits of its numbers."""
    return [repr(v) if isinstance(v, float) else v for v in row]


class Place:
    """A directory that somebody may delete, and put another one there."""

    def __init__(self, path: Path) -> None:
        """Open it: as long as it is open the system gives its number to no other."""
        self._path, self._opened = path, os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        weakref.finalize(self, os.close, self._opened)

    def check(self) -> None:
        """See that it is still there; FileNotFoundError if it is not."""
        if not os.path.samestat(os.fstat(self._opened), self._path.stat()):
            raise FileNotFoundError(errno.ENOENT, "another one is there", str(self._path))


class GrowingFile:
    """A file that text is appended to while a run goes on: all of a piece or nothing of it."""

    def __init__(self, path: Path, text: str = "", keep: int = 0) -> None:
        """Begin the file, with a text, or go on with one that is there.

        ``keep``: bytes of a file that is there which are kept.

        Raises:
            OSError: it cannot be written.
        """
        self._path, self._size = path, keep
        with self._opened(os.O_CREAT) as file:
            os.ftruncate(file, keep)
        self.append(text)

    @contextlib.contextmanager
    def _opened(self, flags: int = 0) -> Iterator[int]:
        """Context with its descriptor; by its name, so that a file that is gone is missed."""
        descriptor = open_own(self._path, os.O_WRONLY | flags)
        try:
            yield descriptor
        finally:
            os.close(descriptor)

    def sync(self) -> None:
        """See that the text is on the disk."""
        with self._opened() as file:
            os.fsync(file)

    def append(self, text: str) -> None:
        """Append a text; OSError if the disk is full, or the file is gone; nothing was appended."""
        data = memoryview(text.encode())
        end = self._size + len(data)
        with self._opened() as file:
            if os.fstat(file).st_size != self._size:
                raise FileNotFoundError(errno.ENOENT, "another one is there", str(self._path))
            try:
                while data:
                    data = data[os.pwrite(file, data, end - len(data)) :]
            except OSError as error:
                os.ftruncate(file, self._size)
                raise OSError(error.errno, error.strerror, str(self._path)) from None
        self._size = end


class GrowingTable:
    """A CSV file that gets rows while a run goes on; what is there is whole up to its last row.

    Attributes:
        written: number of rows so far.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], after: int | None = None, more: int = 0
    ) -> None:
        """Begin with the columns' names, or go on with a table that is there.

        ``after``: last step whose rows are kept, None: a new file; ``more``: rows of the next kept
        too.
        """
        self.written = 0
        if after is None or not has_rows(path):
            self._file = GrowingFile(path, _lines([columns]))
            return
        header, *rows = path.read_bytes().splitlines(keepends=True)
        whole = [(int(row.split(b",", 1)[0]), row) for row in rows if row.endswith(b"\n")]
        kept = [row for step, row in whole if step <= after]
        kept += [row for step, row in whole if step == after + 1][:more]
        self.written = len(kept)
        self._file = GrowingFile(path, keep=len(header) + sum(map(len, kept)))

    def sync(self) -> None:
        """See that the rows are on the disk."""
        self._file.sync()

    def extend(self, rows: Sequence[Sequence[Any]]) -> None:
        """Append rows; numbers with all their digits; OSError: as of :meth:`GrowingFile.append`."""
        if rows:
            self._file.append(_lines(map(_digits, rows)))
            self.written += len(rows)


def header_of(path: Path) -> tuple[str, ...]:
    """The columns of a table that is there and has begun; else none."""
    if not has_rows(path):
        return ()
    with path.open(encoding="utf-8", newline="") as lines:
        return tuple(next(csv.reader(lines), ()))


def has_rows(path: Path) -> bool:
    """Whether a table is there and has begun."""
    return path.is_file() and path.stat().st_size > 0


def _lines(rows: Iterable[Sequence[Any]]) -> str:
    """Rows as lines of CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
