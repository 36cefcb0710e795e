"""What an installation with pip takes along: all packages, and the C sources beside them."""

import importlib
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
TOP = ("app", "forms", "geometry")


def project() -> dict:
    with (ROOT / "pyproject.toml").open("rb") as stream:
        return tomllib.load(stream)


def settings() -> dict:
    return project()["tool"]["setuptools"]


def test_the_command_of_an_installation_exists():
    module, _, name = project()["project"]["scripts"]["tribox"].partition(":")
    assert callable(getattr(importlib.import_module(module), name))


def test_every_directory_with_modules_is_a_package_that_is_found():
    wanted = [pattern for top in TOP for pattern in (top, f"{top}.*")]
    assert settings()["packages"]["find"]["include"] == wanted
    for top in TOP:
        for path in (ROOT / top).rglob("*.py"):
            assert (path.parent / "__init__.py").is_file(), path


def test_every_file_that_is_no_module_is_package_data():
    data = settings()["package-data"]
    for top in TOP:
        for path in (ROOT / top).rglob("*"):
            if path.is_file() and path.suffix not in (".py", ".pyc"):
                package = ".".join(path.relative_to(ROOT).parent.parts)
                assert any(path.match(pattern) for pattern in data[package]), path
