"""The two sides of a comparison: trees of tribox, numbers of ranks, or keys of the case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app.bench.process import ROOT
from app.errors import InputError

# What the tree compared with must have.
OF_A_TREE = ("app/__main__.py", "app/bench/probe.py", "forms", "geometry")


@dataclass(frozen=True, slots=True)
class Side:
    """One side.

    Attributes:
        name: for the tables; tree: whose sources run; ranks: that it runs on.
        changes: KEY=VALUE, keys of the case that it changes.
    """

    name: str
    tree: Path = ROOT
    ranks: int = 1
    changes: tuple[str, ...] = ()


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
        return Side("old", tribox_tree(against), ranks), Side("new", ROOT, ranks)
    if changes:
        return Side("as it is", ROOT, ranks), Side("changed", ROOT, ranks, tuple(changes))
    return (Side("1 rank"), Side(f"{ranks} ranks", ROOT, ranks)) if ranks > 1 else None


def tribox_tree(directory: Path) -> Path:
    """The directory, as a whole path, if it holds the sources of tribox.

    Raises:
        InputError: it does not.
    """
    for name in OF_A_TREE:
        if not (directory / name).exists():
            reason = f"it has no {name}" if directory.is_dir() else "there is no such directory"
            raise InputError(f"bench: --against {directory}: not a source tree of tribox: {reason}")
    return directory.resolve()
