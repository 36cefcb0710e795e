"""What the prose of the pages names is there: pages, sections, files, commands, options."""

import re
from functools import cache
from pathlib import Path

import click
import pytest
from typer.main import get_command

from tests.docs.blocks import without_blocks
from tests.docs.pages import ROOT, all_pages, name_of
from tribox.app.cli import cli

PAGES = [pytest.param(page, id=name_of(page)) for page in all_pages()]
_PLACES = ("docs/**/*.png", "docs/**/*.gif", "examples/**/*.png", "paper/**/*.png")
PICTURES = [picture for place in _PLACES for picture in sorted(ROOT.glob(place))]
SOURCE = re.compile(r"(?<![\w/.])(?:app|forms|geometry|tests|benchmarks|cases)/[\w./*-]*")
LINK = re.compile(r"\]\(([^)\s]+)(?: \"[^\"]*\")?\)")
COMMAND = re.compile(r"(?:\./)?tribox ([a-z]+)\b(.*)", re.DOTALL)


def prose(page: Path) -> str:
    return without_blocks(page.read_text(encoding="utf-8"))


@cache
def sections(page: Path) -> frozenset[str]:
    """Anchors of a page's headings, as code hosts and the site make them, and of its own."""
    text = prose(page)
    found: list[str] = re.findall(r"<a (?:id|name)=\"([^\"]+)\"", text)
    found += re.findall(r"^\(([\w-]+)\)=$", text, re.MULTILINE)
    for heading in re.findall(r"^#{1,6} +(.*?) *#*$", text, re.MULTILINE):
        name = anchor(heading)
        again = sum(1 for other in found if re.fullmatch(rf"{re.escape(name)}(-\d+)?", other))
        found.append(f"{name}-{again}" if name in found else name)
    return frozenset(found)


def anchor(heading: str) -> str:
    """The anchor of a heading: its words in small letters, joined by hyphens."""
    shown = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)
    return re.sub(r"[^\w\- ]", "", shown.lower()).replace(" ", "-")


def lost_links(page: Path) -> list[str]:
    """Links of a page that lead to no file, or to no section of one."""
    lost = []
    for target in LINK.findall(prose(page)):
        if re.match(r"[a-z]+:", target):
            continue
        name, hash_, section = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        if not path.exists() or (hash_ and path.suffix == ".md" and section not in sections(path)):
            lost.append(target)
    return lost


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    assert lost_links(page) == []


@pytest.mark.parametrize("page", PAGES)
def test_files_that_are_named_exist(page):
    for quoted in re.findall(r"`([^`]+)`", prose(page)):
        for name in SOURCE.findall(quoted):
            pattern = name.rstrip("/.").replace("NAME", "*")
            assert next(ROOT.glob(pattern), None), name


BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
# Commands whose words are those of other programs, and what reads these.
PASSED_ON = {"bench": BENCHMARKS / "bench.py", "verify": BENCHMARKS / "verify" / "__main__.py"}


def unknown_words(text: str) -> list[str]:
    """Commands of tribox in inline code that do not exist, and options that they do not have."""
    group = get_command(cli)
    assert isinstance(group, click.Group)
    unknown = []
    for quoted in re.findall(r"`([^`]+)`", text):
        if named := COMMAND.fullmatch(quoted):
            command = group.commands.get(named[1])
            known = [] if command is None else [o for p in command.params for o in p.opts]
            if source := PASSED_ON.get(named[1]):
                known = re.findall(r'add\w*\("(--[a-z-]+)"', source.read_text(encoding="utf-8"))
            options = re.findall(r"(?<![\w-])--[a-z][a-z-]*", named[2])
            if command is None or not (named[1] == "test" or set(options) <= set(known)):
                unknown.append(quoted)
    return unknown


@pytest.mark.parametrize("page", PAGES)
def test_commands_that_are_named_exist(page):
    assert unknown_words(prose(page)) == []


@pytest.mark.parametrize("picture", PICTURES, ids=name_of)
def test_pictures_are_small_enough(picture):
    assert picture.stat().st_size < (250 if picture.suffix == ".gif" else 150) * 1024


def test_lost_links_sections_and_commands_are_seen(tmp_path):
    page, other = tmp_path / "page.md", tmp_path / "other.md"
    other.write_text("# Über `T` und [μN](x.md)!\n\n## Two\n\n## Two\n", encoding="utf-8")
    page.write_text(
        "# One\n[a](other.md#über-t-und-μn) [b](#one) [c](other.md#two-1) [d](https://x.org)\n"
        '[e](none.md) [f](other.md#three) [g](#two) ![h](none.png "picture")\n'
        "```text\n[i](none.md)\n```\n",
        encoding="utf-8",
    )
    assert lost_links(page) == ["none.md", "other.md#three", "#two", "none.png"]
    good = "`tribox run CASE [--force] [--set key=value]` `tribox test -k x --all` `tribox`"
    good += " `tribox bench 4 --np 2`"
    assert unknown_words(good) == []
    bad = ["./tribox rum CASE", "tribox run CASE --forse", "tribox bench 1 --agains DIR"]
    assert unknown_words(" ".join(f"`{words}`" for words in bad)) == bad
