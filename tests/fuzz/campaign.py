"""Runs many inputs of the fuzzer and tells what they came to.

::

    python3 -m tests.fuzz.campaign 10000            # all kinds, by their shares
    python3 -m tests.fuzz.campaign 500 results data --seed 7 --keep /tmp/faults
"""

import argparse
import json
import pickle
import re
import shutil
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from tests.fuzz import case_files, other_files
from tests.fuzz.guard import outcome
from tests.fuzz.made_results import good_directories
from tests.fuzz.targets import acts

# Parts of all inputs, by kind.
SHARES: Mapping[str, float] = {
    "changed": 0.4,
    "made": 0.1,
    "damaged": 0.1,
    "overrides": 0.12,
    "data": 0.1,
    "results": 0.1,
    "figures": 0.02,
    "built": 0.03,
    "map": 0.03,
    "meshes": 0.02,
}


@dataclass
class Tally:
    """Counts of outcomes and of faults, the first input of each fault, and the slowest, s."""

    counts: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    first: dict[str, tuple[object, str]] = field(default_factory=dict)
    slowest: float = 0.0

    def add(self, data: object, came_to: str, seconds: float) -> None:
        """One input."""
        word = came_to.partition(":")[0]
        self.counts[word] += 1
        self.slowest = max(self.slowest, seconds)
        if word not in ("fine", "refused"):
            cause = _cause(word, came_to)
            self.faults[cause] += 1
            self.first.setdefault(cause, (data, came_to))


def _cause(word: str, came_to: str) -> str:
    """What is wrong, without what differs from input to input."""
    if word == "message":
        return f"message: {'holds control characters' if ' holds ' in came_to else came_to[:60]}"
    if word == "hang":
        return came_to[-400:]
    line = re.sub(r"'.*?' at|\".*?\" at", "at", came_to, count=1)
    return re.sub(r"/[^ ]*/", "", line)[:300]


def strategy(kind: str, work: Path) -> st.SearchStrategy[object]:
    """What the inputs of a kind are; ``work`` is where good results are made."""
    if kind in ("results", "figures"):
        return other_files.damaged_results(good_directories(work))
    return {
        "changed": case_files.changed_cases(),
        "made": case_files.made_cases(),
        "damaged": case_files.damaged_texts(),
        "built": case_files.changed_cases(small=True),
        "overrides": other_files.overrides,
        "data": other_files.data_files(),
        "map": other_files.law_overrides,
        "meshes": other_files.damaged_meshes(),
    }[kind]


def run(kind: str, inputs: int, start: int, work: Path) -> Tally:
    """Run so many inputs of a kind, from a seed on, in a directory for what they write."""
    tally, act, place = Tally(), acts()[kind], work / "input"

    @seed(start)
    @settings(
        max_examples=inputs,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy(kind, work))
    def each(data: object) -> None:
        place.mkdir()
        begun = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                with redirect_stdout(StringIO()):
                    came_to = outcome(lambda: act(data, place), place)
        finally:
            shutil.rmtree(place)
        tally.add(data, came_to, time.perf_counter() - begun)

    each()
    return tally


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("inputs", type=int)
    parser.add_argument("kinds", nargs="*", default=list(SHARES))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    total = sum(SHARES[kind] for kind in options.kinds)
    with tempfile.TemporaryDirectory(prefix="tribox-fuzz-") as name:
        for kind in options.kinds:
            begun = time.perf_counter()
            count = max(1, round(options.inputs * SHARES[kind] / total))
            tally = run(kind, count, options.seed, Path(name))
            seconds = time.perf_counter() - begun
            print(f"{kind}: {dict(tally.counts)}, {seconds:.0f} s, slowest {tally.slowest:.1f} s")
            for number, (cause, times) in enumerate(tally.faults.most_common()):
                print(f"  {times:5d} {cause}")
                if options.keep:
                    _keep(options.keep / f"{kind}-{number}", *tally.first[cause])


def _keep(path: Path, data: object, line: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    text = f"{line}\n{_readable(data)}"
    path.with_suffix(".txt").write_text(text, encoding="utf-8", errors="replace")
    path.with_suffix(".pickle").write_bytes(pickle.dumps(data))


def _readable(data: object) -> str:
    if isinstance(data, str):
        return data
    return json.dumps(data, default=repr)


if __name__ == "__main__":
    main()
