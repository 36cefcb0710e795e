"""The two sides of a comparison: trees of tribox, numbers of ranks, or keys of the case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tribox.app.bench.process import SOURCES
from tribox.app.errors import InputError

# What the tree compared with must have.
OF_A_TREE = ("app/bench/probe.py", "forms", "geometry")


@dataclass(frozen=True, slots=True)
class Side:
    """One side.

    Attributes:
        name: for the tables; tree: where the sources are that run; ranks: that it runs on.
        changes: KEY=VALUE, keys of the case that it changes.
    """

    name: str
    tree: Path = SOURCES
    ranks: int = 1
    changes: tuple[str, ...] = ()

    @property
    def package(self) -> str:
        """The package that is the command line; trees before ``tribox.app`` call it ``app``."""
        return "tribox" if (self.tree / "tribox").is_dir() else "app"

    @property
    def packages(self) -> list[str]:
        """The directories of its packages, from ``tree``."""
        inside = "tribox/" if self.package == "tribox" else ""
        return [inside + name for name in ("app", "forms", "geometry")]


def sides_of(against: Path | None, changes: Sequence[str], ranks: int) -> tuple[Side, Side] | None:
    """What is compared with what; None if nothing is.

    Args:
        against: another tree: its run is compared with that of this one.
        changes: KEY=VALUE: the case as it is is compared with the case so changed.
        ranks: of both sides, or, where nothing else differs, of the second.

    Raises:
        InputError: both are given, or the directory is no tree of tribox.
    """
    if against is not None and changes:
        raise InputError(
            f"bench: --against {against} and --with {changes[0]} both say what to compare with: "
            "give one of them"
        )
    if against is not None:
        return Side("old", tribox_tree(against), ranks), Side("new", SOURCES, ranks)
    if changes:
        return Side("as it is", SOURCES, ranks), Side("changed", SOURCES, ranks, tuple(changes))
    return (Side("1 rank"), Side(f"{ranks} ranks", SOURCES, ranks)) if ranks > 1 else None


def tribox_tree(directory: Path) -> Path:
    """Where the packages of a source tree of tribox are, as a whole path.

    Raises:
        InputError: it does not.
    """
    for name in OF_A_TREE:
        if not (directory / name).exists():
            reason = f"it has no {name}" if directory.is_dir() else "there is no such directory"
            raise InputError(f"bench: --against {directory}: not a source tree of tribox: {reason}")
    inner = directory / "src"
    return (inner if (inner / "tribox").is_dir() else directory).resolve()
