"""What a computed film costs of a run: ``python3 -m benchmarks.film_cost [KEY=VALUE ...]``.

`film/soft-line` with 151 vertices on the slave, three steps of pressing and two speeds. CPU time of
the film's own part: its equations at every evaluation, and what they add to the tangent. A contact
without a film has the rest too. With ``--profile`` the functions that cost most.
"""

from __future__ import annotations

import argparse
import cProfile
import functools
import pstats
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tribox import load_case, run_case
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.lubricated_tangent import LubricatedTangent

OWN: tuple[tuple[type, str], ...] = (
    (LubricatedTerm, "_extent"),
    (LubricatedTerm, "_with_film"),
    (LubricatedTerm, "_sheared"),
    (LubricatedTerm, "bearable"),
    (LubricatedTangent, "_through_film"),
    (LubricatedTangent, "_pull_rows"),
    (LubricatedTangent, "_speed_rows"),
)
CASE = Path(__file__).parents[1] / "cases" / "film" / "soft-line.toml"
SHORT = (
    "geometry.blocks.rubber.elements=[150, 20]",
    'stage=[{name="press", duration="1 s", steps=3, rate_dependent=false},'
    '{name="slide", velocities=["10 um/s", "1 mm/s"], slip_step="1.5 mm", min_steps=1}]',
    "output.figures=false",
    "output.fields_every=0",
)


def timed(owner: type, name: str, spent: Counter[str]) -> None:
    """Let a method count its CPU time, s, and its calls."""
    inner: Callable[..., Any] = getattr(owner, name)

    @functools.wraps(inner)
    def outer(*given: Any) -> Any:
        start = time.process_time()
        out = inner(*given)
        spent[name] += time.process_time() - start  # type: ignore[assignment]
        spent[f"{name} calls"] += 1
        return out

    setattr(owner, name, outer)


def main() -> None:
    """Run, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--profile", action="store_true")
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE")
    asked = parser.parse_args()
    spent: Counter[str] = Counter()
    for owner, name in () if asked.profile else OWN:
        timed(owner, name, spent)
    case, profile = load_case(CASE, [*SHORT, *asked.overrides]), cProfile.Profile(time.process_time)
    with tempfile.TemporaryDirectory() as directory:
        start = time.process_time()
        if asked.profile:
            profile.runcall(run_case, case, Path(directory) / "out", quiet=True)
            pstats.Stats(profile).sort_stats("cumtime").print_stats(60)
            return
        run_case(case, Path(directory) / "out", quiet=True)
        whole = time.process_time() - start
    own = sum(spent[name] for _, name in OWN)
    print(f"run {whole:.2f} s, film {own:.2f} s: {100.0 * own / whole:.1f} %")
    for _, name in OWN:
        calls = spent[f"{name} calls"]
        print(
            f"  {name:16s} {spent[name]:6.2f} s, {1e3 * spent[name] / max(calls, 1):5.2f} ms a call"
        )


if __name__ == "__main__":
    main()
