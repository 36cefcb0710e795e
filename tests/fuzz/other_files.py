"""Overrides, data files and results directories for the fuzzer."""

import copy
import csv
import json
import re
from io import StringIO
from pathlib import Path

from hypothesis import strategies as st

from tests.app.conftest import BLOCK, FILM, SLID
from tests.fuzz import hostile
from tests.fuzz.case_files import (
    ODD_BYTES,
    changed_cases,
    damaged,
    good_cases,
    keys_of,
    near,
    place,
)
from tests.fuzz.hostile import text_of

# -- overrides --------------------------------------------------------------------------------

_ODD_KEYS = [
    *("a" + ".a" * 5000, "a.b", "stage.-1.steps", "stage.9999999999999999999999", "stage.²", "{}"),
    *("stage.٣.steps", '"', "'a'", "a=b", "[a]", "", ".", "\x00", "stage." + "9" * 5000),
    *("__class__", "bodies.x.E", "sweep.values.0"),
]
_KEYS = st.one_of(
    st.sampled_from(["contact.0.film.thickness", "contact.0.friction.mu", "stage.0.steps"]),
    st.builds(
        lambda case, n: ".".join(map(str, (keys := list(keys_of(case)))[n % len(keys)])),
        st.sampled_from(good_cases()),
        st.integers(0, 500),
    ),
    st.sampled_from(_ODD_KEYS),
    st.text(max_size=6),
)
_TEXTS = st.one_of(
    st.one_of(hostile.values, near).map(text_of),
    st.one_of(hostile.quantities, hostile.words),
    st.sampled_from(["1\nb = 2", "[", "{", '"', "1 # x", "", " ", "=", "1,2", "{x=1}\n[a]"]),
)
overrides = st.tuples(
    st.sampled_from([BLOCK, FILM, SLID]),
    st.lists(st.builds(lambda key, text: f"{key}={text}", _KEYS, _TEXTS), min_size=1, max_size=2),
)
"""A case and the overrides on it."""

# -- data of tribometers ----------------------------------------------------------------------

DRY = b"""thickness [nm],velocity [mm/s],pressure [MPa],traction [kPa]
0,0.001,3,301.14
0,0.0311,3,296.88
0,0.965,3,297.53
"""
WET = b"""# a film
thickness [nm],velocity [mm/s],load [N],area [mm^2],friction_coefficient,weight
10,0.001,3,1,0.0829,1
10,0.0977,3,1,0.0807,1
10,0.965,3,1,0.0164,2
10,9.54,3,1,0.1579,1
30,0.001,3,1,0.0201,1
30,30,3,1,0.168,1
300,3.04,3,1,0.001,1
"""
SLIP = b"""thickness [nm],velocity [mm/s],pressure [MPa],slip [um],force [N],area [mm^2]
0,0.1,3,0.05,0.15,1
0,0.1,3,0.2,0.39,1
0,0.1,3,1,0.38,1
0,0.1,3,5,0.33,1
0,0.1,3,50,0.3,1
0,0.1,3,,0.3,1
"""
_CELLS = st.one_of(
    st.sampled_from(hostile.NUMBERS + hostile.WORDS),
    st.floats().map(repr),
    st.sampled_from(["1_0", "٣", "1e-320", "1e308", "1e200", "1e-200", " 5 ", "5 mm", '"5"', "5,"]),
)
_NAMES = st.sampled_from(
    ["thickness [nm]", "thickness [{MPa}]", "velocity", "velocity [m]", "pressure [1e999]",
     "slip [um]", "weight", "weight [%]", "{}", "load [N]", "area [m^2]", "traction [Pa]", "[]",
     "effective_viscosity [Pa*s]", "force [kN]", "x" * 500, "a\x00", '"', "traction [Pa]]"]
)  # fmt: skip


@st.composite
def data_files(draw: st.DrawFn) -> tuple[bytes, list[str]]:
    """A data file and what is fixed."""
    good = draw(st.sampled_from([DRY, WET, SLIP]))
    fixed = draw(st.one_of(st.just([]), st.lists(_fixed, max_size=2)))
    if draw(st.booleans()):
        return draw(damaged(good)), fixed
    lines = good.decode().splitlines()
    for _ in range(draw(st.integers(1, 3))):
        row = draw(st.integers(0, len(lines) - 1))
        cells = lines[row].split(",")
        at = draw(st.integers(0, len(cells) - 1))
        is_header = row == 0 or lines[row - 1].startswith("#")
        cells[at] = draw(_NAMES if is_header else _CELLS)
        lines[row] = ",".join(cells)
    if draw(st.integers(0, 9)) == 0:
        lines = lines[:1] + lines[1:] * 3
    return "\n".join(lines).encode("utf-8", "surrogatepass"), fixed


