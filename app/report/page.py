"""The page itself: what stands in it, and the file it goes into."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from tribox.app.case.given import given_keys
from tribox.app.errors import InputError
from tribox.app.report.inputs import input_tables
from tribox.app.report.pictures import Picture, pictures_of
from tribox.app.report.tables import (
    Table,
    comparison_tables,
    detail_tables,
    end_table,
    load_step_table,
    sweep_table,
)
from tribox.app.report.verdicts import (
    Verdict,
    cost_table,
    energy_table,
    energy_verdict,
    facts,
    notes_and_warnings,
    origin,
    status_verdict,
)
from tribox.app.results import Results, read
from tribox.app.results.directory import write_text
from tribox.app.results.reading import files_of_one_run

NAME = "report.html"
TEMPLATE = "template.html"


@dataclass(frozen=True, slots=True)
class RunPart:
    """What the page says of one run.

    Attributes:
        label: of the value of a sweep, "" of a run alone.
        status: how it ended; origin: when and how it was made.
        notes: said before its first step; warnings: said in it.
        tables: of load steps, and of pairs, tools, surfaces and bodies at their ends.
        energy: whether energies add up; energies: table of them.
        pictures: its figures; cost: wall time; facts: sizes and versions.
    """

    label: str
    status: Verdict
    origin: Sequence[tuple[str, str]]
    notes: Sequence[str]
    warnings: Sequence[str]
    tables: Sequence[Table]
    energy: Verdict | None
    energies: Table | None
    pictures: Sequence[Picture]
    cost: Table | None
    facts: Sequence[tuple[str, str]]


def write_report(directory: Path, out: Path | None = None) -> Path:
    """Write the report of a results directory.

    Args:
        directory: of a run or a sweep.
        out: the file; default: ``report.html`` in the directory.

    Returns:
        The file.

    Raises:
        InputError: it is no results directory, or the file cannot be written.
    """
    results = read(directory)
    path = out or directory / NAME
    with files_of_one_run(results):
        text = page(results)
    try:
        write_text(path, text)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return path


def page(results: Results) -> str:
    """The HTML of a results directory's report."""
    return environment().get_template(TEMPLATE).render(**contents(results))


def environment() -> Environment:
    """Templates beside this module; what is put in is text and no HTML."""
    return Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def contents(results: Results) -> dict[str, Any]:
    """What the template is filled with."""
    case, summary = results.case, results.summary
    title = case.title or results.directory.resolve().name
    parts: list[RunPart] = []
    sweep: Table | None = None
    beside: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    if case.sweep is None:
        parts, given = [_run_part(results, "", title)], summary.get("given")
    else:
        given = given_keys(case)
        sweep = sweep_table(results.sweep, len(case.contact))
        beside = comparison_tables(results.sweep, results.sweep_details, list(results.parts))
        pictures = pictures_of(results.directory, title)
        parts = [_run_part(part, label, title) for label, part in results.parts.items()]
    missing = [label for label in _labels(results) if label not in results.parts]
    return {
        "title": title,
        "directory": results.directory.resolve().name,
        "version": _version(summary, parts),
        "parts": parts,
        "sweep": sweep,
        "beside": beside,
        "origin": origin(summary),
        "sweep_key": "" if case.sweep is None else case.sweep.key,
        "missing": missing,
        "sweep_pictures": pictures,
        "inputs": input_tables(case, given),
        "given_known": given is not None,
    }


def _run_part(results: Results, label: str, title: str) -> RunPart:
    summary, history = results.summary, results.history
    ended = summary.get("status") == "done"
    ends = (
        load_step_table(results.load_steps, len(results.case.contact)),
        None if ended else end_table(history, len(results.case.contact)),
    )
    details = detail_tables(
        results.load_steps,
        results.contacts,
        results.surfaces,
        results.bodies,
        results.tools,
        results.shape_probes,
    )
    notes, warnings = notes_and_warnings(summary)
    return RunPart(
        label,
        status_verdict(summary, results.unfinished),
        origin(summary),
        notes,
        warnings,
        [*(table for table in ends if table is not None), *details],
        energy_verdict(history, summary),
        energy_table(history),
        pictures_of(results.directory, f"{title} {label}".strip()),
        cost_table(summary),
        facts(summary),
    )


def _labels(results: Results) -> Sequence[str]:
    return () if results.case.sweep is None else results.case.sweep.labels


def _version(summary: dict[str, Any], parts: Sequence[RunPart]) -> str:
    """The version of the program that made the results; "" where no run tells."""
    told = dict(parts[0].facts) if parts else {}
    return str(summary.get("versions", {}).get("tribox") or told.get("tribox", ""))
