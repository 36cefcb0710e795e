"""Contact over curved tools, measured with default settings.

From the repository, ``python3 -m benchmarks.curved_contact NAME [--quick] [...]``; NAME is

- ``film``: drag of a film over a round tool against η V/D times the length of the contact;
- ``hard``: iterations and cuts over ridges, kinks with a film, an end, a first touch, block-slide;
- ``plough``: friction against μ times the pressure in ploughing and rolling, by steps per mm;
- ``pressed``: pressure of cylinders and spheres against Hertz's, pressed by displacement or force.

``--axis size=80,40 --axis nu=.45`` runs the product of the values given, everything else as in the
base problem; without it each axis is varied by itself. ``--quick`` runs one small problem.
``--set KEY=VALUE`` changes a key of all cases, as for ``tribox run``. ``--write FILE`` writes a
Markdown table, ``--json FILE`` the rows.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

from benchmarks.curved_contact.runs import cell, chosen, markdown

NAMES = ("film", "hard", "plough", "pressed")


def setups_of(problem: Any, quick: bool, given: dict[str, str]) -> list[Any]:
    """What a problem's module is to be run for."""
    if quick or given:
        return chosen(problem.QUICK if quick else problem.BASE, {}, given)
    if hasattr(problem, "ROWS"):
        return list(problem.ROWS)
    return [*chosen(problem.BASE, problem.AXES, {}), *getattr(problem, "EXTRA", ())]


def measure(
    name: str, quick: bool, given: dict[str, str], overrides: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Run the problems of a name and print each row as it comes."""
    problem = import_module(f"benchmarks.curved_contact.{name}")
    setups = setups_of(problem, quick, given)
    rows = []
    for setup in setups:
        with tempfile.TemporaryDirectory() as scratch:
            rows.append(problem.row(setup, Path(scratch), overrides))
        print("  ".join(f"{name} {cell(v)}" for name, v in rows[-1].items()), flush=True)
    return rows


def main() -> None:
    """Print, and write, what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", choices=NAMES)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--axis", action="append", default=[], metavar="NAME=V,V")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--write", type=Path, help="Markdown table")
    parser.add_argument("--json", type=Path, help="rows")
    asked = parser.parse_args()
    given = dict(text.split("=", 1) for text in asked.axis)
    rows = measure(asked.name, asked.quick, given, tuple(asked.set))
    print("\n" + "\n".join(markdown(rows)))
    if asked.write:
        asked.write.write_text("\n".join(markdown(rows)) + "\n", encoding="utf-8")
    if asked.json:
        asked.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
