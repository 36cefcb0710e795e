"""Which engine the launcher takes, what it installs and what it keeps."""

import contextlib
import os
import pty
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.launcher.stand_ins import ABSENT, ENGINE, Machine, values


def test_python_with_dolfinx_comes_first(docker: Machine) -> None:
    docker.install(
        "python3",
        "#!/bin/sh\n"
        'if [ "$1" = -c ]; then exit 0; fi\n'
        'printf "%s\\n" "$PYTHONPATH" "$PWD" "$@"\n'
        "exit 3\n",
    )
    before = len(docker.calls())
    done = docker.launch("run", "a b", cwd=docker.home, PYTHONPATH="/other")
    assert done.returncode == 3
    assert done.stdout.splitlines() == [
        f"{docker.checkout}/src:/other",
        str(docker.home),
        *("-m", "tribox", "run", "a b"),
    ]
    assert len(docker.calls()) == before


def test_podman_is_used_where_docker_does_not_answer(machine: Machine) -> None:
    machine.install("docker", "#!/bin/sh\nexit 1\n")
    machine.install("podman", ENGINE)
    machine.launch("run", "cases/sfa.toml", PULL_WORKS="yes")
    call = machine.container()
    assert call[0] == "podman"
    # The caller is an ordinary user in there, by a map of user ids.
    if os.getuid() == 0:
        assert values(call, "--user") == ["1000:1000"]
        assert "1000:0:1" in values(call, "--uidmap")
    else:
        assert values(call, "--userns") == ["keep-id"]


def test_options_podman_needs_are_found_once(machine: Machine) -> None:
    machine.install("podman", ENGINE)
    machine.environment |= {"TRIBOX_ENGINE": "podman", "PULL_WORKS": "yes"}
    machine.environment["NEEDS"] = "--ulimit nofile="
    machine.launch("check")
    trials = len(machine.calls_of("--entrypoint"))
    assert trials == 2
    assert values(machine.container(), "--ulimit")[0].startswith("nofile=")
    machine.launch("check")
    assert len(machine.calls_of("--entrypoint")) == trials
    assert values(machine.container(), "--ulimit")[0].startswith("nofile=")


@pytest.mark.parametrize(
    "words", ["--privileged", "limits --volume=/:/host", "limits *", "", "$(touch made)"]
)
def test_options_of_podman_are_known_words_only(machine: Machine, words: str) -> None:
    machine.install("podman", ENGINE)
    machine.environment |= {"TRIBOX_ENGINE": "podman", "PULL_WORKS": "yes"}
    machine.launch("check")
    kept = machine.home / ".cache/tribox/podman-words"
    key, good = kept.read_text().splitlines()
    kept.write_text(f"{key}\n{words}\n")
    machine.launch("check")
    assert not {"--privileged", "--volume=/:/host"} & set(machine.container())
    if words:
        assert kept.read_text().splitlines() == [key, good]


def test_podman_that_runs_nothing_is_reported(machine: Machine) -> None:
    machine.install("podman", ENGINE)
    done = machine.launch(
        "check", TRIBOX_ENGINE="podman", PULL_WORKS="yes", NEEDS="what nobody offers"
    )
    assert done.returncode == 2
    assert "podman cannot run a container here" in done.stderr


def bare_path(machine: Machine) -> str:
    """A search path with what every Unix has, and no way to run the program."""
    for name in (
        *("cat", "chmod", "cut", "date", "dirname", "find", "grep", "id", "mkdir", "mktemp"),
        *("readlink", "rm"),
    ):
        found = shutil.which(name, path="/usr/bin:/bin")
        assert found
        (machine.bin / name).symlink_to(found)
    return str(machine.bin)


def test_without_any_way_there_is_one_clear_line(machine: Machine) -> None:
    (machine.bin / "apt-get").unlink()
    done = machine.launch("run", "cases/sfa.toml", PATH=bare_path(machine))
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "neither a python3 with DOLFINx, nor a running Docker engine" in done.stderr


