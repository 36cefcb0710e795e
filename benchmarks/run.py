"""Runs of the repository's cases, for the tables of the documentation.

Where their time goes is measured by ``tribox bench``.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks import comparison
from benchmarks.bench import DEFAULT_CASE, ROOT
from tribox.app.case.reading import load_case

__all__ = ["ROOT", "level_options", "tribox"]


def level_options(level: int) -> list[str]:
    """Options of ``tribox run`` that refine the block-slide problem ``level`` times."""
    return comparison.level_options(load_case(DEFAULT_CASE), level)


def tribox(case: str, out: Path, options: Sequence[str]) -> None:
    """Run a case of the repository into ``out``.

    Raises:
        subprocess.CalledProcessError: the run failed.
    """
    command = [sys.executable, "-m", "tribox", "run", f"cases/{case}.toml", "--out", str(out)]
    subprocess.run([*command, *options], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
