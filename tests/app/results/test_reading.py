"""Results directories read as one object: tables, sweeps, earlier versions, and what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.errors import InputError
from app.results import Results, read
from app.results.directory import write_json, write_table

SWEEP = '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, 0.3]\n'


@pytest.fixture
def directory(tmp_path, block) -> Path:
    """A directory as a run leaves it, with tables of a few columns."""
    (tmp_path / "case.toml").write_text(block)
    write_table(tmp_path / "history.csv", ("step", "stage", "time"), [(1, "NA", 0.1 + 0.2)])
    rows = [(1, "null", "a-b", float("nan")), (1, "1", "c", -5e-324)]
    write_table(tmp_path / "contacts.csv", ("step", "stage", "pair", "gap"), rows)
    rows = [
        {"label": "slide 1", "steady": steady, "stage": "slide", "step": 2}
        for steady in (True, False, None)
    ]
    write_json(tmp_path / "summary.json", {"status": "done", "load_steps": rows})
    return tmp_path


def test_names_are_text_and_all_else_floats(directory):
    results = read(str(directory))
    assert isinstance(results, Results) and str(directory) in repr(results)
    assert results.history.to_dict("list") == {"step": [1.0], "stage": ["NA"], "time": [0.1 + 0.2]}
    contacts = results.contacts
    assert contacts["stage"].tolist() == ["null", "1"] and contacts["pair"].tolist() == ["a-b", "c"]
    assert contacts["gap"].isna().tolist() == [True, False] and contacts["gap"][1] == -5e-324
    assert [str(kind) for kind in contacts.dtypes] == ["float64", "object", "object", "float64"]
    assert results.load_steps["steady"].tolist() == [1.0, 0.0, -1.0]
    assert results.load_steps["label"].tolist() == 3 * ["slide 1"]
    assert results.summary["status"] == "done"
    assert results.case.contact[0].slave == "elastomer_contact"


def test_tables_that_are_not_there_are_empty(directory):
    (directory / "summary.json").unlink()
    results = read(directory)
    for name in ("surfaces", "bodies", "probes", "sweep", "load_steps"):
        assert getattr(results, name).empty, name
    assert results.summary == {} and results.parts == {}
    assert results.steps.tolist() == [] == results.times.tolist()


def test_a_sweep_holds_its_parts(tmp_path, block):
    (tmp_path / "case.toml").write_text(block + SWEEP)
    write_table(tmp_path / "sweep.csv", ("label", "steady"), [("mu=0.3", 1.0)])
    (tmp_path / "mu=0.3").mkdir()
    (tmp_path / "mu=0.3" / "case.toml").write_text(block)
    running = read(tmp_path)
    assert list(running.parts) == ["mu=0.3"]
    assert running.parts["mu=0.3"].case.title == running.case.title
    assert running.sweep.to_dict("list") == {"label": ["mu=0.3"], "steady": [1.0]}
    write_json(tmp_path / "summary.json", {"parts": {"mu=0.3": {}, "mu=0.1": {}}})
    (tmp_path / "mu=0.1").mkdir()
    (tmp_path / "mu=0.1" / "case.toml").write_text(block)
    assert list(read(tmp_path).parts) == ["mu=0.3", "mu=0.1"]


def test_contact_files_of_earlier_versions(directory):
    for name in ("contact", "contact_nodes"):
        (directory / name).mkdir()
        (directory / name / "000001.vtu").write_text("cut off")
    for ask, name in (("contact", "contact_nodes"), ("contact_points", "contact")):
        with pytest.raises(InputError, match=f"/{name}/000001.vtu: is cut off"):
            getattr(read(directory), ask)()


WRONG = {
    "history.csv": (
        "step,stage,time\n1,a,0.",
        "step,stage,time\n1,a\n",
        "step,stage\n1,a,2\n",
        "",
        "step\nx\n",
        b"\xff\xfe\n1\n",
    ),
    "summary.json": ('{"a": 1', "[]", ""),
    "fields.pvd": ('<?xml version="1.0"?>\n<VTKFile><Coll', "<VTKFile><DataSet/></VTKFile>", ""),
}


@pytest.mark.parametrize(("name", "text"), [(n, t) for n, texts in WRONG.items() for t in texts])
def test_a_file_that_is_cut_off_is_one_line(directory, name, text):
    data = text if isinstance(text, bytes) else text.encode()
    (directory / name).write_bytes(data)
    results = read(directory)
    ask = {"history.csv": "history", "summary.json": "summary", "fields.pvd": "steps"}[name]
    with pytest.raises(InputError) as caught:
        getattr(results, ask)
    assert str(caught.value).startswith(f"{directory / name}: is cut off or not ")
    assert "\n" not in str(caught.value)


def test_a_field_file_that_is_cut_off_or_missing_is_one_line(directory):
    results = read(directory)
    with pytest.raises(InputError, match=r"holds no output in fields/$"):
        results.fields()
    (directory / "fields").mkdir()
    for step in (3, 12):
        (directory / "fields" / f"{step:06d}.vtu").write_text("<VTKFile><Unst")
    (directory / "fields" / "copy.vtu").write_text("mine")
    with pytest.raises(InputError, match=r"000012.vtu: is cut off or not a file of tribox$"):
        results.fields()
    with pytest.raises(
        InputError, match=r"no output of step 4 in fields/; there are 2, from step 3 to 12$"
    ):
        results.fields(4)


def test_only_results_directories_are_read(tmp_path):
    with pytest.raises(InputError, match=r"nowhere: no such directory$"):
        read(tmp_path / "nowhere")
    with pytest.raises(
        InputError, match=r"no results directory of tribox run \(it has no case.toml\)"
    ):
        read(tmp_path)
    (tmp_path / "case.toml").write_text("[")
    with pytest.raises(InputError, match="not valid TOML"):
        _ = read(tmp_path).case
