"""Side by side with other codes.

    python3 -m benchmarks.other_codes run tribox --out DIR
    python3 -m benchmarks.other_codes table DIR

``run`` makes one of the runs, each by the Python that has the code (CalculiX: ``ccx`` on the path),
and writes its record into a directory; ``table`` prints the tables of all records there.
``write DIR`` writes the inputs of all codes and runs nothing.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from benchmarks.other_codes.inputs import case_text, deck
from benchmarks.other_codes.problem import press_and_slide
from benchmarks.other_codes.runs import RESIDUAL, ROOT, RUNS, fastest, read, tables, write


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    asked = parser.add_subparsers(dest="what", required=True)
    runs = asked.add_parser("run", help="run a code")
    runs.add_argument("code", choices=RUNS)
    runs.add_argument("--out", type=Path, required=True, help="directory of the records")
    runs.add_argument("--repeat", type=int, default=1, help="runs; the fastest is kept")
    runs.add_argument("--tree", type=Path, default=ROOT, help="sources of tribox to run")
    for name, help_ in (("table", "print the tables"), ("write", "write the inputs")):
        asked.add_parser(name, help=help_).add_argument("directory", type=Path)
    for one in asked.choices.values():
        one.add_argument("--level", type=int, default=12, help="elements along the upper box")
    words = parser.parse_args()
    problem = press_and_slide(words.level)
    if words.what == "run":
        record = fastest(words.code, problem, words.repeat, words.tree.resolve())
        write(record, words.out / f"{words.code}.json")
        print(f"{record.code}: {record.cpu:.1f} s of CPU, {record.clock:.1f} s by the clock")
    elif words.what == "table":
        records = {path.stem: read(path) for path in sorted(words.directory.glob("*.json"))}
        print("\n".join(tables(records, problem)))
    else:
        words.directory.mkdir(parents=True, exist_ok=True)
        (words.directory / "blocks.inp").write_text(deck(problem, tolerance=RESIDUAL))
        (words.directory / "blocks.toml").write_text(case_text(problem))
        (words.directory / "problem.json").write_text(json.dumps(problem.figures(), indent=1))


if __name__ == "__main__":
    main()
