"""The documentation site, which ``./tribox python docs/build.py`` builds into ``build/site``.

Nothing is fetched, neither while the site is built nor when it is read. What Sphinx and its
Markdown parser do not do by themselves is in ``docs/extensions``.
"""

from __future__ import annotations

import sys
from pathlib import Path

from pygments.lexers import CLexer
from sphinx.application import Sphinx

_DOCS = Path(__file__).parent
sys.path[:0] = [str(_DOCS / "extensions"), str(_DOCS.parent / "src")]

import tribox  # noqa: E402 (found by the line above)

project = "tribox"
version = release = tribox.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "docstrings",
    "katex",
    "outside_files",
    "case_keys",
    "notebooks",
    "theme_scripts",
    "wide_tables",
]
exclude_patterns = ["extensions", "static"]

# A broken link, anchor or reference is a warning, and with -W an error.
nitpicky = True
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_preserve_defaults = True
# Names that stand for longer types, and those that only a type checker imports.
_ALIASES = ("Floats", "Ints", "NDArray", "DataFrame", "Table", "MaterialPoints")
autodoc_type_aliases = {name: name for name in _ALIASES}
nitpick_ignore = [("py:class", name) for name in (*_ALIASES, "np.int64", "np.float64")]
default_role = "code"

# Pages and notebooks of the repository outside docs, and the pages that show them.
outside_pages = {
    "README.md": "index",
    "CHANGELOG.md": "more/changelog",
    "CONTRIBUTING.md": "more/contributing",
    "examples/README.md": "examples",
    "examples/notebooks/1-law.ipynb": "notebooks/1-law",
    "examples/notebooks/2-run-and-results.ipynb": "notebooks/2-run-and-results",
    "examples/notebooks/3-calibration.ipynb": "notebooks/3-calibration",
    "benchmarks/RESULTS.md": "benchmarks/timings",
    "benchmarks/RESULTS-explicit.md": "benchmarks/explicit",
    "benchmarks/RESULTS-law.md": "benchmarks/law",
    "benchmarks/RESULTS-other-codes.md": "benchmarks/other-codes",
    "benchmarks/RESULTS-plastic.md": "benchmarks/plastic",
    "benchmarks/RESULTS-scaling.md": "benchmarks/scaling",
}

html_theme = "furo"
html_title = "tribox"
html_math_renderer = "katex"
html_static_path = ["static"]
html_favicon = "static/favicon.svg"
html_search_scorer = str(_DOCS / "static" / "scorer.js")
html_css_files = ["site.css"]
html_js_files = [("colours.js", {"defer": "defer"})]
html_copy_source = False
html_show_copyright = False
highlight_language = "text"


def setup(app: Sphinx) -> None:
    """Colour drawings for gmsh as C, which their language resembles."""
    app.add_lexer("geo", CLexer)
