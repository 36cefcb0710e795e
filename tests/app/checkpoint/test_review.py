"""Runs that go on: what nobody thinks of at first."""

import hashlib
import json
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.app.checkpoint.going_on import as_killed, run, unlike
from tests.app.conftest import BLOCK
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.checkpoint.checkpointer import _sum
from tribox.app.checkpoint.same_case import changes
from tribox.app.errors import InputError, Interrupted
from tribox.app.results.inputs import write_case
from tribox.app.run.ranks import RunOptions
from tribox.app.run.run import Interruption
from tribox.app.run.sweep_runs import _to_run, collate

COARSE = {
    "geometry": {
        "kind": "two-blocks",
        "thickness": "1 mm",
        "upper": {"width": "1.0 mm", "height": "0.5 mm", "elements": [5, 3]},
        "lower": {"width": "2.0 mm", "height": "0.5 mm", "elements": [7, 2]},
    },
    "stage": [
        {"name": "press", "duration": "1 s", "steps": 2},
        {"name": "slide", "duration": "1 s", "steps": 3},
    ],
}
OUTPUT = {"figures": False, "fields_every": 0, "checkpoint_every": 1, "checkpoints_kept": 50}


def case_of(text: str = BLOCK, **tables: Any) -> Case:
    output = OUTPUT | tables.pop("output", {})
    return Case.model_validate(tomllib.loads(text) | COARSE | tables | {"output": output})


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> Path:
    """A run that is done, with a checkpoint of each step."""
    directory = tmp_path_factory.mktemp("done") / "out"
    run(case_of(), directory)
    return directory


# -- checkpoints that are not as they were written ----------------------------------------------


def damage_manifest(path: Path, about: Any) -> None:
    (path / "manifest.json").write_text(about if isinstance(about, str) else json.dumps(about))


def rewritten(path: Path, state: Any) -> None:
    """Put another state into a checkpoint, with a manifest that agrees."""
    about = json.loads((path / "manifest.json").read_text())
    (path / "state.json").write_text(json.dumps(state))
    content = (path / "state.json").read_bytes()
    about["files"]["state.json"] = {
        "bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    about.pop("sha256")
    damage_manifest(path, about | {"sha256": _sum(about)})


def test_a_run_whose_checkpoints_are_all_damaged_is_not_begun_anew(done, tmp_path):
    out = as_killed(done, tmp_path / "out", 2, running=True)
    for number in (1, 2):
        damage_manifest(out / "checkpoints" / f"{number:06d}", "{}")
    rows = (out / "history.csv").read_text()
    with pytest.raises(InputError, match=r"000002: is damaged .*begin anew with --force"):
        run(case_of(), out, resume=True)
    assert (out / "history.csv").read_text() == rows


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda tree: tree["simulation"].pop("runner"), "'runner' is missing"),
        (lambda tree: tree["simulation"].update(state=None), "NoneType"),
    ],
    ids=["no runner", "no state"],
)
def test_a_checkpoint_of_another_make_is_one_line(done, tmp_path, change, said):
    out = as_killed(done, tmp_path / "out", 1, running=True)
    path = out / "checkpoints" / "000001"
    tree = json.loads((path / "state.json").read_text())
    change(tree)
    rewritten(path, state=tree)
    with pytest.raises(InputError, match="not as this version of tribox writes it") as error:
        run(case_of(), out, resume=True)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("table", "change"),
    [
        ("history.csv", lambda text: text.replace("driven_displacement", "way", 1)),
        ("contacts.csv", lambda text: text.splitlines(keepends=True)[0]),
        ("bodies.csv", lambda text: "".join(text.splitlines(keepends=True)[:-1])),
        ("surfaces.csv", lambda text: ""),
    ],
    ids=["columns", "no rows", "one row less", "empty"],
)
def test_a_table_with_other_columns_or_missing_rows_is_refused(done, tmp_path, table, change):
    out = as_killed(done, tmp_path / "out", 5, running=True)
    path = out / table
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError, match=table):
        run(case_of(), out, resume=True)


