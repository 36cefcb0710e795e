"""The README: its example prints what it says, its commands and links exist."""

import contextlib
import io
import re
from pathlib import Path

import pytest

from tribox.app.cli import cli
from tribox.app.results.directory import OWN
from tribox.app.simulation.history import COLUMNS

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = (README, *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "benchmarks").glob("*.md")))
NUMBER = re.compile(r"\d+\.?\d*")
SOURCE = re.compile(r"(?<![\w/.])(?:app|forms|geometry|tests|benchmarks|cases)/[\w./*-]*")


def blocks(kind: str) -> list[str]:
    found = re.findall(r"```(\w*)\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    return [text for name, text in found if name == kind]


def test_the_example_prints_what_the_readme_says(tmp_path, monkeypatch):
    (code,), (expected,) = blocks("python"), blocks("text")
    assert len([line for line in code.splitlines() if line]) <= 10
    (tmp_path / "cases").symlink_to(ROOT / "cases")
    monkeypatch.chdir(tmp_path)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, str(README), "exec"), {})
    assert NUMBER.sub("#", printed.getvalue()) == NUMBER.sub("#", expected)
    found = [float(x) for x in NUMBER.findall(printed.getvalue())]
    assert found == pytest.approx([float(x) for x in NUMBER.findall(expected)], abs=1.1e-3)
    assert (tmp_path / "results" / "mu-0.3" / "history.csv").is_file()


def test_every_command_of_the_readme_exists():
    known = {c.name or c.callback.__name__ for c in cli.registered_commands}
    named = re.findall(r"\btribox (?:-n \d tribox )?([a-z]+)\b", "\n".join(blocks("")))
    named += re.findall(r"`\./tribox ([a-z]+)", README.read_text(encoding="utf-8"))
    assert {"run", "test", "check"} <= set(named)
    assert set(named) <= known


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if not target.startswith(("http://", "https://", "#")):
            assert (page.parent / target.partition("#")[0]).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_are_named_exist(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for quoted in re.findall(r"`([^`]+)`", text):
        for name in SOURCE.findall(quoted):
            assert next(ROOT.glob(name.rstrip("/.")), None), name


def test_the_picture_on_top_is_small_enough():
    for picture in (ROOT / "docs" / "figures").glob("*.png"):
        assert picture.stat().st_size < 150 * 1024, picture.name


def test_every_column_and_array_is_explained():
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    explained = set(re.findall(r"`([a-zA-Z_.]+)`", text))
    source = (ROOT / "app" / "results" / "contact_points.py").read_text(encoding="utf-8")
    arrays = set(re.findall(r'^ {8}"(\w+)": ', source, re.MULTILINE))
    assert {"pressure", "alpha", "regime"} <= arrays
    fields = (ROOT / "app" / "results" / "field_series.py").read_text(encoding="utf-8")
    of_fields = set(re.findall(r'"(\w+)": ', fields))
    assert {"displacement", "body", "log_strain"} <= of_fields
    arrays |= of_fields
    assert arrays | set(COLUMNS) | {"label", "steady"} <= explained


def test_every_file_of_a_results_directory_is_explained():
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    written = set(OWN) - {"fields", "contact", "contact_points", "figures", "mesh.msh"}
    assert written <= set(re.findall(r"`([a-zA-Z_.]+)`", text))


def test_every_key_of_the_summary_is_explained():
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    source = (ROOT / "app" / "results" / "recorder.py").read_text(encoding="utf-8")
    body = source.split("def _known")[1].split("\ndef ")[0]
    keys = set(re.findall(r'"(\w+)":', body))
    assert {"title", "status", "seconds"} <= keys
    assert keys <= set(re.findall(r"`([a-zA-Z_.]+)`", text))