_fixed = st.builds(
    lambda key, text: f"{key}={text}",
    st.sampled_from(["mu_s", "mu_d", "A_d", "B", "K_T", "eta_b", "D_min", "D_max", "alpha",
                     "beta", "V_star", "V_star_at", "gamma", "transition_width", "tau_0",
                     "thickness", "area", "barus", "{}", "film_onset_pressure"]),
    _TEXTS,
)  # fmt: skip


# -- results ----------------------------------------------------------------------------------

_ODD_CELLS = [b"1e999", b"nan", b"", b"x", b'"', b"{}", b"9" * 5000, b"-1", b"\x00", b"1e308",
              b"null", b"[]", b"true", b"-1e308", b"1e-320"]  # fmt: skip


@st.composite
def damaged_results(draw: st.DrawFn, good: tuple[Path, ...]) -> tuple[Path, str, object]:
    """A good directory, a file in it, and what stands there instead."""
    directory = draw(st.sampled_from(good))
    files = sorted(p for p in directory.rglob("*") if p.is_file() and p.suffix != ".png")
    path = draw(st.sampled_from(files))
    name = str(path.relative_to(directory))
    kind = draw(st.sampled_from(["bytes", "cell", "cell", "shape", "shape", "shape", "other"]))
    if kind == "other":
        return (
            directory,
            name,
            draw(st.sampled_from([None, "directory", "loop", "pipe", "endless", b""])),
        )
    content = path.read_bytes()
    if kind == "shape":
        return directory, name, draw(_of_another_shape(path, files))
    if kind == "cell" and path.suffix in (".csv", ".json", ".pvd", ".toml"):
        return directory, name, draw(_with_odd_cell(content))
    return directory, name, draw(damaged(content))


@st.composite
def _of_another_shape(draw: st.DrawFn, path: Path, files: list[Path]) -> bytes:
    """A file that can be read and is another: other values, rows and columns, another's content."""
    if path.suffix == ".json":
        summary = json.loads(path.read_text(encoding="utf-8"))
        for _ in range(draw(st.integers(1, 2))):
            key = draw(st.sampled_from(sorted(keys_of(summary), key=str)))
            # A copy: the next value may go into this one.
            place(summary, key, copy.deepcopy(draw(_JSON_VALUES)))
        return json.dumps(summary).encode()
    if path.suffix == ".csv":
        rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
        return draw(_other_table(rows))
    if path.name == "case.toml" and draw(st.booleans()):
        return draw(changed_cases()).encode()
    return draw(st.sampled_from([p for p in files if p.suffix == path.suffix])).read_bytes()


_JSON_VALUES = st.one_of(
    st.sampled_from([None, True, False, 0, -1, 1e308, 10**30, "", "x", [], {}, [[]], [{}], [None]]),
    st.sampled_from([{"x": []}, {"": None}, ["x"], [1, 2], float("nan"), float("inf"), "\x1b[2J"]),
    st.sampled_from(["a" * 10_000, {"seconds": "x"}, {"tribox": {}}, [{"label": 1}]]),
)


@st.composite
def _other_table(draw: st.DrawFn, rows: list[list[str]]) -> bytes:
    """A table with columns and rows taken away, doubled or exchanged, or all alike."""
    width = len(rows[0])
    for _ in range(draw(st.integers(1, 2))):
        kind = draw(st.sampled_from(["column", "twice", "rows", "none", "order", "fill", "word"]))
        column = draw(st.integers(0, width - 1))
        if kind == "column" and width > 1:
            rows, width = [row[:column] + row[column + 1 :] for row in rows], width - 1
        elif kind == "twice":
            rows, width = [[*row, row[column]] for row in rows], width + 1
        elif kind == "rows":
            rows = [rows[0], *draw(st.lists(st.sampled_from(rows[1:] or rows), max_size=8))]
        elif kind == "none":
            rows = rows[: draw(st.integers(0, 2))] or [[""]]
        elif kind == "order":
            rows = [rows[0], *rows[:0:-1]]
        elif kind == "fill":
            put = draw(st.sampled_from(["0", "1", "-1", "nan", "inf", "1e308", "1e-308", "x", ""]))
            rows = [rows[0], *([*row[:column], put, *row[column + 1 :]] for row in rows[1:])]
        else:
            rows = [[c if c != rows[-1][column] else "other" for c in row] for row in rows]
        width = len(rows[0])
    stream = StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue().encode()


@st.composite
def _with_odd_cell(draw: st.DrawFn, content: bytes) -> bytes:
    """Some word of a text file replaced by another."""
    spans = [m.span() for m in re.finditer(rb"[^\s,:\[\]{}=<>]+", content)]
    for low, high in sorted(draw(st.lists(st.sampled_from(spans), max_size=3)), reverse=True):
        put = draw(st.sampled_from(_ODD_CELLS + ODD_BYTES))
        content = content[:low] + put + content[high:]
    return content
