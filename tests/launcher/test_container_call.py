"""How the launcher starts the container, and what comes out of it."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.launcher.stand_ins import ENGINE, ROOT, Machine, image_of, values


def test_arguments_reach_the_program_unchanged(docker: Machine) -> None:
    words = ["run", "a b", 'c"d', "$HOME", "e'f", "", "*", "--set", "x=1e13 Pa/m"]
    docker.launch(*words)
    call = docker.container()
    assert call[call.index(image_of(call)) + 1 :] == words


def test_the_program_reads_checkout_and_working_directory(docker: Machine, tmp_path: Path) -> None:
    working = tmp_path / "some where"
    working.mkdir()
    docker.launch("check", "x.toml", cwd=working)
    call = docker.container()
    assert values(call, "--workdir") == [str(working)]
    assert values(call, "--volume") == [f"{docker.checkout}:/tribox:ro", f"{working}:{working}:ro"]
    assert f"TRIBOX_RESULTS={working}/results" in values(call, "--env")
    assert {"NO_COLOR", "PYTEST_ADDOPTS", "TRIBOX_CFLAGS"} <= set(values(call, "--env"))


def test_trusted_directories_reach_the_program_without_links(
    docker: Machine, tmp_path: Path
) -> None:
    (tmp_path / "own cases").mkdir()
    (tmp_path / "link").symlink_to("own cases")
    docker.launch("check", "x.toml", TRIBOX_TRUST=f"{tmp_path}/link:relative:/not/there/*")
    said = f"TRIBOX_TRUST={tmp_path}/own cases:relative:/not/there/*"
    assert said in values(docker.container(), "--env")


@pytest.mark.parametrize("engine", ["docker", "podman"])
def test_every_container_is_tight(docker: Machine, engine: str) -> None:
    docker.install("podman", ENGINE)
    docker.launch("run", "cases/sfa.toml", TRIBOX_ENGINE=engine)
    for call in [call for call in docker.calls_of("run") if call[0] == engine]:
        assert values(call, "--network") == ["none"]
        assert values(call, "--cap-drop") == ["all"]
        assert "no-new-privileges" in values(call, "--security-opt")
        assert "--read-only" in call
        assert not {"--privileged", "--cap-add", "--device"} & set(call)
    # Podman limits the number of processes for root, and elsewhere with cgroups of version 2.
    version_2 = Path("/sys/fs/cgroup/cgroup.controllers").exists()
    if engine == "docker" or os.getuid() == 0 or version_2:
        assert values(docker.container(), "--pids-limit") == ["4096"]


def test_files_are_made_as_the_caller(docker: Machine) -> None:
    docker.launch("run", "cases/sfa.toml")
    assert values(docker.container(), "--user") == [f"{os.getuid()}:{os.getgid()}"]
    docker.launch("run", "cases/sfa.toml", SECURITY="name=seccomp name=rootless")
    assert values(docker.container(), "--user") == ["0:0"]


@pytest.mark.parametrize("status", ["0", "2", "3", "130"])
def test_exit_code_is_the_programs(docker: Machine, status: str) -> None:
    assert docker.launch("run", "cases/sfa.toml", RUN_STATUS=status).returncode == int(status)


def test_a_reader_that_leaves_does_not_end_the_container(docker: Machine) -> None:
    lines = "yes 'a line' | head -n 100000"
    docker.install("docker", ENGINE.replace('exit "${RUN_STATUS:-0}"', lines + " || exit 126"))
    command = f"'{docker.checkout}/tribox' schema; echo $? >&2"
    done = subprocess.run(
        ["/bin/sh", "-c", f"{{ {command}; }} | head -n 1"],
        env=docker.environment,
        cwd=docker.checkout,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (done.stdout, done.stderr) == ("a line\n", "0\n")


def test_output_comes_whole_and_apart(docker: Machine) -> None:
    script = "seq 100000; echo problem >&2; exit 3"
    docker.install("docker", ENGINE.replace('exit "${RUN_STATUS:-0}"', script))
    done = docker.launch("schema")
    assert done.returncode == 3
    assert done.stdout.split() == [str(n) for n in range(1, 100001)]
    assert done.stderr == "problem\n"


# -- The image's entry: whoever owns the results, and where caches go ------------------------------


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