def test_a_row_that_was_cut_off_in_the_middle_is_dropped(done, tmp_path):
    out = as_killed(done, tmp_path / "out", 2, running=True)
    path = out / "history.csv"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:3]) + "2,1.")
    run(case_of(), out, resume=True)
    assert path.read_text() == (done / "history.csv").read_text()


def test_probes_are_cut_back_before_the_run_goes_on(tmp_path, monkeypatch):
    probe = [{"name": "upper", "body": "elastomer"}]
    run(case_of(probe=probe), tmp_path / "whole")
    out = as_killed(tmp_path / "whole", tmp_path / "out", 2, running=True)
    (out / "probes.csv").touch()

    def stop(*_):
        raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(Interruption, "ready", stop)
        with pytest.raises(Interrupted):
            run(case_of(probe=probe), out, resume=True)
    path = out / "body_probes.csv"
    rows = path.read_text().splitlines()
    assert len(rows) == 3
    # As one that was written before a column came in.
    older = "".join(row.rpartition(",")[0] + "\n" for row in rows)
    path.write_text(older)
    dropped = rows[0].rpartition(",")[2]
    with pytest.raises(InputError, match=rf"body_probes\.csv: does not have .* \({dropped}\)"):
        run(case_of(probe=probe), out, resume=True)
    assert path.read_text() == older
    path.write_text("\n".join(rows) + "\n")
    run(case_of(probe=probe), out, resume=True)
    assert path.read_text() == (tmp_path / "whole" / "body_probes.csv").read_text()


# -- directories --------------------------------------------------------------------------------


def test_what_a_run_reads_is_not_cleared_where_it_cannot_go_on(tribox, case_file, tmp_path):
    """Of a directory that holds the case itself, and a checkpoint that was never whole."""
    out = tmp_path / "out"
    run(case_of(), out)
    shutil.rmtree(out / "checkpoints")
    (out / "checkpoints" / "000001.part").mkdir(parents=True)
    (out / "summary.json").write_text('{"status": "running"}')
    result = tribox("run", out / "case.toml", "--out", out, "--resume")
    assert result.returncode == 2 and "case.toml, which the run reads" in result.stderr
    assert (out / "case.toml").is_file() and (out / "history.csv").is_file()


def test_a_summary_is_right_as_soon_as_the_run_goes_on(done, tmp_path, monkeypatch):
    """Also where the run was killed while it wrote one."""
    out = as_killed(done, tmp_path / "out", 3, running=True)
    (out / "summary.json").write_text('{"status": "done"}')
    (out / "summary.json.part").write_text("{")
    found = {}

    def look(*_):
        found.update(json.loads((out / "summary.json").read_text()))
        raise Interrupted

    monkeypatch.setattr(Interruption, "ready", look)
    with pytest.raises(Interrupted):
        run(case_of(), out, resume=True)
    assert (found["status"], found["steps"], found["resumed"]) == ("running", 3, [3])


# -- sweeps, and runs that are done ---------------------------------------------------------------


def test_a_run_that_is_done_is_not_taken_for_that_of_another_case(tribox, tmp_path, block):
    out, path = tmp_path / "out", tmp_path / "case.toml"
    path.write_text(block.replace("steps = 6", "steps = 1"))
    run(load_case(path), out)
    for same in (path, out / "case.toml"):
        result = tribox("run", same, "--out", out, "--resume")
        assert result.returncode == 0 and "is done; --extend" in result.stdout, result.stderr
    for old, new, key in (
        ("mu = 0.2", "mu = 0.3", "contact.0.friction.mu = 0.3 instead of 0.2"),
        ("nu = 0.45", 'nu = 0.45\nformulation = "q1"', "bodies.elastomer.formulation"),
        ("mu = 0.2", 'mu = 0.2\nK_T = "1e12 Pa/m"', "contact.0.friction.K_T"),
    ):
        text = path.read_text()
        assert old in text
        (tmp_path / "other.toml").write_text(text.replace(old, new))
        result = tribox("run", tmp_path / "other.toml", "--out", out, "--resume")
        assert result.returncode == 2 and key in result.stderr


