"""The fuzzer: whatever a case file holds, it comes to a result or to one line.

320 inputs by default, the same every time; ``TRIBOX_FUZZ=10000`` tries as many, others every time
(docs/testing.md).
"""

import os
import random
import shutil
import time
import warnings
from collections import Counter
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from tests.fuzz import case_files
from tests.fuzz.guard import outcome
from tests.fuzz.targets import ACTS

INPUTS = int(os.environ.get("TRIBOX_FUZZ", "320"))
FIXED = "TRIBOX_FUZZ" not in os.environ
SEED = int(os.environ.get("TRIBOX_FUZZ_SEED", "14" if FIXED else str(random.randrange(10**6))))
# Parts of all inputs, by kind.
SHARES: Mapping[str, float] = {"changed": 0.75, "damaged": 0.15, "built": 0.1}
KINDS: Mapping[str, st.SearchStrategy[object]] = {
    "changed": case_files.changed_cases(),
    "damaged": case_files.damaged_texts(),
    "built": case_files.changed_cases(small=True),
}


@dataclass
class Tally:
    """Counts of outcomes, the first input that came to each fault, and the slowest, s."""

    counts: Counter[str] = field(default_factory=Counter)
    faults: dict[str, object] = field(default_factory=dict)
    slowest: float = 0.0

    def add(self, data: object, came_to: str, seconds: float) -> None:
        """One input."""
        word = came_to.partition(":")[0]
        self.counts[word] += 1
        self.slowest = max(self.slowest, seconds)
        if word not in ("fine", "refused"):
            self.faults.setdefault(came_to, data)


def run(kind: str, inputs: int, work: Path) -> Tally:
    """Run so many inputs of a kind in a directory for what they write."""
    tally, act, place = Tally(), ACTS[kind], work / "input"

    @seed(SEED)
    @settings(
        max_examples=inputs,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(KINDS[kind])
    def each(data: object) -> None:
        place.mkdir()
        begun = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                with redirect_stdout(StringIO()):
                    came_to = outcome(lambda: act(data, place))
        finally:
            shutil.rmtree(place)
        tally.add(data, came_to, time.perf_counter() - begun)

    each()
    return tally


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory for all that inputs write."""
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.parametrize("kind", SHARES)
def test_an_input_comes_to_a_result_or_to_one_line(kind, work):
    tally = run(kind, max(1, round(INPUTS * SHARES[kind])), work)
    print(f"{kind}, seed {SEED}: {dict(tally.counts)}, slowest {tally.slowest:.1f} s")
    told = "\n".join(f"{line}\n  from {str(data)[:300]}" for line, data in tally.faults.items())
    assert not tally.faults, f"seed {SEED}, TRIBOX_FUZZ={INPUTS}\n{told}"
    assert tally.counts["refused"] > 0
