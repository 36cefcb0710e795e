"""What the fuzzer has found, and what a person thought of: each input comes to one line."""

import copy
import os
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.app.conftest import BLOCK, FILM, SLID
from tests.fuzz.case_files import SWEEP, Key, good_cases, place, text_keys, value_at
from tests.fuzz.guard import outcome, see_line
from tests.fuzz.hostile import Raw, toml_of
from tests.fuzz.targets import read_case
from tribox.app.case.reading import check_case, load_case
from tribox.app.errors import InputError, as_line
from tribox.app.fit.data import read_data
from tribox.app.fit.run import run_fit
from tribox.app.report import write_report
from tribox.app.results import read

DEEP, LONG = 10_000, "9" * 5000
ROUND = {
    "kind": "cylinder-on-block",
    "cylinder": {"radius": "10 mm"},
    "block": {"width": "10 mm", "height": "5 mm"},
    "contact_width": "1 mm",
    "contact_size": "0.1 mm",
}
BALL = {
    "kind": "sphere-on-block",
    "sphere": {"radius": "1 mm"},
    "block": {"radius": "1 mm", "height": "1 mm"},
    "contact_width": "0.1 mm",
    "contact_size": "0.01 mm",
}


def radius(geometry: dict, body: str, value: object) -> dict:
    return geometry | {body: geometry[body] | {"radius": value}}


