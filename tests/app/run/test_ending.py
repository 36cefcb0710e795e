"""How a process ends for what no case is to blame for."""

import errno
import os
import tempfile
from pathlib import Path

import pytest

from tribox.app.errors import InputError
from tribox.app.run.ranks import VARIABLE, end_with, ensure_cache
from tribox.geometry.compat import compiler_cache
from tribox.geometry.native.compiler import KernelError


def test_a_source_that_does_not_compile_is_one_line(capsys):
    with pytest.raises(SystemExit) as ended:
        end_with(KernelError("plane_kernel.c cannot be compiled: cc says: 'm' undeclared\nhere"))
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("tribox: plane_kernel.c cannot be compiled") and "undeclared" in line


def test_a_directory_that_may_not_be_entered_is_one_line(capsys):
    """Whatever looks for results, a mesh or a starter there; root may, so that no test can try."""
    with pytest.raises(SystemExit) as ended:
        end_with(PermissionError(errno.EACCES, "Permission denied", "closed/x/case.toml"))
    assert ended.value.code == InputError.exit_code
    assert capsys.readouterr().err == "tribox: closed/x/case.toml: Permission denied\n"


# -- A cache that cannot be written is replaced by one that can, or it is one line -----------------


@pytest.fixture
def temporary(tmp_path, monkeypatch) -> Path:
    """The place of temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


@pytest.fixture(params=["under a file", "a file", "unknown home"])
def unusable(request, tmp_path, monkeypatch) -> Path:
    """A cache that nobody can write, not even root."""
    file = tmp_path / "file"
    file.touch()
    if request.param == "unknown home":
        monkeypatch.delenv(VARIABLE, raising=False)
        monkeypatch.setattr(os.path, "expanduser", lambda path: path)
        return Path("~/.cache")
    cache = file if request.param == "a file" else file / "cache"
    monkeypatch.setenv(VARIABLE, str(cache))
    return cache


def test_another_place_is_found_and_told(unusable, temporary, monkeypatch, capsys):
    monkeypatch.setenv(VARIABLE, os.environ.get(VARIABLE, ""))  # restored after the test
    ensure_cache()
    ours = Path(os.environ[VARIABLE])
    assert ours.parent == temporary and ours.stat().st_mode & 0o777 == 0o700
    assert capsys.readouterr().err.startswith(f"note: {unusable} cannot be written")
    ensure_cache()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("kind", ["link", "open", "file"])
def test_a_place_that_others_may_write_is_not_used(kind, unusable, temporary):
    place = temporary / f"tribox-{os.getuid()}"
    if kind == "link":
        (temporary / "elsewhere").mkdir()
        place.symlink_to(temporary / "elsewhere")
    elif kind == "file":
        place.touch()
    else:
        place.mkdir()
        place.chmod(0o777)
    with pytest.raises(InputError, match=f"is not yours alone.*{VARIABLE}"):
        ensure_cache()


def test_check_goes_on_without_the_cache(
    tribox, case_file, block, environment, tmp_path, monkeypatch
):
    """What the usual cache holds is there already, but for a kernel that is soon compiled."""
    ours = tmp_path / f"tribox-{os.getuid()}" / "fenics"
    ours.mkdir(parents=True)
    ours.parent.chmod(0o700)
    for path in compiler_cache().glob("lib*"):
        if not path.name.startswith("libtribox_closest_points"):
            (ours / path.name).symlink_to(path)
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setitem(environment, VARIABLE, str(file / "cache"))
    monkeypatch.setitem(environment, "TMPDIR", str(tmp_path))
    done = tribox("check", case_file(block), process=True)
    assert done.returncode == 0, done.stderr
    assert "cannot be written: compiled forms go to" in done.stderr
    assert [path for path in ours.glob("libtribox_*") if not path.is_symlink()]
