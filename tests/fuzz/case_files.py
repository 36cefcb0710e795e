"""Case files for the fuzzer: good ones with bad values, or with other bytes."""

import copy
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from tests.app.conftest import BLOCK, BOXES, FILM, SLID
from tests.fuzz import hostile

ROOT = Path(__file__).parents[2]
Key = tuple[str | int, ...]
SURFACES = ["elastomer_contact", "aluminium_contact", "top", "bottom", "elastomer_left"]
SWEEP = {"key": "contact.0.friction.mu", "values": [0.1, "20 %"]}


@cache
def good_cases() -> tuple[dict[str, Any], ...]:
    """Cases that are correct: those shipped, and those of the tests."""
    texts = [path.read_text() for path in sorted((ROOT / "cases").rglob("*.toml"))]
    cases = [tomllib.loads(text) for text in (*texts, BLOCK, FILM, BOXES, SLID)]
    cases = [case for case in cases if "mesh" not in case["geometry"]]  # which needs a file beside
    return (*cases, tomllib.loads(BLOCK) | {"sweep": SWEEP})


@cache
def small_cases() -> tuple[dict[str, Any], ...]:
    """Those with few cells, all of the same elements and materials."""
    return tuple(tomllib.loads(text) for text in (BLOCK, FILM, SLID, BOXES))


def keys_of(value: Any, before: Key = ()) -> Iterator[Key]:
    """All places in a case, tables and entries of arrays too."""
    if before:
        yield before
    entries: Any = ()
    if isinstance(value, dict):
        entries = value.items()
    elif isinstance(value, list):
        entries = enumerate(value)
    for key, inner in entries:
        yield from keys_of(inner, (*before, key))


def place(case: Any, key: Key, value: Any) -> None:
    """Put a value at a place, or take away what is there (None)."""
    here = case
    for name in key[:-1]:
        here = here[name]
    if value is None:
        del here[key[-1]]
    else:
        here[key[-1]] = value


def value_at(case: Any, key: Key) -> Any:
    """What stands at a place."""
    for name in key:
        case = case[name]
    return case


def leaves(case: dict[str, Any]) -> list[Key]:
    """Places of values that are numbers or text."""
    found = (k for k in keys_of(case) if not isinstance(value_at(case, k), dict | list))
    return sorted(found, key=str)


def text_keys(case: dict[str, Any]) -> list[Key]:
    """Places of text that is no number with a unit: names, kinds, titles."""
    texts = ((key, value_at(case, key)) for key in leaves(case))
    return [k for k, v in texts if isinstance(v, str) and not re.match(r"[-+.]?[0-9]", v)]


@st.composite
def changed_cases(draw: st.DrawFn, small: bool = False) -> str:
    """A good case with a few values replaced, taken away or added.

    ``small``: one whose mesh is made in no time, with values that are of the right kind.
    """
    case = copy.deepcopy(draw(st.sampled_from(small_cases() if small else good_cases())))
    for _ in range(draw(st.integers(1, 3))):
        kind = draw(st.sampled_from(["like"] * 4 if small else ["like", "like", "value", "odd"]))
        key = draw(st.sampled_from(leaves(case) or [("title",)]))
        if kind == "like" and key != ("title",):
            place(case, key, draw(like(value_at(case, key))))
            continue
        key = draw(st.sampled_from(sorted(keys_of(case), key=str)))
        if kind == "odd":  # a key less, or one that no table has
            more = (*key[:-1], draw(hostile.words))
            gone = isinstance(key[-1], int) or draw(st.booleans())
            place(case, key if gone else more, None if gone else draw(hostile.values))
        else:
            place(case, key, draw(hostile.values))
    return hostile.toml_of(case)


_FACTORS = ["1e-300", "1e-30", "1e-12", "1e-3", "0.5", "1", "2", "1e3", "1e6", "1e12", "1e30",
            "1e150", "1e300", "-1", "0", "1e999", "1e308", "5e-324"]  # fmt: skip
_COUNTS = [0, 1, 2, 3, 7, 100, 10**4, 10**6, 10**12, 2**31, 2**63, 10**30, -1]


def like(value: Any) -> st.SearchStrategy[Any]:
    """Values of the same kind, with the same unit."""
    if isinstance(value, bool):
        return st.booleans()
    if isinstance(value, int):
        return st.sampled_from(_COUNTS).map(lambda n: hostile.Raw(str(n)))
    if isinstance(value, float):
        return st.sampled_from(_FACTORS).map(hostile.Raw)
    if isinstance(value, str) and (match := re.match(r"[-+.eE0-9]+(?= *\S)", value)):
        return st.sampled_from(_FACTORS).map(lambda number: number + value[match.end() :])
    return st.one_of(st.sampled_from(SURFACES), hostile.words)


ODD_BYTES = [
    *(b"\x00", b"\xff", b"\xfe\xff", b"\xef\xbb\xbf", b"\r", b"\n", b'"', b"[", b"]]", b"{", b"}"),
    *(b"=", b"#", b"'''", b'"""', b"\\", b"\\u0000", b"\\ud800", b"\\U0010ffff", b"1e999", b"nan"),
    *(b",", b"9" * 5000, b"[" * 5000, b"a." * 5000 + b"b = 1\n", b"\n[a]\n", b"\x1b[2J", b"\xc3"),
    b"",
]


@st.composite
def damaged_texts(draw: st.DrawFn) -> bytes:
    """The bytes of a good case file, some of them cut, replaced, or in another encoding."""
    text = hostile.toml_of(draw(st.sampled_from(good_cases())))
    encodings = ["utf-8"] * 20 + ["utf-16", "utf-8-sig", "utf-32", "latin-1", "utf-16-le"]
    data = text.encode(draw(st.sampled_from(encodings)), "replace")
    for _ in range(draw(st.integers(1, 3))):
        low = draw(st.integers(0, len(data)))
        high = low + draw(st.sampled_from([0, 1, 5, 20, len(data)]))
        data = data[:low] + draw(st.sampled_from(ODD_BYTES)) + data[high:]
    return data
