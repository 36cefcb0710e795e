"""The benchmark scripts: what they read from a summary, and that one run goes through them."""

import json
import os
import re
from pathlib import Path

import pytest

from benchmarks.run import PARTS, Measured, level_options, read, tables, tribox

ROOT = Path(__file__).parents[1]


def measured() -> Measured:
    seconds = {part: 1.0 for part in PARTS} | {"run": 10.0, "command": 12.0, "CPU": 11.0}
    return Measured("a run", 100, 4, 5, 20, seconds, 50.0)


def test_a_level_refines_both_blocks():
    assert level_options(2)[1::2] == [
        "geometry.upper.elements=[80, 40]",
        "geometry.lower.elements=[122, 30]",
    ]


def test_level_one_is_the_case_as_it_is():
    case = (ROOT / "cases" / "block-slide.toml").read_text(encoding="utf-8")
    counts = re.findall(r"elements = (\[.*?\])", case)
    assert [option.split("=")[1] for option in level_options(1)[1::2]] == counts


def test_tables_give_shares_of_the_run_and_iterations_per_step():
    first, second = "\n".join(tables([measured()])).split("\n\n")
    assert first.splitlines()[-1] == "| a run | 100 | 4 | 5 | 20 | 5.00 | 12.0 | 11.0 | 50 |"
    cells = [cell.strip() for cell in second.splitlines()[-1].strip("|").split("|")]
    assert cells[2:-2] == ["10 %"] * len(PARTS) + ["40 %"]
    assert cells[-2:] == ["500.0", "1.00"]
    assert len(cells) == len(second.splitlines()[1].strip("|").split("|"))


@pytest.mark.slow
def test_parts_of_a_real_run_add_up_to_less_than_the_run(tmp_path, monkeypatch):
    # What MPI, once started here, has put into the environment must not reach another process.
    for name in [*os.environ]:
        if name.startswith(("PMIX_", "OMPI_COMM_WORLD", "OMPI_UNIVERSE", "PMI_")):
            monkeypatch.delenv(name)
    out = tmp_path / "block"
    options = ["--set", "stage.0.steps=4", "--set", "output.figures=false"]
    options += [
        "--set",
        "geometry.upper.elements=[10, 5]",
        "--set",
        "geometry.lower.elements=[15, 4]",
    ]
    took = tribox("block-slide", out, options)
    run = read("block", out, took)
    assert run.steps == 34
    assert all(run.seconds[part] > 0.0 for part in PARTS if part != "pattern")
    assert 0.0 <= run.rest < run.seconds["run"] < run.seconds["command"]
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    used = {key for keys in PARTS.values() for key in keys} | {"run"}
    assert set(summary["seconds"]) <= used
