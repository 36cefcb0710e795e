"""Results directories read as one object: tables, sweeps, and what is wrong."""

import tomllib
from pathlib import Path

import pytest

from tribox.app.case.reading import load_case
from tribox.app.case.toml_files import toml_text
from tribox.app.errors import InputError
from tribox.app.results import Results, read
from tribox.app.results.claim import sweep_labels
from tribox.app.results.directory import write_json, write_table

SWEEP = '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, 0.3]\n'


@pytest.fixture
def directory(tmp_path, block) -> Path:
    """A directory as a run leaves it, with tables of a few columns."""
    (tmp_path / "case.toml").write_text(block)
    write_table(tmp_path / "history.csv", ("step", "stage", "time"), [(1, "NA", 0.1 + 0.2)])
    rows = [(1, 0.5, "null", "a-b", float("nan")), (1, 0.5, "1", "c", -5e-324)]
    write_table(tmp_path / "contacts.csv", ("step", "time", "stage", "pair", "gap"), rows)
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
    assert [str(kind) for kind in contacts.dtypes] == 2 * ["float64"] + 2 * ["object"] + ["float64"]
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


@pytest.mark.parametrize("label", ["../mu=0.1", "..", "/tmp/mu=1", "mu=\0", "mu=" + "9" * 400, ""])
def test_parts_lie_in_the_directory_of_their_sweep(directory, label):
    write_json(directory / "summary.json", {"parts": {label: {"status": "done"}}})
    with pytest.raises(InputError, match=r"summary\.json: is no summary of tribox"):
        read(directory).parts


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


WRONG = {
    "history.csv": ("step,stage,time\n1,a,0.", "step,stage,time\n1,a\n", "step,stage\n1,a,2\n",
     "step,time,stage\n1,2,3,a\n", "", "step\nx\n", b"\xff\xfe\n1\n"),
    "summary.json": ('{"a": 1', "[]", ""),
    "fields.pvd": ('<?xml version="1.0"?>\n<VTKFile><Coll', "<VTKFile><DataSet/></VTKFile>", ""),
}  # fmt: skip


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
    (directory / "fields" / "²².vtu").touch()
    with pytest.raises(
        InputError, match=r"no output of step 4 in fields/; there are 2, from step 3 to 12$"
    ):
        results.fields(4)


def listing(*steps: int) -> str:
    """The index of field outputs."""
    sets = "".join(f'<DataSet timestep="{s}" file="fields/{s:06d}.vtu"/>' for s in steps)
    return f'<?xml version="1.0"?>\n<VTKFile><Collection>{sets}</Collection></VTKFile>\n'


def test_an_output_that_is_listed_and_gone_is_missed(directory):
    """Not silently the one before, while ``steps`` ends with what is gone."""
    (directory / "fields.pvd").write_text(listing(18, 19))
    gone = r"fields/000019.vtu: no such file, though fields.pvd lists it$"
    with pytest.raises(InputError, match=gone):
        read(directory).fields()
    with pytest.raises(InputError, match=r"holds no output in fields/$"):
        read(directory).fields(3)
    (directory / "fields").mkdir()
    (directory / "fields" / "000018.vtu").write_text("<VTKFile><Unst")
    results = read(directory)
    for step in (-1, int(results.steps[-1])):
        with pytest.raises(InputError, match=gone):
            results.fields(step)
    # A run has written more than its index tells: what is newest counts.
    (directory / "fields" / "000020.vtu").write_text("<VTKFile><Unst")
    with pytest.raises(InputError, match=r"000020.vtu: is cut off"):
        results.fields()


@pytest.mark.parametrize(
    ("name", "ask"),
    [("history.csv", "history"), ("summary.json", "summary"), ("fields.pvd", "steps")],
)
def test_a_directory_in_place_of_a_file_is_one_line(directory, name, ask):
    (directory / name).unlink(missing_ok=True)
    (directory / name).mkdir()
    with pytest.raises(InputError, match=f"/{name}: cannot be read \\(Is a directory\\)$"):
        getattr(read(directory), ask)


@pytest.mark.parametrize(
    ("summary", "ask", "said"),
    [
        ({"load_steps": 3}, "load_steps", "load_steps is no list"),
        ({"load_steps": None}, "load_steps", "load_steps is no list"),
        ({"load_steps": [{"label": "a"}]}, "load_steps", "a load step has no steady true"),
        ({"load_steps": [{"steady": [1]}]}, "load_steps", "a load step has no steady true"),
        ({"load_steps": [7]}, "load_steps", "a load step has no steady true"),
        ({"load_steps": [{"steady": True}]}, "load_steps", "it has no column label"),
        ({"parts": None}, "parts", "parts is no table"),
        ({"bodies": 1}, "summary", "bodies is no list"),
    ],
)
def test_a_summary_of_another_kind_is_one_line(directory, summary, ask, said):
    write_json(directory / "summary.json", summary)
    with pytest.raises(InputError, match=rf"/summary.json: is no .* of tribox \(.*{said}"):
        getattr(read(directory), ask)


@pytest.mark.parametrize(
    ("name", "columns", "missing"),
    [
        ("history", ("x", "y"), "step"),
        ("contacts", ("step", "time", "stage"), "pair"),
        ("body_probes", ("step", "time", "stage"), "probe"),
        ("sweep", ("label", "value"), "steady"),
    ],
)
def test_some_other_table_is_not_taken_for_one_of_the_run(directory, name, columns, missing):
    write_table(directory / f"{name}.csv", columns, [range(len(columns))])
    said = f"/{name}.csv: is no table of tribox \\(it has no column {missing}\\)$"
    with pytest.raises(InputError, match=said):
        getattr(read(directory), name)


def test_only_results_directories_are_read(tmp_path):
    with pytest.raises(InputError, match=r"nowhere: no such directory$"):
        read(tmp_path / "nowhere")
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file: is no directory$"):
        read(tmp_path / "file")
    with pytest.raises(
        InputError, match=r"no results directory of tribox run \(it has no case.toml\)"
    ):
        read(tmp_path)
    (tmp_path / "case.toml").write_text("[")
    with pytest.raises(InputError, match="not valid TOML"):
        _ = read(tmp_path).case


def test_results_are_read_without_what_the_run_was_made_from(tmp_path, block):
    """A mesh that is gone, and a law in Python: neither is looked for, and no code is run."""
    out = tmp_path / "out"
    out.mkdir()
    data = tomllib.loads(block)
    data["geometry"] = {"mesh": str(tmp_path / "gone.msh")}
    data["contact"][0]["friction"] = {"law": "python", "class": f"{tmp_path}/law.py:Law"}
    (tmp_path / "law.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    (out / "case.toml").write_text(toml_text(data))
    case = read(out).case
    assert case.geometry.mesh == tmp_path / "gone.msh"
    assert case.contact[0].friction.law == "python"
    assert sweep_labels(out) == ()
    assert not (tmp_path / "ran").exists()
    with pytest.raises(InputError, match="no such file"):
        load_case(out / "case.toml")
