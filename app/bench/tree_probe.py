"""The probes of the tree that is on the path, run by a tree that compares itself with it.

``python TREE/app/bench/tree_probe.py REPORT CASE ...`` is given another tree's packages by
PYTHONPATH: the functions that :mod:`tribox.app.bench.probe` names are that tree's own. Left out is
the factorisation from scratch after the run, which is for the tables of one tree.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from typing import Any


def main() -> None:
    """Measure one command and write the report."""
    report, *case = sys.argv[1:]
    # The working directory is where the tree's packages are; older trees have no such package.
    inside = "tribox." if Path("tribox").is_dir() else ""
    probe: Any = importlib.import_module(f"{inside}app.bench.probe")
    stepping = f"{inside}app.explicit.stepper:ExplicitStepper.advance"
    probe.FRAME.setdefault(stepping, "rest of solver")
    probe.one_factorisation = lambda simulation: 0.0
    Path(report).write_text(json.dumps(probe.measure(case)), encoding="utf-8")


if __name__ == "__main__":
    main()
