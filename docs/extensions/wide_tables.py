"""Marks the cells of wide tables by what they hold, so that they stay readable on a telephone.

By the style sheet sentences have a least width there, and single words and numbers stay on one
line. A table that is then wider than the page scrolls by itself.
"""

from __future__ import annotations

from docutils import nodes
from sphinx.application import Sphinx

_COLUMNS = 3
_WORD, _SENTENCE = 10, 24  # characters


def setup(app: Sphinx) -> dict[str, bool]:
    """Mark the cells of each page when it has been read."""
    app.connect("doctree-read", _mark)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _mark(app: Sphinx, tree: nodes.document) -> None:
    for row in tree.findall(nodes.row):
        for cell in row.findall(nodes.entry) if len(row) >= _COLUMNS else ():
            if len(cell.astext()) <= _WORD:
                cell["classes"].append("word")
            elif len(cell.astext()) > _SENTENCE:
                cell["classes"].append("sentence")
