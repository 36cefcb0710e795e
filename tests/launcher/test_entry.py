"""The image's entry: whoever owns the results, and where caches go."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.launcher.stand_ins import ROOT


def enter(
    directory: Path, name: str, *arguments: str, uid: int = 0, owner: int = 0, **environment: str
) -> list[str]:
    """What the entry called ``name`` starts, with /results owned by ``owner``."""
    directory.mkdir(exist_ok=True)
    entry = directory / name
    shutil.copy(ROOT / "docker/entry", entry)
    report = '#!/bin/sh\nprintf "%s\\n" "${0##*/}" "$TRIBOX_RESULTS" "$@"\nenv >"$0.env"\n'
    stand_ins = {
        "id": f"#!/bin/sh\necho {uid}\n",
        "stat": f"#!/bin/sh\ncase $2 in %u) echo {owner} ;; %g) echo 77 ;; esac\n",
        "mountpoint": "#!/bin/sh\nexit ${NOT_MOUNTED:-0}\n",
        "python3": report,
        "setpriv": report,
    }
    for command, script in stand_ins.items():
        (directory / command).write_text(script)
        (directory / command).chmod(0o755)
    done = subprocess.run(
        ["/bin/sh", str(entry), *arguments],
        cwd=directory,
        env={"PATH": f"{directory}:/usr/bin:/bin", "TRIBOX_RESULTS": "/results", **environment},
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    return done.stdout.splitlines()


def test_entry_becomes_the_owner_of_the_results(tmp_path: Path) -> None:
    started = enter(tmp_path / "x", "tribox", "run", "a b", owner=1234)
    assert started[:2] == ["setpriv", "/results"]
    assert started[2:] == [
        *("--reuid", "1234", "--regid", "77", "--clear-groups", "--"),
        *("python3", "-m", "tribox", "run", "a b"),
    ]


def test_entry_starts_all_ranks_as_the_owner(tmp_path: Path) -> None:
    started = enter(tmp_path / "x", "mpirun", "-n", "2", "tribox", owner=1234)
    assert started[-5:] == ["--", "/usr/bin/mpirun", "-n", "2", "tribox"]
    # A rank is what its mpirun is.
    assert enter(tmp_path / "x", "tribox", "run", owner=1234, PMIX_RANK="0")[0] == "python3"


@pytest.mark.parametrize(("uid", "owner"), [(0, 0), (1234, 1234), (1234, 0)])
def test_entry_stays_who_it_is_otherwise(tmp_path: Path, uid: int, owner: int) -> None:
    assert enter(tmp_path / "x", "tribox", "run", uid=uid, owner=owner)[0] == "python3"


def test_entry_without_results_mount_writes_where_it_is(tmp_path: Path) -> None:
    started = enter(tmp_path / "x", "tribox", "run", NOT_MOUNTED="1")
    assert started[1] == f"{tmp_path}/x/results"


def test_entry_leaves_tests_to_their_own_directories(tmp_path: Path) -> None:
    assert enter(tmp_path / "x", "tribox", "test")[1] == ""


@pytest.mark.skipif(os.getuid() == 0, reason="root can write anywhere")
def test_entry_makes_caches_where_the_image_cannot_be_written(tmp_path: Path) -> None:
    image, temporary = tmp_path / "image", tmp_path / "tmp"
    for directory in (image / "fenics", image / "matplotlib", temporary):
        directory.mkdir(parents=True)
    (image / "fenics/form.so").touch()
    image.chmod(0o555)
    enter(tmp_path / "x", "tribox", "run", uid=1, XDG_CACHE_HOME=str(image), TMPDIR=str(temporary))
    seen = dict(
        line.split("=", 1) for line in (tmp_path / "x/python3.env").read_text().splitlines()
    )
    caches = [Path(seen[name]) for name in ("XDG_CACHE_HOME", "MPLCONFIGDIR", "HOME")]
    assert all(temporary in cache.parents and os.access(cache, os.W_OK) for cache in caches)
    assert (caches[0] / "fenics/form.so").resolve() == image / "fenics/form.so"
