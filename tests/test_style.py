"""Style and types of the sources, by the tools of the image."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

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
    assert told(sys.executable, "-m", "mypy", "--cache-dir", os.devnull) == ""


@pytest.mark.long
@pytest.mark.skipif(shutil.which("ruff") is None, reason="ruff is not installed")
@pytest.mark.parametrize("words", [("check", "--no-cache"), ("format", "--no-cache", "--check")])
def test_style_is_kept(words):
    assert told("ruff", *words, ".") == ""
