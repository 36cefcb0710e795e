"""Case files as text: TOML within bounds, cures for what is none, values set at dotted keys."""

from __future__ import annotations

import errno
import json
import os
import re
import stat
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from datetime import date, time
from pathlib import Path
from typing import Any

from pydantic_core import PydanticCustomError

from tribox.app.errors import InputError

# -- TOML of anyone's making as plain data within bounds; what goes beyond them is refused ---------

DEEPEST = 30  # tables and arrays inside each other; a case needs eight
DIGITS = 400  # of a whole number; no float is larger


class TomlError(ValueError):
    """Text that is not TOML, or goes beyond the bounds.

    Attributes:
        line: number of the line, from 1; None where it is not known.
        is_toml: whether the text is TOML all the same.
    """

    def __init__(self, reason: str, line: int | None = None, is_toml: bool = True) -> None:
        super().__init__(reason)
        self.line, self.is_toml = line, is_toml


def parse_toml(text: str) -> dict[str, Any]:
    """Nested tables, arrays, texts, numbers and truth values of TOML text.

    Raises:
        TomlError: it is none, is nested too deeply, or holds an endless number or a date.
    """
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise TomlError(_TOO_DEEP) from None
    except tomllib.TOMLDecodeError as error:
        match = re.fullmatch(r"(.*) \(at line (\d+), column (\d+)\)", str(error), re.DOTALL)
        if match is None:
            raise TomlError(f"not valid TOML: {error}", is_toml=False) from None
        at = int(match[2])
        cure = likely_cure(text, at, match[1])
        reason = f"not valid TOML: {cure or match[1]} (column {match[3]})"
        raise TomlError(reason, at, is_toml=False) from None
    except ValueError:  # Python reads no more than 4300 digits.
        found = re.search(rf"[0-9_]{{{DIGITS},}}", text)
        line = None if found is None else text.count("\n", 0, found.start()) + 1
        raise TomlError(_TOO_LONG, line) from None
    # See that the bounds are kept; without recursion, which has a bound of its own.
    level: list[tuple[str, Any]] = [("", data)]
    for _ in range(DEEPEST + 1):
        level = [entry for place, value in level for entry in _entries(place, value)]
        for place, value in level:
            if isinstance(value, int) and value.bit_length() > DIGITS * 10 // 3:
                raise TomlError(f"{place}: {_TOO_LONG}")
            if isinstance(value, date | time):
                raise TomlError(f"{place}: is a date or time of day, which no key takes")
    if level:
        raise TomlError(f"{level[0][0].split('.')[0]}: {_TOO_DEEP}")
    return data


_TOO_DEEP = f"tables or arrays are nested more than {DEEPEST} deep"
_TOO_LONG = f"holds a whole number of more than {DIGITS} digits"


