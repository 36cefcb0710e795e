"""Runs the blocks of one page in order, and compares what they print with what the page shows."""

import contextlib
import io
import json
import os
import signal
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from tests.docs import commands, fragments
from tests.docs.blocks import LANGUAGES, REASONS, SHOWN, Block, PageError, find_blocks
from tests.docs.checkout import Checkout, Done
from tests.docs.printed import difference

# Marks by the language of the blocks that they may stand above.
_FOR = {
    "not run": ("sh", "python", "toml"), "not printed": ("text",), "printed by": ("text",),
    "differs": ("text",), "fails with": ("sh", "python", "toml", "text"), "in": ("toml",),
    "in the test with": ("sh", "text"),
}  # fmt: skip


def check_page(page: Path) -> list[str]:
    """Look at all blocks of a page; a line for each that is not to be run, with its reason."""
    left: list[str] = []
    for block in find_blocks(page):
        _check_language(block)
        _check_marks(block)
        _check_text(block)
        if reason := block.marks.get("not run") or block.marks.get("not printed"):
            left.append(f"{block.where}: {block.language}: {reason}")
    return left


def _check_language(block: Block) -> None:
    if not block.language:
        raise block.error(f"a block without a language (one of {', '.join(LANGUAGES)})")
    if block.language not in LANGUAGES:
        raise block.error(f"language {block.language!r}: must be one of {', '.join(LANGUAGES)}")


def _check_marks(block: Block) -> None:
    for mark, value in block.marks.items():
        if not value:
            raise block.error(f"{mark}: nothing behind it")
        if block.language not in _FOR.get(mark, LANGUAGES):
            raise block.error(f"{mark}: not for a block of {block.language}")
    for mark, reasons in (("not run", REASONS), ("not printed", SHOWN)):
        if mark in block.marks and block.marks[mark] not in reasons:
            raise block.error(f"{mark}: {block.marks[mark]!r}: must be one of {', '.join(reasons)}")


def _check_text(block: Block) -> None:
    """What can be seen to be wrong without running it."""
    failing = "fails with" in block.marks
    if block.language == "sh" and not failing:
        if found := commands.problems(block.text, ran="not run" not in block.marks):
            raise block.error("; ".join(found))
    elif block.language == "python" and not failing:
        try:
            compile(block.text, block.where, "exec")
        except SyntaxError as error:
            raise block.error(str(error)) from None
    elif block.language == "toml" and not failing:
        fragments.parsed(block)
    elif block.language == "json":
        try:
            json.loads(block.text)
        except ValueError as error:
            raise block.error(str(error)) from None


@contextlib.contextmanager
def _nothing_kept(directory: Path) -> Iterator[None]:
    """Leave numpy, Ctrl-C, pictures and modules of a page's own to the next as they were."""
    interrupt = signal.getsignal(signal.SIGINT)
    with np.printoptions():
        yield
    signal.signal(signal.SIGINT, interrupt)  # gmsh.initialize() takes it
    plt.close("all")
    for name, module in list(sys.modules.items()):
        if (getattr(module, "__file__", None) or "").startswith(f"{directory}/"):
            del sys.modules[name]


class PageRun:
    """Blocks of one page, run in one empty directory, those of Python in one namespace."""

    def __init__(self, directory: Path) -> None:
        self.checkout = Checkout(directory)
        self.names: dict[str, object] = {"__name__": "__main__"}
        self.last: Done | None = None
        self.left_out = False  # whether the block before was not run

    def run(self, page: Path) -> None:
        """Run all of a page, also behind a block that fails: a PageError tells of each."""
        found: list[str] = []
        with _nothing_kept(self.checkout.path):
            for block in find_blocks(page):
                try:
                    self._prepare(block)
                    self._take(block)
                except PageError as error:
                    found.append(str(error))
        if found:
            raise PageError("\n".join(found))

    def _take(self, block: Block) -> None:
        if "file" in block.marks:
            self._write(block)
        elif "not run" in block.marks:
            self.left_out = True
        elif block.language == "text":
            self._compare(block)
        elif block.language == "toml":
            self._check_toml(block)
        elif block.language in ("sh", "python"):
            self._run(block)

    def _prepare(self, block: Block) -> None:
        if first := block.marks.get("in the test first"):
            done = self.checkout.run(first)
            if done.code:
                raise block.error(f"in the test first: exit code {done.code}\n{done.printed}")

    def _write(self, block: Block) -> None:
        """Keep a block as the file that the page says it is; a case must be correct too."""
        path = self.checkout.path / block.marks["file"]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, encoding="utf-8")
        if block.language == "toml":
            self._check_toml(block)

    def _check_toml(self, block: Block) -> None:
        if "fails with" not in block.marks:
            fragments.check_block(block, self.checkout.path)
            return
        wanted = block.marks["fails with"]
        try:
            fragments.check_block(block, self.checkout.path)
        except PageError as error:
            if wanted not in str(error):
                raise
        else:
            raise block.error(f"does not fail with {wanted!r}")

    def _run(self, block: Block) -> None:
        words = block.marks.get("in the test with", "")
        python = block.language == "python"
        done = self._execute(block) if python else self.checkout.run(block.text, words)
        self.last, self.left_out = done, False
        self._expect(block, done)

    def _expect(self, block: Block, done: Done) -> None:
        wanted = block.marks.get("fails with", "0")
        if block.language == "python" and wanted != "0":
            failed = done.printed.splitlines()[-1:] or [""]
            right = done.code == 1 and failed[0].partition(":")[0].endswith(wanted)
        else:
            right = str(done.code) == wanted
        if not right:
            raise block.error(f"exit code {done.code}, not {wanted}; printed is:\n{done.printed}")

    def _execute(self, block: Block) -> Done:
        """Run a block of Python; of an error the last line is kept if the page shows errors."""
        printed = io.StringIO()
        try:
            with self._inside(), contextlib.redirect_stdout(printed):
                # The line numbers are those of the page.
                code = compile("\n" * block.line + block.text, str(block.page), "exec")
                exec(code, self.names)
        except Exception as error:
            lines = traceback.format_exception_only(error)
            if "fails with" not in block.marks:
                lines = traceback.format_exception(error)
            return Done(1, printed.getvalue() + "".join(lines))
        return Done(0, printed.getvalue())

    @contextlib.contextmanager
    def _inside(self) -> Iterator[None]:
        """In the directory, with its home."""
        with pytest.MonkeyPatch.context() as patch, contextlib.chdir(self.checkout.path):
            patch.setenv("HOME", self.checkout.environment["HOME"])
            patch.setenv("XDG_CACHE_HOME", self.checkout.environment["XDG_CACHE_HOME"])
            for name in ("TRIBOX_RESULTS", "TRIBOX_TRUST"):
                patch.delenv(name, raising=False)
            patch.syspath_prepend(os.getcwd())
            yield

    def _compare(self, block: Block) -> None:
        if "not printed" in block.marks:
            return
        done = self.last
        if command := block.marks.get("printed by"):
            done = self.checkout.run(command, block.marks.get("in the test with", ""))
            self._expect(block, done)
        elif self.left_out:
            return
        if done is None:
            raise block.error("no block above prints it; add 'printed by' or 'not printed'")
        found = difference(block.text, done.printed, block.marks.get("differs", ""))
        if found:
            raise block.error(found)
