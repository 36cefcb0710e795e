"""The lock of a results directory, and what may be cleared in one."""

import fcntl
import json
import os
import platform
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from tests.ranks import ROOT
from tribox.app.errors import InputError, OutputError
from tribox.app.figures.run_figures import draw_figures
from tribox.app.figures.style import save
from tribox.app.results import read
from tribox.app.results.claim import Claim, claimed, owner_of
from tribox.app.results.directory import LOCK, GrowingTable, write_text

HOLD = """
import sys, time
from pathlib import Path
from tribox.app.results.claim import Claim
Claim(Path(sys.argv[1]), False).take()
print("taken", flush=True)
time.sleep(60)
"""


@pytest.fixture
def held(tmp_path):
    """A directory that another process has locked, and that process."""
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "taken\n"
        yield tmp_path, process
        process.kill()


@pytest.mark.parametrize("force", [False, True])
def test_a_directory_is_refused_while_its_owner_lives(held, force):
    directory, process = held
    with pytest.raises(InputError) as caught:
        Claim(directory, force).take()
    said = str(caught.value)
    assert f"process {process.pid} on {platform.node()}" in said and str(directory) in said
    assert owner_of(directory)["pid"] == process.pid
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert owner_of(directory) is None and (directory / LOCK).exists()
    with claimed(directory, force):  # nothing but the lock of the dead is there
        assert owner_of(directory)["pid"] == os.getpid()
    assert not (directory / LOCK).exists()


def test_a_directory_made_for_nothing_goes_again(tmp_path):
    directory = tmp_path / "a" / "b"
    with pytest.raises(ZeroDivisionError), claimed(directory, False):
        assert directory.is_dir()
        raise ZeroDivisionError
    assert not (tmp_path / "a").exists()
    with claimed(directory, False):
        (directory / "history.csv").touch()
    assert [path.name for path in directory.iterdir()] == ["history.csv"]


def test_two_claims_of_one_process_exclude_each_other(tmp_path):
    first, second = Claim(tmp_path, False), Claim(tmp_path, False)
    first.take(goes_on=True)
    with pytest.raises(InputError, match="is writing there"):
        second.take(goes_on=True)
    second.release()  # takes nothing from the first
    assert owner_of(tmp_path) is not None
    first.release()
    second.take(goes_on=True)
    second.release()


@pytest.mark.parametrize(
    ("pid", "host", "free"),
    [(None, None, True), ("here", "here", False), (2**22 + 1, "here", True), (1, "afar", False)],
)
def test_without_locks_of_files_the_owners_name_decides(monkeypatch, tmp_path, pid, host, free):
    def refuse(descriptor: int, operation: int) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(fcntl, "flock", refuse)
    owner = {"pid": os.getppid() if pid == "here" else pid}
    owner["host"] = platform.node() if host == "here" else host
    (tmp_path / LOCK).write_text("" if pid is None else json.dumps(owner))
    lock = Claim(tmp_path, False)
    if free:
        lock.take(goes_on=True)
        lock.release()
    else:
        with pytest.raises(InputError, match="is writing there"):
            lock.take(goes_on=True)


def test_what_cannot_be_locked_is_one_line(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be written"):
        Claim(tmp_path / "file" / "below", False).take(goes_on=True)


def fill(directory: Path, *names: str) -> None:
    for name in names:
        path = directory / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("something")


@pytest.mark.parametrize(
    "foreign", ["figures/notes.txt", "fields/mine/000001.vtu", "fields/readme"]
)
def test_foreign_files_below_are_never_cleared(tmp_path, foreign):
    fill(tmp_path, "history.csv", "figures/history.png", "fields/000001.vtu", foreign)
    with pytest.raises(InputError, match=re.escape(foreign.rsplit("/", 1)[0])):
        Claim(tmp_path, True).take()
    assert (tmp_path / foreign).exists() and (tmp_path / "history.csv").exists()


def test_what_comes_between_is_not_cleared(tmp_path):
    fill(tmp_path, "history.csv")
    with claimed(tmp_path, True) as claim:
        fill(tmp_path, "thesis.tex")
        with pytest.raises(InputError, match=r"holds thesis\.tex"):
            claim.clear()
    assert {path.name for path in tmp_path.iterdir()} == {"history.csv", "thesis.tex"}
    (tmp_path / "thesis.tex").unlink()
    with claimed(tmp_path, True) as claim:
        claim.clear()
        assert [path.name for path in tmp_path.iterdir()] == [LOCK]


def test_links_are_never_followed_nor_cleared(tmp_path):
    fill(tmp_path / "elsewhere", "000001.vtu")
    fill(tmp_path / "out", "history.csv")
    (tmp_path / "out" / "fields").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="holds fields, which is no result"):
        Claim(tmp_path / "out", True).take()
    assert (tmp_path / "elsewhere" / "000001.vtu").exists()


