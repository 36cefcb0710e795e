"""What of a case was given, and not filled in by a default."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from tribox.app.case.case import Case


def given_keys(case: Case) -> list[str]:
    """Dotted keys that a case file gave, such as "contact.0.film.thickness", in its order.

    Args:
        case: as it was read; one whose defaults were resolved knows no longer.
    """
    return list(_keys(case.model_dump(mode="json", exclude_unset=True)))


def _keys(table: Mapping[str, Any], before: str = "") -> Iterator[str]:
    for key, value in table.items():
        name = f"{before}{key}"
        if isinstance(value, Mapping):
            yield from _keys(value, f"{name}.")
        elif isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
            for index, item in enumerate(value):
                yield from _keys(item, f"{name}.{index}.")
        else:
            yield name
