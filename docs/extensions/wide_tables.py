"""Marks the cells of wide tables that hold sentences, so that these stay readable on a telephone.

The style sheet makes marked cells as wide as a few words; a table that is then wider than the page
scrolls by itself.
"""

from __future__ import annotations

from docutils import nodes
from sphinx.application import Sphinx

_COLUMNS = 3
_SENTENCE = 40  # characters


def setup(app: Sphinx) -> dict[str, bool]:
    """Mark the cells of each page when it has been read."""
    app.connect("doctree-read", _mark)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _mark(app: Sphinx, tree: nodes.document) -> None:
    for row in tree.findall(nodes.row):
        if len(row) >= _COLUMNS:
            for cell in row:
                if isinstance(cell, nodes.entry) and len(cell.astext()) > _SENTENCE:
                    cell["classes"].append("sentence")