@pytest.fixture
def victim(tmp_path: Path) -> Iterator[Path]:
    """A file elsewhere, which must stay as it is."""
    path = tmp_path / "victim"
    path.write_text("precious")
    yield path
    assert path.read_text() == "precious"


@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_a_lock_that_is_a_link_is_not_written(tmp_path, victim, link):
    (tmp_path / "out").mkdir()
    link(tmp_path / "out" / LOCK, victim)
    assert owner_of(tmp_path / "out") is None
    for force in (False, True):
        with pytest.raises(OutputError, match=r"is a link or no file.*tribox\.lock"):
            Claim(tmp_path / "out", force).take()


def test_a_lock_that_is_a_pipe_waits_for_nobody(tmp_path):
    os.mkfifo(tmp_path / LOCK)
    assert owner_of(tmp_path) is None
    with pytest.raises(OutputError, match="is a link or no file"):
        Claim(tmp_path, True).take()


@pytest.mark.parametrize(
    "name",
    [
        *("history.csv", "contacts.csv", "log.txt", "summary.json.part", "figures", "fields"),
        *("fields/000001.vtu", "checkpoints", "checkpoints/000001"),
    ],
)
def test_a_run_does_not_go_on_among_links(tmp_path, victim, name):
    path = tmp_path / "out" / name
    path.parent.mkdir(parents=True)
    path.symlink_to(victim)
    (tmp_path / "out" / "of-mine").symlink_to(victim)  # which no run writes
    with pytest.raises(InputError, match=f"out/{name}: is a link, and tribox writes through none"):
        Claim(tmp_path / "out", True).take(goes_on=True)
    path.unlink()
    with claimed(tmp_path / "out", True, goes_on=True):
        pass


@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_nothing_is_written_through_a_link(tmp_path, victim, link):
    for name in ("summary.json.part", "history.csv", "figures.part.png"):
        link(tmp_path / name, victim)
    write_text(tmp_path / "summary.json", "new")
    assert (tmp_path / "summary.json").read_text() == "new"
    save(Figure(), tmp_path / "figures.png")
    with pytest.raises(OSError, match="is a link or no file"):
        GrowingTable(tmp_path / "history.csv", ["step"], after=1)


def test_figures_are_not_drawn_through_a_link(tmp_path, victim, block):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "case.toml").write_text(block)
    (tmp_path / "out" / "figures").symlink_to(elsewhere)
    with pytest.raises(InputError, match="figures: is a link, and tribox writes through none"):
        draw_figures(read(tmp_path / "out"))
    assert list(elsewhere.iterdir()) == []


def test_the_part_of_a_sweep_that_runs_alone_is_not_cleared(tmp_path, block):
    sweep = '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, 0.3]\n'
    fill(tmp_path, "mu=0.1/history.csv", "sweep.csv")
    (tmp_path / "case.toml").write_text(block + sweep)
    with claimed(tmp_path / "mu=0.1", True):
        with pytest.raises(InputError, match=r"mu=0.1: tribox is writing there"):
            Claim(tmp_path, True).take()
    with claimed(tmp_path, True) as claim:
        claim.clear()
        assert [path.name for path in tmp_path.iterdir()] == [LOCK]
