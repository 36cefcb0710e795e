"""A results directory that the tests of the figures share; none of them changes its files."""

import pytest

from tests.app.figures.made_results import write_strip
from tribox.app.results import Results, read


@pytest.fixture(scope="session")
def strip(tmp_path_factory) -> Results:
    """Three bodies, two pairs, five steps with fields."""
    return read(write_strip(tmp_path_factory.mktemp("strip") / "out"))