def flat(table: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and plain values of nested tables and lists of tables."""
    items = table.items() if isinstance(table, Mapping) else enumerate(table)
    for key, value in items:
        tables = isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value)
        if tables or isinstance(value, Mapping):
            yield from flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _entries(place: str, value: Any) -> Iterator[tuple[str, Any]]:
    """What is inside a value, with its dotted place."""
    before = f"{place}." if place else ""
    if isinstance(value, dict):
        yield from ((f"{before}{key}", inner) for key, inner in value.items())
    elif isinstance(value, list):
        yield from ((f"{before}{index}", inner) for index, inner in enumerate(value))


# -- what somebody has probably meant ---------------------------------------------------------

_LISTS = ("boundary", "contact", "probe", "stage")  # tables of which there may be several
_NUMBER = r"[-+]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_QUANTITY = re.compile(rf"([\w.-]+)\s*=\s*({_NUMBER}\s*[A-Za-zµ°%][\w/^*·%°µ]*)")
_WORDS = {**dict.fromkeys(("yes", "on"), "true"), **dict.fromkeys(("no", "off"), "false")}
_NOTHING = ("none", "null", "nan", "nil")
# What is wrong with a line, by a pattern of it without comments, and the cure.
_CURES = (
    (r".*[“”„‘’«»].*", 'quotes are straight: "text"'),
    (r"\s*([\w.-]+)\s*:.*", r"a key and its value have = between them: \1 = …"),
    (r"\s*([\w.-]+)\s+[^=\s].*", r"a key and its value have = between them: \1 = …"),
    (r"\s*([\w.-]+)\s*=\s*", r"\1 has no value"),
    (r".*//.*", "comments begin with #"),
    (r".*;\s*", "lines end without a semicolon"),
    (r".*=\s*([-+]?\d+),(\d+)\s*", r"decimals stand behind a point: \1.\2"),
    (r".*=\s*([-+]?)(\.\d+)\s*", r"a digit stands before the point too: \g<1>0\2"),
    (r".*=\s*([-+]?\d+\.)\s*", r"a digit stands behind the point too: \g<1>0"),
    (r".*=\s*[-+\d.]+\s*\*.*", "values are numbers and no sums: 5e6"),
    (r"\s*(\[\[?)((?:\w+\.)*)(\w+(?: +\w+)+)\]+\s*",
     r'a name with spaces stands in quotes: \1\2"\3"]'),
    (r"\s*(\[\[[\w.]+)\]?\s*", r"the brackets are not closed: \1]]"),
    (r"\s*(\[[\w.]+)\s*", r"the bracket is not closed: \1]"),
    (r'[^"]*("[^"]*)', "the quote is not closed"),
    (r'.*"[^"]*\\.*".*', r"in quotes \ begins a special character: write / in paths"),
    (r".*\{[^}]*", "a table in braces stands on one line: { x = 0, y = 0 }"),
    (r"\s*[^\x00-\x7f].*", "a key consists of letters a to z, digits, _ and -"),
)  # fmt: skip


def likely_cure(text: str, line: int, said: str) -> str:
    """What is probably wrong with TOML text, in a few words; "" where nothing is known."""
    lines = text.splitlines()
    here = lines[line - 1] if line <= len(lines) else ""
    if found := re.match(r"Cannot declare \((.*?),?\) twice", said):
        name = found[1].replace("'", "").replace(", ", ".")
        if name in _LISTS:
            return f"each of several tables is headed [[{name}]]"
        return f"there is a table [{name}] already; its keys belong below one heading"
    if said == "Cannot overwrite a value":
        return f"{here.partition('=')[0].strip()} stands there twice"
    if said.startswith("Unclosed array"):
        return "a list above is not closed with ]"
    bare = re.sub(r"^((?:[^\"#]|\"[^\"]*\")*)#.*", r"\1", here)
    return _value_cure(bare) or next(
        (match.expand(cure) for known, cure in _CURES if (match := re.fullmatch(known, bare))), ""
    )


def _value_cure(line: str) -> str:
    """What is wrong with a value that is no TOML by itself, "" if nothing."""
    outside = re.sub(r'"[^"]*"', '""', line)
    if "//" not in outside and (found := _QUANTITY.search(outside)):
        return f'a value with a unit stands in quotes: {found[1]} = "{found[2].strip()}"'
    if not (found := re.search(r"([\w.-]+)\s*=\s*([A-Za-z_][\w-]*)\s*(?:[,}].*)?$", outside)):
        return ""
    key, word = found.groups()
    if word in ("true", "false"):
        return ""
    if word.lower() in ("true", "false") or word.lower() in _WORDS:
        return f"write {key} = {_WORDS.get(word.lower(), word.lower())}"
    if word.lower() in _NOTHING:
        return f"leave {key} out where it has no value"
    return f'text stands in quotes: {key} = "{word}"'


# -- Values set at dotted keys, such as contact.0.film.thickness: overrides and sweeps -------------

_INDEX = re.compile(r"0|[1-9][0-9]{0,8}", re.ASCII)
_PLAIN = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?", re.ASCII)
_LONGEST = 100  # letters of an override that a message shows
_NO_KEY = (
    "not a dotted key such as contact.0.film.thickness, or "
    "bodies.'rubber pad'.nu with quotes round what has spaces"
)


class KeyPathError(ValueError):
    """A dotted key that leads nowhere in a case."""


def set_value(data: dict[str, Any], key: str, value: object) -> None:
    """Set the value at a dotted key, quoted as in TOML, in plain data; tables are made, lists not.

    KeyPathError if it leads through what is no table or array.
    """
    names = _split(key)
    here: Any = data
    for depth, name in enumerate(names):
        above = ".".join(names[:depth])
        last = depth == len(names) - 1
        if isinstance(here, list):
            if _INDEX.fullmatch(name) is None or int(name) >= len(here):
                raise KeyPathError(f'{above} has no entry "{name}"; {_counted(len(here))}')
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
    """What validated tables hold at a dotted key, in SI; KeyPathError if it leads nowhere."""
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


def _counted(count: int) -> str:
    return f"entries are numbered from 0 to {count - 1}" if count else "it is empty"


def _split(key: str) -> list[str]:
    """The names in a dotted key, by TOML's own rules."""
    try:
        here: Any = parse_toml(f"{key.strip()} = 0")
    except TomlError:
        raise KeyPathError(_NO_KEY) from None
    names = []
    while isinstance(here, dict):
        if len(here) != 1:
            raise KeyPathError(_NO_KEY)
        [(name, here)] = here.items()
        names.append(name)
    return names


def apply_override(data: dict[str, Any], override: str) -> None:
    """Set what one "dotted.key=value" says; InputError if it is none, or leads nowhere."""
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
    """The value as TOML if it is that, else the text itself; .5 and 5. are numbers too."""
    try:
        parsed = parse_toml(f"value = {text}")
    except TomlError as error:
        if error.is_toml:
            raise
        plain = text.strip()
        return float(plain) if _PLAIN.fullmatch(plain) else plain
    return parsed["value"] if parsed.keys() == {"value"} else text.strip()


# -- Plain data written as TOML, with the option to write some keys as comments  ------------------

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(data: Mapping[str, Any], given: Mapping[str, Any] | None = None) -> str:
    """TOML of nested mappings, lists, text, numbers and truth values, without the None keys.

    Keys of ``data`` that are not in ``given``, where it is not None, are written as comments.
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


# -- Text files of anyone's making: read if they are files, of bounded size, in UTF-8  ------------

MEGABYTE = 1_000_000
LARGEST = 4 * MEGABYTE  # bytes of a case file or of data


def read_text(path: Path, largest: int = LARGEST) -> str:
    """Text of a file in UTF-8, without an editor's mark; InputError if it cannot be read."""
    try:
        if see_file(path).st_size > largest:
            raise _too_large(path, largest)
        with path.open("rb") as stream:
            content = stream.read(largest + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL.
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason})") from None
    if len(content) > largest:
        raise _too_large(path, largest)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}: not a text file in UTF-8: byte {error.start} (line {line}) is "
            f"0x{content[error.start]:02x}; save it as UTF-8 in the editor"
        ) from None


def see_file(path: Path) -> os.stat_result:
    """See that something is a file: to read a pipe may take for ever, a device has no end."""
    found = os.stat(path)
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found.st_mode):
        raise OSError("it is a device, pipe or socket")
    return found


def _too_large(path: Path, largest: int) -> InputError:
    return InputError(f"{path}: is larger than {largest // MEGABYTE} MB, so it is none of ours")


# -- Files that a case names, found from where the case file is ------------------------------------


def found_file(value: object, context: Mapping[str, Any], what: str) -> Path:
    """An absolute path, seen from the case file, of a file that is there, ``what`` it may be.

    PydanticCustomError if there is no such file.
    """
    if not isinstance(value, str | Path) or not str(value):
        raise PydanticCustomError("path", "must be the name of {what}, in quotes", {"what": what})
    try:
        path = (Path(context.get("source") or "").parent / value).resolve()
        found = path.is_file()
    except (OSError, ValueError):  # a name that no file can have
        raise PydanticCustomError("path", "is no name that a file can have") from None
    if not found and not context.get("past"):
        raise PydanticCustomError("path", "no such file ({path})", {"path": str(path)})
    return path
