"""The index of a series: whole at any moment, and cheap however long the series is."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from tribox.app.results import output_files as module
from tribox.app.results.output_files import INDEX_SHARE, Series


def listed(directory) -> list[tuple[float, str]]:
    sets = ET.parse(directory / "fields.pvd").getroot().iter("DataSet")
    return [(float(s.attrib["timestep"]), s.attrib["file"]) for s in sets]


def test_every_file_is_listed_with_its_time(tmp_path):
    series = Series(tmp_path, "fields")
    assert series.path(3) == tmp_path / "fields" / "000003.vtu"
    assert series.path(3).parent.is_dir()
    series.add(3, 0.1 + 0.2)
    assert listed(tmp_path) == [(0.1 + 0.2, "fields/000003.vtu")]
    series.add(1234567, 2.0)
    series.write_index()
    assert listed(tmp_path)[1] == (2.0, "fields/1234567.vtu")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fields", "fields.pvd"]


def test_rewriting_takes_a_small_share_of_the_time(tmp_path, monkeypatch):
    """Writing takes a second in this clock, and a file comes every second."""
    now, writes = [0.0], []

    def write(path, text):
        now[0] += 1.0
        writes.append(text.count("DataSet"))

    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(module, "write_text", write)
    series = Series(tmp_path, "fields")
    for step in range(1, 201):
        now[0] += 1.0
        series.add(step, float(step))
    assert writes[0] == 1 and writes == sorted(writes)
    assert len(writes) == pytest.approx(INDEX_SHARE * now[0], rel=0.2)
    series.write_index()
    assert writes[-1] == 200
