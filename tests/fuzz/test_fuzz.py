"""The fuzzer: whatever a case file holds, it comes to a result or to one line.

160 inputs by default, the same every time; ``TRIBOX_FUZZ=10000`` tries as many, others every time
(docs/testing.md).
"""

import os
import random
import shutil
import warnings
from collections import Counter
from contextlib import redirect_stdout
from io import StringIO

import pytest
from hypothesis import HealthCheck, given, seed, settings

from tests.fuzz.case_files import changed_cases, damaged_texts
from tests.fuzz.guard import outcome
from tests.fuzz.targets import build_case, read_case

INPUTS = int(os.environ.get("TRIBOX_FUZZ", "160"))
FIXED = "TRIBOX_FUZZ" not in os.environ
SEED = int(os.environ.get("TRIBOX_FUZZ_SEED", "14" if FIXED else str(random.randrange(10**6))))
# Kinds of inputs, what is done with them, and their part of all inputs.
KINDS = {
    "changed": (changed_cases(), read_case, 0.75),
    "damaged": (damaged_texts(), read_case, 0.15),
    "built": (changed_cases(small=True), build_case, 0.1),
}


@pytest.mark.parametrize("kind", KINDS)
def test_an_input_comes_to_a_result_or_to_one_line(kind, tmp_path):
    inputs, act, share = KINDS[kind]
    counts: Counter[str] = Counter()

    @seed(SEED)
    @settings(
        max_examples=max(1, round(INPUTS * share)),
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(inputs)
    def each(data: object) -> None:
        place = tmp_path / "input"
        place.mkdir()
        try:
            with warnings.catch_warnings(), redirect_stdout(StringIO()):
                warnings.simplefilter("ignore")
                came_to = outcome(lambda: act(data, place))
        finally:
            shutil.rmtree(place)
        word = came_to.partition(":")[0]
        counts[word] += 1
        assert word in ("fine", "refused"), came_to

    each()
    print(f"{kind}, seed {SEED}: {dict(counts)}")
    assert counts["refused"] > 0
