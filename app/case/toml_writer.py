"""Plain data written as TOML, with the option to write some keys as comments."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(data: Mapping[str, Any], given: Mapping[str, Any] | None = None) -> str:
    """TOML of nested mappings, lists, text, numbers and truth values.

    Args:
        data: what to write; keys that are None are left out, as TOML has no such value.
        given: where not None, keys of `data` that are not in `given` are written as comments.

    Returns:
        Text that `tomllib.loads` reads back to `data` (or `given`) without the None keys.
    """
    return "\n".join(_table((), data, data if given is None else given)).strip("\n") + "\n"


def _table(path: tuple[str, ...], data: Mapping[str, Any], given: Any) -> Iterator[str]:
    """Lines of one table: its values, then its tables, then its arrays of tables."""
    entries = {key: value for key, value in data.items() if value is not None}
    known = given if isinstance(given, Mapping) else {}
    for key, value in entries.items():
        if not isinstance(value, Mapping) and not _is_tables(value):
            yield f"{_mark(key in known)}{_key(key)} = {_value(value)}"
    for key, value in entries.items():
        inner = (*path, _key(key))
        mark = _mark(key in known)
        if isinstance(value, Mapping):
            if not value or any(not isinstance(v, Mapping) for v in value.values()):
                yield from ("", f"{mark}[{'.'.join(inner)}]")
            yield from _table(inner, value, known.get(key))
        elif _is_tables(value):
            for index, item in enumerate(value):
                yield from ("", f"{mark}[[{'.'.join(inner)}]]")
                yield from _table(inner, item, known[key][index] if key in known else None)


def _mark(is_given: bool) -> str:
    return "" if is_given else "# "


def _is_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else _text(key)


def _text(text: str) -> str:
    # JSON's escapes are TOML's, but for DEL, which TOML wants escaped too.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any) -> str:
    """One value on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{_key(k)} = {_value(v)}' for k, v in value.items())} }}"
    raise TypeError(f"{value!r} cannot be written as TOML")
