"""docs/results.md explains every file, column, array and key that a run writes."""

import re
from pathlib import Path

from tribox.app.results.directory import OWN
from tribox.app.simulation.history import COLUMNS, DECLARED

ROOT = Path(__file__).parents[2]


def explained() -> set[str]:
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    return set(re.findall(r"`([a-zA-Z_.]+)`", text))


def source(name: str) -> str:
    return (ROOT / "app" / "results" / name).read_text(encoding="utf-8")


def test_every_column_and_array_is_explained():
    arrays = set(re.findall(r'^ {8}"(\w+)": ', source("contact_points.py"), re.MULTILINE))
    assert {"pressure", "alpha", "regime"} <= arrays
    of_fields = set(re.findall(r'"(\w+)": ', source("output_files.py")))
    assert {"displacement", "body", "log_strain"} <= of_fields
    assert arrays | of_fields | set(COLUMNS) | {"label", "steady"} <= explained()


def test_units_of_columns_are_those_declared():
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    table = text.split("| column | unit | meaning |")[1].split("\n\n")[0]
    found = {}
    for names, unit in re.findall(r"^\| (`.*?) \| (\S.*?) \|", table, re.MULTILINE):
        found |= dict.fromkeys(re.findall(r"`(\w+)`", names), unit.replace("–", ""))
    assert found == {name: one.unit for name, one in DECLARED.items()}


def test_every_file_of_a_results_directory_is_explained():
    written = set(OWN) - {"fields", "contact", "contact_points", "figures", "mesh.msh"}
    assert written <= explained()


def test_every_key_of_the_summary_is_explained():
    body = source("recorder.py").split("def _known")[1].split("\ndef ")[0]
    keys = set(re.findall(r'"(\w+)":', body))
    assert {"title", "status", "seconds"} <= keys
    assert keys <= explained()
