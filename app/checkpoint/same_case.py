"""Whether a run may go on with a case: in what it differs from the one that the run began with."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

from tribox.app.case.case import Case, given_keys
from tribox.app.case.reading import load_past_case
from tribox.app.case.stage import Stage
from tribox.app.case.toml_files import flat
from tribox.app.errors import InputError
from tribox.app.results.claim import end_of, given_keys_of, sums_of
from tribox.app.results.directory import sha256_of

# What may change: it has no part in the results, or only in how well equations are solved. Meshes
# are compared by what is in them.
FREE = (
    *("title", "output", "probe", "geometry.mesh", "geometry.meshed"),
    "geometry.max_cells",
    *("solver.tolerance", "solver.max_iterations", "solver.min_step_fraction"),
    *("solver.petsc", "solver.partition"),
)
# Classes of the user's own and meshes of tools: their files are compared by what is in them.
OWN = re.compile(r"(contact\.\d+\.friction|bodies\..+)\.class")
TOOL = re.compile(r"tools\..+\.file")
MESH = "geometry.mesh"
LENGTHS = ("duration", "steps", "velocities")  # of a stage
SHOWN = 3  # differences that are named
EQUAL = 1e-12  # relative difference of step lengths that are one


def is_whole(directory: Path, now: Case) -> bool:
    """Whether a run that is done ended as the case does now; InputError if it is another."""
    began, given = load_past_case(directory / "case.toml"), given_keys_of(directory)
    given |= set(given_keys(now))
    refuse(changes(began, now, len(began.stage) - 1, given, end_of(directory)), directory)
    sums = sums_of(directory)
    files = {key: (path.name, sums.get(path.name)) for key, path in named_files(began)}
    refuse_files(files, now, directory)
    pairs = zip(began.stage, now.stage, strict=False)
    same = all(getattr(a, key) == getattr(b, key) for a, b in pairs for key in LENGTHS)
    return same and len(began.stage) == len(now.stage)


def refuse(found: Iterator[str], directory: Path) -> None:
    """Refuse a case that differs; InputError if there are differences."""
    lines = list(found)
    if lines:
        raise InputError(f"{directory}: the case is not the one of the run: {listed(lines)}")


def named_files(case: Case) -> Iterator[tuple[str, Path]]:
    """Files that a case was written with, by their keys: what was meshed is not."""
    keyed = ((".".join(map(str, place)), path) for place, path in case.named_files())
    return ((key, path) for key, path in keyed if key != "geometry.meshed")


def refuse_files(began: Mapping[str, tuple[str, str | None]], now: Case, directory: Path) -> None:
    """InputError for files with other contents than ``began``: names and SHA-256, by keys."""
    for key, path in named_files(now):
        name, digest = began.get(key, ("", ""))
        if name and sha256_of(path) != digest:
            raise InputError(
                f"{directory}: {key}: {path} is not the file that the run was begun with, a copy "
                f"of which is {directory / 'inputs' / name}"
            )


def listed(lines: list[str]) -> str:
    """The first few of differences, in one line."""
    more = f" (and {len(lines) - SHOWN} more)" if len(lines) > SHOWN else ""
    return "; ".join(lines[:SHOWN]) + more


def changes(
    began: Case, now: Case, stage: int, given: Set[str] | None = None, time: float = math.inf
) -> Iterator[str]:
    """Differences that a run cannot go on with, one line each; of ``given`` keys, None: all.

    ``time``: s, to which the run has come: what follows in a boundary's tables may be added to.
    """
    for key, was, is_ in _unequal(began, now, stage):
        further = key.startswith("boundary.") and _goes_further(was, is_, time)
        if not further and (given is None or key in given or key == "stage"):
            yield _line(key, was, is_)


def _unequal(began: Case, now: Case, stage: int) -> Iterator[tuple[str, Any, Any]]:
    """Keys, and the values before and now."""
    before, after = dict(flat(_table(began))), dict(flat(_table(now)))
    for key in sorted({**before, **after}):
        was, is_ = (_without_place(key, table.get(key)) for table in (before, after))
        free = any(key == n or key.startswith(f"{n}.") for n in FREE)
        if not free and was != is_:
            yield key, was, is_
    yield from _stage_changes(began.stage, now.stage, stage)


def _table(case: Case) -> Any:
    return case.model_dump(mode="json", exclude_none=True, exclude={"stage"})


def _without_place(key: str, value: Any) -> Any:
    """A value without the file, which is compared by its sum: the name of a class, or nothing."""
    if TOOL.fullmatch(key) and isinstance(value, str):
        return ""
    return value.rpartition(":")[2] if OWN.fullmatch(key) and isinstance(value, str) else value


def _stage_changes(
    began: Sequence[Stage], now: Sequence[Stage], at: int
) -> Iterator[tuple[str, Any, Any]]:
    """Stages may be added at the end, the last one be longer, and one not over have more steps."""
    if len(now) < len(began):
        yield "stage", f"{len(began)} stages", f"{len(now)} stages"
        return
    for number, (before, after) in enumerate(zip(began, now, strict=False)):
        was, is_ = (one.model_dump(mode="json", exclude_none=True) for one in (before, after))
        last = number == len(began) - 1
        for key in sorted({**was, **is_}):
            more = (key == "max_steps" and number >= at) or (last and _longer(key, before, after))
            if was.get(key) != is_.get(key) and not more:
                yield f"stage.{number}.{key}", was.get(key), is_.get(key)


def _goes_further(was: Any, is_: Any, time: float) -> bool:
    """Whether a table over time differs only by rows that change nothing up to ``time`` (s)."""
    try:
        after = [(float(t.split()[0]), v) for t, v in is_]
        if isinstance(was, str):  # one value at all times
            was = [[is_[0][0], was]]
        before = [(float(t.split()[0]), v) for t, v in was]
    except (AttributeError, IndexError, TypeError, ValueError):
        return False
    if after[: len(before)] != before or len(after) == len(before):
        return False
    last = before[-1]
    for row in after[len(before) :]:  # as long as they hold the value
        if row[1] != last[1]:
            return last[0] >= (1.0 - EQUAL) * time
        last = row
    return True


def _longer(key: str, before: Stage, after: Stage) -> bool:
    """Whether a stage differs in ``key`` only by going on for longer, with the same steps."""
    if key == "velocities":
        return after.velocities[: len(before.velocities)] == before.velocities
    if key not in ("duration", "steps") or before.duration is None or after.duration is None:
        return False
    had, has = before.duration / before.steps, after.duration / after.steps
    return after.steps >= before.steps and abs(had - has) <= EQUAL * had


def _line(key: str, before: Any, after: Any) -> str:
    texts = ["nothing" if v is None else json.dumps(v, ensure_ascii=False) for v in (after, before)]
    return f"{key} = {texts[0]} instead of {texts[1]}"
