"""How the launcher makes the image: once, from what it is made from, on what base."""

import shutil

import pytest

from tests.launcher.stand_ins import (
    COPIES,
    ENGINE,
    MMDEBSTRAP,
    ROOT,
    SOURCES,
    Machine,
    image_of,
    values,
)


def test_image_is_made_once(docker: Machine) -> None:
    assert len(docker.calls_of("build")) == 1
    done = docker.launch("run", "cases/sfa.toml")
    assert len(docker.calls_of("build")) == 1
    assert done.stderr == ""
    build = docker.calls_of("build")[0]
    assert "BASE=docker.io/library/debian:trixie-slim" in values(build, "--build-arg")
    assert build[-1] == str(docker.checkout)


@pytest.mark.parametrize(
    ("name", "rebuilt"),
    [
        ("Dockerfile", True), ("docker/entry", True), *((source, True) for source in SOURCES),
        ("app/cli.py", False), ("cases/sfa.toml", False),
    ],
)  # fmt: skip
def test_only_dependencies_and_forms_rebuild_it(docker: Machine, name: str, rebuilt: bool) -> None:
    docker.launch("check")
    before = image_of(docker.container())
    with (docker.checkout / name).open("a") as stream:
        stream.write("# changed\n")
    docker.launch("check")
    assert (image_of(docker.container()) != before) == rebuilt
    assert len(docker.calls_of("build")) == 1 + rebuilt


@pytest.mark.parametrize("name", ["app/precompile.py", "geometry", ".dockerignore"])
def test_a_source_of_the_image_that_is_missing_is_named(docker: Machine, name: str) -> None:
    path, builds = docker.checkout / name, docker.calls_of("build")
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    done = docker.launch("check")
    assert done.returncode == 2
    assert f"{name} is missing; the image is made from it" in done.stderr
    assert docker.calls_of("build") == builds


def test_every_source_of_the_image_is_in_the_checkout() -> None:
    copied = [line.split()[1:-1] for line in COPIES if line.split()[1:-1] != ["."]]
    assert {source for sources in copied for source in sources} > {"forms", "docker/entry"}
    for source in (source for sources in copied for source in sources):
        assert (ROOT / source).exists(), source


def test_failed_build_is_one_line_and_the_log(machine: Machine) -> None:
    machine.install("docker", ENGINE)
    done = machine.launch("check", PULL_WORKS="yes", BUILD_STATUS="1")
    assert done.returncode == 2
    assert "tribox: the image could not be built (all of it: " in done.stderr.splitlines()[-1]
    assert not [call for call in machine.calls_of("run") if "--workdir" in call]


def test_base_that_cannot_be_pulled_is_made(machine: Machine) -> None:
    machine.install("docker", ENGINE)
    machine.install("mmdebstrap", MMDEBSTRAP)
    assert machine.launch("check").returncode == 0
    assert len(machine.calls_of("mmdebstrap")) == 1
    assert values(machine.calls_of("import")[0], "import")
    base = "BASE=localhost/tribox-base:trixie"
    assert base in values(machine.calls_of("build")[0], "--build-arg")
    # The next image is built on the same one.
    (machine.checkout / "forms/bodies/solid.py").write_text("# other forms\n")
    machine.launch("check")
    assert len(machine.calls_of("mmdebstrap")) == 1
    assert base in values(machine.calls_of("build")[1], "--build-arg")


def test_base_of_the_users_choice(machine: Machine) -> None:
    machine.install("docker", ENGINE)
    machine.launch("check", TRIBOX_BASE="my/base:1")
    assert "BASE=my/base:1" in values(machine.calls_of("build")[0], "--build-arg")
    assert not machine.calls_of("pull")


def test_proxy_reaches_the_build(machine: Machine) -> None:
    machine.install("docker", ENGINE)
    machine.install("apt-config", "#!/bin/sh\necho 'Acquire::http::Proxy \"http://p:1\";'\n")
    machine.launch("check", PULL_WORKS="yes", https_proxy="http://q:2")
    arguments = values(machine.calls_of("build")[0], "--build-arg")
    assert 'APT_OPTIONS=Acquire::http::Proxy "http://p:1";' in arguments
    assert "https_proxy=http://q:2" in arguments