@pytest.fixture(scope="module")
def swept(tmp_path_factory) -> Path:
    """A sweep over two values, done."""
    directory = tmp_path_factory.mktemp("swept") / "out"
    directory.mkdir()
    case = sweep_of()
    write_case(case, directory)
    for label, single in case.sweep_cases():
        run(single, directory / label)
    collate(case, directory, "done")
    return directory


def sweep_of(**tables: Any) -> Case:
    return case_of(sweep={"key": "contact.0.friction.mu", "values": [0.1, 0.3]}, **tables)


BODIES = tomllib.loads(BLOCK)["bodies"]
SOFTER = BODIES | {"elastomer": BODIES["elastomer"] | {"nu": 0.4}}
LONGER = [*COARSE["stage"], {"name": "wait", "duration": "1 s", "steps": 1}]


def test_values_of_another_sweep_are_not_mixed_with_new_ones(swept, tmp_path):
    options = RunOptions(resume=True)
    assert _to_run(sweep_of(), swept, options) == []
    with pytest.raises(InputError, match=r"elastomer\.nu = 0\.4 instead of 0\.45"):
        _to_run(sweep_of(bodies=SOFTER), swept, options)
    with pytest.raises(InputError, match="use --extend"):
        _to_run(sweep_of(stage=LONGER), swept, options)


def test_a_sweep_that_was_extended_in_part_is_extended_in_the_rest(swept, tmp_path):
    longer, options = sweep_of(stage=LONGER), RunOptions(extend=True)
    out = tmp_path / "out"
    shutil.copytree(swept, out)
    (first, case), (second, _) = longer.sweep_cases()
    assert [label for _, label in _to_run(longer, out, options)] == [first, second]
    run(case, out / first, extend=True)
    assert [label for _, label in _to_run(longer, out, options)] == [second]
    assert options.how(out / second) == {"resume": False, "extend": True}
    shutil.rmtree(out / second)
    assert options.how(out / second) == {"resume": True, "extend": False}
    with pytest.raises(InputError, match="--extend: the sweep is done"):
        _to_run(sweep_of(), swept, options)


def moved(x: Any) -> list[dict[str, Any]]:
    """The boundaries of the small block with another way of its top."""
    bottom, top = tomllib.loads(BLOCK)["boundary"]
    return [bottom, top | {"displacement": top["displacement"] | {"x": x}}]


WAY = [["1 s", "0 mm"], ["2 s", "0.15 mm"]]


def test_tables_over_time_may_go_on_past_the_end(done, tmp_path):
    whole = case_of(stage=LONGER, boundary=moved([*WAY, ["3 s", "0.1 mm"]]))
    run(whole, tmp_path / "whole")
    out = as_killed(done, tmp_path / "out", 6, running=True)
    run(whole, out, extend=True)
    assert unlike(tmp_path / "whole", out) == []


@pytest.mark.parametrize(
    ("way", "time", "fits"),
    [
        ([*WAY, ["3 s", "0 mm"]], 2.0, True),
        ([*WAY, ["3 s", "0 mm"]], 2.5, False),
        ([*WAY, ["2.5 s", "0.15 mm"], ["3 s", "0 mm"]], 2.5, True),
        ([*WAY, ["3 s", "0.15 mm"]], 2.5, True),
        ([WAY[0], ["2 s", "0.1 mm"], ["3 s", "0 mm"]], 1.0, False),
        (WAY[:1], 2.0, False),
        ("0 mm", 2.0, False),
    ],
    ids=["at its end", "past its end", "held", "held on", "changed", "shorter", "constant"],
)
def test_rows_of_tables_must_not_change_what_was(way, time, fits):
    found = list(changes(case_of(), case_of(boundary=moved(way)), 1, time=time))
    assert (not found) == fits
    still = case_of(boundary=moved("0 mm"))
    later = case_of(boundary=moved([["2 s", "0 mm"], ["3 s", "1 mm"]]))
    assert not list(changes(still, later, 1, time=2.0))
    assert list(changes(still, later, 1, time=2.1))
