"""How the launcher starts the container, and what comes out of it."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.launcher.stand_ins import ENGINE, Machine, image_of, values


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
