"""Every message that docs/failures.md quotes is one that the sources can print."""

import ast
import re
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "failures.md"
LEFT_OUT = "…"  # in the page: what differs from case to case
SHELL = ("tribox", "docker/mounts.sh")


def quoted() -> Iterator[str]:
    """The messages of the page: the first column of every table that begins with "message"."""
    inside = False
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            inside = False
        elif cells[0] == "message":
            inside = True
        elif inside and not set(cells[0]) <= set("-"):
            yield cells[0].strip("`")


def text_of(node: ast.AST) -> str | None:
    """The text of a string in the sources, with ``LEFT_OUT`` for what is put into it."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        parts = [text_of(v) if isinstance(v, ast.Constant) else LEFT_OUT for v in node.values]
        return "".join(part or "" for part in parts)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        both = text_of(node.left), text_of(node.right)
        return "".join(LEFT_OUT if part is None else part for part in both) if any(both) else None
    return None


@lru_cache
def texts() -> tuple[str, ...]:
    """All strings of the sources but docstrings, and the lines of the launcher."""
    found = []
    for package in ("app", "forms", "geometry"):
        for path in (ROOT / package).rglob("*.py"):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            bare = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
            found += [text_of(n) or "" for n in ast.walk(tree) if id(n) not in bare]
    for name in SHELL:
        found += (ROOT / name).read_text(encoding="utf-8").replace('" \\\n', "").splitlines()
    # A name that the page writes out where the source puts it in, and what pydantic does.
    return tuple(sorted({re.sub(r"\{\w+\}|\$\w+", LEFT_OUT, text) for text in found if text}))


def stands_in(message: str, text: str) -> bool:
    """Whether all pieces of a message stand in a text, in their order."""
    at = 0
    for piece in (part.strip() for part in message.split(LEFT_OUT)):
        at = text.find(piece, at)
        if at < 0:
            return False
        at += len(piece)
    return True


def test_the_page_quotes_messages_with_words_to_search_for():
    messages = list(quoted())
    assert len(messages) > 80 and len(set(messages)) == len(messages)
    for message in messages:
        longest = max(map(len, message.split(LEFT_OUT)))
        assert longest >= 10, f"{message}: too few fixed words"


@pytest.mark.parametrize("message", list(quoted()))
def test_every_message_of_the_page_stands_in_the_sources(message):
    assert any(stands_in(message, text) for text in texts()), f"nothing prints: {message}"


def test_a_message_that_nothing_prints_is_noticed():
    assert not any(stands_in("the bodies never squeezed each other", text) for text in texts())
    assert not stands_in("beside … penalty", "penalty beside it")
