"""Figures are drawn here; a results directory that tests share, of which none changes its files."""

from collections.abc import Iterator

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from tests.app.figures.made_results import write_strip
from tests.blank_figures import CANVAS
from tribox.app.results import Results, read


@pytest.fixture(autouse=True, scope="module")
def _drawn() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CANVAS, FigureCanvasAgg)
        yield


@pytest.fixture(scope="session")
def strip(tmp_path_factory) -> Results:
    """Three bodies, two pairs, five steps with fields."""
    return read(write_strip(tmp_path_factory.mktemp("strip") / "out"))
