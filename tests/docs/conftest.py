"""After the tests of the pages: what blocks are not run, by reason."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.docs.blocks import PageError, find_blocks
from tests.docs.pages import all_pages


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Count the blocks of all pages that are not run."""
    try:
        blocks = [block for page in all_pages() for block in find_blocks(page)]
    except PageError:
        return  # a test has said so
    reasons = Counter(block.marks["not run"] for block in blocks if "not run" in block.marks)
    counts = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common())
    line = f"{len(blocks)} blocks of the pages; not run are {reasons.total()}: {counts or 'none'}"
    terminalreporter.write_line(line)
