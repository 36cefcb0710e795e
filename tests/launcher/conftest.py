"""Machines with stand-ins for the container engines."""

import shutil
from pathlib import Path

import pytest

from tests.launcher.stand_ins import ABSENT, ENGINE, ROOT, SOURCES, Machine


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    made = Machine(tmp_path / "home", tmp_path / "check out", tmp_path / "bin", tmp_path / "state")
    for directory in (made.home, made.checkout, made.bin, made.state / "images"):
        directory.mkdir(parents=True)
    for name in ("tribox", "Dockerfile", ".dockerignore"):
        shutil.copy(ROOT / name, made.checkout)
    shutil.copytree(ROOT / "docker", made.checkout / "docker")
    for name in (*SOURCES, "app/cli.py", "cases/sfa.toml"):
        (made.checkout / name).parent.mkdir(parents=True, exist_ok=True)
        (made.checkout / name).write_text("title = 'a'\n")
    for name in ("python3", "apt-get", "apt-config"):
        made.install(name, ABSENT)
    made.environment = {
        "PATH": f"{made.bin}:/usr/bin:/bin",
        "HOME": str(made.home),
        "STATE": str(made.state),
    }
    return made


@pytest.fixture
def docker(machine: Machine) -> Machine:
    """A machine with a Docker engine and all images."""
    machine.install("docker", ENGINE)
    machine.launch("check", PULL_WORKS="yes")
    return machine
