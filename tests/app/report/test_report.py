"""The HTML page of a results directory: what stands in it, and that it needs nothing else."""

import base64
import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pandas import DataFrame
from PIL import Image

from tests.ranks import LIMIT
from tribox.app.case.case import given_keys
from tribox.app.case.quantities import COMMON_UNITS, format_quantity, parse_quantity
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError
from tribox.app.report import input_tables, pictures_of, readable, write_report
from tribox.app.report.tables import frame_table
from tribox.app.results import read
from tribox.app.simulation.history import COLUMNS

ROOT = Path(__file__).parents[3]
EVIL = "<script>alert('a & b')</script>"
VOID = {"meta", "img", "link", "br", "input"}


class Reader(HTMLParser):
    """Elements of a page, the text of each, and the problems of their nesting."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"</{tag}> in {self.open}"

    def handle_data(self, data):
        if data.strip() and self.open:
            self.texts.append((self.open[-1], " ".join(data.split())))

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]

    def words(self, *tags: str) -> list[str]:
        return [text for tag, text in self.texts if tag in tags]


def row(step: int, stage: str = "slide", **values: float) -> dict[str, object]:
    """A row of the history."""
    zeros = dict.fromkeys(COLUMNS, 0.0)
    told = {"normal_force": 20.0, "external_work": 2e-3, "strain_energy": 1.5e-3}
    rest = {"dissipation": 5e-4, "energy_error": 2e-6, "friction_coefficient": 0.1}
    return {**zeros, **told, **rest, "step": step, "time": 0.1 * step, "stage": stage, **values}


def write_csv(path: Path, rows: list[dict[str, object]]) -> None:
    lines = [",".join(rows[0]), *(",".join(map(str, one.values())) for one in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def results(directory: Path, case: str, **summary: object) -> Path:
    """A results directory as a run leaves it, with two pairs and a surface."""
    (directory / "figures").mkdir(parents=True)
    (directory / "case.toml").write_text(case, encoding="utf-8")
    rows = [row(1, "press"), row(2, film_thickness=3e-8)]
    write_csv(directory / "history.csv", rows)
    pair = {"step": 2.0, "time": 0.2, "stage": "slide", "normal_force": 12.5}
    write_csv(directory / "contacts.csv", [pair | {"pair": p} for p in ("pad-tool", "pad-die")])
    moved = {"step": 2.0, "time": 0.2, "stage": "slide", "surface": "top", "force_x": -2.0}
    write_csv(directory / "surfaces.csv", [moved | {"force_y": 20.0, "displacement_y": -5e-5}])
    ends = [{"label": one["stage"], "steady": None, **one} for one in rows]
    whole = {
        **{"title": "t", "status": "done", "failure": None, "warnings": [], "load_steps": ends},
        **{"steps": 2, "newton_iterations": 7, "dofs": 12345, "ranks": 2},
        **{"energy_error_relative": 1e-3, "memory_MiB_per_rank": [100.0, 120.0]},
        **{"seconds": {"run": 4.0, "contact": 1.0}, "versions": {"tribox": "0.1.0"}},
        "given": given_keys(load_case(directory / "case.toml")),
    }
    (directory / "summary.json").write_text(json.dumps(whole | summary), encoding="utf-8")
    Image.new("RGB", (40, 30)).save(directory / "figures" / "history.png")
    Image.new("RGB", (40, 30)).save(directory / "figures" / "my_own_view.png")
    return directory


def read_page(directory: Path) -> tuple[str, Reader]:
    text = write_report(directory).read_text(encoding="utf-8")
    return text, Reader(text)


@pytest.fixture
def run(tmp_path, film):
    return results(tmp_path / "run", film, warnings=["penetration <deep>", "note & more"])


def test_the_page_is_whole_and_needs_nothing_else(run):
    text, page = read_page(run)
    assert page.open == [] and text.startswith("<!doctype html>")
    assert not page.all("script") and not page.all("link") and not page.all("iframe")
    assert "@import" not in text and "url(" not in text and "http://" not in text
    assert "https://" not in text and " on" + "click" not in text
    policy = next(m["content"] for m in page.all("meta") if "http-equiv" in m)
    assert policy.startswith("default-src 'none'")
    sources = [image["src"] for image in page.all("img")]
    figures = [run / "figures" / name for name in ("history.png", "my_own_view.png")]
    packed = [base64.b64encode(path.read_bytes()).decode() for path in figures]
    assert sources == [f"data:image/png;base64,{data}" for data in packed]


def test_a_phone_and_a_reader_of_the_screen_can_use_it(run):
    text, page = read_page(run)
    assert page.all("html") == [{"lang": "en"}]
    names = {m.get("name"): m.get("content") for m in page.all("meta")}
    assert names["viewport"] == "width=device-width, initial-scale=1"
    assert names["color-scheme"] == "light dark" and "prefers-color-scheme: dark" in text
    assert all(len(image["alt"]) > 10 and image["width"] == "40" for image in page.all("img"))
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch(r"h\d", tag)]
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(b - a <= 1 for a, b in pairwise(levels))
    regions = [d for d in page.all("div") if d.get("role") == "region"]
    assert regions and all(d["aria-label"] and d["class"] == "scroll" for d in regions)
    assert all(cell["scope"] in ("col", "row") for cell in page.all("th"))
    ids = {attributes["id"] for _, attributes in page.tags if "id" in attributes}
    assert {a["href"][1:] for a in page.all("a")} <= ids


def test_warnings_come_first_and_all_text_is_escaped(tmp_path, film):
    case = film.replace("small sliding test", EVIL)
    text, page = read_page(results(tmp_path / "run", case, warnings=[f"see {EVIL}"]))
    assert page.words("h1") == [EVIL] and page.words("title") == [EVIL]
    assert page.words("li") == [f"see {EVIL}"]
    assert page.words("strong") == ["Warning:"]
    assert "<script" not in text
    assert text.index('id="warnings"') < text.index('id="run"') < text.index('id="inputs"')


def test_notes_stand_apart_and_the_page_says_when_how_and_on_what(tmp_path, film):
    about = {
        "started": "2025-03-04T05:06:07+00:00",
        "command": "tribox run 'a b.toml' --np 2",
        "host": {"system": "Debian 13", "kernel": "Linux 6.1", "mpi": "Open MPI v5.0.7"},
    }
    lines = ["known before", "seen in the run", "seen too"]
    _, page = read_page(results(tmp_path / "run", film, warnings=lines, notes=1, **about))
    assert page.words("strong", "li") == [
        *("Warning:", lines[1], "Warning:", lines[2], "Note:", lines[0]),
    ]  # fmt: skip
    told = page.words("dd", "code")
    assert "2025-03-04 05:06:07 UTC, took 4 s" in told and about["command"] in told
    assert {"Debian 13", "Linux 6.1", "Open MPI v5.0.7"} <= set(told)


def test_a_figure_opens_in_full_size_without_a_script(run):
    text, page = read_page(run)
    boxes = {one["id"]: one for one in page.all("input")}
    labels = [one["for"] for one in page.all("label")]
    assert len(boxes) == len(page.all("img")) == 2 and labels == list(boxes)
    assert all(one["type"] == "checkbox" and one["aria-label"] for one in boxes.values())
    assert ".full:checked + label img { max-width: none;" in text


def test_nothing_is_minus_nought():
    frame = DataFrame({"label": ["a"], "normal_force": [-0.0], "tangential_force": [-0.0]})
    frame["friction_force"] = 2.0
    table = frame_table(frame, list(frame), "")
    assert "-0" not in table.rows[0]


def test_tables_have_units_that_fit(run):
    _, page = read_page(run)
    headings = page.words("th", "span")
    for title, unit in (
        ("normal force N", "N"), ("film thickness D", "nm"), ("displacement u_y", "µm"),
    ):  # fmt: skip
        assert headings[headings.index(title) + 1] == unit
    cells = page.words("td")
    assert {"30", "12.5", "-50"} <= set(cells) and "12 345" in page.words("dd")
    assert {"pad-tool", "pad-die", "top"} <= set(page.words("th"))


def test_inputs_are_readable_and_defaults_marked(run):
    text, page = read_page(run)
    found = re.findall(r'<tr( class="default")?><th scope="row">([^<]*)</th><td>([^<]*)', text)
    values = {key: (value.strip(), not default) for default, key, value in found}
    assert values["film.thickness"] == ("30 nm", True)
    assert values["friction.K_T"] == ("1000 GPa/m", True)
    assert values["platen.pressure"] == ("0 s → 0 Pa; 1 s → 500 kPa", True)
    assert values["velocities"] == ("10 µm/s, 2 mm/s", True)
    assert values["upper.elements"] == ("14, 3", True)
    assert values["friction.eta_b"] == ("0.8 Pa s", False)  # of the preset
    assert values["penalty_factor"] == ("30", False)
    assert "default" in page.words("span")
    # A program with its ramp, and options by name, are one value of one key each.
    ramp = 'boundary.1.platen.pressure={table=[["0 s", 0], ["1 s", 5]], ramp="smooth"}'
    more = load_case(run / "case.toml", [ramp, "solver.petsc={ksp_rtol=1e-9, ksp_max_it=50}"])
    rows = {one.key: one for table in input_tables(more, given_keys(more)) for one in table.inputs}
    assert rows["platen.pressure"].value == "table: 0 s → 0 Pa; 1 s → 5 Pa; ramp: smooth"
    assert (rows["petsc"].value, rows["petsc"].given) == ("ksp_rtol: 1e-9; ksp_max_it: 50", True)
    assert rows["petsc"].meaning.startswith("PETSc options")
    summary = json.loads((run / "summary.json").read_text())
    del summary["given"]
    (run / "summary.json").write_text(json.dumps(summary))
    assert 'class="default"' not in read_page(run)[0]


@pytest.mark.parametrize(
    ("gap", "word"),
    [(1e-3, "energies add up"), (-0.03, "energies do not add up"), (0.2, "energies do not add up")],
)
def test_the_energy_verdict_has_its_number(tmp_path, film, gap, word):
    _, page = read_page(results(tmp_path / "run", film, energy_error_relative=gap))
    assert page.words("span").count(word) == 2
    assert sum(f"{abs(100 * gap):.2g} % of" in text for text in page.words("p")) == 2


def test_a_failed_run_says_why_and_shows_its_last_step(tmp_path, film):
    directory = results(
        tmp_path / "run", film, status="failed", failure="stage slide: <no> solution", load_steps=[]
    )
    _, page = read_page(directory)
    assert "failed" in page.words("span")
    assert "stage slide: <no> solution" in page.words("p")
    assert "After the last step that was solved" in page.words("caption")


def test_a_killed_run_without_steps_has_a_page_too(tmp_path, film):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "case.toml").write_text(film)
    _, page = read_page(tmp_path / "run")
    assert "unfinished" in page.words("span") and "No step was solved." in page.words("p")


def test_a_sweep_has_a_table_and_a_section_for_each_value(tmp_path, block):
    sweep = '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, 0.2, 0.3]\n'
    top = tmp_path / "sweep"
    labels = ("mu=0.1", "mu=0.2")
    for label in labels:
        results(top / label, block, warnings=[f"warned in {label}"])
    (top / "case.toml").write_text(block + sweep)
    (top / "figures").mkdir()
    more = {"driving_moment": "nan", "bend_angle": "nan", "springback": "nan"}
    rows = []
    for number, label in enumerate(labels):
        first = {"label": label, "steady": -1, "kind": "run", "name": ""}
        rows.append(first | row(2) | more)
        none = dict.fromkeys(COLUMNS, "nan") | {"step": 2, "time": 0.2, "stage": "slide"}
        tool = {"force_x": 5.0 + number, "driving_moment": 2e-3}
        rows.append(first | {"kind": "tool", "name": "punch"} | none | more | tool)
        rest = {"bend_angle": 0.1, "springback": 0.01 * (number + 1)}
        rows.append(first | {"kind": "probe", "name": "edge"} | none | more | rest)
    write_csv(top / "sweep.csv", rows)
    parts = {label: {"status": "done"} for label in labels} | {"mu=0.3": {"status": "not run"}}
    (top / "summary.json").write_text(json.dumps({"title": "t", "parts": parts}))
    text, page = read_page(top)
    assert [h for h in page.words("h2") if h.startswith("mu=")] == list(labels)
    warned = [one for one in page.words("li") if "warned" in one]
    assert warned == [f"warned in {label}" for label in labels]
    assert "mu=0.3 was not run." in page.words("p")
    assert "All values at the end of each load step" in page.words("caption")
    assert len(page.all("img")) == 4
    # Side by side: a column for each value, a row for each quantity of runs, tools and probes.
    beside = page.words("th", "td")[page.words("th", "td").index("quantity") :]
    assert beside[1:3] == list(labels)
    for title, *values in (
        ("normal force N (N)", "20", "20"), ("punch: force R_x (N)", "5", "6"),
        ("punch: driving moment (mN m)", "2", "2"), ("edge: springback (°)", "0.573", "1.146"),
    ):  # fmt: skip
        at = beside.index(title)
        assert [found[:5] for found in beside[at + 1 : at + 3]] == values
    assert read(top).sweep["label"].tolist() == list(labels)
    assert re.search(r'<tr class="default"><th scope="row">penalty_factor', text)


@pytest.mark.parametrize(
    "content", [b"", b"no picture", b"\x89PNG\r\n\x1a\n" + b"\0" * 60, b"GIF89a\xff\xff\xff\xff"]
)
def test_a_picture_that_is_none_is_one_line(tmp_path, content):
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "history.png").write_bytes(content)
    with pytest.raises(InputError, match=r"history\.png: is no picture that can be read"):
        pictures_of(tmp_path, "run")


def test_pictures_that_are_links_or_pipes_are_left_out(tmp_path):
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "history.png").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "figures" / "energy.png")
    assert pictures_of(tmp_path, "run") == []


def test_the_command_loads_no_solver_and_keeps_what_is_there(run, tmp_path, tribox):
    done = subprocess.run(
        [sys.executable, "-c", "import sys; from tribox.app.report import write_report; "
         "from pathlib import Path; write_report(Path(sys.argv[1])); "
         "print([m for m in ('dolfinx', 'petsc4py', 'mpi4py', 'pint') if m in sys.modules])",
         str(run)],
        capture_output=True, text=True, cwd=ROOT, timeout=LIMIT,
    )  # fmt: skip
    assert done.stdout == "[]\n", done.stderr
    out = tmp_path / "page.html"
    first = tribox("report", run, "--out", out)
    assert (first.returncode, first.stdout) == (0, f"wrote {out}\n")
    again = tribox("report", run, "--out", out)
    assert again.returncode == 2 and "--force" in again.stderr
    assert tribox("report", run, "--out", out, "--force").returncode == 0
    assert tribox("report", run).returncode == 0 and (run / "report.html").is_file()
    nothing = tribox("report", tmp_path / "none")
    assert nothing.returncode == 2 and nothing.stderr.count("\n") == 1
    with pytest.raises(InputError, match="cannot be written"):
        write_report(run, tmp_path / "no" / "such" / "place.html")


def test_several_pairs_are_told_apart_and_one_is_told_once(run):
    _, page = read_page(run)
    assert "Each pair at the end of each load step" in page.words("caption")
    alone = (run / "contacts.csv").read_text().splitlines()[:2]
    (run / "contacts.csv").write_text("\n".join(alone) + "\n")
    assert "Each pair at the end of each load step" not in read_page(run)[1].words("caption")


def test_long_tables_of_details_are_folded(run):
    assert "<details>" not in read_page(run)[0]
    head, *rows = (run / "surfaces.csv").read_text().splitlines()
    more = [rows[0].replace("top", f"wall {number}") for number in range(15)]
    (run / "surfaces.csv").write_text("\n".join([head, *more]) + "\n")
    text, page = read_page(run)
    assert page.open == [] and text.count("<details>") == 1
    assert any(words.endswith("(15 rows)") for words in page.words("summary"))


def test_tables_say_what_is_round_off_and_keep_decades():
    frame = DataFrame(
        {
            "label": ["press", "slide 1e-8 m/s", "slide 1e-3 m/s"],
            "time": [21023.2712, 21023.2713, 21023.3],
            "velocity": [0.0, 1e-8, 1e-3],
            "normal_force": [18.0, 18.0, 18.0],
            "friction_force": [3e-14, 1.5, 2e-3],
            "twist_moment": [0.0, 0.0, 0.0],
        }
    )
    table = frame_table(frame, list(frame), "caption")
    assert table.headings[1:] == [
        ("time t", "s"),
        ("sliding velocity V", "m/s"),
        ("normal force N", "N"),
        ("friction force F_T", "N"),
    ]
    assert [row[1:] for row in table.rows] == [
        ("21023.2712", "0", "18", "≈ 0"),
        ("21023.2713", "1e-08", "18", "1.5"),
        ("21023.3", "0.001", "18", "0.002"),
    ]
    assert frame_table(frame.head(0), list(frame), "caption") is None


def test_what_a_pair_does_not_have_is_a_dash_and_friction_has_one_unit():
    frame = DataFrame(
        {
            "pair": ["wet", "dry"],
            "friction_force": [2.0, 4.0],
            "tangential_force": [-2e-3, 4e-4],
            "film_thickness": [3e-8, 0.0],
            "effective_viscosity": [0.0, 0.0],
        }
    )
    frame.loc[0, "effective_viscosity"] = 0.8
    table = frame_table(frame, list(frame.columns), "")
    assert [unit for _, unit in table.headings] == ["", "N", "N", "nm", "mPa s"]
    assert list(zip(*table.rows, strict=True))[1:] == [
        ("2", "4"), ("-0.002", "0.0004"), ("30", "–"), ("800", "–"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("stem", "said"),
    [
        ("deformed-2-slide_on", "end of stage 2, slide_on"),
        ("deformed-cauchy_stress_xy-1-press-2-x", "cauchy stress xy, end of stage 1, press-2-x"),
        ("deformed-pressure-highest-load", "pressure highest load"),
    ],
)
def test_a_picture_is_called_what_it_shows(tmp_path, stem, said):
    (tmp_path / "figures").mkdir()
    Image.new("RGB", (2, 1)).save(tmp_path / "figures" / f"{stem}.png")
    [picture] = pictures_of(tmp_path, "it")
    assert picture.title == f"Deformed bodies: {said}" and said in picture.alt


# -- Numbers with units as a person writes them ----------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("3e-08 m", "30 nm"), ("0.0005 m", "500 µm"), ("0.35 m", "0.35 m"), ("0.0 m", "0 m"),
        ("70000000000.0 Pa", "70 GPa"), ("100000000000.0 Pa/m", "100 GPa/m"),
        ("0.8 Pa*s", "0.8 Pa s"), ("0.02 Pa*s", "20 mPa s"), ("1000000.0 1/m", "1e6 1/m"),
        ("1100.0 kg/m^3", "1100 kg/m³"), ("-1e-05 m/s", "-10 µm/s"), ("5e-13 s", "0.5 ps"),
        ("0.33", "0.33"), ("30.0", "30"), ("neo-hookean", "neo-hookean"), ("1.2.3", "1.2.3"),
    ],
)  # fmt: skip
def test_quantities_are_readable(text, said):
    assert readable(text) == said


@settings(deadline=None)  # the first call loads the unit library
@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([*COMMON_UNITS]))
def test_readable_quantities_are_exact(value, unit):
    assert parse_quantity(readable(str(format_quantity(value, unit))), unit) == value
