"""Errors of writing: nothing is torn, all ranks hear of them, and room is kept for the end."""

import errno
import os
import shutil

import pytest
from mpi4py import MPI

from tribox.app.errors import OutputError
from tribox.app.results.directory import GrowingTable, read_table
from tribox.app.results.saving import Saving


def full(*arguments: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def short(descriptor: int, data: memoryview, at: int) -> int:
    """A disk that becomes full in the middle of what is written."""
    if len(data) < 4:
        full()
    return WRITE(descriptor, data[: len(data) // 2], at)


WRITE = os.pwrite


def test_a_row_is_appended_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "history.csv"
    table = GrowingTable(path, ("step", "time"))
    table.extend([(1, 0.1)])
    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", short)
        with pytest.raises(OSError, match="No space left"):
            table.extend([(2, 0.2)])
    assert path.read_text() == "step,time\n1,0.1\n" and table.written == 1
    table.extend([(2, 0.2), (3, 0.3)])
    assert [row["step"] for row in read_table(path)] == [1.0, 2.0, 3.0]


def test_rows_do_not_go_into_the_file_of_another_run(tmp_path):
    directory = tmp_path / "out"
    directory.mkdir()
    table, saving = GrowingTable(directory / "t.csv", ("step",)), Saving(directory)
    shutil.rmtree(directory)
    with pytest.raises(FileNotFoundError):
        table.extend([(1,)])
    with pytest.raises(FileNotFoundError):
        saving.place.check()
    directory.mkdir()
    (directory / "t.csv").write_text("step\n")
    with pytest.raises(FileNotFoundError, match="another one is there"):
        table.extend([(1,)])
    with pytest.raises(FileNotFoundError, match="another one is there"):
        saving.regain_directory()
    assert (directory / "t.csv").read_text() == "step\n"
    shutil.rmtree(directory)
    saving.regain_directory()
    saving.place.check()


def test_the_first_error_is_kept_and_others_pass(tmp_path):
    saving = Saving(tmp_path)
    saving.raise_together(MPI.COMM_SELF)
    with saving:
        full()
    with saving:
        (tmp_path / "a" / "b").touch()
    with pytest.raises(OutputError, match=r"cannot be written \(No space left on device\)$"):
        saving.raise_together(MPI.COMM_SELF)
    with pytest.raises(ZeroDivisionError), saving:
        raise ZeroDivisionError