# Key of the small block, value there, and what is said of it.
FOUND = [
    ("stage.0.steps", Raw(LONG), "holds a whole number of more than 400 digits"),
    ("stage.0.steps", Raw("0x" + "f" * 5000), "holds a whole number of more than 400 digits"),
    ("bodies.elastomer.E", Raw("-" + LONG), "holds a whole number of more than 400 digits"),
    ("bodies.elastomer.E", Raw("1e999"), "bodies.elastomer.E = inf: must be finite"),
    ("bodies.elastomer.E", "1e99999999999999999999 MPa", "must be finite"),
    ("bodies.elastomer.E", "1e" + LONG, "has 5002 letters"),
    ("bodies.elastomer.E", "5 {MPa}", 'unknown unit "{MPa}"'),
    ("bodies.elastomer.E", "5 {0.__class__}", 'unknown unit "{0.__class__}"'),
    ("bodies.elastomer.E", "5 MPa!", 'unknown unit "MPa!"'),
    ("bodies.elastomer.E", "5 " + "(" * DEEP + "Pa", "letters; must be a number"),
    ("geometry.upper.width", "10", '"10": is text without a unit; must be a number (in m) or'),
    ("bodies.elastomer.E", Raw("2020-01-01"), "is a date or time of day"),
    ("bodies.elastomer.E", Raw("[" * DEEP + "]" * DEEP), "are nested more than 30 deep"),
    ("bodies.elastomer.E", Raw("[" * 100 + "]" * 100), "are nested more than 30 deep"),
    ("bodies", Raw("{a = " * DEEP + "1" + "}" * DEEP), "are nested more than 30 deep"),
    ("bodies", Raw("{a" + ".a" * DEEP + " = 1}"), "are nested more than 30 deep"),
    ("stage.0.name", "a" * 400, "must have at most 100 letters"),
    ("stage.0.name", "a\nb", "must be one line without control characters"),
    ("contact.0.name", "\u202eabc", "must be one line without control characters"),
    ("title", "\x1b[2J", "must be one line without control characters"),
    ("stage.0.steps", 10**12, "stage.0.steps = 1000000000000: must be <= 10000000"),
    ("geometry.upper.elements", [10**9, 10**9], "must be <= 100000"),
    ("contact.0.quadrature_degree", 1000, "must be <= 30"),
    ("solver", {"tolerance": 1}, "must be > 0 and < 1"),
    ("stage.0.steady_tolerance", 1.0, "must be > 0 and < 1"),
    ("boundary.1.displacement.y", [[n, 0] for n in range(100_001)], "has 100001 rows"),
    ("bodies.elastomer.material", ["a"], 'bodies.elastomer.material = ["a"]: must be one of'),
    ("bodies.elastomer.material", {"a": 1}, "bodies.elastomer.material: must be one of"),
    ("bodies.elastomer", {"material": ["a"], "library": "AA1050-O"}, 'material = ["a"]: must be'),
    ("geometry.thickness", "1e300 m", "must be of a size up to 1e+50 m"),
    ("geometry.thickness", "1e-300 m", "must be of a size from 1e-50 m on"),
    ("geometry", radius(ROUND, "cylinder", "1e300 m"), "must be of a size up to 1e+50 m"),
    ("geometry", radius(BALL, "sphere", "1e300 m"), "must be of a size up to 1e+50 m"),
    ("geometry", radius(BALL, "block", "1e160 m"), "must be of a size up to 1e+50 m"),
    ("geometry", {"mesh": "a\x00b"}, "is no name that a file can have"),
    ("geometry", {"mesh": "a/" * 3000}, "is no name that a file can have"),
    ("geometry", {"mesh": "/dev/zero"}, "no such file (/dev/zero)"),
    ("sweep", SWEEP | {"values": list(range(1001))}, "must have at most 1000 entries"),
    ("sweep", SWEEP | {"values": ["9" * 300]}, "is too long for the name of a directory"),
    ("probe", [{"name": "x", "line": {"from": [0, 0], "to": [1, 1], "points": 10**9}}],
     "must be <= 100000"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("key", "value", "said"), FOUND, ids=[f"{key}-{said[:40]}" for key, _, said in FOUND]
)
def test_a_value_that_no_case_may_hold_is_a_line_with_file_and_key(key, value, said, tmp_path):
    case = copy.deepcopy(tomllib.loads(BLOCK))
    place(case, tuple(int(k) if k.isdigit() else k for k in key.split(".")), value)
    path = tmp_path / "case.toml"
    path.write_text(toml_of(case), encoding="utf-8")
    lines = check_case(path)
    assert any(said in line for line in lines), [line[:300] for line in lines]
    for line in lines:
        see_line(line)
        assert line.startswith(str(path))
        assert "nested" in said or "digits" in said or key.split(".")[0] in line
    came_to = outcome(lambda: load_case(path))
    assert came_to.startswith("refused"), came_to


def name_of(key: Key) -> tuple[str, ...]:
    return tuple("0" if isinstance(part, int) else part for part in key)


def places_of_text() -> Iterator[tuple[dict, Key]]:
    """Each text key of the good cases once, beside the laws and kinds that stand with it."""
    seen = set()
    for case in good_cases():
        for key in text_keys(case):
            table = value_at(case, key[:-1])
            kinds = [table.get(n) for n in ("law", "kind", "shape") if isinstance(table, dict)]
            mark = (name_of(key), *map(str, kinds))
            if mark not in seen:
                seen.add(mark)
                yield case, key


def test_a_list_or_a_table_at_any_text_key_is_a_line(tmp_path):
    """As a value, and as one that a sweep puts there."""
    found, tried = {}, 0
    for case, key in places_of_text():
        text = value_at(case, key)
        for number, shape in enumerate([[text], [[text]], {"name": text}, [], {}]):
            changed = copy.deepcopy(case)
            if number == 1:
                changed["sweep"] = {"key": ".".join(map(str, key)), "values": [shape]}
            else:
                place(changed, key, shape)
            came_to = outcome(lambda: read_case(toml_of(changed), tmp_path))
            tried += 1
            if not came_to.startswith(("refused: ", "fine")):
                found[".".join(map(str, key)), str(shape)] = came_to
    assert tried > 200 and not found, found


OVERRIDES = [
    (f"stage.0.steps={LONG}", "holds a whole number of more than 400 digits"),
    ("stage.0.steps=" + "[" * DEEP + "]" * DEEP, "nested more than 30 deep"),
    ("stage.'²'.steps=3", 'stage has no entry "²"'),
    ("stage.'٠'.steps=3", 'stage has no entry "٠"'),
    (f"stage.{LONG}.steps=3", "stage has no entry"),
    ("a" + ".a" * DEEP + "=3", "not a dotted key"),
    ("title=\x1b[31m", "must be one line without control characters"),
    ("\x1b[31m=3", "not a dotted key"),
    ("geometry.thickness=10 {mm}", 'unknown unit "{mm}"'),
    ("geometry.thickness='10'", "is text without a unit"),
]


@pytest.mark.parametrize(("override", "said"), OVERRIDES, ids=range(len(OVERRIDES)))
def test_an_override_that_no_case_may_hold_is_a_line(override, said, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(BLOCK, encoding="utf-8")
    lines = check_case(path, [override])
    assert any(said in line for line in lines), [line[:300] for line in lines]
    for line in lines:
        see_line(line)


def test_an_override_may_write_a_number_as_people_do(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(BLOCK, encoding="utf-8")
    case = load_case(path, ["contact.0.friction.mu=.5", "geometry.thickness=2."])
    assert case.contact[0].friction.mu == 0.5 and case.geometry.thickness == 2.0


def test_a_mark_before_the_text_is_no_mistake_and_other_bytes_are_one_line(tmp_path):
    path = tmp_path / "case.toml"
    path.write_bytes(b"\xef\xbb\xbf" + BLOCK.encode())
    assert load_case(path).title == "small block"
    for content, said in (
        (BLOCK.encode("utf-16"), "not a text file in UTF-8"),
        (BLOCK.encode().replace(b"steps = 3", b"steps = \x003"), ":33: not valid TOML"),
        (b"\xff" * 100, "not a text file in UTF-8"),
    ):
        path.write_bytes(content)
        [line] = check_case(path)
        assert said in line
        see_line(line)


@pytest.mark.parametrize("kind", ["directory", "loop", "pipe", "endless", "huge"])
def test_what_is_no_file_of_a_case_is_refused_at_once(kind, tmp_path):
    path = tmp_path / "case.toml"
    make_odd(path, kind)
    for act in (lambda: load_case(path), lambda: read_data(path)):
        came_to = outcome(act, seconds=2.0)
        assert came_to.startswith(f"refused: {path}: "), came_to
    assert outcome(lambda: load_case(tmp_path / ("a" * 400))).startswith("refused")


@pytest.mark.parametrize("kind", ["loop", "pipe", "endless"])
def test_what_is_no_file_of_results_is_refused_at_once(kind, tmp_path):
    (tmp_path / "case.toml").write_text(BLOCK)
    for name in ("history.csv", "summary.json", "fields.pvd"):
        make_odd(tmp_path / name, kind)
    (tmp_path / "fields").mkdir()
    make_odd(tmp_path / "fields" / "000003.vtu", kind)
    results = read(tmp_path)
    asked = (lambda: results.history, lambda: results.summary, lambda: results.steps,
             lambda: results.fields(3))  # fmt: skip
    for act in asked[3 * (kind == "loop") :]:  # what leads nowhere is not there: empty tables
        came_to = outcome(act, seconds=2.0)
        assert came_to.startswith("refused"), came_to


def make_odd(path: Path, kind: str) -> None:
    if kind == "directory":
        path.mkdir()
    elif kind == "loop":
        path.symlink_to(path)
    elif kind == "endless":
        path.symlink_to("/dev/zero")
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        with path.open("wb") as stream:
            stream.truncate(1 << 40)  # a hole


def test_a_message_is_one_line_whatever_it_quotes():
    assert as_line("a\nb\x1b[2J\u202e") == "a\\nb\\x1b[2J\\u202e"
    assert as_line("µm – „Öl“ 🙂") == "µm – „Öl“ 🙂"
    assert len(str(InputError("x" * 10**6))) < 1000


HEADER = "thickness [nm],velocity [mm/s],pressure [MPa],traction [kPa]\n"
DATA = [
    ("x" * 2000, "no such column"),
    (HEADER + "0,1,3," + "5" * 200_000, "no line of a table"),
    (HEADER + "0,1,3," + "5" * 5000, "must be"),
    (HEADER + "0,1,3,\u202e5\n", "must be a number"),
    (HEADER + "0,1e-99,3,5\n", "must be of a size from"),
    (HEADER + "0,1e99999999999999999999,3,5\n", "must be finite"),
    (HEADER + "0,1,3,5\n" * 5001, "has 5001 rows of data"),
    (HEADER.replace("nm", "{nm}") + "0,1,3,5\n", 'unknown unit "{nm}"'),
    ("a" + " " * 100_000 + "b[x", "no such column"),
]


@pytest.mark.parametrize(("text", "said"), DATA, ids=[said for _, said in DATA])
def test_data_that_cannot_be_fitted_are_a_line_with_file_and_row(text, said, tmp_path):
    path = tmp_path / "data.csv"
    path.write_text(text, encoding="utf-8")
    came_to = outcome(lambda: read_data(path))
    assert came_to.startswith(f"refused: {path}") and said in came_to, came_to[:500]


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


def test_a_law_that_overflows_on_the_data_is_a_line(tmp_path):
    path = tmp_path / "data.csv"
    path.write_bytes(WET)
    act = lambda: run_fit(path, None, ["barus=1"], [], tmp_path / "fit", False)  # noqa: E731
    came_to = outcome(act)
    assert came_to.startswith("refused: the law has no finite friction for row 1"), came_to
    assert not (tmp_path / "fit").exists()


def test_a_film_case_takes_ordinary_values_still(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(FILM, encoding="utf-8")
    assert check_case(path, ["contact.0.film.thickness=0", "contact.0.friction.alpha=0"]) == []


def test_a_start_that_turns_elements_inside_out_is_a_line_with_the_file(tmp_path):
    from tribox.app.run.building import notes_on_building

    path = tmp_path / "case.toml"
    path.write_text(SLID)
    wrong = 'boundary.0.displacement.y="1 m"'  # the block below, from the first moment on
    case = load_case(path, [wrong])
    came_to = outcome(lambda: notes_on_building(case))
    assert came_to.startswith(f"refused: {path}: the start: an element has been turned inside out")


@pytest.mark.parametrize(
    "written", [r'{"warnings": ["\ud800"]}', "[" * 99_999], ids=["half of a pair", "nested deep"]
)
def test_a_summary_that_no_file_can_hold_is_a_line(written, tmp_path):
    """Half of a pair of surrogates is JSON, but a report with it cannot be written."""
    (tmp_path / "case.toml").write_text(FILM, encoding="utf-8")
    (tmp_path / "summary.json").write_text(written, encoding="utf-8")
    came_to = outcome(lambda: write_report(tmp_path))
    assert came_to.startswith(f"refused: {tmp_path / 'summary.json'}: is cut off"), came_to[:300]


def test_an_input_hangs_that_computes_for_too_long_and_not_one_that_waits_for_its_turn():
    """A busy machine takes longer; what waits for ever is ended by the clock all the same."""

    def computes() -> None:
        while True:
            pass

    assert outcome(lambda: time.sleep(0.15), seconds=0.1) == "fine"
    assert outcome(computes, seconds=0.1).startswith("hang: ")
    assert outcome(lambda: time.sleep(60.0), seconds=0.01).startswith("hang: ")
