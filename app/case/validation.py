"""Mistakes in a case as text: one line each, with place, value and the values allowed."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from tribox.app.case.quantities import Quantity
from tribox.app.case.table import ABSENT, Model, Place, Problem, meanings
from tribox.app.case.toml_files import toml_text

_LONGEST_VALUE = 60
MOST_KEYS = 8  # of a table that a message names

# Errors of pydantic that need no more than other words; {} stands for their context.
_REASONS = {
    "bool_type": "must be true or false",
    "string_type": "must be text, in quotes",
    "string_too_short": "must not be empty",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "greater_than_equal": "must be >= {ge}",
    "less_than_equal": "must be <= {le}",
    "string_too_long": "must have at most {max_length} letters",
    "too_short": "must have at least {min_length} entry",
    "too_long": "must have at most {max_length} entries",
}


def format_problem(problem: Problem) -> str:
    """One line such as `contact.0.film.thickness = "-3 nm": must be >= 0 m`."""
    name = ".".join(map(str, problem.place))
    shown = _shown(problem.found)
    place = f"{name} = {shown}" if shown else name
    return f"{place}: {problem.reason}" if place else problem.reason


def _shown(value: object) -> str:
    """The value as it would stand in the file; empty for tables and what is too long."""
    if value is ABSENT or isinstance(value, Mapping):
        return ""
    try:
        text = toml_text({"v": value}).removeprefix("v = ").strip()
    except TypeError:  # A date, which TOML knows and a case does not use.
        text = str(value)
    if "\n" in text:
        return ""
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 3] + "..."


def problems_of(error: ValidationError, model: type[Model], data: object) -> list[Problem]:
    """The problems behind an error in ``data``, its place without tags; unknown keys first."""
    details = error.errors(include_url=False)
    details.sort(key=lambda detail: detail["type"] != "extra_forbidden")
    return [
        problem
        for detail in details
        if not _is_consequence(detail, details)
        for problem in _problems_of(detail, model, data)
    ]


def _is_consequence(detail: ErrorDetails, details: Sequence[ErrorDetails]) -> bool:
    """Whether an array is "too short" only because an entry of it is wrong."""
    loc = detail["loc"]
    return detail["type"] == "too_short" and any(
        len(other["loc"]) > len(loc) and other["loc"][: len(loc)] == loc for other in details
    )


def _problems_of(detail: ErrorDetails, model: type[Model], data: object) -> Iterator[Problem]:
    kind, context, found = detail["type"], detail.get("ctx", {}), detail["input"]
    loc = detail["loc"]
    place = _place(model, loc, data)
    if kind == "problems":
        yield from (Problem((*place, *p.place), p.reason, p.found) for p in context["problems"])
    elif kind == "extra_forbidden":
        yield Problem((), _unknown_key(model, loc, place))
    elif kind == "missing":
        yield Problem(place, _missing(model, loc))
    elif kind == "union_tag_invalid":
        reason = f"must be one of {_quoted(context['expected_tags'])}"
        key = context["discriminator"].strip("'")
        tag = found[key] if isinstance(found, Mapping) else context["tag"]
        yield Problem((*place, key), reason, tag)
    elif kind == "union_tag_not_found":
        reason = f"missing; one of {', '.join(_tags(_type_at(model, loc)))}"
        yield Problem((*place, context["discriminator"].strip("'")), reason)
    elif kind == "literal_error":
        yield Problem(place, f"must be {_quoted(context['expected'])}", found)
    elif kind in ("dict_type", "model_type", "model_attributes_type"):
        yield Problem(place, _no_table(_type_at(model, loc)), found)
    elif kind == "tuple_type":
        array = f"must be an array of tables: write [[{place[-1]}]]"
        yield Problem(place, array if isinstance(found, Mapping) else "must be an array", found)
    else:
        # What the library or a validator of ours has put together may hold braces of the writer's.
        reason = _REASONS[kind].format(**context) if kind in _REASONS else detail["msg"]
        if kind == "too_short" and context["min_length"] > 1:
            reason = reason.replace("entry", "entries")
        yield Problem((*place, *context.get("at", ())), reason, context.get("found", found))


def _no_table(wanted: Any) -> str:
    """What to write where a value stands in the place of a table."""
    if isinstance(wanted, tuple) and (tags := _tags(wanted)):
        kinds = wanted[0].model_fields.items()
        key = next(k for k, f in kinds if get_origin(f.annotation) is Literal)
        return f"must be a table, {{ {key} = {tags[0]}, ... }}; kinds: {', '.join(tags)}"
    if not _is_model(wanted):
        return "must be a table of keys and values"
    keys = list(wanted.model_fields)
    more = ", ..." if len(keys) > MOST_KEYS else ""
    return f"must be a table, {{ {keys[0]} = ... }}; its keys: {', '.join(keys[:MOST_KEYS])}{more}"


def _place(model: type[Model], loc: Sequence[str | int], data: object) -> Place:
    """Pydantic's location without the tags of unions, which no user has written.

    A table may have a key that is called like its tag: kind = "blocks" has `blocks`.
    """
    place: list[str | int] = []
    here: Any = data
    for number, part in enumerate(loc, start=1):
        members = _type_at(model, loc[: number - 1])
        if isinstance(members, tuple) and any(part in _own_tags(one) for one in members):
            continue
        if isinstance(here, Mapping) and part in here:
            here = here[part]
        elif isinstance(here, Sequence) and isinstance(part, int) and part < len(here):
            here = here[part]
        elif number < len(loc):
            continue
        place.append(part)
    return tuple(place)


def _quoted(names: str) -> str:
    return names.replace("'", '"')


def _missing(model: type[Model], loc: Sequence[str | int]) -> str:
    """What a missing key would mean."""
    table, key = _type_at(model, loc[:-1]), loc[-1]
    if isinstance(key, int):
        return "missing entry"
    if not _is_model(table) or key not in table.model_fields:
        return "missing"
    field = table.model_fields[key]
    units = [m.unit for m in field.metadata if isinstance(m, Quantity) and m.unit]
    return ", in ".join([f"missing; {meanings(table)[str(key)]}", *units])


def _unknown_key(model: type[Model], loc: Sequence[str | int], place: Place) -> str:
    """A line on a key that does not exist, with the one that was probably meant."""
    key, where = str(loc[-1]), ".".join(map(str, place[:-1]))
    inside = f" in {where}" if where else ""
    table = _type_at(model, loc[:-1])
    if not _is_model(table):
        return f'unknown key "{key}"{inside}'
    choice = _choice_made(model, loc[:-1])
    if choice is not None and any(key in other.model_fields for other in choice[1]):
        return f'key "{key}"{inside} does not go with {choice[0]}'
    meant = _meant(key, table)
    hint = f'did you mean "{meant}"?' if meant else f"valid keys: {', '.join(table.model_fields)}"
    return f'unknown key "{key}"{inside}; {hint}'


def _meant(word: str, table: type[Model]) -> str | None:
    """The key nearest to a word: by its name, one table further down, or by its description."""
    names = {name.lower(): name for name in table.model_fields}
    for name, field in table.model_fields.items():
        inner = _plain(field.annotation)
        if _is_model(inner):
            names |= {
                key.lower(): f"{name}.{key}" for key in inner.model_fields if key not in names
            }
    near = difflib.get_close_matches(word.lower(), names, n=1, cutoff=0.6)
    if near:
        return names[near[0]]
    words = {
        described.lower(): name
        for name in reversed(table.model_fields)
        for described in re.findall(r"[A-Za-z]{4,}", meanings(table).get(name, ""))
    }
    near = difflib.get_close_matches(word.lower(), words, n=1, cutoff=0.8)
    return words[near[0]] if near else None


def _type_at(model: type[Model], loc: Sequence[str | int]) -> Any:
    """The model (or models of a union, or other type) at one of pydantic's locations."""
    here: Any = model
    for part in loc:
        if _is_model(here):
            field = here.model_fields.get(str(part))
            here = _plain(field.annotation) if field is not None else None
        elif isinstance(here, tuple):
            here = next((member for member in here if part in _own_tags(member)), None)
        elif get_origin(here) is dict:
            here = _plain(get_args(here)[1])
        elif get_origin(here) is tuple:
            here = _plain(get_args(here)[0])
        else:
            return None
    return here


