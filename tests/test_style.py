"""Style and types of the sources, by the tools of the image."""

from __future__ import annotations

import os
import re
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
        command, cwd=ROOT, capture_output=True, text=True, timeout=LIMIT, check=False
    )
    return "" if done.returncode == 0 else (done.stdout + done.stderr)[-3000:]


@pytest.mark.long
@pytest.mark.skipif(find_spec("mypy") is None, reason="mypy is not installed")
def test_types_are_right(tmp_path):
    assert told(sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path)) == ""


@pytest.mark.long
@pytest.mark.skipif(shutil.which("ruff") is None, reason="ruff is not installed")
@pytest.mark.parametrize("words", [("check", "--no-cache"), ("format", "--no-cache", "--check")])
def test_style_is_kept(words):
    assert told("ruff", *words, ".") == ""


# What pip does in the place of ruff: installs one that fails at the words given, or fails itself.
PIP = """#!/bin/sh
[ {fails} != pip ] || exit 1
while [ "$1" != --target ]; do shift; done
mkdir "$2/bin"
printf '#!/bin/sh\\necho ruff "$*" >>"{told}"\\n[ "$1" != {fails} ]\\n' >"$2/bin/ruff"
chmod +x "$2/bin/ruff"
"""


@pytest.mark.parametrize(
    ("fails", "code", "ran"),
    [
        ("nothing", 0, ["ruff check", "ruff format", "test --all"]),
        ("format", 1, ["ruff check", "ruff format"]),
        ("pip", 0, ["test --all"]),
    ],
)
def test_continuous_integration_checks_the_style_where_it_can(tmp_path, fails, code, ran):
    (pinned,) = re.findall(r'"(ruff==[\d.]+)"', (ROOT / "pyproject.toml").read_text("utf-8"))
    assert f"pip install {pinned}\n" in (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    (tmp_path / ".ci").mkdir()
    for name in (".ci/run", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path / name)
    told = tmp_path / "told"
    pip = PIP.format(told=told, fails=fails)
    for path, text in (("python3", pip), ("tribox", f'#!/bin/sh\necho "$*" >>"{told}"\n')):
        (tmp_path / path).write_text(text)
        (tmp_path / path).chmod(0o755)
    done = subprocess.run(
        ["bash", ".ci/run"],
        cwd=tmp_path,
        env=os.environ | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    lines = told.read_text().splitlines()
    assert [" ".join(line.split()[:2]) for line in lines] == ran
    assert ("style is not checked" in done.stdout) is (fails == "pip")
