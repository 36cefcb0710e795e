"""What all tables of a case file share: strict keys, frozen values, problems with a place."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict
from pydantic_core import PydanticCustomError

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
    """A table of the case file: unknown keys are errors, values do not change."""

    # Field names are those of the case file, also where they are capitals (E, K_T).
    # Validators are built in one pass when a case is read: one by one they take twice as long.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


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
