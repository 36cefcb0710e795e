"""The command line on several ranks: it starts them, and they fail and stop together."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.app.conftest import BLOCK, FILM
from tests.ranks import command
from tribox.app.build.model import build_model, failures_as
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError, SolutionError, TriboxError
from tribox.app.results.reading import read_table
from tribox.app.run.building import notes_on_building
from tribox.app.simulation.history import PHYSICAL
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

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


def refused(comm, directory):
    """Run the small block into a directory that holds something else."""
    path, out = directory / "block.toml", directory / "out"
    if comm.rank == 0:
        path.write_text(BLOCK, encoding="utf-8")
        out.mkdir()
        (out / "mine.txt").write_text("mine")
    comm.barrier()
    codes, said = command(comm, "run", path, "--out", out)
    return codes, said, [p.name for p in out.iterdir()]


@pytest.mark.mpi(refused, 2)
def test_ranks_refuse_together_with_one_line(on_ranks):
    codes, said, there = on_ranks(refused, 2)
    [line] = [line for line in said.splitlines() if line.startswith("tribox: ")]
    assert codes == [2, 2] and "--force" in line and there == ["mine.txt"]


# -- Values that are allowed one by one and come to nothing together: one line, on all ranks -------

EXPLICIT = (
    BLOCK.replace("nu = 0.45", 'nu = 0.45\ndensity = "1100 kg/m^3"')
    .replace("nu = 0.33", 'nu = 0.33\ndensity = "2700 kg/m^3"')
    .replace('"2 s"', '"2e-5 s"')
    .replace('"1 s"', '"1e-5 s"')
    + '[solver]\nkind = "explicit"\n'
)
FOLDED = EXPLICIT.replace('["0 s", "0 mm"]', '["0 s", "-0.6 mm"]')
HARD = ["contact.0.penalty=3e200"]


def end(path, comm, overrides=()):
    """How building and running a case end: kind of the error and its line."""
    try:
        Simulation(build_model(load_case(path, overrides), comm)).run(Observer())
    except TriboxError as error:
        return [type(error).__name__, str(error)]
    return ["", ""]


def ends(comm, directory):
    """The ends on these ranks, of all of them."""
    texts = {"folded": FOLDED, "hard": EXPLICIT, "film": FILM}
    if comm.rank == 0:
        for name, text in texts.items():
            (directory / f"{name}.toml").write_text(text)
    comm.barrier()
    found = [
        end(directory / "folded.toml", comm),
        end(directory / "hard.toml", comm, HARD),
        end(directory / "film.toml", comm, ["contact.0.friction.V_star=1e200"]),
        end(directory / "hard.toml", comm, ["bodies.elastomer.E=1e300", "solver.kind=implicit"]),
    ]
    assert len({str(one) for one in comm.allgather(found)}) == 1
    return found


@pytest.mark.mpi(ends, 2)
def test_a_start_that_cannot_be_is_wrong_input_on_all_ranks(on_ranks):
    for folded, hard, film, stiff in (on_ranks(ends, 1), on_ranks(ends, 2)):
        assert folded[0] == "InputError"
        assert folded[1].startswith("the start: an element has been turned inside out at (")
        assert {hard[0], film[0], stiff[0]} <= {"InputError", "SolutionError"}
        assert all(said.isprintable() for _, said in (folded, hard, film, stiff))


def test_check_says_so_too(case_file):
    with pytest.raises(InputError, match="the start: an element has been turned inside out"):
        notes_on_building(load_case(case_file(FOLDED)))
    with pytest.raises(InputError):
        notes_on_building(load_case(case_file(EXPLICIT), HARD))


def test_numbers_out_of_range_are_one_line_and_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with failures_as(SolutionError, "here"):
            np.float64(1e300) ** 2
    for failure in (
        lambda: 1e300**2,
        lambda: np.linalg.eigvals(np.full((2, 2), np.nan)),
        lambda: 1.0 / 0.0,
    ):
        with pytest.raises(SolutionError, match=r"^here: numbers out of range") as caught:
            with failures_as(SolutionError, "here"):
                failure()
        assert str(caught.value).isprintable()
    with pytest.raises(InputError, match="not enough memory"), failures_as(InputError, "here"):
        np.empty(1 << 50)
