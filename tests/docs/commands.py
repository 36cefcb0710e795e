"""Commands of a shell block, checked without running them: tribox's own, modules, files."""

import re
import shlex
import subprocess
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import click
from typer.main import get_command

from tribox.app.cli import cli

ROOT = Path(__file__).resolve().parents[2]
_PROGRAM = ("tribox", "./tribox")
# What tribox is started through. Behind other programs the word "tribox" is a name (conda -n).
_STARTERS = (*_PROGRAM, "docker", "podman", "mpirun", "mpiexec", "srun", "python3", "exec")
# Packages of this tree whose modules have command lines of their own.
_OWN = ("benchmarks", "tests", "tribox")
_ASSIGNED = re.compile(r"(\w+)=(.*)", re.DOTALL)
_TREE = re.compile(r"(?:benchmarks|cases|docs|examples|tests)/[\w./-]+")


def problems(script: str, ran: bool = False) -> list[str]:
    """What is wrong with the commands of a block; ``ran``: it is run too, and files show there."""
    found = _syntax(script)
    if found:
        return found
    for words in simple_commands(script):
        found += _tribox_problems(words) + _module_problems(words)
        if not ran or "test" in words:
            found += [f"{name}: no such file" for name in _tree_files(words) if not _there(name)]
    return found


def _syntax(script: str) -> list[str]:
    done = subprocess.run(["bash", "-n"], input=script, capture_output=True, text=True)
    return done.stderr.splitlines()


def simple_commands(script: str) -> Iterator[list[str]]:
    """The words of each command, with variables that the block itself has set."""
    known: dict[str, str] = {}

    def value(found: re.Match[str]) -> str:
        return known.get(found[1], found[0])

    for line in re.sub(r"\\\n", " ", script).splitlines():
        lexer = shlex.shlex(re.sub(r"\$\{?(\w+)\}?", value, line), punctuation_chars=";|&<>()")
        lexer.whitespace_split = True
        for words in _split(_words(lexer)):
            assigned = [_ASSIGNED.fullmatch(word) for word in words]
            known.update({a[1]: a[2] for a in assigned if a and len(words) == 1})
            command = words[next((n for n, a in enumerate(assigned) if not a), len(words)) :]
            if command:
                yield command


def _words(lexer: shlex.shlex) -> Iterator[str]:
    """Words without their quotes. A line of a document within a script need not have any."""
    try:
        for word in lexer:
            quoted = word.startswith(("'", '"')) or not set(word) <= set(";|&<>()")
            yield "".join(shlex.split(word)) if quoted else word
    except ValueError:
        return


def _split(words: Iterator[str]) -> Iterator[list[str]]:
    """Words between ;, |, && and the like, without the files that output goes to."""
    command: list[str] = []
    skip = False
    for word in words:
        if word and set(word) <= set(";|&()"):
            yield command
            command = []
        elif word and set(word) <= set("<>&"):
            skip = True
        elif skip:
            skip = False
        else:
            command.append(word)
    yield command


def _tribox_problems(words: list[str]) -> list[str]:
    if words[0] not in _STARTERS:
        return []
    if words[0] == "python3":
        own = [n + 1 for n, pair in enumerate(pairwise(words)) if pair == ("-m", "tribox")]
    else:
        own = [n for n, word in enumerate(words) if word in _PROGRAM]
    rest = words[max(own) + 1 :] if own else []
    if not rest or not (words[0] in _PROGRAM or re.fullmatch(r"-{0,2}[a-z]+", rest[0])):
        return []
    return [f"{' '.join(words)}: {problem}"] if (problem := parse_problem(rest)) else []


def parse_problem(words: list[str]) -> str | None:
    """What the command line's parser finds wrong with the words behind ``tribox``."""
    group = get_command(cli)
    assert isinstance(group, click.Group)
    try:
        if words[0] in ("--version", "--help"):
            return None
        above = group.make_context("tribox", list(words))
        name, command, rest = group.resolve_command(above, words)
        assert command is not None
        command.make_context(name, rest, parent=above)
    except click.exceptions.Exit:
        return None
    except click.ClickException as error:
        return error.format_message()
    return None


def _module_problems(words: list[str]) -> list[str]:
    """Of ``python3 -m MODULE ...``: the module is there, and its source has the words behind it."""
    if words[0] not in ("python", "python3") or "-m" not in words[:-1]:
        return []
    at = words.index("-m") + 1
    module, rest = words[at], words[at + 1 :]
    if module == "tribox":
        return []  # its words have been parsed
    if module.split(".")[0] not in _OWN:
        there = find_spec(module.split(".")[0]) is not None
        return [] if there else [f"python3 -m {module}: no such module"]
    source = _source(module)
    if not source:
        return [f"python3 -m {module}: no such module"]
    values = {word for option, word in pairwise(rest) if option.startswith("--")}
    named = [word for word in rest if re.fullmatch(r"-{0,2}[a-z][a-z-]*", word)]
    unknown = [word for word in named if word not in values and word.strip("-") not in source]
    return [f"python3 -m {module}: {word}: not in its source" for word in unknown]


def _source(module: str) -> str:
    """Text of a module of this tree, and of all that its package has beside it."""
    path = ROOT.joinpath(*module.removeprefix("tribox.").split("."))
    files = [*path.glob("*.py"), path.with_suffix(".py")]
    return "".join(file.read_text(encoding="utf-8") for file in files if file.is_file())


def _tree_files(words: list[str]) -> list[str]:
    return [word for word in words if _TREE.fullmatch(word)]


def _there(name: str) -> bool:
    return (ROOT / name).exists()
