"""The tables of a comparison, as Markdown: both sides of each job, then all jobs together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tribox.app.bench.comparison import Comparison, Ran
from tribox.app.bench.tables import CONTACT, FACTORISATION, PARTS, SOLIDS

# Parts that are shown as one; all others by themselves.
TOGETHER: dict[str, tuple[str, ...]] = {
    "solids": SOLIDS,
    "contact": CONTACT,
    "factorisation": FACTORISATION,
}
SHORTEST = 0.05  # s; a ratio to less than this is noise
COUNTS = {
    "dofs": "dofs",
    "steps": "steps",
    "attempts (explicit: time steps)": "attempts",
    "Newton iterations": "iterations",
    "tangents": "tangents",
}


def job_table(found: Comparison) -> Iterator[str]:
    """Both sides of a job, and the second over the first."""
    first, second = found.first, found.second
    yield f"| {found.job} | {first.side} | {second.side} | {second.side} / {first.side} |"
    yield "|---|---|---|---|"
    for name, a, b in (
        ("command, CPU (s)", first.cost.cpu, second.cost.cpu),
        ("command, clock (s)", first.cost.clock, second.cost.clock),
    ):
        yield f"| {name} | {a:.2f} | {b:.2f} | **{b / a:.3f}** |"
    for name, attribute in COUNTS.items():
        c, d = getattr(first, attribute), getattr(second, attribute)
        yield f"| {name} | {c} | {d} | {f'{d / c:.3f}' if c else '–'} |"
    yield f"| largest difference of the forces | | | {forces(found)} |"
    clock = "clock" if found.by_clock else "CPU"
    parts = [grouped(run) for run in (first, second)]
    for part in in_order([*parts[0], *parts[1]]):
        a, b = (seconds.get(part, 0.0) for seconds in parts)
        ratio = f"{b / a:.2f}" if a >= SHORTEST else "–"
        yield f"| {part}, {clock} (s) | {a:.3f} | {b:.3f} | {ratio} |"


def forces(found: Comparison) -> str:
    """How far the forces are apart, and where."""
    if found.forces.worst == 0.0:
        return "the same"
    return f"{found.forces.worst:.1e} ({found.forces.where})"


def grouped(run: Ran) -> dict[str, float]:
    """Seconds by part, some parts as one; parts of the program's own clock stay as they are."""
    of = {part: name for name, parts in TOGETHER.items() for part in parts}
    sums: dict[str, float] = {}
    for part, seconds in run.parts.items():
        name = of.get(part, part)
        sums[name] = sums.get(name, 0.0) + seconds
    return sums


def in_order(parts: Sequence[str]) -> list[str]:
    """Parts in the order of the run, unknown ones last."""
    of = {part: name for name, several in TOGETHER.items() for part in several}
    known = list(dict.fromkeys(of.get(part, part) for part in PARTS))
    return [p for p in known if p in parts] + sorted(set(parts) - set(known))


def all_jobs(found: Sequence[Comparison]) -> Iterator[str]:
    """One row for each job: what the command took on both sides, counts and forces."""
    first, second = found[0].first.side, found[0].second.side
    yield (
        f"| run | dofs | CPU {first} (s) | CPU {second} (s) | **CPU {second} / {first}** | "
        f"clock {first} (s) | clock {second} (s) | **clock {second} / {first}** | "
        "Newton iterations | forces apart by |"
    )
    yield "|---" * 10 + "|"
    for one in found:
        a, b = one.first, one.second
        yield (
            f"| {one.job} | {b.dofs} | {a.cost.cpu:.2f} | {b.cost.cpu:.2f} | "
            f"**{b.cost.cpu / a.cost.cpu:.3f}** | {a.cost.clock:.2f} | {b.cost.clock:.2f} | "
            f"**{b.cost.clock / a.cost.clock:.3f}** | {a.iterations} → {b.iterations} | "
            f"{forces(one)} |"
        )
