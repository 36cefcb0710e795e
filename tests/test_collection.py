"""pytest finds every test: a directory it passes over would go unnoticed."""

import ast
from pathlib import Path

import hypothesis
import pytest

TESTS = Path(__file__).parent


class Finder:
    """Notes the files that pytest comes to, whatever it then makes of them."""

    def __init__(self) -> None:
        self.files: set[Path] = set()

    def pytest_collect_file(self, file_path: Path) -> None:
        self.files.add(file_path)


def holds_tests(path: Path) -> bool:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    return any(isinstance(n, functions) and n.name.startswith("test_") for n in tree.body)


def test_every_test_file_is_collected(pytestconfig):
    finder = Finder()
    words = ["--collect-only", "--noconftest", "-p", "no:python", "-p", "no:cacheprovider"]
    words += ["-c", str(pytestconfig.inipath), f"--rootdir={pytestconfig.rootpath}"]
    pytest.main([*words, str(TESTS)], plugins=[finder])
    there = {path for path in TESTS.rglob("*.py") if holds_tests(path)}
    assert len(there) > 90
    assert there - finder.files == set()
    misnamed = {path.name for path in there if not path.name.startswith("test_")}
    assert misnamed == set()


def test_examples_are_the_same_every_time(pytestconfig):
    """Unless others are asked for."""
    if pytestconfig.getoption("--hypothesis-profile", default=None):
        pytest.skip("other examples are asked for")
    settings = hypothesis.settings()
    assert settings.derandomize and settings.deadline is None
