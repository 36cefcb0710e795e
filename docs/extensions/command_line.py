"""The reference of the command line: each command with its options, from the program's own help.

The line ``<!-- commands of the program -->`` of a page is replaced by them when the site is built.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from click import Argument, Choice, Command, Group, IntRange, Option, Parameter
from sphinx.application import Sphinx
from typer.main import get_command

from tribox.app.cli import cli

MARK = "<!-- commands of the program -->"


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill the page when it is read."""
    app.connect("source-read", _fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _fill(app: Sphinx, page: str, source: list[str]) -> None:
    if MARK in source[0]:
        source[0] = source[0].replace(MARK, commands())


def commands() -> str:
    """All commands in Markdown."""
    group = get_command(cli)
    assert isinstance(group, Group)
    shown = {name: each for name, each in group.commands.items() if not each.hidden}
    return "\n\n".join("\n".join(_command(name, each)) for name, each in shown.items())


def _command(name: str, command: Command) -> Iterator[str]:
    arguments = [each for each in command.params if isinstance(each, Argument)]
    options = [each for each in command.params if isinstance(each, Option) and not each.hidden]
    words = [each.make_metavar() for each in arguments]
    yield f"## `tribox {name}`\n"
    yield _plain(command.help or "") + "\n"
    yield "```text"
    yield " ".join(["tribox", name, *words, *(["[OPTION ...]"] if options else [])])
    yield "```\n"
    if not (arguments or options):
        return
    yield "| Argument or option | Meaning | Default |"
    yield "|---|---|---|"
    for word, argument in zip(words, arguments, strict=True):
        yield _row(word.strip("[]"), argument)
    for option in options:
        yield _row(" ".join([option.opts[0], _value(option)]).strip(), option)


def _row(written: str, parameter: Parameter) -> str:
    code = written.replace("|", r"\|")
    default = "–"
    if parameter.required:
        default = "needed"
    elif parameter.default not in (None, False) and not callable(parameter.default):
        default = f"`{parameter.default}`"
    meaning = getattr(parameter, "help", None) or ""
    if found := re.fullmatch(r"([^(]*) \(default: ([^)]*)\)", meaning):
        meaning, default = found[1], found[2]
    return f"| `{code}` | {_plain(meaning)} | {_plain(default) if found else default} |"


def _value(option: Option) -> str:
    """What stands behind an option, as its help has it."""
    if option.is_flag:
        return ""
    if isinstance(option.type, Choice):
        return "|".join(map(str, option.type.choices))
    return option.metavar or ("N" if isinstance(option.type, IntRange) else "PATH")


def _plain(text: str) -> str:
    """Text in which Markdown finds nothing to do."""
    return re.sub(r"([\\|*_\[\]<>$#~])", r"\\\1", text)
