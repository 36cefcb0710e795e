"""Figures that are composed and saved, but not drawn: white.

To lay a figure out and draw it takes a third of a second, more than many a run that it is made of.
Those of ``tests/app/figures`` are drawn, and wherever ``drawn_figures`` is asked for.
"""

from collections.abc import Iterator

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

CANVAS = "tribox.app.figures.style.FigureCanvasAgg"


class BlankCanvas:
    """Stands for matplotlib's canvas, as far as pictures are saved from it."""

    def __init__(self, figure: Figure) -> None:
        self.figure = figure

    def draw(self) -> None:
        """Nothing."""

    def buffer_rgba(self) -> np.ndarray:
        return np.full((600, 800, 4), 255, dtype=np.uint8)


@pytest.fixture(autouse=True, scope="session")
def _blank_figures() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CANVAS, BlankCanvas)
        yield


@pytest.fixture
def drawn_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw the figures of a test."""
    monkeypatch.setattr(CANVAS, FigureCanvasAgg)
