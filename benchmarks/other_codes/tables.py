"""The tables of what the codes took and found, as Markdown, from their records."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from benchmarks.other_codes.problem import Problem
from benchmarks.other_codes.runs import Record

SPACE = (
    "tribox",
    "tribox-energy-of-calculix",
    "getfem",
    "getfem-multipliers",
    "calculix",
    "calculix-own-tolerance",
)
PLANE = ("block-slide", "felupe")


def tables(records: Mapping[str, Record], problem: Problem) -> Iterator[str]:
    """Cost and forces of the codes in space, then of those in the plane."""
    ends = {
        "pressed": problem.press_steps - 1,
        "slip begins": problem.press_steps + 2,
        "slid": problem.press_steps + problem.slide_steps - 1,
    }
    in_space = {name: records[name] for name in SPACE if name in records}
    if in_space:
        yield from ("## Press and slide in space", "", *costs(in_space), "")
        yield from (*forces(in_space, ends), "")
    in_plane = {name: records[name] for name in PLANE if name in records}
    if in_plane:
        yield from ("## block-slide, level 1", "", *costs(in_plane), "")
        yield from forces(in_plane, {"pressed": 9, "slid": 39})


def costs(records: Mapping[str, Record]) -> Iterator[str]:
    """What each took, and over the first of them."""
    yield (
        "| code | version | settings | dofs | Newton iterations | CPU (s) | clock (s) | "
        "memory (MiB) | **CPU over the first** |"
    )
    yield "|---" * 9 + "|"
    first = next(iter(records.values()))
    for one in records.values():
        yield (
            f"| {one.code} | {one.version} | {one.settings} | {one.dofs} | "
            f"{sum(one.iterations)} | {one.cpu:.1f} | {one.clock:.1f} | {one.memory:.0f} | "
            f"**{one.cpu / first.cpu:.2f}** |"
        )


def forces(records: Mapping[str, Record], steps: Mapping[str, int]) -> Iterator[str]:
    """Normal force and friction at some steps, each over that of the first code."""
    heads = [f"{what}, {when} (N)" for when in steps for what in ("normal", "friction")]
    yield "| code | " + " | ".join(heads) + " |"
    yield "|---" * (len(heads) + 1) + "|"
    first = next(iter(records.values()))
    for one in records.values():
        cells = []
        for step in steps.values():
            size = first.forces[step][1]
            pairs = [(one.forces[step][axis], first.forces[step][axis]) for axis in (1, 0)]
            cells += [_cell(mine, other, size, one is first) for mine, other in pairs]
        yield f"| {one.code} | " + " | ".join(cells) + " |"


def _cell(mine: float, other: float, size: float, alone: bool) -> str:
    """A force, and how far it is from the first code's; one that is round-off is 0."""
    if max(abs(mine), abs(other)) < 1e-6 * abs(size):
        return "0"
    apart = "" if alone or other == 0.0 else f" ({100.0 * (mine / other - 1.0):+.2f} %)"
    return f"{mine:.4f}{apart}"
