"""Compares the histories of two results trees: the way to see that a change kept the numbers.

    python3 -m benchmarks.same_history BEFORE AFTER

Each tree holds one results directory per case, as ``tribox run cases/NAME.toml --out TREE/NAME``
writes it; those of a sweep hold one directory per value. Every ``history.csv`` below BEFORE must be
at the same place below AFTER, with the same rows. Printed for each case: the largest difference of
any entry over its column's largest absolute value, and that column.

Exit code 1 where one of them is above 1e-12, or something is missing. Uses the standard library
only, so the two trees may come from anywhere.
"""

from __future__ import annotations

import csv
import math
import sys
from pathlib import Path
from typing import NamedTuple

TOLERANCE = 1e-12
# Columns that were renamed, by the name they had.
RENAMED = {"area_stretch": "area_ratio"}
TEXT = {"stage", "label"}

Table = dict[str, list[str]]


class Difference(NamedTuple):
    """How far two histories are apart.

    Attributes:
        worst: largest difference over the largest absolute value of its column; infinite where
            the histories cannot be compared.
        where: the column, or why they cannot be compared.
    """

    worst: float
    where: str


def read(path: Path) -> Table:
    """Columns of a history under the names that they have now."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    names = [RENAMED.get(name, name) for name in rows[0]]
    return {name: [row[i] for row in rows[1:]] for i, name in enumerate(names)}


def compare(before: Table, after: Table) -> Difference:
    """The largest relative difference of two histories."""
    if before.keys() != after.keys():
        return Difference(math.inf, f"columns {', '.join(sorted(before.keys() ^ after.keys()))}")
    counts = {len(column) for table in (before, after) for column in table.values()}
    if len(counts) > 1:
        return Difference(math.inf, f"numbers of rows {', '.join(map(str, sorted(counts)))}")
    found = [Difference(_apart(before[n], after[n], n in TEXT), n) for n in before]
    return max(found, key=lambda difference: difference.worst)


def _apart(before: list[str], after: list[str], text: bool) -> float:
    """Largest difference of a column's entries over its largest absolute value."""
    if text:
        return 0.0 if before == after else math.inf
    one, two = [[float(v or "nan") for v in values] for values in (before, after)]
    if [math.isnan(v) for v in one] != [math.isnan(v) for v in two]:
        return math.inf
    pairs = [(a, b) for a, b in zip(one, two, strict=True) if not math.isnan(a) and a != b]
    if not pairs:
        return 0.0
    size = max(abs(v) for v in (*one, *two) if not math.isnan(v))
    worst = max(abs(a - b) for a, b in pairs)
    return math.inf if math.isinf(size) or math.isnan(worst) else worst / size


def compare_trees(before: Path, after: Path) -> dict[str, Difference]:
    """The differences of all histories below two directories, by their place below these."""
    places = {
        str(path.parent.relative_to(tree))
        for tree in (before, after)
        for path in tree.rglob("history.csv")
    }
    return {place: _at(before / place, after / place) for place in sorted(places)}


def _at(before: Path, after: Path) -> Difference:
    for directory in (before, after):
        if not (directory / "history.csv").is_file():
            return Difference(math.inf, f"no history.csv in {directory}")
    return compare(read(before / "history.csv"), read(after / "history.csv"))


def main() -> None:
    """Compare the two trees named on the command line."""
    if len(sys.argv) != 3:
        raise SystemExit("usage: python3 -m benchmarks.same_history BEFORE AFTER")
    found = compare_trees(Path(sys.argv[1]), Path(sys.argv[2]))
    if not found:
        raise SystemExit("no history.csv below either directory")
    width = max(map(len, found))
    for place, (worst, where) in found.items():
        print(f"{place:<{width}}  {worst:8.1e}  {where if worst else 'the same'}")
    different = [place for place, (worst, _) in found.items() if not worst <= TOLERANCE]
    print(f"{len(found) - len(different)} of {len(found)} agree to {TOLERANCE:.0e}")
    sys.exit(1 if different else 0)


if __name__ == "__main__":
    main()
