"""The fuzzer: whatever a file or an option holds, it comes to a result or to one line.

500 inputs by default, the same every time; ``TRIBOX_FUZZ=10000`` tries as many, others every time
(docs/testing.md).
"""

import os
import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz.campaign import SHARES, run
from tests.fuzz.case_files import damaged
from tests.fuzz.other_files import damaged_results

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


@settings(max_examples=200, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_the_fuzzer_damages_files_that_are_no_text_too(tmp_path_factory, data):
    directory = tmp_path_factory.getbasetemp() / "good"
    directory.mkdir(exist_ok=True)
    (directory / "arrays.npz").write_bytes(b"PK\xff")
    _, name, content = data.draw(damaged_results((directory,)))
    assert isinstance(data.draw(damaged(b"PK\xff")), bytes)
    assert name == "arrays.npz" and (content is None or isinstance(content, str | bytes))
