"""What a sweep tells: labelled lines, or on a terminal one line for each value that is running."""

from __future__ import annotations

import re
import sys
import time
from contextlib import AbstractContextManager
from types import TracebackType
from typing import TYPE_CHECKING, Self

from tribox.app.errors import SaidOnce, folded
from tribox.app.run.stage_progress import clock

if TYPE_CHECKING:
    from rich.console import Console, RenderableType


_PASSING = re.compile(r"(step|row|time step) +\d+  |          step of ")


def is_passing(line: str) -> bool:
    """Whether a line of a run is of the moment: on a step that others follow."""
    return _PASSING.match(line) is not None


class SweepLines(AbstractContextManager["SweepLines"]):
    """Prints the lines of every value, labelled; a note that several values have is said once."""

    def __init__(self) -> None:
        """Make ready."""
        self._once = SaidOnce()

    def begin(self, label: str) -> None:
        """A value is begun."""

    def say(self, label: str, line: str) -> None:
        """A running value has printed a line."""
        if self._once.is_new(line):
            print(f"[{label}] {line}", flush=True)

    def end(self, label: str, code: int) -> None:
        """A value has ended, with this exit code."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Nothing more will be said."""


class SweepScreen(SweepLines):
    """On a terminal: one line for each running value, the others of its lines above.

    Attributes:
        running: of each running value the time of the clock (s) it was begun, and its last line.
    """

    def __init__(self, count: int, console: Console) -> None:
        """Make ready.

        Args:
            count: number of values.
            console: the terminal.
        """
        from rich.live import Live

        super().__init__()
        self._count, self._console = count, console
        self.running: dict[str, tuple[float, str]] = {}
        self._done = self._failed = 0
        self._live = Live(
            console=console,
            transient=True,
            refresh_per_second=4,
            get_renderable=self.render,
            redirect_stderr=False,
        )

    def __enter__(self) -> Self:
        """Show the lines."""
        self._live.start()
        return self

    def begin(self, label: str) -> None:
        """A value is begun: it has a line from now on."""
        self.running[label] = (time.monotonic(), "starting")

    def say(self, label: str, line: str) -> None:
        """Show a line in the place of the value's last; print it above if it is to stay."""
        if is_passing(line):
            started, _ = self.running[label]
            self.running[label] = (started, " ".join(line.split()))
        elif self._once.is_new(line):
            text = folded(f"[{label}] {line}", self._console.width)
            self._console.print(text, markup=False, soft_wrap=True)

    def end(self, label: str, code: int) -> None:
        """The value's line goes."""
        del self.running[label]
        self._done += 1
        self._failed += code != 0

    def render(self) -> RenderableType:
        """The lines as they stand."""
        from rich.console import Group
        from rich.table import Table
        from rich.text import Text

        grid = Table.grid(padding=(0, 2))
        grid.add_column(no_wrap=True)
        grid.add_column(no_wrap=True, justify="right")
        grid.add_column(no_wrap=True, overflow="ellipsis")
        for label, (started, line) in list(self.running.items()):
            grid.add_row(Text(label), Text(clock(time.monotonic() - started)), Text(line))
        waiting = self._count - self._done - len(self.running)
        failed = f", {self._failed} failed" if self._failed else ""
        said = f"{self._done} of {self._count} values done{failed}, {waiting} waiting"
        return Group(grid, Text(said))

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Take the lines away."""
        self._live.stop()


def sweep_lines(count: int) -> SweepLines:
    """What tells of a sweep of ``count`` values on this standard output."""
    if not sys.stdout.isatty():
        return SweepLines()
    from rich.console import Console

    console = Console(highlight=False)
    return SweepLines() if console.is_dumb_terminal else SweepScreen(count, console)
