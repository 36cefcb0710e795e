"""Formulae by KaTeX, from files beside the pages: scripts and fonts of Debian's ``libjs-katex``.

Where a browser runs no scripts, the formulae stand there in LaTeX.
"""

from __future__ import annotations

import shutil
from html import escape
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.errors import ConfigError
from sphinx.writers.html5 import HTML5Translator

_FILES = ("katex.min.js", "katex.min.css")


def setup(app: Sphinx) -> dict[str, bool]:
    """Offer the renderer as ``html_math_renderer = "katex"``."""
    app.add_config_value("katex_directory", "/usr/share/javascript/katex", "html")
    app.add_html_math_renderer("katex", (_inline, None), (_block, None))
    app.connect("html-page-context", _load)
    app.connect("build-finished", _copy)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(writer: HTML5Translator, node: nodes.math) -> None:
    writer.body.append(f'<span class="formula">{escape(node.astext())}</span>')
    raise nodes.SkipNode


def _block(writer: HTML5Translator, node: nodes.math_block) -> None:
    writer.body.append(f'<div class="formula">{escape(node.astext())}</div>\n')
    raise nodes.SkipNode


def _load(
    app: Sphinx, page: str, template: str, context: dict[str, object], tree: nodes.document | None
) -> None:
    """Load KaTeX on the pages that have formulae."""
    if tree is not None and any(tree.findall(_is_formula)):
        app.add_css_file("katex/katex.min.css")
        app.add_js_file("katex/katex.min.js", loading_method="defer")
        app.add_js_file("formulae.js", loading_method="defer")


def _is_formula(node: nodes.Node) -> bool:
    return isinstance(node, nodes.math | nodes.math_block)


def _copy(app: Sphinx, error: Exception | None) -> None:
    """Put KaTeX beside the pages."""
    if error is not None or app.builder.format != "html":
        return
    source = Path(app.config.katex_directory)
    target = Path(app.outdir) / "_static" / "katex"
    if not (source / _FILES[0]).is_file():
        raise ConfigError(
            f"no KaTeX in {source}: install libjs-katex, or name its directory by "
            "-D katex_directory=DIR"
        )
    (target / "fonts").mkdir(parents=True, exist_ok=True)
    for name in _FILES:
        shutil.copyfile(source / name, target / name)
    for font in (source / "fonts").glob("*.woff2"):
        shutil.copyfile(font, target / "fonts" / font.name)
