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
PLAUSIBLE = ["1e-8", "1e-4", "0.1", "0.3", "0.5", "1", "1.0", "2", "10", "1e5", "1e9"]


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


@st.composite
def changed_cases(draw: st.DrawFn, small: bool = False) -> str:
    """A good case with a few values replaced, taken away, doubled or added.

    ``small``: one whose mesh is made in no time, with values that are mostly of the right kind.
    """
    case = copy.deepcopy(draw(st.sampled_from(small_cases() if small else good_cases())))
    for _ in range(draw(st.integers(1, 3))):
        key = draw(st.sampled_from(sorted(keys_of(case), key=str)))
        odd = ["near"] if small else ["value"] * 3 + ["near"] * 3 + ["take", "add", *["shape"] * 2]
        kind = draw(st.sampled_from([*odd, *["like"] * 6, "known"]))
        if kind == "like":
            leaf = draw(st.sampled_from(sorted(_leaves(case), key=str)))
            place(case, leaf, draw(like(value_at(case, leaf))))
        elif kind == "shape":
            _put_shape(draw, case)
        elif kind == "take":
            place(case, key, None)
        elif kind == "add":
            place(case, (*key[:-1], draw(new_keys)) if isinstance(key[-1], str) else key,
                  draw(hostile.values))  # fmt: skip
        elif kind == "known":
            _add_known(draw, case, key)
        else:
            place(case, key, draw(hostile.values if kind == "value" else near))
    return hostile.toml_of(case)


def _put_shape(draw: st.DrawFn, case: dict[str, Any]) -> None:
    """Put a list or a table where a text stands, or sweep the text over some."""
    leaf = draw(st.sampled_from(text_keys(case) or [("title",)]))
    text = value_at(case, leaf) if leaf != ("title",) else "a"
    shape = st.one_of(st.sampled_from(hostile.shapes_of(text)), hostile.shapes)
    if draw(st.integers(0, 4)) == 0:
        values = draw(st.lists(st.one_of(shape, st.just(text)), max_size=3))
        case["sweep"] = {"key": ".".join(map(str, leaf)), "values": values}
    else:
        place(case, leaf, draw(shape))


def text_keys(case: dict[str, Any]) -> list[Key]:
    """Places of text that is no number with a unit: names, kinds, titles."""
    texts = ((key, value_at(case, key)) for key in _leaves(case))
    return sorted(
        (k for k, v in texts if isinstance(v, str) and not re.match(r"[-+.]?[0-9]", v)), key=str
    )


def _leaves(case: dict[str, Any]) -> Iterator[Key]:
    """Places of values that are numbers or text."""
    return (k for k in keys_of(case) if not isinstance(value_at(case, k), dict | list))


def value_at(case: Any, key: Key) -> Any:
    """What stands at a place."""
    for name in key:
        case = case[name]
    return case


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


near = st.one_of(
    st.sampled_from(PLAUSIBLE).map(hostile.Raw),
    st.sampled_from(PLAUSIBLE).map(hostile.Raw),
    st.sampled_from(hostile.NUMBERS).map(hostile.Raw),
    st.builds(
        lambda number, unit: f"{number} {unit}",
        st.sampled_from([*PLAUSIBLE, "1e300", "1e-300", "1e999", "0"]),
        st.sampled_from(["m", "mm", "nm", "Pa", "MPa", "s", "N", "m/s", "Pa*s", "1/m", "Pa/m"]),
    ),
)
"""Values of which many are of the right kind, however large."""

new_keys = st.one_of(
    st.sampled_from(["x", "{}", "size", "elements", "mesh", "kind", "law", "velocity", "steps"]),
    st.text(min_size=1, max_size=5),
)


def _add_known(draw: st.DrawFn, case: dict[str, Any], key: Key) -> None:
    """Put a value at one of the top keys, or a sweep of some key."""
    name = draw(st.sampled_from(["probe", "solver", "output", "sweep", "stage", "boundary"]))
    if name == "sweep":
        listed = st.lists(st.one_of(near, hostile.values), max_size=3)
        case[name] = {"key": ".".join(map(str, key)), "values": draw(listed)}
        return
    case[name] = draw(hostile.values)


@st.composite
def damaged_texts(draw: st.DrawFn) -> bytes:
    """The bytes of a good case file, some of them others."""
    return draw(damaged(hostile.toml_of(draw(st.sampled_from(good_cases()))).encode()))


ODD_BYTES = [
    *(b"\x00", b"\xff", b"\xfe\xff", b"\xef\xbb\xbf", b"\r", b"\n", b'"', b"[", b"]]", b"{", b"}"),
    *(b"=", b"#", b"'''", b'"""', b"\\", b"\\u0000", b"\\ud800", b"\\U0010ffff", b"1e999", b"nan"),
    *(b",", b"9" * 5000, b"[" * 5000, b"a." * 5000 + b"b = 1\n", b"\n[a]\n", b"\x1b[2J", b"\xc3"),
]


@st.composite
def damaged(draw: st.DrawFn, good: bytes) -> bytes:
    """Bytes with a few of them cut, doubled, swapped or replaced."""
    kind = draw(st.integers(0, 30))
    if kind == 0:
        return b""
    if kind == 1:
        return draw(st.binary(max_size=64))
    if kind == 2:
        encoding = draw(st.sampled_from(["utf-16", "utf-8-sig", "utf-32", "latin-1", "utf-16-le"]))
        return good.decode("utf-8", "replace").encode(encoding, "replace")
    data = good
    for _ in range(draw(st.integers(1, 3))):
        low = draw(st.integers(0, len(data)))
        high = draw(st.one_of(st.just(low), st.integers(low, min(low + 20, len(data))),
                              st.integers(low, len(data))))  # fmt: skip
        put = draw(st.one_of(st.sampled_from(ODD_BYTES), st.just(b""), st.just(data[low:high] * 2)))
        data = data[:low] + put + data[high:]
    return data
