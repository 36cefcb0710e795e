"""What is done with one case file of the fuzzer: all that reads it, short of running it."""

from pathlib import Path

from tests.fuzz.guard import OddLine, see_line
from tribox.app.build.case_notes import notes_on
from tribox.app.case.case import Case, given_keys, resolved_toml
from tribox.app.case.generators import BlocksGeometry, BoxesGeometry
from tribox.app.case.reading import check_case, load_case
from tribox.app.case.stage import load_steps_of
from tribox.app.errors import InputError

SMALL = 300  # cells that are meshed for an input


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
