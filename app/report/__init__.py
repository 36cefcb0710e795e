"""``tribox report``: a results directory as one HTML page, drawn from its files alone."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from tribox.app.case.case import Case, given_keys
from tribox.app.case.table import Model, meanings
from tribox.app.errors import InputError
from tribox.app.figures.style import fitting
from tribox.app.report.tables import (
    Table,
    comparison_tables,
    cost_table,
    detail_tables,
    end_table,
    energy_table,
    energy_verdict,
    facts,
    load_step_table,
    notes_and_warnings,
    origin,
    status_verdict,
    sweep_table,
)
from tribox.app.results import Results, read
from tribox.app.results.directory import write_text
from tribox.app.results.reading import files_of_one_run

# -- The figures of a results directory, to stand in the page itself -------------------------------

_KNOWN = {
    "history": ("Forces and friction", "Normal force, friction force and their ratio over the run"),
    "mesh": ("Mesh", "The bodies with their cells before anything moved"),
    "deformed": ("Deformed bodies", "The deformed bodies, and the tractions between them"),
    "animation": ("Animation", "The deformed bodies in the course of the run"),
    "energy": ("Energies", "Work and energies over the run"),
    "effective_viscosity": (
        "Effective viscosity",
        "Effective viscosity over the velocity, on logarithmic axes",
    ),
    "friction_map": ("Friction map", "Friction over the velocity at steady points"),
    "stribeck": ("Stribeck view", "Friction coefficient over the velocity"),
    "force_displacement": (
        "Force and displacement",
        "Force of platens and tools over their displacement",
    ),
    "phase": ("Phase plot", "Velocity over displacement"),
    "sweep_comparison": (
        "Comparison",
        "Forces of pairs and tools, springback and thickness at the end of each run",
    ),
    "sweep": ("Sweep", "Forces at the end of each run over the swept value"),
}
_ORDER = ("sweep", "mesh", "deformed", "history", "force_displacement", "energy")
_KINDS = {".png": "image/png", ".gif": "image/gif"}


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure."""

    title: str  # above it
    alt: str  # what it shows, for those who cannot see it
    source: str  # the image itself, as a data address
    width: int  # in points of the image
    height: int  # likewise


def pictures_of(directory: Path, subject: str) -> list[Picture]:
    """All figures of a results directory, those that tell most first; InputError if one is none."""
    from PIL import Image

    found = (p for p in (directory / "figures").glob("*.*") if p.suffix in _KINDS)
    paths = [p for p in found if p.is_file() and not p.is_symlink()]
    pictures = []
    for path in sorted(paths, key=_rank):
        if ".part" in path.name:
            continue
        title, shows = _title(path.stem)
        try:
            data = base64.b64encode(path.read_bytes()).decode("ascii")
            with Image.open(path, formats=[path.suffix[1:]]) as image:
                width, height = image.size
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            raise InputError(
                f"{path}: is no picture that can be read ({error}); tribox plot draws it again"
            ) from None
        source = f"data:{_KINDS[path.suffix]};base64,{data}"
        pictures.append(Picture(title, f"{shows}. {subject}", source, width, height))
    return pictures


def _rank(path: Path) -> tuple[int, str]:
    places = [place for place, name in enumerate(_ORDER) if path.stem.startswith(name)]
    return (min(places, default=len(_ORDER)), path.name)


def _title(stem: str) -> tuple[str, str]:
    """Title and description of a figure, by the longest known beginning of its name."""
    known = [name for name in _KNOWN if stem.startswith(name)]
    if not known:
        words = stem.replace("_", " ").replace("-", " ")
        return words.capitalize(), f"Figure {words}"
    name = max(known, key=len)
    title, shows = _KNOWN[name]
    rest = stem.removeprefix(name).replace("_", " ").replace("-", " ").strip()
    # Names of fields hold no dash, and begin with a letter.
    if found := re.fullmatch(r"deformed-(?:([A-Za-z]\w*)-)?(\d+)-(.+)", stem):
        field = f"{found[1].replace('_', ' ')}, " if found[1] else ""
        rest = f"{field}end of stage {found[2]}, {found[3]}"
    return (f"{title}: {rest}", f"{shows}: {rest}") if rest else (title, shows)


NAME = "report.html"
TEMPLATE = "template.html"


def write_report(directory: Path, out: Path | None = None) -> Path:
    """Write the report of a results directory, by default its ``report.html``; InputError."""
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
    parts: list[dict[str, Any]] = []
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
    labels = () if case.sweep is None else case.sweep.labels
    told = dict(parts[0]["facts"]) if parts else {}
    return {
        "title": title,
        "directory": results.directory.resolve().name,
        "version": str(summary.get("versions", {}).get("tribox") or told.get("tribox", "")),
        "parts": parts,
        "sweep": sweep,
        "beside": beside,
        "origin": origin(summary),
        "sweep_key": "" if case.sweep is None else case.sweep.key,
        "missing": [label for label in labels if label not in results.parts],
        "sweep_pictures": pictures,
        "inputs": input_tables(case, given),
        "given_known": given is not None,
    }


