"""Tables as plain columns."""

from __future__ import annotations

import numpy as np
import pytest

from tribox.app.results.reading import Table, joined

TEXT = 'step,stage,value\n1,press,0.5\n\n2,"slide, slowly",1e3\n3,press,-2\n'


def test_columns_are_numbers_but_for_names():
    table = Table.from_csv(TEXT)
    assert len(table) == 3 and list(table.columns) == ["step", "stage", "value"]
    assert table["step"].tolist() == [1.0, 2.0, 3.0] and table["step"].dtype == np.float64
    assert table["stage"].tolist() == ["press", "slide, slowly", "press"]
    assert table["value"].tolist() == [0.5, 1e3, -2.0]
    assert len(Table.from_csv("step,stage\n")) == 0 and len(Table()) == 0


def test_what_was_swept_may_be_text():
    assert Table.from_csv(TEXT.replace("1e3", "q1"))["value"].tolist() == ["0.5", "q1", "-2"]


@pytest.mark.parametrize(
    "text",
    ["", "\n", "a,a\n1,2\n", "a,b\n1\n", "a,b\n1,2,3\n", "a\nx\n", "a,b\n1,\n", 'a,b\n1,"2\n'],
)
def test_other_texts_are_no_tables(text):
    with pytest.raises(ValueError):
        Table.from_csv(text)


@pytest.mark.parametrize("rows", [[{"a": 1}, {"b": 1}], [{"a": None}], [{"a": [1]}], [{"a": "x"}]])
def test_records_have_the_same_numbers(rows):
    with pytest.raises(ValueError):
        Table.from_records(rows)


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


def test_tables_are_joined_with_gaps():
    more = Table.from_records([{"step": 4, "tool": "die"}])
    whole = joined(Table.from_csv(TEXT), more)
    assert whole["step"].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert whole["stage"].tolist()[2:] == ["press", ""] and whole["tool"].tolist()[2:] == [
        "",
        "die",
    ]
    assert np.isnan(whole["value"]).tolist() == [False, False, False, True]
