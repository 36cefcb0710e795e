"""TOML blocks: a whole case is checked as it is, a fragment within a case that it could be part of.

A fragment is merged over its case: a table with a choice in it (``kind``, ``law``, ``mesh``, ...)
takes the place of the case's table, as does an entry of a list of tables with the same name or
surface; all else is added.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.docs.blocks import Block
from tribox import check_case
from tribox.app.case.toml_files import toml_text

USUAL = "cases/block-slide.toml"
_WHOLE = {"geometry", "bodies", "stage"}
_CHOICES = {"kind", "law", "mesh", "preset", "shape", "material"}
_NAMES = ("name", "surface", "slave")
Table = dict[str, Any]


def parsed(block: Block) -> Table:
    """The block as TOML."""
    try:
        return tomllib.loads(block.text)
    except tomllib.TOMLDecodeError as error:
        raise block.error(str(error)) from None


def is_whole(data: Mapping[str, Any]) -> bool:
    """Whether TOML is a case of its own."""
    return _WHOLE <= set(data)


def check_block(block: Block, directory: Path) -> None:
    """Check a block of TOML in a directory that looks like a checkout."""
    data = parsed(block)
    if not data and not block.text.strip().startswith("#"):
        raise block.error("an empty block")
    base, _, inside = block.marks.get("in", "").partition(" at ")
    if not base and is_whole(data):
        path = directory / f"block_{block.line}.toml"
        path.write_text(block.text, encoding="utf-8")
    else:
        path = _in_a_case(block, data, directory / (base or USUAL), inside.strip())
    found = check_case(path)
    path.unlink()
    if found:
        hint = (
            "" if base or is_whole(data) else f" (as part of {USUAL}; name another: <!-- in: -->)"
        )
        raise block.error("; ".join(found) + hint)


def _in_a_case(block: Block, data: Table, base: Path, inside: str) -> Path:
    """Write the case that a fragment has become part of, beside its files."""
    if not base.is_file():
        raise block.error(f"in: {base.name}: no such case")
    for key in reversed(inside.split(".") if inside else []):
        data = {key: data}
    whole = merged(tomllib.loads(base.read_text(encoding="utf-8")), data)
    path = base.with_name(f"block_{block.line}.toml")
    path.write_text(toml_text(whole), encoding="utf-8")
    return path


def merged(base: Table, over: Mapping[str, Any]) -> Table:
    """A table with another merged over it, neither changed."""
    if _CHOICES & set(over):
        return dict(over)
    result = dict(base)
    for key, value in over.items():
        result[key] = _merged_value(base.get(key), value)
    return result


def _merged_value(old: Any, new: Any) -> Any:
    if isinstance(new, Mapping) and _is_tables(old):
        # [contact.friction] alone belongs to the last [[contact]] of the file.
        return [*old[:-1], merged(old[-1], new)]
    if isinstance(new, Mapping) and isinstance(old, Mapping):
        return merged(dict(old), new)
    if _is_tables(new) and _is_tables(old):
        return _merged_list(old, new)
    return new


def _merged_list(old: list[Table], new: list[Table]) -> list[Table]:
    names = {_name(entry) for entry in new}
    return [*(entry for entry in old if _name(entry) not in names), *new]


def _name(entry: Table) -> Any:
    return next((entry[key] for key in _NAMES if key in entry), id(entry))


def _is_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)
