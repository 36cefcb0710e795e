"""Every picture of ``docs/gallery.md`` is drawn here from its case in reduced form.

The comment above an entry's commands says how the case is reduced. Forming cases are run, and
their pictures drawn, by their own tests (``tests/forming_pictures.py``).
"""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.main import get_command

from tests.docs.blocks import Block, find_blocks
from tests.docs.commands import simple_commands
from tests.docs.pages import ROOT
from tests.forming_pictures import PICTURES
from tribox.app.cli import cli

PAGE = ROOT / "docs" / "gallery.md"
MOST_BYTES = 150_000
LONG = ("boxes-3d", "effective_viscosity")  # in the figure's path: they take seconds


@dataclass(frozen=True)
class Entry:
    """A picture in docs, the figure its commands write, and words that reduce the case."""

    picture: str
    figure: Path
    commands: list[list[str]]
    changes: list[str]

    @property
    def case(self) -> str:
        """Name of the case."""
        return Path(self.commands[0][2]).stem


def entries() -> list[Entry]:
    """The entries of the page: one picture for each block of commands, in the same order."""
    pictures = re.findall(r"^!\[[^]]+\]\((\S+)\)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return [_entry(*both) for both in zip(pictures, find_blocks(PAGE), strict=True)]


def _entry(picture: str, block: Block) -> Entry:
    (figure,) = re.findall(r"# (results/\S+)$", block.text, re.MULTILINE)
    changes = shlex.split(block.marks.get("in the test with", ""))
    return Entry(picture, Path(figure), list(simple_commands(block.text)), changes)


ENTRIES = entries()
FORMING = [entry for entry in ENTRIES if "/forming/" in entry.commands[0][2]]


def _others() -> list[object]:
    """The entries that are run here, as parameters."""
    others = [entry for entry in ENTRIES if entry not in FORMING]
    return [pytest.param(e, id=Path(e.picture).stem, marks=_marks(e)) for e in others]


def _marks(entry: Entry) -> list[pytest.MarkDecorator]:
    return [pytest.mark.long] if any(name in str(entry.figure) for name in LONG) else []


@pytest.mark.parametrize("entry", _others())
def test_the_commands_of_an_entry_draw_its_picture(entry, tmp_path, monkeypatch, capsys):
    for name in ("cases", "examples"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    for words in entry.commands:
        changes = entry.changes if words[1] == "run" else []
        code = get_command(cli).main([*words[1:], *changes], standalone_mode=False)
        assert not code, capsys.readouterr().err
    assert entry.figure.stat().st_size > 0


@pytest.mark.parametrize("entry", FORMING, ids=lambda e: e.case)
def test_the_picture_of_a_forming_case_is_drawn_by_its_test(entry):
    assert PICTURES[entry.case].figure == entry.figure.name
    fields = [words[words.index("--field") + 1] for words in entry.commands if "--field" in words]
    assert fields == ([PICTURES[entry.case].field] if PICTURES[entry.case].field else [])


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda e: Path(e.picture).stem)
def test_pictures_are_there_and_load_fast(entry):
    assert 0 < (PAGE.parent / entry.picture).stat().st_size < MOST_BYTES
