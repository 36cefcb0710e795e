"""What all tables of a case file share: strict keys, frozen values, problems with a place."""

from __future__ import annotations

import ast
import difflib
import functools
import inspect
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, GetJsonSchemaHandler, Strict
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

from tribox.app.errors import as_line

Place = tuple[str | int, ...]
"""The keys that lead to a value, such as ("contact", 0, "film", "thickness")."""

LONGEST_NAME = 100
MOST_STEPS = 10_000_000
MOST_ENTRIES = 1000


def _on_one_line(text: str) -> str:
    """See that a name holds nothing that breaks the lines of tables, logs and terminals."""
    if as_line(text) != text:
        raise PydanticCustomError("line", "must be one line without control characters")
    return text


Flag = Annotated[bool, Strict()]
Text = Annotated[str, Strict(), Field(min_length=1)]
Line = Annotated[str, Strict(), Field(max_length=500), AfterValidator(_on_one_line)]
Name = Annotated[
    str, Strict(), Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_on_one_line)
]
Count = Annotated[int, Strict(), Field(ge=1, le=MOST_STEPS)]
CountOrZero = Annotated[int, Strict(), Field(ge=0, le=MOST_STEPS)]
Points = Annotated[int, Strict(), Field(ge=1, le=100_000)]
Degree = Annotated[int, Strict(), Field(ge=1, le=30)]
Elements = Annotated[int, Strict(), Field(ge=1, le=100_000)]


class Model(BaseModel):
    """A table of the case file: unknown keys are errors, values do not change.

    What a key means stands below it in the source, or in its `Field`; see `meanings`.
    """

    # Field names are those of the case file, also where they are capitals (E, K_T).
    # Validators are built in one pass when a case is read: one by one they take twice as long.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        schema = handler(core_schema)
        properties = handler.resolve_ref_schema(schema).get("properties", {})
        for key, meaning in meanings(cls).items():
            properties.get(key, {}).setdefault("description", meaning)
        return schema


@functools.cache
def meanings(kind: type[Model]) -> dict[str, str]:
    """What the keys of a table mean, by name; read from the source where it is asked for."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        try:
            table = ast.parse(inspect.getsource(base)).body[0]
        except (OSError, TypeError):  # made of a declaration, or none of Python
            continue
        assert isinstance(table, ast.ClassDef)
        for key, text in itertools.pairwise(table.body if issubclass(base, Model) else ()):
            match key, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                    value=ast.Constant(value=str(words))
                ):
                    found[name] = " ".join(words.split())
    given = {name: field.description for name, field in kind.model_fields.items()}
    return found | {name: words for name, words in given.items() if words}


def nearest(name: str, known: Sequence[str]) -> str:
    """Which of the known names was meant, or all of them, for a message."""
    near = difflib.get_close_matches(name, known, n=1)
    return f'did you mean "{near[0]}"?' if near else f"there are {', '.join(known)}"


class _Absent:
    """The type of `ABSENT`."""

    def __repr__(self) -> str:
        return "ABSENT"


ABSENT = _Absent()  # stands for "no value to show" in a `Problem`; None could be a value


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong in a case."""

    place: Place  # where, from the top of the case
    reason: str  # what is allowed, or what is wrong, in a few words
    found: Any = ABSENT  # the value to show; `ABSENT` shows only the place


def size_problems(
    values: Sequence[float] | None, dim: int, place: Place, what: str = "components"
) -> Iterator[Problem]:
    """A point or direction, if it is given, with more or fewer numbers than the mesh has axes."""
    if values is not None and len(values) != dim:
        yield Problem(place, f"must have {dim} {what} in this mesh", list(values))


def problems_error(problems: Iterable[Problem]) -> PydanticCustomError:
    """The error by which a validator reports several problems at once."""
    listed = list(problems)
    text = "; ".join(f"{'.'.join(map(str, p.place))}: {p.reason}" for p in listed)
    return PydanticCustomError("problems", "{text}", {"text": text, "problems": listed})
