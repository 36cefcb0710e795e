"""The fuzzer: whatever a file or an option holds, it comes to a result or to one line.

500 inputs by default, the same every time; ``TRIBOX_FUZZ=10000`` tries as many, others every time
(docs/testing.md).
"""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

from tests.fuzz.campaign import SHARES, run

INPUTS = int(os.environ.get("TRIBOX_FUZZ", "500"))
FIXED = "TRIBOX_FUZZ" not in os.environ
SEED = int(os.environ.get("TRIBOX_FUZZ_SEED", "14" if FIXED else str(random.randrange(10**6))))


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory for all that inputs write, with good results to damage."""
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.parametrize("kind", SHARES)
def test_an_input_comes_to_a_result_or_to_one_line(kind, work, tmp_path):
    tally = run(kind, max(1, round(INPUTS * SHARES[kind])), SEED, work)
    print(f"{kind}, seed {SEED}: {dict(tally.counts)}, slowest {tally.slowest:.1f} s")
    told = "\n".join(f"{tally.faults[cause]} times {line}\n  first from {str(data)[:300]}"
                     for cause, (data, line) in tally.first.items())  # fmt: skip
    assert not tally.faults, f"seed {SEED}, TRIBOX_FUZZ={INPUTS}\n{told}"
    assert tally.counts["refused"] > 0
