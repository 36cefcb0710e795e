"""Fenced blocks of a Markdown page, and the marks above them that say how a test treats them.

A mark is an HTML comment between a block and the text above it; readers do not see it. The rules
are in docs/testing.md.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from inspect import cleandoc
from pathlib import Path

# Code that is run or checked, text that is printed, and files that are only shown or written.
LANGUAGES = ("sh", "python", "toml", "text", "json", "csv", "geo")
# Directives of the site (MyST), which are no code: ```{toctree}.
DIRECTIVE = re.compile(r"\{[\w:-]+\}.*")
# Why a block need not run, and why a text need not be what a block above has printed.
REASONS = (
    "a benchmark", "another test runs the case", "needs a cluster", "needs a container engine",
    "needs a second machine", "needs another program", "needs root", "needs the network",
    "takes minutes",
)  # fmt: skip
SHOWN = ("a sketch", "of another machine", "of a long run", "the parts of a line")
MARKS = (
    "not run", "not printed", "fails with", "file", "in", "in the test first", "in the test with",
    "printed by", "differs",
)  # fmt: skip
LONG = "<!-- long test -->"
_FENCE = re.compile(r"(?P<indent>[ >]*)(?P<fence>`{3,}|~{3,})\s*(?P<language>.*?)\s*$")
_COMMENT = re.compile(r"<!--(.*?)-->", re.DOTALL)


class PageError(AssertionError):
    """Something on a page is not as the rules ask for; says where."""


@dataclass(frozen=True)
class Block:
    """A fenced block: where it starts, language, text, and comments above it by first words."""

    page: Path
    line: int
    language: str
    text: str
    marks: dict[str, str] = field(default_factory=dict)

    @property
    def where(self) -> str:
        """Page and line, as a compiler names them."""
        return f"{self.page.name}:{self.line}"

    def error(self, what: str) -> PageError:
        """What is wrong with it, to be raised."""
        return PageError(f"{self.where}: {what}")


def find_blocks(page: Path) -> list[Block]:
    """All fenced blocks of a page in order; a PageError tells of what is not closed or no mark."""
    return list(_blocks(page, page.read_text(encoding="utf-8").splitlines()))


def _blocks(page: Path, lines: list[str]) -> Iterator[Block]:
    at, free = 0, 0
    while at < len(lines):
        opened = _FENCE.match(lines[at])
        if opened is None:
            at += 1
            continue
        end = _closed(lines, at, opened["fence"])
        if end is None:
            raise PageError(f"{page.name}:{at + 1}: this block is not closed")
        cut = len(opened["indent"])
        inside = [line[cut:] for line in lines[at + 1 : end]]
        block = Block(page, at + 1, opened["language"], "\n".join([*inside, ""]))
        if not DIRECTIVE.fullmatch(block.language):
            block.marks.update(_marks(block, lines[free:at]))
            yield block
        at = free = end + 1


def _closed(lines: list[str], start: int, fence: str) -> int | None:
    """The line that closes a block."""
    closing = re.compile(rf"[ >]*{re.escape(fence)}{re.escape(fence[0])}*\s*")
    return next((n for n in range(start + 1, len(lines)) if closing.fullmatch(lines[n])), None)


def _marks(block: Block, above: list[str]) -> dict[str, str]:
    """The comments that stand directly above a block, with nothing else between."""
    text = "\n".join(re.sub(r"^ *> ?", "", line) for line in above).replace(LONG, "").rstrip()
    found: dict[str, str] = {}
    while text.endswith("-->"):
        start = text.rindex("<!--")
        name, colon, value = text[start + 4 : -3].strip().partition(":")
        if name not in MARKS or not colon:
            raise block.error(f"the comment above is no mark: {name!r} (known: {', '.join(MARKS)})")
        found[name] = cleandoc(value)
        text = text[:start].rstrip()
    return found


def is_long(page: Path) -> bool:
    """Whether the page says that its blocks take more than about 3 s."""
    return LONG in page.read_text(encoding="utf-8").splitlines()


def without_blocks(text: str) -> str:
    """A page's prose: without fenced blocks and comments, its lines kept."""

    def blank(found: re.Match[str]) -> str:
        return "\n" * found[0].count("\n")

    text = _COMMENT.sub(blank, text)
    fenced = r"^[ >]*(?P<fence>`{3,}|~{3,}).*?^[ >]*(?P=fence)[`~]*[ ]*$"
    return re.sub(fenced, blank, text, flags=re.DOTALL | re.MULTILINE)
