"""Values set at dotted keys, such as contact.0.film.thickness: overrides and sweeps."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from tribox.app.case.plain_data import TomlError, parse_toml
from tribox.app.errors import InputError

_NUMBER = re.compile(r"0|[1-9][0-9]{0,8}", re.ASCII)
_PLAIN = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?", re.ASCII)
_LONGEST = 100  # letters of an override that a message shows


class KeyPathError(ValueError):
    """A dotted key that leads nowhere in a case."""


def set_value(data: dict[str, Any], key: str, value: object) -> None:
    """Set the value at a dotted key in plain data; missing tables are made, list entries not.

    Args:
        data: nested dicts and lists, as read from TOML; changed in place.
        key: such as "contact.0.film.thickness"; quotes as in TOML around a name with dots.
        value: what to put there.

    Raises:
        KeyPathError: the key is malformed, or leads through something that is no table or array.
    """
    names = _split(key)
    here: Any = data
    for depth, name in enumerate(names):
        above = ".".join(names[:depth])
        last = depth == len(names) - 1
        if isinstance(here, list):
            if _NUMBER.fullmatch(name) is None or int(name) >= len(here):
                raise KeyPathError(f'{above} has no entry "{name}"; {_entries(len(here))}')
            step: Any = int(name)
        elif isinstance(here, dict):
            step = name
            if not last:
                here.setdefault(name, {})
        else:
            raise KeyPathError(f"{above} is no table, so it has no key {name!r}")
        if last:
            here[step] = value
        here = here[step]


def value_at(model: Any, key: str) -> Any:
    """What validated tables hold at a dotted key, such as a number in SI.

    Raises:
        KeyPathError: the key leads nowhere.
    """
    here = model
    for name in _split(key):
        try:
            if isinstance(here, Mapping):
                here = here[name]
            else:
                here = here[int(name)] if isinstance(here, Sequence) else getattr(here, name)
        except (AttributeError, IndexError, KeyError, ValueError):
            raise KeyPathError(f"there is no {name!r}") from None
    return here


def _entries(count: int) -> str:
    return f"entries are numbered from 0 to {count - 1}" if count else "it is empty"


def _split(key: str) -> list[str]:
    """The names in a dotted key, by TOML's own rules."""
    try:
        here: Any = parse_toml(f"{key.strip()} = 0")
    except TomlError:
        raise KeyPathError("not a dotted key such as contact.0.film.thickness") from None
    names = []
    while isinstance(here, dict):
        if len(here) != 1:
            raise KeyPathError("not a dotted key such as contact.0.film.thickness")
        [(name, here)] = here.items()
        names.append(name)
    return names


def apply_override(data: dict[str, Any], override: str) -> None:
    """Set what one "dotted.key=value" text says.

    Args:
        data: nested dicts and lists, as read from TOML; changed in place.
        override: the text; the value is TOML if it can be, else text.

    Raises:
        InputError: the text is no such thing, or its key leads nowhere.
    """
    key, equals, text = override.partition("=")
    shown = override if len(override) <= _LONGEST else f"{override[:_LONGEST]}..."
    if not equals or not key.strip():
        raise InputError(f'"{shown}": an override is written key=value')
    try:
        set_value(data, key, _override_value(text))
    except (KeyPathError, TomlError) as error:
        raise InputError(f'"{shown}": {error}') from None


def without_effect(overrides: Sequence[str], swept: str) -> str | None:
    """Why overrides do not change a sweep over the key ``swept`` as they look; None if they do."""
    for override in overrides:
        key = override.partition("=")[0].strip()
        if _split(key) == _split(swept):
            return (
                f"--set {key}: the [sweep] sets this key to each of its values; change those: "
                "--set 'sweep.values=[...]'"
            )
    return None


def _override_value(text: str) -> object:
    """The value as TOML if it is that, else the text itself; .5 and 5. are numbers too.

    Raises:
        TomlError: it is TOML that no case may hold.
    """
    try:
        parsed = parse_toml(f"value = {text}")
    except TomlError as error:
        if error.is_toml:
            raise
        plain = text.strip()
        return float(plain) if _PLAIN.fullmatch(plain) else plain
    return parsed["value"] if parsed.keys() == {"value"} else text.strip()