def _run_part(results: Results, label: str, title: str) -> dict[str, Any]:
    """What the template says of one run; ``label`` of its value in a sweep."""
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
    return {
        "label": label,
        "status": status_verdict(summary, results.unfinished),
        "origin": origin(summary),
        "notes": notes,
        "warnings": warnings,
        "tables": [*(table for table in ends if table is not None), *details],
        "energy": energy_verdict(history, summary),
        "energies": energy_table(history),
        "pictures": pictures_of(results.directory, f"{title} {label}".strip()),
        "cost": cost_table(summary),
        "facts": facts(summary),
    }


# -- The case of a run as tables of keys, values and meanings; what was given is marked ------------

_RAISED = {"^2": "²", "^3": "³", "*": " "}
_QUANTITY = re.compile(r"([+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?)(?: (.*))?")


@dataclass(frozen=True, slots=True)
class Input:
    """One key of a case."""

    key: str  # within its table, such as "film.thickness"
    value: str  # with its unit
    given: bool  # whether the case file gave it
    meaning: str  # what the key is


@dataclass(frozen=True, slots=True)
class InputTable:
    """One table of a case: its title and its keys, those that were given first."""

    title: str
    inputs: Sequence[Input]


def input_tables(case: Case, given: Sequence[str] | None) -> list[InputTable]:
    """A case's tables, in its order; ``given``: dotted keys of the file, None: all count so."""
    data = case.model_dump(mode="json", exclude_none=True, exclude={"title"})
    tables: dict[str, list[Input]] = {}
    for title, place, key, value, meaning in _entries(case, data):
        whole = f"{place}{key}"
        known = given is None or any(g == whole or g.startswith(f"{whole}.") for g in given)
        tables.setdefault(title, []).append(Input(key, value_text(value), known, meaning))
    return [
        InputTable(title, sorted(inputs, key=lambda one: not one.given))
        for title, inputs in tables.items()
    ]


def _entries(
    table: Model, data: Mapping[str, Any], title: str = "", place: str = "", inside: str = ""
) -> Iterator[tuple[str, str, str, Any, str]]:
    """Title and place of its table, key in it, value and meaning of each key of a table and below.

    ``inside``: dotted keys from the table at the top of the case to this one.
    """
    for name, field in type(table).model_fields.items():
        key, value = field.alias or name, getattr(table, name)
        if data.get(key, {}) == {}:
            continue
        parts = [(key, value, data[key])]
        if isinstance(value, Mapping):  # of tables, by name
            parts = [(f"{key}.{one}", value[one], data[key][one]) for one in value]
        elif isinstance(value, tuple):
            parts = [
                (f"{key}.{n}", *one) for n, one in enumerate(zip(value, data[key], strict=True))
            ]
        if not parts or not all(isinstance(one, Model) for _, one, _ in parts):
            yield title, place, f"{inside}{key}", data[key], meanings(type(table)).get(name, "")
            continue
        for path, one, own in parts:
            if title:
                yield from _entries(one, own, title, place, f"{inside}{path}.")
            else:
                yield from _entries(one, own, _title_of(path, own), f"{path}.")


def _title_of(path: str, data: Mapping[str, Any]) -> str:
    """What a table at the top of a case is called, such as "Contact 0: pad on tool"."""
    name, _, which = path.partition(".")
    if word := {"bodies": "Body", "tools": "Tool"}.get(name):
        return f"{word} {which}"
    called = f"{data['slave']} on {data['master']}" if name == "contact" else ""
    called = called or str(data.get("name") or data.get("surface", ""))
    return f"{name.capitalize()} {which}: {called}".rstrip(": ") if which else name.capitalize()


def value_text(value: Any) -> str:
    """A value of a case as text: quantities readable, tables over time as pairs."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return "; ".join(" → ".join(map(value_text, row)) for row in value)
    if isinstance(value, list):
        return ", ".join(map(value_text, value))
    if isinstance(value, Mapping):
        return "; ".join(f"{key}: {value_text(one)}" for key, one in value.items())
    return readable(str(value))


def readable(text: str) -> str:
    """A quantity as a resolved case holds it, such as "3e-08 m", exactly, but as "30 nm"."""
    match = _QUANTITY.fullmatch(text)
    if match is None:
        return text
    try:
        number = Decimal(match[1])
    except InvalidOperation:
        return text
    unit = match[2] or ""
    for old, new in _RAISED.items():
        unit = unit.replace(old, new)
    if not 0.1 <= abs(number) < 1000:
        fit = fitting([float(number)], unit)
        number, unit = number.scaleb(-fit.power), fit.name
    return f"{_plain(number)} {unit}".rstrip()


def _plain(number: Decimal) -> str:
    """A number without needless zeros; with a power of ten where it is long."""
    number = number.normalize()
    if number == 0 or -5 < number.adjusted() < 6:
        return f"{number:f}"
    return f"{number:e}".replace("e+", "e")
