"""The stages of a run on a terminal: a bar for each, and a line on the step at hand."""

from __future__ import annotations

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from tribox.app.run.stage_progress import StagesProgress

MOST_BARS = 6  # stages shown at a time
NAME_WIDTH, BAR_WIDTH = 20, 20  # characters


class StageBars:
    """Bars that stay below the lines of a run while it goes on, and vanish at its end.

    Attributes:
        details: what is said of the step at hand.
    """

    def __init__(self, progress: StagesProgress, console: Console) -> None:
        """Show the bars.

        Args:
            progress: of the stages, kept up to date by somebody else.
            console: the terminal, on which other lines are printed too.
        """
        self._progress = progress
        self.details = ""
        self._live = Live(
            console=console,
            transient=True,
            refresh_per_second=4,
            get_renderable=self.render,
            redirect_stderr=False,
        )
        self._live.start()

    def render(self) -> RenderableType:
        """The bars as they stand."""
        grid = Table.grid(padding=(0, 1))
        begun = self._progress.begun[-MOST_BARS:]
        names = [f"{one.number}/{self._progress.count} {one.stage.name}" for one in begun]
        width = min(max(map(len, names)), NAME_WIDTH)
        grid.add_column(no_wrap=True, overflow="ellipsis", width=width)
        grid.add_column(width=BAR_WIDTH)
        grid.add_column(no_wrap=True, overflow="ellipsis")
        now = self._progress.now()
        for name, one in zip(names, begun, strict=True):
            said = one.time_left(now)
            if one.ended is None:
                said = ", ".join(part for part in (one.place(), said) if part)
            grid.add_row(
                Text(name),
                ProgressBar(total=1.0, completed=one.share, width=BAR_WIDTH),
                Text(said),
            )
        return Group(grid, Text(self.details, no_wrap=True, overflow="ellipsis"))

    def close(self) -> None:
        """Take the bars away."""
        self._live.stop()
