"""The comparison of histories finds each kind of difference."""

from __future__ import annotations

import sys

import pytest

from benchmarks.same_history import main

HISTORY = "step,stage,area_ratio,force\n1,press,1.0,2.0\n2,slide,1.5,\n3,slide,1.5,-4.0\n"


@pytest.fixture
def compare(tmp_path, monkeypatch, capsys):
    """Compares two histories on the command line; gives the exit code and what is printed."""

    def run(before, after):
        for name, text in (("before", before), ("after", after)):
            directory = tmp_path / name / "case" / "D-10"
            directory.mkdir(parents=True)
            if text is not None:
                (directory / "history.csv").write_text(text, encoding="utf-8")
        trees = [str(tmp_path / name) for name in ("before", "after")]
        monkeypatch.setattr(sys, "argv", ["same_history", *trees])
        with pytest.raises(SystemExit) as done:
            main()
        return done.value.code, capsys.readouterr().out

    return run


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("", ""),
        ("area_ratio", "area_stretch"),  # the name before the renaming
        ("-4.0", "-4.0000000000009"),  # 2e-13 of the largest
        ("2.0", "2.000000000003"),  # 7e-13 of the largest, not 2e-12
    ],
)
def test_like_histories_pass(compare, old, new):
    code, out = compare(HISTORY.replace(old, new) if old else HISTORY, HISTORY)
    assert code == 0 and "1 of 1 agree" in out


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("-4.0", "-4.00000000001", "force"),
        ("slide,1.5,\n", "slide,1.5,0.0\n", "force"),
        ("press", "slide", "stage"),
        ("force", "load", "columns force, load"),
        ("3,slide,1.5,-4.0\n", "", "numbers of rows 2, 3"),
        ("-4.0", "inf", "force"),
    ],
)
def test_a_difference_is_found(compare, old, new, said):
    code, out = compare(HISTORY, HISTORY.replace(old, new, 1))
    assert code == 1
    assert said in out and "0 of 1 agree" in out


def test_a_missing_history_is_a_difference(compare):
    code, out = compare(HISTORY, None)
    assert code == 1 and "no history.csv in" in out