def installing(machine: Machine, answer: str | None, **environment: str) -> tuple[int, str]:
    """Exit code and what is said where Podman has to be installed, on a terminal if answered."""
    path = bare_path(machine)
    machine.install("env", '#!/bin/sh\nshift\nexec "$@"\n')
    machine.install("tail", '#!/bin/sh\nexec /usr/bin/tail "$@"\n')
    machine.install(
        "apt-get",
        '#!/bin/sh\n{ printf "%s\\n" apt-get "$@"; echo =====; } >>"$STATE/calls"\nexit 1\n',
    )
    if answer is None:
        done = machine.launch("run", "cases/sfa.toml", PATH=path, **environment)
        return done.returncode, done.stderr
    master, terminal = pty.openpty()
    os.write(master, answer.encode())
    done = subprocess.run(
        ["/bin/sh", str(machine.checkout / "tribox"), "run", "cases/sfa.toml"],
        env={**machine.environment, "PATH": path, **environment},
        cwd=machine.checkout,
        stdin=terminal,
        stdout=subprocess.PIPE,
        stderr=terminal,
        timeout=300,
    )
    os.close(terminal)
    said = b""
    with contextlib.suppress(OSError):  # the end of a terminal
        while part := os.read(master, 10000):
            said += part
    os.close(master)
    return done.returncode, said.decode()


as_root = pytest.mark.skipif(os.getuid() != 0, reason="only root installs packages")


@as_root
@pytest.mark.parametrize(
    ("answer", "environment"),
    [(None, {}), ("\n", {}), ("y\n", {}), ("", {"CI": "true"})],
    ids=["no terminal", "Enter", "yes", "nobody there"],
)
def test_podman_is_installed_after_saying_so(
    machine: Machine, answer: str | None, environment: dict[str, str]
) -> None:
    code, said = installing(machine, answer, **environment)
    assert code == 2
    assert "installing podman runc mmdebstrap debian-archive-keyring with apt-get, as root" in said
    assert ("go on? [Y/n]" in said) == (answer not in (None, ""))
    assert "apt-get could not install podman" in said.splitlines()[-1]
    assert machine.calls_of("apt-get", "install", "podman", "runc", "mmdebstrap")


@as_root
@pytest.mark.parametrize("answer", ["n\n", "what?\n", "\x04"])
def test_nothing_is_installed_against_the_users_will(machine: Machine, answer: str) -> None:
    code, said = installing(machine, answer)
    assert code == 2
    assert "nothing was installed" in said.splitlines()[-1]
    assert not machine.calls_of("apt-get")


@pytest.mark.parametrize("engine", ["kubernetes", "docker", "podman", "python"])
def test_engine_that_is_not_there_is_named(machine: Machine, engine: str) -> None:
    done = machine.launch("check", PATH=bare_path(machine), TRIBOX_ENGINE=engine)
    assert done.returncode == 2
    assert done.stderr.startswith(f"tribox: TRIBOX_ENGINE={engine}")
    assert done.stderr.count("\n") == 1


def test_kept_options_of_others_are_not_used(machine: Machine) -> None:
    machine.install("podman", ENGINE)
    machine.environment |= {"TRIBOX_ENGINE": "podman", "PULL_WORKS": "yes"}
    machine.launch("check")
    good = (machine.home / ".cache/tribox/podman-words").read_text()
    trials = len(machine.calls_of("--entrypoint"))
    # A directory that everybody can write, where one used to be looked for without HOME.
    shared = machine.state / "shared"
    (shared / "tribox").mkdir(parents=True)
    (shared / "tribox").chmod(0o777)
    (shared / "tribox/podman-words").write_text(good)
    done = machine.launch("check", XDG_CACHE_HOME=str(shared))
    assert done.returncode == 0
    assert f"{shared}/tribox is not yours, or others can write it" in done.stderr
    assert len(machine.calls_of("--entrypoint")) == trials + 1
    assert os.listdir(shared / "tribox") == ["podman-words"]


def test_directory_that_can_be_exchanged_is_not_used(machine: Machine) -> None:
    machine.install("docker", ENGINE)
    shared = machine.state / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    machine.launch("check", PULL_WORKS="yes", XDG_CACHE_HOME=str(shared))
    assert not (shared / "tribox/setup.log").exists()
    shared.chmod(0o1777)
    machine.launch("check", TRIBOX_BASE="b", XDG_CACHE_HOME=str(shared))
    assert (shared / "tribox").stat().st_mode & 0o077 == 0


def test_without_a_home_nothing_in_a_shared_directory_is_used(machine: Machine) -> None:
    machine.install("podman", ENGINE)
    machine.install("getent", ABSENT)
    machine.environment |= {"TRIBOX_ENGINE": "podman", "PULL_WORKS": "yes"}
    del machine.environment["HOME"]
    shared, own = Path("/tmp/.cache/tribox"), machine.state / "tmp"
    own.mkdir()
    before = shared.exists()
    done = machine.launch("check", TMPDIR=str(own))
    # What was kept by an earlier call would be there to be read again.
    machine.launch("check", TMPDIR=str(own))
    assert done.returncode == 0
    assert shared.exists() == before
    assert os.listdir(own) == []
    assert len(machine.calls_of("--entrypoint")) == 2
