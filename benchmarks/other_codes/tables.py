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
            for axis in (1, 0):
                mine, other = one.forces[step][axis], first.forces[step][axis]
                scale = abs(first.forces[step][1])
                share = f" ({100.0 * (mine - other) / abs(other):+.2f} %)"
                small = abs(other) < 1e-6 * scale
                cells.append("0" if small else f"{mine:.4f}{'' if one is first else share}")
        yield f"| {one.code} | " + " | ".join(cells) + " |"
