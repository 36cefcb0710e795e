"""Results directories: what may be cleared, and how files are written and read."""

import json
from pathlib import Path

import pytest

from tribox.app.errors import InputError, OutputError
from tribox.app.results.claim import sweep_labels
from tribox.app.results.directory import (
    OWN,
    check_free,
    default_directory,
    prepare,
    write_json,
    write_table,
    write_text,
)
from tribox.app.results.reading import Table, read_table


def make(directory: Path, *names: str) -> None:
    for name in names:
        path = directory / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("something")


def test_default_directory_is_named_after_the_case(monkeypatch):
    monkeypatch.delenv("TRIBOX_RESULTS", raising=False)
    assert default_directory(Path("/a/b/sfa.toml")) == Path("results/sfa")
    monkeypatch.setenv("TRIBOX_RESULTS", "/results")
    assert default_directory(Path("/a/b/sfa.toml")) == Path("/results/sfa")


@pytest.mark.parametrize("foreign", ["notes.txt", "data/measured.csv", ".git/config"])
def test_what_is_no_result_is_never_cleared(tmp_path, foreign):
    make(tmp_path, "history.csv", foreign)
    for force in (False, True):
        with pytest.raises(InputError, match="name another directory"):
            check_free(tmp_path, force=force)


def test_results_of_other_runs_below_are_never_cleared(tmp_path, block):
    make(tmp_path, "history.csv", "other/case.toml", "other/notes.txt")
    for case in (None, block):
        if case:
            (tmp_path / "case.toml").write_text(case)
        with pytest.raises(InputError, match="holds other, which is no result"):
            check_free(tmp_path, force=True, labels=sweep_labels(tmp_path))


def test_a_file_is_no_directory(tmp_path):
    make(tmp_path, "file")
    for force in (False, True):
        with pytest.raises(InputError, match="is a file"):
            check_free(tmp_path / "file", force=force)


def test_prepare_makes_and_clears(tmp_path):
    directory = tmp_path / "a" / "b"
    prepare(directory)
    make(directory, *OWN[:3], "contact/000001.vtu")
    prepare(directory)
    assert list(directory.iterdir()) == []


def test_a_directory_that_cannot_be_made(tmp_path):
    make(tmp_path, "file")
    with pytest.raises(OutputError, match="cannot be written"):
        prepare(tmp_path / "file" / "below")


def test_a_file_is_there_whole_or_not_at_all(tmp_path):
    write_text(tmp_path / "a.txt", "old")
    write_json(tmp_path / "a.json", {"x": 1.5})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "a.txt"]
    with (tmp_path / "a.txt").open() as reader:
        write_text(tmp_path / "a.txt", "new")
        assert reader.read() == "old"  # whoever has it open goes on reading the whole old file
    write_text(tmp_path / "a.txt", "old")
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "a.json", {"x": float("nan")})
    assert json.loads((tmp_path / "a.json").read_text()) == {"x": 1.5}
    rows = iter([(1.0, "a"), None])  # Breaks off in the middle.
    with pytest.raises(TypeError):
        write_table(tmp_path / "a.txt", ("x", "stage"), rows)
    assert (tmp_path / "a.txt").read_text() == "old"


def test_numbers_come_back_with_all_their_digits(tmp_path):
    values = [0.1 + 0.2, 1.0 / 3.0, -5e-324, 1.7976931348623157e308]
    write_table(tmp_path / "t.csv", ("x", "n", "stage"), [(v, 7, "a, b") for v in values])
    rows = read_table(tmp_path / "t.csv")
    assert [row["x"] for row in rows] == values
    assert {row["n"] for row in rows} == {7.0} and {row["stage"] for row in rows} == {"a, b"}
    with pytest.raises(InputError, match=r"nowhere\.csv: cannot be read"):
        read_table(tmp_path / "nowhere.csv")


# -- Tables as plain columns -----------------------------------------------------------------------

TEXT = 'step,stage,value\n1,press,0.5\n\n2,"slide, slowly",1e3\n3,press,-2\n'


def test_what_was_swept_may_be_text():
    assert Table.from_csv(TEXT.replace("1e3", "q1"))["value"].tolist() == ["0.5", "q1", "-2"]


@pytest.mark.parametrize(
    "text",
    ["", "\n", "a,a\n1,2\n", "a,b\n1\n", "a,b\n1,2,3\n", "a\nx\n", "a,b\n1,\n", 'a,b\n1,"2\n'],
)
def test_other_texts_are_no_tables(text):
    with pytest.raises(ValueError):
        Table.from_csv(text)


def test_rows_are_chosen_by_value_and_number():
    table = Table.from_csv(TEXT)
    assert table.where("stage", "press")["step"].tolist() == [1.0, 3.0]
    assert table.where("step", 2, 3).where("stage", "press").records() == [
        {"step": 3.0, "stage": "press", "value": -2.0}
    ]
    assert len(table.where("stage", "none")) == 0
    assert [(name, len(rows)) for name, rows in table.parts("stage")] == [
        ("press", 2),
        ("slide, slowly", 1),
    ]
    assert table.rows(slice(1, None))["step"].tolist() == [2.0, 3.0]
