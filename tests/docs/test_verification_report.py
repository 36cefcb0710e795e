"""The verification report among the pages is one of the program's present cases, all passed."""

from __future__ import annotations

import re
from pathlib import Path

from tribox.app.verify.report import CASES

PAGE = Path(__file__).resolve().parents[2] / "docs/verification-report.md"
CHECK = re.compile(r"^\| .+ \| (pass|FAIL) \|$", re.MULTILINE)


def test_the_report_has_every_case_and_says_how_many_checks_passed():
    text = PAGE.read_text(encoding="utf-8")
    assert re.findall(r"^## (\S+)$", text, re.MULTILINE) == list(CASES)
    verdicts = CHECK.findall(text)
    assert set(verdicts) == {"pass"}
    said = re.search(r"All (\d+) checks of\s(\d+) cases passed", text)
    assert said is not None
    assert [int(number) for number in said.groups()] == [len(verdicts), len(CASES)]
