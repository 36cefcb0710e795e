"""Reads a log as the lines that were said, which it keeps folded."""

from pathlib import Path

from tribox.app.errors import CONTINUED


def unfolded(text: str) -> str:
    """A log whose folded lines are whole again; only those go on with just this indent."""
    lines: list[str] = []
    for line in text.splitlines():
        told = line.removeprefix(CONTINUED)
        if told != line and not told.startswith(" "):
            lines[-1] += f" {told}"
        else:
            lines.append(line)
    return "".join(f"{line}\n" for line in lines)


def read_log(directory: Path) -> str:
    """The log of a results directory."""
    return unfolded((directory / "log.txt").read_text(encoding="utf-8"))
