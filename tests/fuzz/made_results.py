"""Good results directories for the fuzzer to damage: of a run, of a sweep, and made by hand."""

import json
import shutil
from pathlib import Path

from tests.app.conftest import BLOCK
from tests.app.figures.made_results import write_strip
from tribox.app.case.reading import load_case
from tribox.app.results.directory import write_json, write_table, write_text
from tribox.app.simulation.history import COLUMNS

PROBES = """
[[probe]]
name = "under"
point = ["1 mm", "-0.1 mm"]
[[probe]]
name = "block"
body = "elastomer"
[[probe]]
name = "interface"
contact = "elastomer_contact-aluminium_contact"
"""
SWEEP = '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, "20 %"]\n'


def good_directories(work: Path) -> tuple[Path, ...]:
    """Directories as a run, a sweep and a hand-made series leave them; made once in ``work``."""
    top = work / "good"
    if not top.is_dir():
        run, sweep, strip = top / "run", top / "sweep", top / "strip"
        _make_run(run)
        _make_sweep(sweep, run)
        write_strip(strip)
    return tuple(sorted(top.iterdir()))


def _make_run(directory: Path) -> None:
    from tribox.app.run.run import run_case

    text = BLOCK.replace("steps = 6", "steps = 2").replace("[10, 5]", "[4, 2]")
    directory.mkdir(parents=True)
    case_file = directory.parent / "case.toml"
    case_file.write_text(text.replace("[15, 4]", "[7, 2]") + PROBES)
    run_case(load_case(case_file), directory, quiet=True)
    case_file.unlink()


def _make_sweep(directory: Path, run: Path) -> None:
    directory.mkdir()
    write_text(directory / "case.toml", BLOCK + SWEEP)
    sweep = load_case(directory / "case.toml").sweep
    assert sweep is not None
    rows, parts = [], {}
    for label, value in zip(sweep.labels, (0.1, 0.2), strict=True):
        shutil.copytree(run, directory / label)
        summary = json.loads((run / "summary.json").read_text())
        parts[label] = {"status": "done", "warnings": [], "steps": 5, "newton_iterations": 9}
        for row in summary["load_steps"]:
            rows.append([label, value, -1, *(row[name] for name in COLUMNS)])
    write_table(directory / "sweep.csv", ("label", "value", "steady", *COLUMNS), rows)
    write_json(directory / "summary.json", {"title": "", "status": "done", "parts": parts})
