"""Starter cases: each is correct, runs in seconds as it is, and overwrites nothing."""

import csv
import json
import re
import tomllib
from pathlib import Path

import pytest

from tribox.app.case.reading import check_case
from tribox.app.case.schema import FILE_NAME, json_schema
from tribox.app.errors import InputError
from tribox.app.init import HERE, KINDS, write_starter
from tribox.geometry.meshes.drawing import mesh_drawing
from tribox.geometry.meshes.gmsh_model import MeshError

MESHED = ("own-mesh",)


def files(directory: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in directory.iterdir()}


@pytest.mark.parametrize(
    "kind", ["two-blocks", "own-mesh", pytest.param("forming", marks=pytest.mark.long)]
)
def test_a_starter_runs_as_it_is(kind, tmp_path, tribox):
    case = tmp_path / "try" / "mine.toml"
    done = tribox("init", kind, case)
    assert done.returncode == 0, done.stderr
    names = {"mine.toml", FILE_NAME} | ({"mine.geo", "mine.msh"} if kind in MESHED else set())
    assert set(files(case.parent)) == names
    assert {Path(line.split()[1]).name for line in done.stdout.splitlines()[:-1]} == names

    text = case.read_text(encoding="utf-8")
    assert text.startswith(f"#:schema ./{FILE_NAME}\n") and "NAME" not in text
    assert json.loads((case.parent / FILE_NAME).read_text(encoding="utf-8")) == json_schema()
    assert check_case(case) == []

    out = tmp_path / "out"
    ran = tribox("run", case, "--out", out, "--set", "output.figures=false")
    assert ran.returncode == 0, ran.stderr
    # A strip touches an edge along a line, narrower than its facets.
    expected = 2 if kind == "forming" else 0
    assert ran.stdout.count("warning") == ran.stdout.count("slave facets wide") == expected
    summary = json.loads((out / "summary.json").read_text())
    steps = summary["load_steps"]
    assert steps[0]["label"] == ("bend" if kind == "forming" else "press")
    pressed = steps[0] if kind == "forming" else steps[-1]
    assert pressed["normal_force"] > 1.0 and pressed["friction_coefficient"] > 0.0
    assert summary["seconds"]["run"] < 60.0
    if kind == "forming":
        assert_springback(out)


def assert_springback(out: Path) -> None:
    """The punch has left, and the strip is bent for good but for a part."""
    rows = list(csv.DictReader((out / "probes.csv").open()))
    tip = {row["stage"]: float(row["displacement_y"]) for row in rows}  # m, at the end of each
    assert tip["bend"] < -0.01
    assert 5e-5 < tip["lift"] - tip["bend"] < 5e-4
    left = list(csv.DictReader((out / "contacts.csv").open()))
    forces = [float(row["normal_force"]) for row in left if row["pair"] == "strip_top-punch"]
    assert max(forces) > 10.0 and forces[-1] == 0.0


def test_every_starter_is_listed():
    texts = {p.stem for p in HERE.glob("*.toml")}
    assert set(KINDS) == texts and set(MESHED) < texts


@pytest.mark.parametrize("kind", KINDS)
def test_comments_are_in_step_with_the_program(kind):
    """Commands and files that a starter speaks of are there, and so are the commented tables."""
    from tribox.app.cli import cli

    text = (HERE / f"{kind}.toml").read_text(encoding="utf-8")
    spoken = set(re.findall(r"#.*?\btribox (\w+)", text))
    known = {c.name or c.callback.__name__ for c in cli.registered_commands}
    assert {"check", "mesh", "run"} <= spoken <= known
    assert max(map(len, text.splitlines())) <= 105
    aside = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# [")]
    assert all(tomllib.loads(line) for line in aside)


def test_it_overwrites_nothing(tmp_path):
    write_starter("own-mesh", tmp_path)
    before = files(tmp_path)
    for name in ("own-mesh.toml", "own-mesh.geo", "own-mesh.msh"):
        for other in before:
            if other not in (name, FILE_NAME):
                (tmp_path / other).unlink(missing_ok=True)
        (tmp_path / name).write_bytes(before[name])
        with pytest.raises(InputError, match=rf"{name}: exists already"):
            write_starter("own-mesh", tmp_path)
        assert set(files(tmp_path)) == {name, FILE_NAME}


