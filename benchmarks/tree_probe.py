"""The probes of the tree that is on the path, run by a tree that compares itself with it.

``python tree_probe.py TREE/benchmarks/probe.py REPORT CASE ...`` is given another tree's packages
by PYTHONPATH: the functions that its probes name are that tree's own. Left out is the factorisation
from scratch after the run, which is for the tables of one tree.
"""

from __future__ import annotations

import json
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path


def main() -> None:
    """Measure one command and write the report."""
    file, report, *case = sys.argv[1:]
    spec = spec_from_file_location("tree_s_probe", file)
    assert spec is not None and spec.loader is not None
    probe = sys.modules["tree_s_probe"] = module_from_spec(spec)
    spec.loader.exec_module(probe)
    probe.FRAME.setdefault("tribox.app.explicit.stepper:ExplicitStepper.advance", "rest of solver")
    probe.one_factorisation = lambda simulation: 0.0
    Path(report).write_text(json.dumps(probe.measure(case)), encoding="utf-8")


if __name__ == "__main__":
    main()
