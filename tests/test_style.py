"""Style and types of the sources, by the tools of the image."""

import inspect
import os
import pkgutil
import shutil
import subprocess
import sys
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType

import pytest

import tribox
from tests.ranks import LIMIT

ROOT = Path(__file__).parents[1]


def told(*command: str) -> str:
    """What a command prints where it fails."""
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=3 * LIMIT, check=False
    )
    return "" if done.returncode == 0 else (done.stdout + done.stderr)[-3000:]


@pytest.mark.long
@pytest.mark.skipif(find_spec("mypy") is None, reason="mypy is not installed")
def test_types_are_right():
    # It never frees what it reads: looking for what to free takes a seventh of its time.
    check = "import gc; gc.disable(); from mypy.__main__ import console_entry; console_entry()"
    assert told(sys.executable, "-c", check, "--cache-dir", os.devnull) == ""


@pytest.mark.long
@pytest.mark.skipif(shutil.which("ruff") is None, reason="ruff is not installed")
@pytest.mark.parametrize("words", [("check", "--no-cache"), ("format", "--no-cache", "--check")])
def test_style_is_kept(words):
    assert told("ruff", *words, ".") == ""


METHODS = FunctionType, classmethod, staticmethod, property, cached_property


def test_every_public_method_says_what_it_does_or_overrides_one_that_does():
    silent = []
    for found in pkgutil.walk_packages(tribox.__path__, "tribox."):
        if found.name.endswith("__main__"):
            continue
        for name, kind in inspect.getmembers(import_module(found.name), inspect.isclass):
            if kind.__module__ != found.name or name.startswith("_"):
                continue
            own = (key for key, one in vars(kind).items() if isinstance(one, METHODS))
            for key in (key for key in own if not key.startswith("_")):
                said = [vars(above)[key].__doc__ for above in kind.__mro__ if key in vars(above)]
                if not any(said):
                    silent.append(f"{found.name}.{name}.{key}")
    assert silent == []