def test_several_starters_share_a_schema(tmp_path):
    first = write_starter("two-blocks", tmp_path)
    again = write_starter("two-blocks", tmp_path / "b.toml")
    assert [p.name for p in first] == ["two-blocks.toml", FILE_NAME]
    assert [p.name for p in again] == ["b.toml"]
    (tmp_path / FILE_NAME).write_text('{"$schema": "older"}')
    newer = write_starter("two-blocks", tmp_path / "c.toml")
    assert [p.name for p in newer] == ["c.toml", FILE_NAME]
    (tmp_path / FILE_NAME).write_text("mine")
    with pytest.raises(InputError, match=f"{FILE_NAME}: exists already"):
        write_starter("two-blocks", tmp_path / "d.toml")
    assert not (tmp_path / "d.toml").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["three-blocks"], 'no starter "three-blocks"; there are two-blocks'),
        (
            ["my.toml"],
            "there are two-blocks, own-mesh, forming (as in: tribox init two-blocks my.toml)",
        ),
        (["two-blocks", "there/notes.txt"], "name a case file"),
        (["two-blocks", "there/notes.txt/case.toml"], "cannot be written"),
    ],
)
def test_wrong_words_are_one_line(tribox, tmp_path, words, said):
    (tmp_path / "home" / "there").mkdir()
    (tmp_path / "home" / "there" / "notes.txt").write_text("mine")
    done = tribox("init", *words)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and said in done.stderr
    assert [p.name for p in (tmp_path / "home").rglob("*")] == ["there", "notes.txt"]


def test_by_default_it_writes_here(tribox, tmp_path):
    assert tribox("init").returncode == 0
    assert set(files(tmp_path / "home")) == {"two-blocks.toml", FILE_NAME}


def test_a_changed_drawing_is_meshed_again(tribox, tmp_path):
    """``tribox mesh FILE.geo`` takes the place of the program gmsh, and says what is wrong."""
    home = tmp_path / "home"
    write_starter("own-mesh", home / "pad.toml")
    drawing, before = home / "pad.geo", (home / "pad.msh").read_bytes()
    refused = tribox("mesh", "pad.geo")
    assert refused.returncode == 2 and "pad.msh: exists already" in refused.stderr
    drawing.write_text(drawing.read_text().replace("size = 0.5e-3", "size = 1e-3"))
    done = tribox("mesh", "pad.geo", "--out", "coarse.msh")
    assert done.returncode == 0, done.stderr
    told = re.fullmatch(r"wrote coarse.msh \(cells: pad (\d+), plate (\d+)\)\n", done.stdout)
    assert told and 0 < int(told[1]) < 100
    assert (home / "pad.msh").read_bytes() == before
    coarse = (home / "coarse.msh").read_text()
    assert coarse.startswith("$MeshFormat\n4.1 ") and '"pad_face"' in coarse
    assert len(coarse) < len(before)
    set_mesh = tribox("check", "pad.toml", "--set", "geometry.mesh='coarse.msh'")
    assert set_mesh.returncode == 0, set_mesh.stderr


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("Line(1) = {1, 2};", "Line(1) = {1, 99};", "cannot mesh it"),
        ('Physical Surface("pad") = {1};', "", "cells are in no named body"),
        ("Physical Surface", "// ", "no physical groups of faces or volumes"),
    ],
)
def test_what_is_wrong_with_a_drawing_is_one_error(tmp_path, old, new, said):
    drawing = tmp_path / "pad.geo"
    drawing.write_text((HERE / "own-mesh.geo").read_text().replace(old, new))
    with pytest.raises(MeshError, match=said) as refused:
        mesh_drawing(drawing, tmp_path / "pad.msh")
    assert "\n" not in str(refused.value) and str(drawing) in str(refused.value)
    assert [p.name for p in tmp_path.iterdir()] == ["pad.geo"]
