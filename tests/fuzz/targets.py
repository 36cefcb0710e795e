"""What is done with one input of the fuzzer: all that reads it, short of running a case."""

import os
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from unittest import mock

from tests.fuzz.guard import OddLine, see_line
from tribox.app.build.case_notes import notes_on
from tribox.app.case.case import Case, given_keys, resolved_toml
from tribox.app.case.generators import BlocksGeometry, BoxesGeometry
from tribox.app.case.reading import check_case, load_case
from tribox.app.case.stage import load_steps_of
from tribox.app.errors import InputError
from tribox.app.fit.run import run_fit
from tribox.app.results import Results, read
from tribox.app.results.claim import sweep_labels
from tribox.app.results.directory import check_free

SMALL = 300  # cells that are meshed for an input

Act = Callable[[object, Path], None]


def read_case(data: object, directory: Path) -> None:
    """Check a case file, and look at it as ``run`` does if it is correct."""
    _look_at(_correct(data, directory))


def build_case(data: object, directory: Path) -> None:
    """As :func:`read_case`; the mesh and all on it are made too, if it is small."""
    case = _correct(data, directory)
    _look_at(case)
    if _cells(case) <= SMALL:
        from tribox.app.run.building import notes_on_building

        notes_on_building(case)


def _correct(data: object, directory: Path) -> Case:
    """The case in these bytes (or text); each mistake is seen to be a line that names the file."""
    path = directory / "case.toml"
    path.write_bytes(data.encode() if isinstance(data, str) else bytes(data))  # type: ignore[call-overload]
    lines = check_case(path)
    _see_lines(lines, path)
    if lines:
        raise InputError(lines[0])
    return load_case(path)


def _see_lines(lines: list[str], path: Path) -> None:
    for line in lines:
        see_line(line)
        if not line.startswith(str(path)):
            raise OddLine(f"does not name the file: {line[:200]!r}")


def _look_at(case: Case) -> None:
    for one in [case, *(part for _, part in case.sweep_cases())]:
        for note in notes_on(one):
            see_line(note)
        before = 0.0
        for stage in one.stage:
            for step in load_steps_of(stage, one.film_conductance, before):
                step.travel(step.dt), step.speed(step.dt)
                before = step.velocity
    given_keys(case)
    path = case.source
    assert path is not None
    again = path.with_name("resolved.toml")
    again.write_text(resolved_toml(case), encoding="utf-8")
    assert load_case(again) == case, "the resolved case is another"


def _cells(case: Case) -> float:
    """Number of cells that a mesh of blocks or boxes has; of others, more than any limit."""
    if not isinstance(case.geometry, BlocksGeometry | BoxesGeometry):
        return float("inf")
    total = 0.0
    for one in (case.geometry.upper, case.geometry.lower):
        if one.elements is None:
            return float("inf")
        count = 1.0
        for number in one.elements:
            count *= min(number, 10**6)
        total += count
    return total


def override_case(data: object, directory: Path) -> None:
    """Read a good case with overrides."""
    text, overrides = data  # type: ignore[misc]
    path = directory / "case.toml"
    path.write_text(text, encoding="utf-8")
    lines = check_case(path, overrides)
    for line in lines:
        see_line(line)
    if lines:
        raise InputError(lines[0])
    _look_at(load_case(path, overrides))


def fit_data(data: object, directory: Path) -> None:
    """Fit the law to a data file, without figures."""
    content, fixed = data  # type: ignore[misc]
    path = directory / "data.csv"
    path.write_bytes(content)
    with mock.patch("tribox.app.fit.run.draw_fit"):
        run_fit(path, None, fixed, [], directory / "fit", force=True)


def read_results(data: object, directory: Path) -> None:
    """Read all of a results directory of which one file is damaged, and report on it."""
    _with_damage(data, directory, _read_all)


def _with_damage(data: object, directory: Path, act: Callable[[Path], None]) -> None:
    good, name, content = data  # type: ignore[misc]
    here = directory / "results"
    shutil.copytree(good, here)
    damage(here / name, content)
    try:
        act(here)
    finally:
        if not (here / name).is_dir():  # A pipe, say, on which a copy of the tree would wait.
            (here / name).unlink(missing_ok=True)


def damage(path: Path, content: bytes | str | None) -> None:
    """Put other content in the place of a file: bytes, nothing, or "directory", "loop", "pipe"."""
    path.unlink(missing_ok=True)
    if isinstance(content, bytes):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    elif content == "directory":
        path.mkdir()
    elif content == "loop":
        path.symlink_to(path)
    elif content == "pipe":
        os.mkfifo(path)
    elif content == "endless":
        path.symlink_to("/dev/zero")


def _read_all(directory: Path) -> None:
    sweep_labels(directory)
    errors: list[InputError] = []
    look = read(directory)
    for one in _with_parts(look, errors):
        for name in TABLES:
            _try(lambda: getattr(one, name), errors)
        for step in _steps(one, errors):
            for kind in ("fields", "contact", "contact_points"):
                _try(lambda: getattr(one, kind)(step), errors)
    from tribox.app.report import write_report

    _try(lambda: write_report(directory, directory.parent / "report.html"), errors)
    _try(lambda: check_free(directory, True, sweep_labels(directory)), errors)
    if errors:
        raise errors[0]


TABLES = (
    *("case", "summary", "history", "contacts", "surfaces", "bodies", "probes", "body_probes"),
    *("contact_probes", "load_steps", "sweep", "times"),
)


def _with_parts(results: Results, errors: list[InputError]) -> list[Results]:
    try:
        return [results, *results.parts.values()]
    except InputError as error:
        errors.append(error)
        return [results]


def _steps(results: Results, errors: list[InputError]) -> list[int]:
    try:
        return [-1, *map(int, results.steps)][:4]
    except InputError as error:
        errors.append(error)
        return [-1]


def _try(act: Callable[[], object], errors: list[InputError]) -> None:
    """Do one thing; a refusal is kept, seen to be a line, and the next thing follows."""
    try:
        act()
    except InputError as error:
        see_line(str(error))
        errors.append(error)


@cache
def acts() -> dict[str, Act]:
    """What is done with the inputs of each kind."""
    return {
        "changed": read_case,
        "damaged": read_case,
        "built": build_case,
        "overrides": override_case,
        "data": fit_data,
        "results": read_results,
    }
