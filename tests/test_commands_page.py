"""The page of the command line has every command with every option, and no others."""

import re
from pathlib import Path

import pytest
import typer

from tribox.app.cli import cli

PAGE = Path(__file__).parents[1] / "docs" / "commands.md"
HELP = re.compile(r"^## (\w+)\n(.*?)(?=^## )", re.DOTALL | re.MULTILINE)
COMMANDS = {
    name: command
    for name, command in typer.main.get_command(cli).commands.items()  # type: ignore[attr-defined]
    if not command.hidden
}


def sections() -> dict[str, str]:
    return dict(HELP.findall(PAGE.read_text(encoding="utf-8")))


def test_every_command_has_a_section_and_a_line():
    text = PAGE.read_text(encoding="utf-8")
    assert set(sections()) == set(COMMANDS)
    assert set(re.findall(r"^\| \[`(\w+)`\]\(#\1\)", text, re.MULTILINE)) == set(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_a_line(name):
    options = {
        option
        for parameter in COMMANDS[name].params
        if not getattr(parameter, "hidden", False)
        for option in parameter.opts
        if option.startswith("--") and option != "--help"
    }
    named = re.findall(r"^\| (`--.*?) \|", sections()[name], re.MULTILINE)
    assert sorted(re.findall(r"`(--[\w-]+)", " ".join(named))) == sorted(options)
