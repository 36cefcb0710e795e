"""Notebooks as pages: their text, code and stored outputs. Nothing is run.

A page that consists of the line ``<!-- notebook: examples/notebooks/NAME.ipynb -->`` becomes that
notebook when the site is built.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

_MARK = re.compile(r"<!-- notebook: (\S+) -->")


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill the pages when they are read."""
    app.connect("source-read", _fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _fill(app: Sphinx, page: str, source: list[str]) -> None:
    if found := _MARK.search(source[0]):
        path = Path(app.srcdir).parent / found[1]
        app.env.note_dependency(str(path))
        source[0] = "\n\n".join(_cells(json.loads(path.read_text(encoding="utf-8"))))


def _cells(notebook: dict[str, Any]) -> Iterator[str]:
    """The cells in Markdown."""
    heading = ""
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            heading = [heading, *re.findall(r"^#+ (.*)", text, re.MULTILINE)][-1]
            yield re.sub(r"\]\(#([^)]+)\)", _to_heading, text)
            continue
        lines = [line for line in text.splitlines() if not line.startswith("%")]
        yield _fenced("python", "\n".join(lines))
        for output in cell["outputs"]:
            yield _output(output, heading)


def _to_heading(found: re.Match[str]) -> str:
    """A link within the notebook, to the name that its heading has on the site."""
    name = re.sub(r"[^\w-]", "", found[1]).lower()
    return f"](#{name})"


def _output(output: dict[str, Any], heading: str) -> str:
    """What a cell has printed, or drawn under a heading."""
    data = output.get("data", {})
    if picture := data.get("image/png"):
        return f"![{heading}](data:image/png;base64,{''.join(picture).replace(chr(10), '')})"
    return _fenced("text", "".join(output.get("text") or data.get("text/plain", "")))


def _fenced(language: str, text: str) -> str:
    return f"````{language}\n{text.rstrip()}\n````"
