"""Tables as plain columns."""

import pytest

from tribox.app.results.table import Table

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
