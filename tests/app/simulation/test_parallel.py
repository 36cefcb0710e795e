"""The command line on several ranks: it starts them, and they fail and stop together."""

import json
from pathlib import Path

import pytest

from tests.app.conftest import BLOCK
from tests.ranks import command
from tribox.app.results.directory import read_table
from tribox.app.simulation.history import PHYSICAL

SAME = 1e-9  # of each column's largest value, at a solver tolerance of 1e-11
TIGHT = ("--set", "solver.tolerance=1e-11")


def differences(mine: list[dict], theirs: list[dict]) -> dict[str, float]:
    """Largest difference in each physical column, relative to the column's largest value."""
    assert len(mine) == len(theirs)
    found = {}
    for name in PHYSICAL:
        largest = max(abs(row[name]) for row in theirs)
        apart = max(abs(a[name] - b[name]) for a, b in zip(mine, theirs, strict=True))
        found[name] = apart / largest if largest > 0.0 else apart
    return found


def run_block(comm, directory):
    """Run the small block by the command line; what it ends with and says, and its results."""
    path, out = directory / "block.toml", directory / "out"
    if comm.rank == 0:
        path.write_text(BLOCK, encoding="utf-8")
    comm.barrier()
    return [*command(comm, "run", path, "--out", out, *TIGHT), str(out)]


@pytest.mark.mpi(run_block, 3)
def test_np_starts_the_ranks_itself(tribox, on_ranks, case_file, block, tmp_path):
    path, histories = case_file(block), []
    for ranks, options in ((1, {}), (2, {"process": True})):
        out = tmp_path / f"{ranks}"
        words = ("--np", 2) if ranks == 2 else ()
        result = tribox("run", path, "--out", out, *TIGHT, *words, **options)
        assert result.returncode == 0, result.stderr
        assert json.loads((out / "summary.json").read_text())["ranks"] == ranks
        assert result.stdout.count("step    1 ") == 1
        histories.append(read_table(out / "history.csv"))
    codes, said, out = on_ranks(run_block, 3)
    assert codes in (3 * [0], 3 * [None]), said
    assert json.loads((Path(out) / "summary.json").read_text())["ranks"] == 3
    assert said.count("step    1 ") == 1
    histories.append(read_table(Path(out) / "history.csv"))
    for history in histories[1:]:
        apart = differences(history, histories[0])
        assert {k: v for k, v in apart.items() if v > SAME} == {}


@pytest.mark.mpi
def test_ranks_refuse_together_with_one_line(tribox, case_file, block, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    result = tribox("run", case_file(block), "--out", tmp_path / "out", ranks=2)
    assert result.returncode == 2
    said = [line for line in result.stderr.splitlines() if line.startswith("tribox: ")]
    assert len(said) == 1 and "--force" in said[0]
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["mine.txt"]


@pytest.mark.mpi
def test_ranks_give_up_together(tribox, case_file, film, tmp_path):
    """A platen that pulls the bodies apart: one line, and mpirun ends with the code."""
    text = film.replace('thickness = "1 mm"', 'thickness = "1 mm"\ngap = "1 um"', 1)
    text = text.replace('["1 s", "0.5 MPa"]', '["1 s", "-0.5 MPa"]')
    result = tribox(
        *("run", case_file(text), "--out", tmp_path / "out"),
        *("--set", "solver.min_step_fraction=0.6", "--set", "solver.max_iterations=5"),
        ranks=2,
    )
    assert result.returncode == 3
    said = [line for line in result.stderr.splitlines() if line.startswith("tribox: ")]
    assert len(said) == 1 and "no solution" in said[0]
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["status"] == "failed"