def _choice_made(
    model: type[Model], loc: Sequence[str | int]
) -> tuple[str, tuple[type[Model], ...]] | None:
    """For a table chosen by a tag: how it was chosen, such as `law = "coulomb"`, and the others."""
    members = _type_at(model, loc[:-1]) if loc else None
    if not isinstance(members, tuple):
        return None
    chosen = next(member for member in members if loc[-1] in _own_tags(member))
    key = next(k for k, f in chosen.model_fields.items() if loc[-1] in get_args(f.annotation))
    return f'{key} = "{loc[-1]}"', tuple(m for m in members if m is not chosen)


def _plain(annotation: Any) -> Any:
    """An annotation without `Annotated` and `None`; the members of a union of models."""
    if get_origin(annotation) is Annotated:
        return _plain(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        members = tuple(_plain(a) for a in get_args(annotation) if a is not type(None))
        return members[0] if len(members) == 1 else members
    return annotation


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, Model)


def _own_tags(member: Any) -> tuple[Any, ...]:
    """The tags that choose this member of a union: the words of its one-word literals."""
    if not _is_model(member):
        return ()
    literals = (
        get_args(f.annotation)
        for f in member.model_fields.values()
        if get_origin(f.annotation) is Literal
    )
    return tuple(words[0] for words in literals if len(words) == 1)


def _tags(members: Any) -> list[str]:
    """The tags of a union of models, in quotes."""
    models = members if isinstance(members, tuple) else (members,)
    return [f'"{tag}"' for member in models for tag in _own_tags(member)]
