"""The page of verification tells of the program's present cases, with how many checks passed."""

import re
from pathlib import Path

from benchmarks.verify.report import CASES

PAGE = Path(__file__).resolve().parents[2] / "docs/verification.md"
ROW = re.compile(r"^\| `([\w-]+)` \| (\d+) \|", re.MULTILINE)


def test_the_page_has_every_case_and_says_how_many_checks_passed():
    text = PAGE.read_text(encoding="utf-8")
    rows = ROW.findall(text)
    assert [name for name, _ in rows] == list(CASES)
    said = re.search(r"all (\d+) checks of\s(\d+) cases passed", text)
    assert said is not None
    checks = sum(int(count) for _, count in rows)
    assert [int(number) for number in said.groups()] == [checks, len(CASES)]
