"""The example of docs/law.md prints what the page says."""

import contextlib
import io
import re
from pathlib import Path

PAGE = Path(__file__).parents[3] / "docs" / "law.md"


def test_the_example_prints_what_the_page_says():
    section = PAGE.read_text(encoding="utf-8").split("## From Python")[1]
    blocks = re.findall(r"```(\w+)\n(.*?)```", section, re.DOTALL)
    (code,) = [text for kind, text in blocks if kind == "python"]
    (expected,) = [text for kind, text in blocks if kind == "text"]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, str(PAGE), "exec"), {})
    assert printed.getvalue() == expected
